"""The questions every law asks first: is the target usable, is the telemetry usable."""

from __future__ import annotations

import math

import numpy as np

from control.messages import CommandReason, GimbalState, VehicleState
from tracker.messages import TargetReason, TargetState, TargetStatus

# Older estimates are not acted on: the low end of the 0.3-0.5 s that a control decision may rest on (mavlink.md, 5).
MAX_TARGET_AGE_S = 0.3
# A command is made for the moment it is sent in; one as old as a target may be rests on an older one.
MAX_COMMAND_AGE_S = 0.3
# Telemetry comes at 10 Hz or more; five missing messages mean that it has stopped.
MAX_TELEMETRY_AGE_S = 0.5
# A stamp may lie this far ahead of `now` through clock alignment (two frames at 30 Hz); more is a broken clock.
MAX_CLOCK_LEAD_S = 0.07
# No pixel, metre, radian or second of a flight is this large; such a value is garbage and its square may overflow.
MAX_MAGNITUDE = 1e12


def all_finite(*values: float) -> bool:
    """True when every value is finite and no larger than `MAX_MAGNITUDE`."""
    return all(abs(v) <= MAX_MAGNITUDE for v in values)


def is_fresh(t_s: float, now_s: float, max_age_s: float) -> bool:
    """True when a stamp is at most `max_age_s` old and not from the future; False when either is not finite."""
    return -MAX_CLOCK_LEAD_S <= now_s - t_s <= max_age_s


def target_hold(target: TargetState, now_s: float) -> CommandReason | None:
    """Why this target must not be acted on, or None. Only LOCKED and COASTING may move anything.

    ACQUIRING holds: the box is the operator's click and may still turn out to be wrong, and to move the camera then
    blurs the very frames that confirm it.
    """
    if not _is_finite(target, now_s):
        return CommandReason.HOLD_NOT_FINITE
    if target.reason is TargetReason.FAULT:
        return CommandReason.HOLD_FAULT
    if target.status not in (TargetStatus.LOCKED, TargetStatus.COASTING) or target.box is None:
        return CommandReason.HOLD_NO_TARGET
    if not is_fresh(target.t_s, now_s, MAX_TARGET_AGE_S):
        return CommandReason.HOLD_STALE_TARGET
    return None if target.box.is_valid else CommandReason.HOLD_NO_TARGET


def gimbal_usable(gimbal: GimbalState, now_s: float) -> bool:
    """Valid, finite and fresh."""
    finite = all_finite(gimbal.pitch_rad, gimbal.yaw_rad)
    return gimbal.valid and finite and is_fresh(gimbal.t_s, now_s, MAX_TELEMETRY_AGE_S)


def telemetry_hold(vehicle: VehicleState, gimbal: GimbalState, now_s: float) -> CommandReason | None:
    """Why the vehicle must not be flown on this telemetry, or None. Attitude, position and gimbal are all needed."""
    if not (vehicle.attitude_valid and vehicle.position_valid and gimbal.valid):
        return CommandReason.HOLD_NO_TELEMETRY
    vehicle_values = (vehicle.t_s, vehicle.roll_rad, vehicle.pitch_rad, vehicle.yaw_rad)
    gimbal_values = (gimbal.t_s, gimbal.pitch_rad, gimbal.yaw_rad)
    if not all_finite(*vehicle_values, *vehicle.pos_ned_m, *vehicle.vel_ned_m_s, *gimbal_values):
        return CommandReason.HOLD_NOT_FINITE
    fresh = all(is_fresh(t_s, now_s, MAX_TELEMETRY_AGE_S) for t_s in (vehicle.t_s, gimbal.t_s))
    return None if fresh else CommandReason.HOLD_NO_TELEMETRY


def _is_finite(target: TargetState, now_s: float) -> bool:
    values = [now_s, target.t_s, *target.vel_px_s, target.growth_per_s, target.confidence]
    if target.box is not None:
        values += [target.box.cx_px, target.box.cy_px, target.box.w_px, target.box.h_px]
    return all_finite(*values) and (target.cov is None or bool((np.abs(target.cov) <= MAX_MAGNITUDE).all()))


# What the reports of 50 and 25 Hz may disagree by in a hard turn; a reset of the estimator is metres.
MAX_POSITION_JUMP_M = 1.5
# Faster than this no vehicle that is followed with turns; a reset of the heading comes at once.
MAX_TURN_RAD_S = 4.0
# Interpolation and rounding of two headings a frame apart.
TURN_SLACK_RAD = 0.1


def has_jumped(before: VehicleState, after: VehicleState) -> bool:
    """Whether position or heading changed by more than the vehicle can move: the estimator was reset, the vehicle not.

    False when the two are not of one flight of reports: more than a second apart, not valid or not finite.
    """
    dt_s = after.t_s - before.t_s
    values = [v for s in (before, after) for v in (s.yaw_rad, *s.pos_ned_m, *s.vel_ned_m_s)]
    if not 0 < dt_s <= 1.0 or not all_finite(*values):
        return False
    if before.attitude_valid and after.attitude_valid:
        turn = math.remainder(after.yaw_rad - before.yaw_rad, math.tau)
        if abs(turn) > MAX_TURN_RAD_S * dt_s + TURN_SLACK_RAD:
            return True
    if not (before.position_valid and after.position_valid):
        return False
    expected = [dt_s * (a + b) / 2 for a, b in zip(before.vel_ned_m_s, after.vel_ned_m_s, strict=True)]
    moved = [b - a for a, b in zip(before.pos_ned_m, after.pos_ned_m, strict=True)]
    return math.dist(expected, moved) > MAX_POSITION_JUMP_M
