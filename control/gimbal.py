"""Gimbal law: turns the camera so that the target stays in the middle of the picture.

    rate = K * joint error + feed-forward * rate of the target in the gimbal's base

- *Joint error*: from the pixel and where the gimbal pointed at exposure, exactly (control/line_of_sight.py).
- *K* = `GAIN_TIMES_DELAY` / (loop delay + half a frame interval): computed from the delay, not tuned per camera.
- *Rate of the target in the base*: the apparent rate in the picture plus the camera's own rate at the same time. The
  apparent rate alone is no feed-forward: it is near zero exactly when the camera follows well. The sum is taken by
  differences of the line of sight in the base, which holds both. Adding a filter's pixel velocity to a measured camera
  rate looks alike, but the velocity lags: 0.2 s of it makes 30 % of overshoot. With a gimbal in the EARTH frame the
  base is NED; in the VEHICLE frame it is the heading, so a turn of the vehicle is in the rate too.

There is no dead-time prediction. The error is measured between target and camera at exposure, so with the right
feed-forward a target of constant rate is centred whatever the delay; a prediction would add the noise of the velocity
times the delay to the error and help only while the target accelerates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from control.camera import Intrinsics
from control.frames import GIMBAL_FROM_CAMERA, gimbal_rotation, wrap_pi
from control.gate import all_finite, gimbal_usable, target_hold
from control.line_of_sight import joint_error, joint_rate, sight_in_base
from control.messages import CommandReason, GimbalCommand, GimbalFrame, GimbalState
from control.pointing import PointingTrack, TargetRate
from tracker.messages import TargetState, TargetStatus

# Integrator with dead time tau under gain K: K tau = 0.45 gives 1.4 % overshoot and settles in 3.2 tau; the loop is
# unstable from K tau = 1.57, so the delay may be 3.5 times the modelled one (field.md, 4.2).
GAIN_TIMES_DELAY = 0.45
# No chain of exposure, network, link and motor is faster; it bounds K to 9 per second when the delay is given too low.
MIN_LOOP_DELAY_S = 0.05
# Above this the picture is no feedback for a gimbal any more: K would be 0.22 per second.
MAX_LOOP_DELAY_S = 2.0
# One period at 20 Hz, taken as the time step of the first call, which has none of its own.
FIRST_STEP_S = 0.05
# Longer steps are taken as this long, so that a pause cannot become one large move (four frames missing at 20 Hz).
MAX_STEP_S = 0.25
# Time that runs back less than this is jitter and comes again; more is a new clock.
MAX_BACKSTEP_S = 1.0
# How far the integrated angle may lead the reported one: what a gimbal with 0.25 s of lag and link delay needs at the
# greatest rate, and all that an angle-driven gimbal can run on after its reports have become wrong.
MAX_ANGLE_LEAD_RAD = math.radians(15.0)
# The frame interval is averaged over this time: jitter of single frames must not modulate the gain.
INTERVAL_FILTER_S = 1.0


@dataclass(frozen=True, slots=True)
class GimbalLawConfig:
    """Parameters of `GimbalLaw`. Raises ValueError naming field, value and range.

    `loop_delay_s`: exposure to motion of the camera, gimbal lag included. `feed_forward`: share in [0, 1], 0 = P only.
    `feed_forward_filter_s`: low-pass on the feed-forward. `dead_zone_rad` is subtracted from each error, so that there
    is no jump. `yaw_limits_rad` (min, max) applies in the VEHICLE frame only, since stops are on the vehicle; None =
    turns without end.
    """

    loop_delay_s: float = 0.15
    feed_forward: float = 1.0
    feed_forward_filter_s: float = 0.2  # 1 px of box noise becomes 0.6 deg/s; the error loop is no faster either
    max_rate_rad_s: float = math.radians(60.0)  # three times a 20 deg/s crossing, so that a lag can be caught up
    max_accel_rad_s2: float = math.radians(400.0)  # greatest rate in 0.15 s: no slower than the loop delay, no jerk
    pitch_min_rad: float = math.radians(-90.0)
    pitch_max_rad: float = math.radians(30.0)  # the usual upper stop of a gimbal under a multicopter
    yaw_limits_rad: tuple[float, float] | None = None
    dead_zone_rad: float = 0.001  # half a pixel at f = 493 px, below what a tracker resolves

    def __post_init__(self) -> None:
        for name, low, high in (
            ("loop_delay_s", 0.0, MAX_LOOP_DELAY_S),
            ("feed_forward", 0.0, 1.0),
            ("feed_forward_filter_s", 0.0, 5.0),
            ("max_rate_rad_s", 1e-3, 2 * math.tau),
            ("max_accel_rad_s2", 1e-2, 1000.0),
            ("pitch_min_rad", -math.pi / 2, math.pi / 2),
            ("pitch_max_rad", self.pitch_min_rad, math.pi / 2),
            ("dead_zone_rad", 0.0, 0.2),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"GimbalLawConfig.{name} = {value}: must lie in [{low}, {high}]")
        if self.yaw_limits_rad is not None:
            low, high = self.yaw_limits_rad
            if not -math.pi <= low <= 0 <= high <= math.pi:
                raise ValueError(f"GimbalLawConfig.yaw_limits_rad = {self.yaw_limits_rad}: must be -pi..0, 0..pi")

    def gain_per_s(self, interval_s: float) -> float:
        """K of the law, rad/s per rad. A command held for a frame interval acts half of it late on average."""
        return GAIN_TIMES_DELAY / (max(self.loop_delay_s, MIN_LOOP_DELAY_S) + interval_s / 2)


class GimbalLaw:
    """Rate law with feed-forward, limits, stops and an integrated angle. Holds state of one gimbal and no clock."""

    def __init__(self, config: GimbalLawConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Forget rates, feed-forward and angle, as at the start or when the gimbal was given away."""
        self._last_s: float | None = None
        self._interval_s = FIRST_STEP_S
        self._rate = (0.0, 0.0)
        self._angle: tuple[float, float] | None = None
        self._frame: GimbalFrame | None = None
        self._holding = True
        self._pointing = PointingTrack()
        self._target_rate = TargetRate(self._config.feed_forward_filter_s, self._config.max_rate_rad_s)

    def step(
        self,
        target: TargetState,
        gimbal: GimbalState,
        intrinsics: Intrinsics,
        now_s: float,
        camera_rate_rad_s: tuple[float, float] | None = None,
    ) -> GimbalCommand:
        """One command, pitch up + and yaw right +, rad/s and rad, in `gimbal.frame`.

        `gimbal` is the report nearest to exposure (`target.t_s`); the law carries it there. `camera_rate_rad_s` (pitch,
        yaw) is how fast the camera turned then, for gimbals whose reports are too coarse or missing: with it the
        feed-forward is `target.vel_px_s` as an angular rate plus this rate ((0, 0) when the camera's motion is already
        taken out of the pixel velocity). Without a usable gimbal state the picture's own angles are the error, there is
        no feed-forward unless the rate was given, and the command has no angle. Anything not finite, no target or a
        stale one: zero rate, and the angle stays where the gimbal was. LIMITED: the greatest rate or a stop acted.
        """
        report = gimbal if gimbal_usable(gimbal, now_s) else None
        dt_s = self._time_step(now_s)
        if gimbal.frame is not self._frame or report is None:
            self._angle, self._frame = None, gimbal.frame
            self._pointing.reset()
            if camera_rate_rad_s is None:
                self._target_rate.reset()
        if report is not None:
            self._pointing.update(report)
        hold = self._hold_reason(target, gimbal, now_s, camera_rate_rad_s)
        if hold is not None:
            return self._hold(report, now_s, hold)
        demand = self._demand(target, report is not None, intrinsics, camera_rate_rad_s)
        self._rate, limited = self._limit(demand, report, dt_s)
        self._holding = False
        self._integrate(report, dt_s)
        reason = CommandReason.LIMITED if limited else CommandReason.TRACKING
        if target.status is TargetStatus.COASTING:
            reason = CommandReason.COASTING
        return self._command(now_s, reason)

    def _hold_reason(
        self, target: TargetState, gimbal: GimbalState, now_s: float, camera_rate: tuple[float, float] | None
    ) -> CommandReason | None:
        if camera_rate is not None and not all_finite(*camera_rate):
            return CommandReason.HOLD_NOT_FINITE
        if gimbal.valid and not all_finite(gimbal.t_s, gimbal.pitch_rad, gimbal.yaw_rad):
            return CommandReason.HOLD_NOT_FINITE
        return target_hold(target, now_s)

    def _time_step(self, now_s: float) -> float:
        """Seconds since the last call, in [0, MAX_STEP_S]. Time that stands still or runs back is a step of 0."""
        if not all_finite(now_s):
            return 0.0
        dt_s = FIRST_STEP_S if self._last_s is None else now_s - self._last_s
        if dt_s >= 0 or dt_s < -MAX_BACKSTEP_S:
            self._last_s = now_s
        dt_s = min(max(dt_s, 0.0), MAX_STEP_S)
        self._interval_s += -math.expm1(-dt_s / INTERVAL_FILTER_S) * (dt_s - self._interval_s)
        return dt_s

    def _demand(
        self,
        target: TargetState,
        has_report: bool,
        intrinsics: Intrinsics,
        camera_rate: tuple[float, float] | None,
    ) -> tuple[float, float]:
        """Pitch and yaw rate that the target asks for, before any limit."""
        box, c = target.box, self._config
        assert box is not None  # target_hold has seen to it
        pitch_rad, yaw_rad = self._pointing.at(target.t_s)
        sight = sight_in_base(intrinsics, box.cx_px, box.cy_px, pitch_rad, yaw_rad)
        if camera_rate is not None:
            ray_rate = intrinsics.ray_rate(box.cx_px, box.cy_px, *target.vel_px_s)
            apparent = gimbal_rotation(pitch_rad, yaw_rad) @ GIMBAL_FROM_CAMERA @ ray_rate
            self._target_rate.update(target.t_s, sight, joint_rate(sight, apparent, camera_rate, yaw_rad))
        elif has_report:
            self._target_rate.update(target.t_s, sight)
        gain = c.gain_per_s(self._interval_s)
        pitch, yaw = (
            gain * _soft_dead_zone(error, c.dead_zone_rad) + c.feed_forward * rate
            for error, rate in zip(joint_error(sight, pitch_rad, yaw_rad), self._target_rate.rate_rad_s, strict=True)
        )
        return pitch, yaw

    def _limit(
        self, demand: tuple[float, float], gimbal: GimbalState | None, dt_s: float
    ) -> tuple[tuple[float, float], bool]:
        """Greatest rate, then greatest change of rate, then stops. Second: whether the rate limit or a stop acted."""
        c = self._config
        change = c.max_accel_rad_s2 * dt_s
        clamped = [_clamp(d, -c.max_rate_rad_s, c.max_rate_rad_s) for d in demand]
        slewed = [_clamp(r, old - change, old + change) for r, old in zip(clamped, self._rate, strict=True)]
        if gimbal is None:
            return (slewed[0], slewed[1]), clamped != list(demand)
        # A rate is taken back so far before a stop that the delay of the loop cannot carry the camera into it.
        horizon_s = max(c.loop_delay_s, MIN_LOOP_DELAY_S)
        pitch = _stopped(slewed[0], gimbal.pitch_rad, c.pitch_min_rad, c.pitch_max_rad, horizon_s)
        yaw = _stopped(slewed[1], gimbal.yaw_rad, *self._yaw_limits(), horizon_s)
        return (pitch, yaw), clamped != list(demand) or [pitch, yaw] != slewed

    def _integrate(self, gimbal: GimbalState | None, dt_s: float) -> None:
        """Carry the angle on by the rate, at most `MAX_ANGLE_LEAD_RAD` from the reported one and within the stops.

        A gimbal that is reported beyond a stop is not sent back to it: what holds, stays.
        """
        if gimbal is None:
            self._angle = None
            return
        pitch, yaw = self._angle or (gimbal.pitch_rad, gimbal.yaw_rad)
        lead = MAX_ANGLE_LEAD_RAD
        pitch_lead = _clamp(pitch + self._rate[0] * dt_s - gimbal.pitch_rad, -lead, lead)
        yaw_lead = _clamp(wrap_pi(yaw + self._rate[1] * dt_s - gimbal.yaw_rad), -lead, lead)
        low, high = self._yaw_limits()
        yaw = gimbal.yaw_rad + yaw_lead
        if math.isinf(high):
            yaw = wrap_pi(yaw)  # with stops, the angle beyond one must not come out at the other
        self._angle = (
            _within(
                gimbal.pitch_rad + pitch_lead, self._config.pitch_min_rad, self._config.pitch_max_rad, gimbal.pitch_rad
            ),
            _within(yaw, low, high, gimbal.yaw_rad),
        )

    def _hold(self, gimbal: GimbalState | None, now_s: float, reason: CommandReason) -> GimbalCommand:
        """Zero rate, and the angle at which the gimbal was reported when the hold began: no running on, no drift."""
        if not self._holding:
            self._angle = None
        self._rate = (0.0, 0.0)
        self._target_rate.reset()
        self._holding = True
        self._integrate(gimbal, 0.0)
        return self._command(now_s, reason)

    def _yaw_limits(self) -> tuple[float, float]:
        limits = self._config.yaw_limits_rad
        return limits if limits and self._frame is GimbalFrame.VEHICLE else (-math.inf, math.inf)

    def _command(self, now_s: float, reason: CommandReason) -> GimbalCommand:
        pitch, yaw = self._angle or (None, None)
        frame = self._frame or GimbalFrame.VEHICLE
        return GimbalCommand(*self._rate, pitch_rad=pitch, yaw_rad=yaw, frame=frame, t_s=now_s, reason=reason)


def _clamp(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def _within(value: float, low: float, high: float, reported: float) -> float:
    """The value between two stops, or between one and a reported angle beyond it."""
    return _clamp(value, min(low, reported), max(high, reported))


def _soft_dead_zone(error: float, half_width: float) -> float:
    return math.copysign(max(0.0, abs(error) - half_width), error)


def _stopped(rate: float, angle: float, low: float, high: float, horizon_s: float) -> float:
    """The rate, taken back to reach a stop no sooner than after `horizon_s`; zero at or beyond it, never sent back."""
    room_up, room_down = max(0.0, high - angle) / horizon_s, max(0.0, angle - low) / horizon_s
    return _clamp(rate, -room_down, room_up)
