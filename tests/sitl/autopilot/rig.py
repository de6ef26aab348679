"""A simulated ArduCopter on a bench: links, senders, a clock, and everything that was heard."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.arducopter import ArduCopter
from sitl.autopilot.config import ArduCopterConfig
from sitl.autopilot.link import PipeEnd, pipe
from sitl.plant.gimbal import GimbalPlant
from sitl.plant.quadrotor import Quadrotor

NAN = float("nan")
STEP_S = 0.02
VELOCITY_AND_RATE, VELOCITY_ONLY = 1479, 3527

ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4
STABILIZE, ALT_HOLD, AUTO, GUIDED, LOITER, RTL, LAND, BRAKE = 0, 2, 3, 4, 5, 6, 9, 17
STICKS = (1500, 1500, 1500, 1500, 1800, 1000, 1000, 1800)


class Station:
    """Someone on a link of its own: sends as (sysid, compid), keeps what it hears with the time."""

    def __init__(self, end: PipeEnd, sysid: int, compid: int) -> None:
        self._end = end
        self._parser = mavlink.MAVLink(None)
        self.mav = mavlink.MAVLink(end, srcSystem=sysid, srcComponent=compid)
        self.heard: list[tuple[float, Any]] = []

    def listen(self, t_s: float) -> None:
        self.heard += [(t_s, m) for m in self._parser.parse_buffer(self._end.read_available()) or []]

    def of(self, kind: str, since_s: float = -math.inf) -> list[Any]:
        return [m for t, m in self.heard if t > since_s and m.get_type() == kind]

    def last(self, kind: str) -> Any:
        return self.of(kind)[-1]


class Rig:
    """`companion` (1/191) and `station` (255/190), each on its own link; time goes on by `run` only."""

    def __init__(self, config: ArduCopterConfig | None = None, yaw_rad: float = 0.0, **parameters: float) -> None:
        self.vehicle = Quadrotor(yaw_rad=yaw_rad)
        self.gimbal = GimbalPlant()
        config = config if config is not None else ArduCopterConfig(parameters=parameters)
        self.autopilot = ArduCopter(self.vehicle, self.gimbal, config)
        self.stations: list[Station] = []
        self.companion = self.attach("companion", 1, 191)
        self.station = self.attach("station", 255, 190)
        self.t_s = config.booted_at_s

    def attach(self, name: str, sysid: int, compid: int) -> Station:
        theirs, ours = pipe()
        self.autopilot.attach(theirs, name)
        self.stations.append(Station(ours, sysid, compid))
        return self.stations[-1]

    def run(self, seconds: float, each: Callable[[], object] = lambda: None) -> None:
        end_s = self.t_s + seconds
        while self.t_s < end_s - 1e-9:
            each()
            self.t_s += STEP_S
            self.autopilot.step(self.t_s)
            for station in self.stations:
                station.listen(self.t_s)

    def command(self, number: int, *p: float, who: Station | None = None, to: tuple[int, int] = (1, 1)) -> int | None:
        """Send a COMMAND_LONG and return the result of its acknowledgement; None without one."""
        who = who if who is not None else self.companion
        before_s = self.t_s
        who.mav.command_long_send(*to, number, 0, *p, *([0.0] * (7 - len(p))))
        self.run(STEP_S)
        acks = [m for m in who.of("COMMAND_ACK", before_s) if m.command == number]
        assert len(acks) <= 1
        return acks[0].result if acks else None

    def mode(self, number: int) -> int | None:
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, number)

    def arm(self) -> int | None:
        return self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def take_off(self, height_m: float = 5.0) -> None:
        """GUIDED, armed, up, and the pilot's throttle centred for whatever follows."""
        assert self.mode(GUIDED) == ACCEPTED
        assert self.arm() == ACCEPTED
        assert self.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m) == ACCEPTED
        self.autopilot.set_rc(STICKS)
        self.run(5.0)
        while self.autopilot.state.landed_state != 2:
            self.run(0.5)
            assert self.t_s < 60.0
        self.run(1.0)

    def setpoint(
        self,
        velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
        yaw_rate: float = 0.0,
        frame: int = 1,
        mask: int = VELOCITY_AND_RATE,
        position: tuple[float, float, float] = (0.0, 0.0, 0.0),
        yaw: float = 0.0,
        to: tuple[int, int] = (1, 1),
        who: Station | None = None,
    ) -> None:
        who = who if who is not None else self.companion
        who.mav.set_position_target_local_ned_send(
            0, *to, frame, mask, *position, *velocity, 0.0, 0.0, 0.0, yaw, yaw_rate
        )

    def fly(self, seconds: float, *args: Any, **kwargs: Any) -> None:
        """Setpoints at the rate of the steps."""
        self.run(seconds, lambda: self.setpoint(*args, **kwargs))

    @property
    def speed(self) -> float:
        north, east, _ = self.vehicle.vel_ned_m_s
        return math.hypot(north, east)

    def texts(self) -> list[str]:
        return [m.text for m in self.companion.of("STATUSTEXT")]
