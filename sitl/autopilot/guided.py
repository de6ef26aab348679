"""GUIDED: setpoints accepted or refused as ArduCopter does, take-off, time-out.

Source of every rule: what a real ArduCopter 4.7 was seen to do. Messages get no answer; a setpoint that is refused
makes the vehicle stop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from sitl.autopilot.motion import Motion, wrap
from sitl.autopilot.parameters import Parameters

LOCAL_NED, LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED = 1, 7, 8, 9
BODY_FRAMES = frozenset({BODY_NED, BODY_OFFSET_NED})
FRAMES = frozenset({LOCAL_NED, LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED})
# One bit of a group is enough to drop the whole group.
IGNORE_POSITION, IGNORE_VELOCITY, IGNORE_ACCELERATION = 0x007, 0x038, 0x1C0
FORCE = 0x200
IGNORE_YAW, IGNORE_YAW_RATE = 0x400, 0x800
# Faster than any multicopter: such a number is an error, not a wish (ArduPilot's sanity check).
SANE_M_S = 1000.0
SANE_M = 1e6
# ArduPilot's YAW_LOOK_AHEAD_MIN_SPEED: below it the course says nothing about where to look.
LOOK_AHEAD_M_S = 1.0
# The climb counts as finished this close below the wanted height.
TAKEOFF_REACHED_M = 0.03


@dataclass(frozen=True, slots=True)
class Setpoint:
    """SET_POSITION_TARGET_LOCAL_NED as it came, without its targets."""

    frame: int
    mask: int
    position: tuple[float, float, float]
    velocity: tuple[float, float, float]
    acceleration: tuple[float, float, float]
    yaw_rad: float
    yaw_rate_rad_s: float


class SubMode(Enum):
    """What GUIDED is doing."""

    VELOCITY = "velocity"
    POSITION = "position"
    TAKEOFF = "takeoff"


class _Yaw(Enum):
    COURSE = "course"
    ANGLE = "angle"
    RATE = "rate"


class Guided:
    """State of GUIDED; `run` is called in every tick while the mode flies."""

    __slots__ = (
        "_motion", "_parameters", "_yaw", "_yaw_value", "position_ned_m", "reached", "set_at_s", "sub_mode",
        "takeoff_height_m", "velocity_ned_m_s",
    )  # fmt: skip

    def __init__(self, motion: Motion, parameters: Parameters) -> None:
        self._motion = motion
        self._parameters = parameters
        self.takeoff_height_m = 0.0
        self.position_ned_m = (0.0, 0.0, 0.0)
        self.set_at_s: float | None = None
        self.stop()

    def stop(self) -> None:
        """Velocity control with zero velocity, as on entry and after a setpoint that cannot be obeyed."""
        self.sub_mode = SubMode.VELOCITY
        self.velocity_ned_m_s = (0.0, 0.0, 0.0)
        self.reached = False
        self._yaw, self._yaw_value = _Yaw.COURSE, 0.0

    def take_off(self, height_m: float) -> None:
        """Climb straight up to a height above home and stay there."""
        self.sub_mode = SubMode.TAKEOFF
        self.reached = False
        self.takeoff_height_m = height_m
        self._yaw, self._yaw_value = _Yaw.RATE, 0.0

    @property
    def climbing(self) -> bool:
        """Taking off and not there yet."""
        return self.sub_mode is SubMode.TAKEOFF and not self.reached

    def accept(self, setpoint: Setpoint, t_s: float) -> None:
        """Obey a setpoint that arrived in GUIDED at `t_s`, or stop."""
        position_ignored = bool(setpoint.mask & IGNORE_POSITION)
        velocity_ignored = bool(setpoint.mask & IGNORE_VELOCITY)
        acceleration_ignored = bool(setpoint.mask & IGNORE_ACCELERATION)
        insane = not velocity_ignored and not _below(setpoint.velocity, SANE_M_S)
        if setpoint.frame not in FRAMES or insane or (setpoint.mask & FORCE and not acceleration_ignored):
            self.stop()
        elif not velocity_ignored and position_ignored:
            self._fly_velocity(setpoint, t_s)
        elif (
            not position_ignored
            and (acceleration_ignored or not velocity_ignored)
            and _below(setpoint.position, SANE_M)
        ):
            self._fly_to(setpoint, t_s)
        else:
            # Nothing to obey, or pure acceleration, which is not modelled: it stops as for an invalid one.
            self.stop()

    def _fly_velocity(self, setpoint: Setpoint, t_s: float) -> None:
        self.sub_mode = SubMode.VELOCITY
        self.velocity_ned_m_s = self._rotated(setpoint.frame, setpoint.velocity)
        self.set_at_s = t_s
        self._turn_as_asked(setpoint)

    def _fly_to(self, setpoint: Setpoint, t_s: float) -> None:
        position = self._rotated(setpoint.frame, setpoint.position)
        if setpoint.frame != LOCAL_NED:
            here = self._motion.vehicle.pos_ned_m
            position = (here[0] + position[0], here[1] + position[1], here[2] + position[2])
        self.sub_mode = SubMode.POSITION
        self.position_ned_m = position
        self.set_at_s = t_s
        self._turn_as_asked(setpoint)

    def _rotated(self, frame: int, vector: tuple[float, float, float]) -> tuple[float, float, float]:
        """Into north and east; body frames are turned by the heading only, never by the lean."""
        if frame not in BODY_FRAMES:
            return vector
        yaw = self._motion.vehicle.yaw_rad
        c, s = math.cos(yaw), math.sin(yaw)
        return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]

    def _turn_as_asked(self, setpoint: Setpoint) -> None:
        if not setpoint.mask & IGNORE_YAW and math.isfinite(setpoint.yaw_rad):
            here = self._motion.vehicle.yaw_rad if setpoint.frame in BODY_FRAMES else 0.0
            self._yaw, self._yaw_value = _Yaw.ANGLE, wrap(here + setpoint.yaw_rad)
        elif not setpoint.mask & IGNORE_YAW_RATE and math.isfinite(setpoint.yaw_rate_rad_s):
            self._yaw, self._yaw_value = _Yaw.RATE, setpoint.yaw_rate_rad_s
        else:
            self._yaw, self._yaw_value = _Yaw.COURSE, 0.0

    def run(self, t_s: float, dt_s: float) -> None:
        """Fly one tick."""
        motion = self._motion
        if self.sub_mode is SubMode.TAKEOFF:
            self.reached = self.reached or motion.height_m >= self.takeoff_height_m - TAKEOFF_REACHED_M
            motion.fly(motion.hold_velocity(), motion.down_to(-self.takeoff_height_m), 0.0, t_s, dt_s)
            return
        if self.sub_mode is SubMode.POSITION:
            north, east, down = self.position_ned_m
            horizontal = motion.velocity_to((north, east))
            motion.fly(horizontal, motion.down_to(down), self._yaw_rate(), t_s, dt_s)
            return
        self._time_out(t_s)
        north, east, down = self.velocity_ned_m_s
        down = min(motion.speed_down_m_s, max(-motion.speed_up_m_s, down))
        motion.fly((north, east), down, self._yaw_rate(), t_s, dt_s)

    def _time_out(self, t_s: float) -> None:
        """Silence: the last velocity goes on for GUID_TIMEOUT, then it brakes; the mode stays."""
        if self.set_at_s is not None and t_s - self.set_at_s > self._parameters["GUID_TIMEOUT"]:
            self.velocity_ned_m_s = (0.0, 0.0, 0.0)
            if self._yaw is _Yaw.RATE:
                self._yaw_value = 0.0

    def _yaw_rate(self) -> float:
        if self._yaw is _Yaw.RATE:
            return self._yaw_value
        if self._yaw is _Yaw.ANGLE:
            return self._motion.yaw_rate_to(self._yaw_value)
        if self._parameters["WP_YAW_BEHAVIOR"] == 0 or self._motion.speed_m_s < LOOK_AHEAD_M_S:
            return 0.0
        north, east, _ = self._motion.vehicle.vel_ned_m_s
        return self._motion.yaw_rate_to(math.atan2(east, north))


def _below(vector: tuple[float, float, float], limit: float) -> bool:
    return all(abs(v) < limit for v in vector)  # false for NaN
