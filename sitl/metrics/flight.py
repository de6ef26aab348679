"""Metrics of the flight: where the vehicle kept itself, and what went over the wire."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from sitl.metrics.picture import rms
from sitl.metrics.sample import LOCKED, Sample, Setpoint, since_lock

# A target slower than this stands: 2 mm a picture.
STILL_M_S = 0.05
# The gimbal needs this long to bring a newly locked target to the aim point; that motion is wanted.
CENTRING_S = 1.0
# Setpoints are float32 on the wire, and times are sums of steps.
LIMIT_TOLERANCE = 1e-3
# The application takes at least a setpoint's period as the time step of a change of speed (20 Hz).
MIN_STEP_S = 0.05
# A rate needs some setpoints to be one.
MIN_SETPOINTS = 3


@dataclass(frozen=True, slots=True)
class FlightLimits:
    """The most that may be commanded. `max_accel_m_s2`: change of horizontal speed, braking included."""

    max_horizontal_m_s: float = 5.0
    max_up_m_s: float = 1.0
    max_down_m_s: float = 1.0
    max_yaw_rate_rad_s: float = math.radians(45.0)
    max_accel_m_s2: float = 5.0


def standoff_err_rms_m(samples: Sequence[Sample], standoff_m: float) -> float | None:
    """Horizontal distance of vehicle and target minus the standoff, while following."""
    return rms([_ground_range_m(s) - standoff_m for s in samples if s.following])


def height_err_rms_m(samples: Sequence[Sample], height_m: float | None) -> float | None:
    """Height above ground minus `height_m`, while following; None: minus the height at which following began."""
    heights = [-s.vehicle_pos_ned_m[2] for s in samples if s.following]
    if not heights:
        return None
    wanted = heights[0] if height_m is None else height_m
    return rms([h - wanted for h in heights])


def bearing_err_rms_deg(samples: Sequence[Sample], bearing_rad: float | None) -> float | None:
    """Bearing of the vehicle seen from the target minus the wanted one, while following; None when none is wanted."""
    if bearing_rad is None:
        return None
    errors = []
    for s in samples:
        if s.following:
            north, east = (v - t for v, t in zip(s.vehicle_pos_ned_m[:2], s.target_pos_ned_m[:2], strict=True))
            errors.append(math.degrees(math.remainder(math.atan2(east, north) - bearing_rad, math.tau)))
    return rms(errors)


def gimbal_cmd_rms_deg_s(samples: Sequence[Sample]) -> float | None:
    """Size of the commanded gimbal rate while LOCKED on a target that stands, from 1 s after the first lock on."""
    locked = since_lock(samples)
    return rms(
        [
            math.degrees(math.hypot(s.gimbal_pitch_rate_rad_s, s.gimbal_yaw_rate_rad_s))
            for s in locked
            if s.status == LOCKED
            and s.t_s >= locked[0].t_s + CENTRING_S
            and math.hypot(*s.target_vel_ned_m_s) < STILL_M_S
        ]
    )


def following_spans(samples: Sequence[Sample]) -> list[tuple[float, float]]:
    """Times (of `now_s`) from the first to the last sample of each stretch of following."""
    spans: list[tuple[float, float]] = []
    was = False
    for s in samples:
        if s.following:
            spans = [*spans[:-1], (spans[-1][0], s.now_s)] if was else [*spans, (s.now_s, s.now_s)]
        was = s.following
    return spans


def setpoint_metrics(samples: Sequence[Sample], times_s: Sequence[float]) -> dict[str, float | None]:
    """`setpoint_rate_hz`, `setpoint_gap_max_s`: of the setpoints on the wire while following.

    The gap counts from the start of following to the first setpoint and from the last one to its end as well. None
    without a stretch of following; the rate is None below 3 setpoints.
    """
    spans = [span for span in following_spans(samples) if span[1] > span[0]]
    if not spans:
        return {"setpoint_rate_hz": None, "setpoint_gap_max_s": None}
    inside = [[t for t in sorted(times_s) if first <= t <= last] for first, last in spans]
    marks = [[first, *times, last] for (first, last), times in zip(spans, inside, strict=True)]
    gap_s = max(later - earlier for row in marks for earlier, later in pairwise(row))
    intervals = sum(len(row) - 1 for row in inside if row)
    time_s = sum(row[-1] - row[0] for row in inside if row)
    enough = intervals + 1 >= MIN_SETPOINTS and time_s > 0
    return {"setpoint_rate_hz": intervals / time_s if enough else None, "setpoint_gap_max_s": gap_s}


def commands_after_override(
    times_s: Sequence[float], override_s: float | None, resumed_s: float | None = None
) -> float | None:
    """Number of setpoints later than `override_s`, when the application knew of it; None without an override.

    Those from `resumed_s` on, when the operator started it again, are wanted.
    """
    if override_s is None:
        return None
    end_s = math.inf if resumed_s is None else resumed_s
    return float(sum(override_s < t < end_s for t in times_s))


def limit_violations(setpoints: Sequence[Setpoint], limits: FlightLimits) -> float | None:
    """Number of setpoints on the wire that are not finite, beyond a speed limit, or too sudden a change of speed.

    All zeros may come at once. None when nothing was sent.
    """
    if not setpoints:
        return None
    wrong = [_too_fast(s, limits) for s in setpoints]
    for index in range(1, len(setpoints)):
        wrong[index] = wrong[index] or _too_sudden(setpoints[index - 1], setpoints[index], limits)
    return float(sum(wrong))


def _too_fast(s: Setpoint, limits: FlightLimits) -> bool:
    north, east, down = s.v_ned_m_s
    if not all(math.isfinite(v) for v in (north, east, down, s.yaw_rate_rad_s)):
        return True
    over = (
        math.hypot(north, east) - limits.max_horizontal_m_s,
        -down - limits.max_up_m_s,
        down - limits.max_down_m_s,
        abs(s.yaw_rate_rad_s) - limits.max_yaw_rate_rad_s,
    )
    return max(over) > LIMIT_TOLERANCE


def _too_sudden(before: Setpoint, after: Setpoint, limits: FlightLimits) -> bool:
    (n0, e0, _), (n1, e1, d1) = before.v_ned_m_s, after.v_ned_m_s
    if n1 == e1 == d1 == after.yaw_rate_rad_s == 0.0:
        return False
    step_s = max(after.t_s - before.t_s, MIN_STEP_S)
    return math.hypot(n1 - n0, e1 - e0) > limits.max_accel_m_s2 * step_s + LIMIT_TOLERANCE


def _ground_range_m(s: Sample) -> float:
    return math.dist(s.vehicle_pos_ned_m[:2], s.target_pos_ned_m[:2])
