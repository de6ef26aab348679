"""Trail: keep a horizontal standoff from the target, on the present line or on a fixed bearing, nose to the target.

The law works in polar coordinates about the target, so that no path to the desired place leads over the target:

    radial      (ground range - standoff) / position_time_s, towards the target +
    tangential  ground range * bearing error / bearing_time_s, only with a fixed bearing
    both        + the target's own horizontal velocity
    yaw rate    (azimuth of the target - heading) / yaw_time_s

The target's velocity is the filtered difference of its estimated places in NED. It is not taken from
`TargetState.growth_per_s` (range rate = -range * growth): that would need the vehicle's velocity added at the same
instant, while the difference of places needs no second path and makes no steady error for a target of constant speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from control.camera import Intrinsics
from control.frames import GIMBAL_FROM_CAMERA, ned_from_gimbal, wrap_pi
from control.gate import all_finite, target_hold, telemetry_hold
from control.line_of_sight import MIN_COS
from control.messages import CommandReason, GimbalState, VehicleState, VelocityCommand
from control.range import RangeEstimate
from tracker.messages import TargetState, TargetStatus

# Nearer than this on the ground the line to the target has no direction: the vehicle's tail is the way out instead.
MIN_GROUND_RANGE_M = 0.5
# Places further apart in time than this make no velocity; the estimate starts again from zero.
MAX_GAP_S = 1.0
# A target that fills this share of the picture's width or height is too near, whatever the range estimate says.
MAX_APPARENT_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class TrailConfig:
    """Parameters of `TrailGuidance`. Raises ValueError naming field, value and range.

    `standoff_m`, `min_standoff_m`: horizontal. `height_m` above the origin of local NED; None: vertical speed zero, the
    autopilot holds. `bearing_rad`: the vehicle's place seen from the target, clockwise from north; None: where it is.
    """

    standoff_m: float = 15.0
    min_standoff_m: float = 5.0  # two arm lengths and the error of a monocular range
    height_m: float | None = None
    bearing_rad: float | None = None
    # 5 m/s taper off with 5 / 3 = 1.7 m/s2, within the 2 m/s2 of VelocityLimits: no overshoot towards the target.
    position_time_s: float = 3.0
    bearing_time_s: float = 4.0  # slower than the radial loop: on the way round the standoff is kept
    height_time_s: float = 2.0  # 1 m/s from 2 m of error on; vertical response of a multicopter is about 0.5 s
    yaw_time_s: float = 0.7  # gain 1.4 per s, half that of the gimbal law, which does the fine pointing
    velocity_filter_s: float = 1.0  # 0.3 m of range noise becomes 0.3 m/s; a walker changes speed no faster
    max_target_speed_m_s: float = 8.0  # nothing that 5 m/s can follow is faster: an error of range
    max_tangential_m_s: float = 3.0  # orbiting must leave speed for the standoff within the 5 m/s of VelocityLimits

    def __post_init__(self) -> None:
        for name, low, high in (
            ("min_standoff_m", 1.0, 500.0),
            ("standoff_m", self.min_standoff_m, 500.0),
            ("position_time_s", 0.5, 30.0),
            ("bearing_time_s", 0.5, 60.0),
            ("height_time_s", 0.5, 30.0),
            ("yaw_time_s", 0.2, 30.0),
            ("velocity_filter_s", 0.1, 30.0),
            ("max_target_speed_m_s", 0.0, 50.0),
            ("max_tangential_m_s", 0.0, 20.0),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"TrailConfig.{name} = {value}: must lie in [{low}, {high}]")
        if self.height_m is not None and not 0.0 <= self.height_m <= 500.0:
            raise ValueError(f"TrailConfig.height_m = {self.height_m}: must lie in [0, 500] or be None")
        if self.bearing_rad is not None and not abs(self.bearing_rad) <= math.tau:
            raise ValueError(f"TrailConfig.bearing_rad = {self.bearing_rad}: must lie in [-2 pi, 2 pi] or be None")


@dataclass(frozen=True, slots=True)
class _Line:
    """The line from vehicle to target: unit vector on the ground, whether it is below, ground range, yaw error."""

    north: float
    east: float
    below: bool
    ground_m: float
    yaw_error_rad: float
    yaw_weight: float


class TrailGuidance:
    """The trail law. Holds the target's velocity estimate; no clock."""

    def __init__(self, config: TrailConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Forget the target's motion, as when following begins or the target was changed."""
        self._place_ne: tuple[float, float] | None = None
        self._place_s = 0.0
        self._target_ne_m_s = (0.0, 0.0)

    def step(
        self,
        target: TargetState,
        gimbal: GimbalState,
        intrinsics: Intrinsics,
        vehicle: VehicleState,
        range_estimate: RangeEstimate,
        now_s: float,
    ) -> VelocityCommand:
        """Velocity NED (m/s) and yaw rate (right +), before `VelocityLimiter`.

        `gimbal` and `vehicle` are those of the exposure (`target.t_s`) or the nearest reports. Zero with a HOLD reason
        when target, telemetry or a number is not usable. Without a usable range it only turns (NO_RANGE). Below
        `min_standoff_m`, or when the target fills the picture, nothing points towards it, the vehicle only retreats
        (TOO_CLOSE, or COASTING on a prediction).
        """
        hold = target_hold(target, now_s) or telemetry_hold(vehicle, gimbal, now_s)
        if hold is None and range_estimate.valid and not all_finite(range_estimate.range_m, range_estimate.sigma_m):
            hold = CommandReason.HOLD_NOT_FINITE
        if hold is not None:
            self.reset()
            return VelocityCommand((0.0, 0.0, 0.0), 0.0, now_s, hold)
        has_range = range_estimate.valid and range_estimate.range_m > 0 and range_estimate.sigma_m >= 0
        line = self._line(target, gimbal, intrinsics, vehicle, range_estimate.range_m if has_range else 0.0)
        yaw_rate = line.yaw_error_rad * line.yaw_weight / self._config.yaw_time_s
        if not has_range:
            self.reset()
            return VelocityCommand((0.0, 0.0, 0.0), yaw_rate, now_s, CommandReason.NO_RANGE)
        north, east, reason = self._horizontal(target, vehicle, line)
        down = self._down_m_s(vehicle)
        if line.ground_m < self._config.min_standoff_m or _fills_picture(target, intrinsics):
            north, east, down = _not_towards(line, north, east, down)
            # A coast stays a coast: the limiter slows it down, and a retreat by a prediction may wait.
            reason = CommandReason.COASTING if reason is CommandReason.COASTING else CommandReason.TOO_CLOSE
        return VelocityCommand((north, east, down), yaw_rate, now_s, reason)

    def _line(
        self, target: TargetState, gimbal: GimbalState, intrinsics: Intrinsics, vehicle: VehicleState, range_m: float
    ) -> _Line:
        box = target.box
        assert box is not None  # target_hold has seen to it
        to_ned = ned_from_gimbal(gimbal.pitch_rad, gimbal.yaw_rad, gimbal.frame, vehicle.yaw_rad)
        sight = to_ned @ GIMBAL_FROM_CAMERA @ intrinsics.ray(box.cx_px, box.cy_px)
        north, east, below = float(sight[0]), float(sight[1]), float(sight[2]) >= 0.0
        share = math.hypot(north, east)
        yaw_error = wrap_pi(math.atan2(east, north) - vehicle.yaw_rad)
        # Straight below, the azimuth of the target is noise: the demand fades as in control/line_of_sight.py.
        yaw_weight = min(1.0, share / MIN_COS)
        if share * range_m < MIN_GROUND_RANGE_M:
            return _Line(math.cos(vehicle.yaw_rad), math.sin(vehicle.yaw_rad), below, 0.0, yaw_error, yaw_weight)
        return _Line(north / share, east / share, below, share * range_m, yaw_error, yaw_weight)

    def _horizontal(
        self, target: TargetState, vehicle: VehicleState, line: _Line
    ) -> tuple[float, float, CommandReason]:
        """North and east speed, and why."""
        c = self._config
        coasting = target.status is TargetStatus.COASTING
        if not coasting:
            self._update_target_velocity(vehicle, line, target.t_s)
        radial = (line.ground_m - c.standoff_m) / c.position_time_s
        right = self._tangential_m_s(line)
        feed_north, feed_east = self._target_ne_m_s
        # (-east, north) is the horizontal direction to the right of the line to the target
        north = radial * line.north - right * line.east + feed_north
        east = radial * line.east + right * line.north + feed_east
        return north, east, CommandReason.COASTING if coasting else CommandReason.TRACKING

    def _tangential_m_s(self, line: _Line) -> float:
        """Speed to the right of the line to the target that brings the vehicle to its bearing; 0 without one."""
        c = self._config
        if c.bearing_rad is None:
            return 0.0
        bearing = math.atan2(-line.east, -line.north)
        # A vehicle that moves to its right while it faces the target goes round it clockwise backwards: bearing falls.
        speed = -line.ground_m * wrap_pi(c.bearing_rad - bearing) / c.bearing_time_s
        return min(max(speed, -c.max_tangential_m_s), c.max_tangential_m_s)

    def _down_m_s(self, vehicle: VehicleState) -> float:
        if self._config.height_m is None:
            return 0.0
        return (-self._config.height_m - vehicle.pos_ned_m[2]) / self._config.height_time_s

    def _update_target_velocity(self, vehicle: VehicleState, line: _Line, t_s: float) -> None:
        """First-order low-pass on the place of the target; its innovation over the step is the velocity.

        With share = 1 - exp(-dt / T) the lag of a ramp v is v dt / share, so innovation * share / dt is exactly v in
        the steady state at any rate of frames.
        """
        north = vehicle.pos_ned_m[0] + line.ground_m * line.north
        east = vehicle.pos_ned_m[1] + line.ground_m * line.east
        dt_s = t_s - self._place_s
        if self._place_ne is None or dt_s > MAX_GAP_S or dt_s < 0:
            self._place_ne, self._place_s, self._target_ne_m_s = (north, east), t_s, (0.0, 0.0)
            return
        if dt_s == 0:
            return
        share = -math.expm1(-dt_s / self._config.velocity_filter_s)
        step_north, step_east = share * (north - self._place_ne[0]), share * (east - self._place_ne[1])
        self._place_ne = (self._place_ne[0] + step_north, self._place_ne[1] + step_east)
        self._place_s = t_s
        speed = math.hypot(step_north, step_east) / dt_s
        scale = 1.0 if speed <= self._config.max_target_speed_m_s else self._config.max_target_speed_m_s / speed
        self._target_ne_m_s = (step_north / dt_s * scale, step_east / dt_s * scale)


def _fills_picture(target: TargetState, intrinsics: Intrinsics) -> bool:
    box = target.box
    assert box is not None  # target_hold has seen to it
    return max(box.w_px / intrinsics.width_px, box.h_px / intrinsics.height_px) > MAX_APPARENT_SHARE


def _not_towards(line: _Line, north: float, east: float, down: float) -> tuple[float, float, float]:
    """The velocity without its parts that lead to the target, on the ground and in height."""
    towards = max(0.0, north * line.north + east * line.east)
    down = min(down, 0.0) if line.below else max(down, 0.0)
    return north - towards * line.north, east - towards * line.east, down
