"""A two-axis gimbal whose roll is stabilised: delay, limits, lag, stops, stiction, encoder.

Angles: pitch from the horizon, up +; yaw from the vehicle's heading, clockwise from above +.
"""

from __future__ import annotations

import math
from collections import deque

from sitl.plant.gimbal_params import GimbalParams

__all__ = ["GimbalParams", "GimbalPlant"]

# Commands due "now" must be taken in spite of the rounding of times that are sums of steps.
_TIME_SLACK_S = 1e-9
# A joint slower than this is at rest: 0.3 mrad of drift in three seconds, below a pixel.
_REST_RAD_S = 1e-4


class _Axis:
    """One axis: the gimbal's own controller moves a reference within its limits, stiction holds the joint behind it."""

    __slots__ = (
        "_accel", "_alpha", "_breakaway", "_dt", "_gain", "_high", "_lag", "_limit", "_low", "_moving", "_reference",
        "_reference_rate", "_target", "_wanted_rate", "angle", "rate",
    )  # fmt: skip

    def __init__(self, params: GimbalParams, low: float, high: float, start: float) -> None:
        self._low, self._high = low, high
        self._limit, self._accel, self._lag = params.max_rate_rad_s, params.max_accel_rad_s2, params.lag_s
        self._breakaway = params.stiction_rad
        # A quarter of the lag's corner: the fastest position loop around a lag that does not overshoot.
        self._gain = 0.25 / params.lag_s
        self._dt = 0.0
        self._alpha = 0.0
        self._target: float | None = None
        self._wanted_rate = 0.0
        self._reference = self.angle = min(high, max(low, start))
        self._reference_rate = self.rate = 0.0
        self._moving = False

    def aim(self, angle: float) -> None:
        self._target = min(self._high, max(self._low, angle))

    def turn(self, rate: float) -> None:
        self._target = None
        self._wanted_rate = rate

    def step(self, dt_s: float) -> None:
        if dt_s != self._dt:
            self._dt = dt_s
            self._alpha = 1.0 - math.exp(-dt_s / self._lag)
        self._lead(dt_s)
        if self._moving or abs(self._reference - self.angle) > self._breakaway:
            self._follow(dt_s)

    def _lead(self, dt_s: float) -> None:
        """Move the reference: towards the angle or at the rate, slowing down before angle and stops."""
        here, before = self._reference, self._reference_rate
        if self._target is None:
            wanted = self._wanted_rate
            way = self._slow((self._high if wanted > 0.0 else self._low) - here)
            if (way < wanted) if wanted > 0.0 else (way > wanted):
                wanted = way
        else:
            wanted = self._slow(self._target - here)
        rate = before + _bounded(self._alpha * (_bounded(wanted, self._limit) - before), self._accel * dt_s)
        here += rate * dt_s
        if not self._low <= here <= self._high:
            here, rate = (self._high if here > self._high else self._low), 0.0
        self._reference, self._reference_rate = here, rate

    def _slow(self, way: float) -> float:
        """The fastest rate from which the axis still stops after `way`, with half of its acceleration in hand."""
        linear = self._gain * way
        # Where the straight line meets the root; inside of it the line is the slower one.
        if linear * linear <= self._accel * abs(way):
            return linear
        return math.copysign(math.sqrt(self._accel * abs(way)), way)

    def _follow(self, dt_s: float) -> None:
        """The joint goes along with the reference, and catches up where stiction has held it back."""
        before = self.rate
        wanted = _bounded(self._reference_rate + self._slow(self._reference - self.angle), self._limit)
        rate = before + _bounded(wanted - before, self._accel * dt_s)
        angle = self.angle + rate * dt_s
        if not self._low <= angle <= self._high:
            angle, rate = (self._high if angle > self._high else self._low), 0.0
        # At rest, and in passing through rest when it turns back, it sticks again.
        self._moving = before * rate >= 0.0 and not -_REST_RAD_S < rate < _REST_RAD_S
        self.angle = angle
        self.rate = rate if self._moving else 0.0


def _bounded(value: float, limit: float) -> float:
    if value > limit:
        return limit
    return -limit if value < -limit else value


class GimbalPlant:
    """The plant of the gimbal. Starts at rest, by default level and along the heading.

    A rate command keeps on until the next command; a stop ends the motion. Commands beyond the stops go to the stops.
    """

    __slots__ = (
        "_dt", "_last_pitch", "_last_roll", "_leak_pitch", "_leak_roll", "_params", "_pitch", "_queue", "_share",
        "_slow_pitch", "_slow_roll", "_yaw",
    )  # fmt: skip

    def __init__(self, params: GimbalParams | None = None, pitch_rad: float = 0.0, yaw_rad: float = 0.0) -> None:
        self._params = params = params if params is not None else GimbalParams()
        self._pitch = _Axis(params, params.min_pitch_rad, params.max_pitch_rad, pitch_rad)
        self._yaw = _Axis(params, params.min_yaw_rad, params.max_yaw_rad, yaw_rad)
        self._queue: deque[tuple[float, bool, float, float]] = deque()  # due, is a rate, pitch, yaw
        self._dt = math.nan  # none yet; unlike any step
        self._share = 0.0
        self._slow_roll = self._slow_pitch = 0.0
        self._leak_roll = self._leak_pitch = self._last_roll = self._last_pitch = 0.0

    @property
    def params(self) -> GimbalParams:
        """What it was built with."""
        return self._params

    def command_angle(self, pitch_rad: float, yaw_rad: float, t_s: float) -> None:
        """Go to these angles. Raises ValueError for a number that is not finite or a time before the last command."""
        self._enqueue(False, pitch_rad, yaw_rad, t_s)

    def command_rate(self, pitch_rate_rad_s: float, yaw_rate_rad_s: float, t_s: float) -> None:
        """Turn at these rates until told otherwise. Raises ValueError as `command_angle` does."""
        self._enqueue(True, pitch_rate_rad_s, yaw_rate_rad_s, t_s)

    def _enqueue(self, is_rate: bool, pitch: float, yaw: float, t_s: float) -> None:
        if not math.isfinite(pitch + yaw + t_s):
            raise ValueError("GimbalPlant: pitch, yaw and time of a command must be finite")
        due = t_s + self._params.delay_s
        queue = self._queue
        if queue and due < queue[-1][0]:
            raise ValueError(f"GimbalPlant: t_s {t_s} is before that of the last command")
        queue.append((due, is_rate, pitch, yaw))

    def step(self, t_s: float, dt_s: float, roll_rad: float = 0.0, pitch_rad: float = 0.0) -> None:
        """Advance from `t_s` to `t_s + dt_s` under a vehicle that is tilted by `roll_rad`, `pitch_rad`."""
        if dt_s != self._dt:
            if not dt_s > 0.0:
                raise ValueError(f"GimbalPlant.step: dt_s must be above 0, not {dt_s}")
            self._dt = dt_s
            self._share = 1.0 - math.exp(-dt_s / self._params.stabilisation_time_s)
        queue = self._queue
        while queue and queue[0][0] <= t_s + _TIME_SLACK_S:
            _, is_rate, pitch, yaw = queue.popleft()
            if is_rate:
                self._pitch.turn(pitch)
                self._yaw.turn(yaw)
            else:
                self._pitch.aim(pitch)
                self._yaw.aim(yaw)
        self._pitch.step(dt_s)
        self._yaw.step(dt_s)
        self._stabilise(roll_rad, pitch_rad)

    def _stabilise(self, roll_rad: float, pitch_rad: float) -> None:
        """What the stabilisation lets through: a share of the tilt's fast part (high pass)."""
        share, residue = self._share, self._params.stabilisation_residue
        self._slow_roll += share * (roll_rad - self._slow_roll)
        self._slow_pitch += share * (pitch_rad - self._slow_pitch)
        self._last_roll, self._last_pitch = self._leak_roll, self._leak_pitch
        self._leak_roll = residue * (roll_rad - self._slow_roll)
        self._leak_pitch = residue * (pitch_rad - self._slow_pitch)

    @property
    def pitch_rad(self) -> float:
        """True pitch of the joint from the horizon, without misalignment and leak."""
        return self._pitch.angle

    @property
    def yaw_rad(self) -> float:
        """True yaw of the joint from the vehicle's heading, without misalignment."""
        return self._yaw.angle

    @property
    def pitch_rate_rad_s(self) -> float:
        """True rate of the pitch joint."""
        return self._pitch.rate

    @property
    def yaw_rate_rad_s(self) -> float:
        """True rate of the yaw joint."""
        return self._yaw.rate

    @property
    def measured_pitch_rad(self) -> float:
        """Pitch as the encoder reports it: quantised; it knows nothing of the misalignment of the camera."""
        return self._quantised(self._pitch.angle)

    @property
    def measured_yaw_rad(self) -> float:
        """Yaw as the encoder reports it."""
        return self._quantised(self._yaw.angle)

    @property
    def leak_rad(self) -> tuple[float, float]:
        """Tilt of the gimbal's base plane that was not compensated: roll and pitch in the heading frame."""
        return self._leak_roll, self._leak_pitch

    @property
    def leak_rates_rad_s(self) -> tuple[float, float]:
        """Rates of `leak_rad` over the last step."""
        if self._share == 0.0:
            return 0.0, 0.0
        return (self._leak_roll - self._last_roll) / self._dt, (self._leak_pitch - self._last_pitch) / self._dt

    def _quantised(self, angle_rad: float) -> float:
        step = self._params.encoder_step_rad
        return angle_rad if step == 0.0 else step * round(angle_rad / step)
