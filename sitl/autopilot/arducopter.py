"""The simulated ArduCopter: bytes in, bytes out, in lockstep with a clock that the caller keeps.

Behaves as a real ArduCopter 4.7 was seen to behave on its links; shares no code with the application's own MAVLink
side, so that a mistake there is not made here too. No thread, no clock, no sleep: `step` is told the time. The same
bytes at the same times give the same bytes back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sitl.autopilot.channel import Channel
from sitl.autopilot.config import ArduCopterConfig
from sitl.autopilot.core import Core, Hardware
from sitl.autopilot.flight import LandedState
from sitl.autopilot.link import ByteLink
from sitl.autopilot.modes import Mode, ModeReason
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.ports import Gimbal, Vehicle
from sitl.autopilot.rc import RcInput
from sitl.autopilot.routing import Routes

# From PREFLIGHT_REBOOT until the first heartbeat of the new life, as seen.
REBOOT_S = 1.2
# Times that are sums of steps: rounding must not cost a tick.
TICK_SLACK = 1e-6


@dataclass(frozen=True, slots=True)
class ArduCopterState:
    """What is true of the autopilot after a step, for the scenario runner and for tests."""

    t_s: float
    booting: bool
    mode: Mode
    mode_reason: ModeReason
    armed: bool
    landed_state: LandedState
    has_position: bool
    failsafe: bool
    setpoint_age_s: float | None
    gimbal_primary: tuple[int, int]
    gimbal_pitch_rad: float
    gimbal_yaw_rad: float


class ArduCopter:
    """A vehicle with its gimbal behind any number of links.

    `vehicle` and `gimbal` are the plant; `step` advances them. Time begins at `config.booted_at_s`.
    """

    def __init__(self, vehicle: Vehicle, gimbal: Gimbal, config: ArduCopterConfig | None = None, seed: int = 0) -> None:
        config = config if config is not None else ArduCopterConfig()
        parameters = Parameters({"MAV_SYSID": config.sysid, **config.parameters})
        self._hardware = Hardware(
            config, parameters, RcInput(parameters), vehicle, gimbal, [], Routes(int(parameters["MAV_SYSID"])), seed
        )
        self._ticks = 0
        self._t_s = config.booted_at_s
        self._silent_until_s = config.booted_at_s
        self._core = Core(self._hardware, config.booted_at_s, config.booted_at_s)

    def attach(self, link: ByteLink, name: str) -> None:
        """Use one more link. Raises ValueError for a name that is taken."""
        if any(channel.name == name for channel in self._hardware.channels):
            raise ValueError(f"attach: there is already a link named {name}")
        channel = Channel(link, name, int(self._hardware.parameters["MAV_SYSID"]))
        self._hardware.channels.append(channel)
        self._core.open(channel)

    def set_rc(self, pwm: tuple[int, ...] | None) -> None:
        """What the pilot's receiver gives from now on, us; None: no signal.

        Channels 1 to 8 (roll, pitch, throttle, yaw, mode switch, ...); missing ones stay as they are.
        """
        self._hardware.rc.receive(pwm, self._t_s)

    def step(self, now_s: float) -> None:
        """Read the links, do what they ask for, fly up to `now_s` and send what is due by then.

        Physics runs in whole ticks, so the state is that of the last tick at or before `now_s`. Raises ValueError when
        `now_s` is not finite or lies before the last step.
        """
        if not math.isfinite(now_s) or now_s < self._t_s - TICK_SLACK:
            raise ValueError(f"step: now_s must be finite and not before {self._t_s}, not {now_s}")
        self._receive()
        config = self._hardware.config
        dt_s = 1.0 / config.physics_hz
        wanted = math.floor((now_s - config.booted_at_s) * config.physics_hz + TICK_SLACK)
        while self._ticks < wanted:
            self._ticks += 1
            self._tick(config.booted_at_s + self._ticks * dt_s, dt_s)

    def _receive(self) -> None:
        for channel in self._hardware.channels:
            if self._silent:
                channel.receive()  # nobody listens
            else:
                self._core.receive(channel)
        if self._core.reboot_asked:
            self._reboot()

    @property
    def _silent(self) -> bool:
        return self._t_s < self._silent_until_s

    def _reboot(self) -> None:
        """Intervals, routes and modes are forgotten; parameters are kept."""
        self._silent_until_s = self._t_s + REBOOT_S
        for channel in self._hardware.channels:
            channel.reset()
        self._hardware.routes.forget()
        self._hardware.rc.release()
        self._core = Core(self._hardware, self._t_s, self._t_s)

    def _tick(self, next_s: float, dt_s: float) -> None:
        self._core.tick(next_s, dt_s, silent=next_s < self._silent_until_s)
        self._t_s = next_s

    @property
    def state(self) -> ArduCopterState:
        """The autopilot as of the last tick."""
        core, flight = self._core, self._core.flight
        report = core.gimbal.report()
        set_at_s = flight.guided.set_at_s
        return ArduCopterState(
            t_s=self._t_s,
            booting=self._silent or core.telemetry.initialising,
            mode=flight.mode,
            mode_reason=flight.mode_reason,
            armed=flight.armed,
            landed_state=flight.landed_state,
            has_position=flight.has_position,
            failsafe=flight.failsafes.pending,
            setpoint_age_s=None if set_at_s is None else self._t_s - set_at_s,
            gimbal_primary=core.gimbal.primary,
            gimbal_pitch_rad=report.pitch_rad,
            gimbal_yaw_rad=report.yaw_rad,
        )
