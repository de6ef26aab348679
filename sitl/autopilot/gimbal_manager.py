"""ArduPilot's gimbal manager (protocol v2) over one gimbal: what moves it, what it reports. No MAVLink here.

As seen on a real one: primary control is reported, never enforced; only the YAW_LOCK bit of the flags counts; a rate
goes on for ever; angle and rate together are ignored in messages, while in commands the angle wins. MNT1_TYPE 1
(servo) reports the commanded servo angles, which are those of the body, at once; type 6 (a gimbal device) reports the
stabilised angles that the device measures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from sitl.autopilot.motion import wrap
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.ports import Gimbal, Vehicle

# ArduPilot's mount runs at this rate whatever the rate of the main loop.
UPDATE_S = 0.02
# Times are sums of intervals: rounding must not cost a tick.
TIME_SLACK_S = 1e-9
NONE_TYPE, DEVICE_TYPE = 0, 6
DEVICE_ID = 1
# GIMBAL_MANAGER_FLAGS / GIMBAL_DEVICE_FLAGS
RETRACT, NEUTRAL, ROLL_LOCK, PITCH_LOCK, YAW_LOCK, YAW_IN_VEHICLE_FRAME = 1, 2, 4, 8, 16, 32
# As reported for a servo mount in the recording.
CAP_FLAGS = 206847
ROLL_LIMIT_RAD = math.radians(45.0)
# DO_GIMBAL_MANAGER_CONFIGURE
KEEP, SELF, RELEASE = -1, -2, -3


class Targeting(Enum):
    """What the gimbal follows."""

    ANGLE = "angle"
    RATE = "rate"
    LOCATION = "location"


@dataclass(frozen=True, slots=True)
class GimbalReport:
    """Attitude as reported: roll, pitch, yaw relative to the vehicle, and the device flags."""

    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    flags: int


class GimbalManager:
    """The one gimbal, id 1. `update` is called in every tick; it steers at 50 Hz."""

    __slots__ = (
        "_due_s", "_gimbal", "_lock", "_parameters", "_pitch", "_place_ned_m", "_rate", "_roll", "_targeting",
        "_vehicle", "_yaw", "primary", "yaw_lock",
    )  # fmt: skip

    def __init__(self, gimbal: Gimbal, vehicle: Vehicle, parameters: Parameters, now_s: float) -> None:
        self._gimbal = gimbal
        self._vehicle = vehicle
        self._parameters = parameters
        self._due_s = now_s
        self._targeting = Targeting.ANGLE
        self._roll = self._pitch = self._yaw = 0.0
        self._lock = False
        self._rate = (0.0, 0.0)
        self._place_ned_m = (0.0, 0.0, 0.0)
        self.primary = (0, 0)
        self.yaw_lock = False

    # --- what it is told -----------------------------------------------------------------------------------------

    def has(self, device_id: int) -> bool:
        """Whether there is such a gimbal; 0 stands for the first one."""
        return self._parameters["MNT1_TYPE"] != NONE_TYPE and device_id in (0, DEVICE_ID)

    def point(self, roll_rad: float, pitch_rad: float, yaw_rad: float, lock: bool) -> None:
        """Angles: pitch and roll from the horizon, yaw from north (`lock`) or from the nose."""
        low, high = self.pitch_limits_rad
        self._targeting = Targeting.ANGLE
        self._roll = min(ROLL_LIMIT_RAD, max(-ROLL_LIMIT_RAD, roll_rad))
        self._pitch = min(high, max(low, pitch_rad))
        self._yaw = wrap(yaw_rad) if lock else self._within_yaw(wrap(yaw_rad))
        self._lock = lock

    def turn(self, pitch_rate_rad_s: float, yaw_rate_rad_s: float, lock: bool) -> None:
        """Rates, without time-out, from where it points."""
        self._targeting = Targeting.RATE
        self._rate = (pitch_rate_rad_s, yaw_rate_rad_s)
        if lock != self._lock:
            heading = self._vehicle.yaw_rad
            self._yaw = wrap(self._yaw + heading if lock else self._yaw - heading)
            self._lock = lock

    def look_at(self, place_ned_m: tuple[float, float, float]) -> None:
        """Keep pointing at a place (region of interest)."""
        self._targeting = Targeting.LOCATION
        self._place_ned_m = place_ned_m

    def leave_place(self) -> None:
        """No region of interest any more: it stays where it points."""
        if self._targeting is Targeting.LOCATION:
            self._targeting = Targeting.ANGLE

    def park(self) -> None:
        """RETRACT or NEUTRAL: level and ahead (MNT1_RETRACT and MNT1_NEUTRAL are zero by default)."""
        self.point(0.0, 0.0, 0.0, lock=False)

    def obey(
        self,
        flags: int,
        pitch_rad: float,
        yaw_rad: float,
        pitch_rate_rad_s: float,
        yaw_rate_rad_s: float,
        roll_rad: float = 0.0,
    ) -> bool:
        """An order of angles or rates, NaN for what is not asked for; False when it asks for neither.

        With finite angles the rates do not count; a message that has both must be dropped by the caller.
        """
        lock = bool(flags & YAW_LOCK)
        if flags & (RETRACT | NEUTRAL):
            self.park()
        elif math.isfinite(pitch_rad) and math.isfinite(yaw_rad):
            self.point(roll_rad if math.isfinite(roll_rad) else 0.0, pitch_rad, yaw_rad, lock)
        elif math.isfinite(pitch_rate_rad_s) and math.isfinite(yaw_rate_rad_s):
            self.turn(pitch_rate_rad_s, yaw_rate_rad_s, lock)
        elif all(math.isnan(v) for v in (pitch_rad, yaw_rad, pitch_rate_rad_s, yaw_rate_rad_s)):
            self.yaw_lock = lock
        else:
            return False
        return True

    def configure(self, sysid: float, compid: float, sender: tuple[int, int]) -> bool:
        """Who is in primary control; only reported. False for numbers that mean nothing."""
        if math.isnan(sysid) or math.isnan(compid):
            return False
        asked = (int(max(-4.0, min(256.0, sysid))), int(max(-4.0, min(256.0, compid))))
        if asked == (SELF, SELF):
            self.primary = sender
        elif asked == (RELEASE, RELEASE):
            if self.primary == sender:
                self.primary = (0, 0)
        elif 0 <= asked[0] <= 255 and 0 <= asked[1] <= 255:
            self.primary = asked
        elif asked != (KEEP, KEEP):
            return False
        return True

    # --- one tick ------------------------------------------------------------------------------------------------

    def update(self, t_s: float, dt_s: float) -> None:
        """Steer when it is time, and advance the gimbal from `t_s` by `dt_s`."""
        if t_s >= self._due_s - TIME_SLACK_S:
            self._due_s += UPDATE_S
            self._steer(t_s)
        self._gimbal.step(t_s, dt_s, self._vehicle.roll_rad, self._vehicle.pitch_rad)

    def _steer(self, t_s: float) -> None:
        if self._targeting is Targeting.RATE:
            low, high = self.pitch_limits_rad
            self._pitch = min(high, max(low, self._pitch + self._rate[0] * UPDATE_S))
            yaw = self._yaw + self._rate[1] * UPDATE_S
            self._yaw = wrap(yaw) if self._lock else self._within_yaw(yaw)
        elif self._targeting is Targeting.LOCATION:
            north, east, down = (p - h for p, h in zip(self._place_ned_m, self._vehicle.pos_ned_m, strict=True))
            low, high = self.pitch_limits_rad
            self._roll, self._lock = 0.0, True
            self._yaw = math.atan2(east, north)
            self._pitch = min(high, max(low, math.atan2(-down, math.hypot(north, east))))
        self._gimbal.command_angle(self._pitch, self.body_yaw_rad, t_s)

    # --- what it reports -----------------------------------------------------------------------------------------

    @property
    def pitch_limits_rad(self) -> tuple[float, float]:
        """MNT1_PITCH_MIN and MNT1_PITCH_MAX."""
        return math.radians(self._parameters["MNT1_PITCH_MIN"]), math.radians(self._parameters["MNT1_PITCH_MAX"])

    @property
    def yaw_limits_rad(self) -> tuple[float, float]:
        """MNT1_YAW_MIN and MNT1_YAW_MAX."""
        return math.radians(self._parameters["MNT1_YAW_MIN"]), math.radians(self._parameters["MNT1_YAW_MAX"])

    def _within_yaw(self, yaw_rad: float) -> float:
        low, high = self.yaw_limits_rad
        return min(high, max(low, yaw_rad))

    @property
    def body_yaw_rad(self) -> float:
        """Commanded yaw relative to the nose, within the limits."""
        return self._within_yaw(wrap(self._yaw - self._vehicle.yaw_rad) if self._lock else self._yaw)

    def report(self) -> GimbalReport:
        """GIMBAL_DEVICE_ATTITUDE_STATUS: yaw is always relative to the vehicle, also in lock."""
        flags = ROLL_LOCK | PITCH_LOCK | YAW_IN_VEHICLE_FRAME | (YAW_LOCK if self._lock else 0)
        if self._parameters["MNT1_TYPE"] == DEVICE_TYPE:
            return GimbalReport(0.0, self._gimbal.measured_pitch_rad, self._gimbal.measured_yaw_rad, flags)
        yaw = self.body_yaw_rad
        c, s = math.cos(yaw), math.sin(yaw)
        lean_roll, lean_pitch = self._vehicle.roll_rad, self._vehicle.pitch_rad
        roll = self._roll - (c * lean_roll + s * lean_pitch)
        pitch = self._pitch - (c * lean_pitch - s * lean_roll)
        return GimbalReport(roll, pitch, yaw, flags)
