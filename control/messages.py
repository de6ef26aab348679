"""What travels from the estimate to the wire: telemetry in, commands out.

Radians, metres, seconds; NED and FRD axes (control/frames.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class CommandReason(str, Enum):
    """Why a command is what it is; logged with every step. A `hold_` reason always means zero, at once."""

    TRACKING = "tracking"
    COASTING = "coasting"  # led by a prediction: horizontal speed may fall, never rise
    TOO_CLOSE = "too_close"  # nothing may lead towards the target; it may still retreat
    NO_RANGE = "no_range"  # it may turn, but neither approach nor retreat
    HOLD_NO_TARGET = "hold_no_target"
    HOLD_STALE_TARGET = "hold_stale_target"
    HOLD_STALE_COMMAND = "hold_stale_command"
    HOLD_NO_TELEMETRY = "hold_no_telemetry"
    HOLD_NOT_FINITE = "hold_not_finite"
    HOLD_FAILSAFE = "hold_failsafe"  # the autopilot reports a critical state and has not left the mode yet
    HOLD_FAULT = "hold_fault"  # an error in the estimate or a law; the record's `fault` says which
    LIMITED = "limited"


class GimbalFrame(str, Enum):
    """What gimbal yaw is measured from: the vehicle's heading (follow) or north (lock)."""

    VEHICLE = "vehicle"
    EARTH = "earth"


@dataclass(frozen=True, slots=True)
class VehicleState:
    """Vehicle telemetry at `t_s` (our clock). Euler angles roll right +, pitch up +, yaw right of north +.

    `pos_ned_m` and `vel_ned_m_s` are north, east, down from the estimator's origin. A group is used only when its
    `*_valid` flag is set. `source` names where it came from (for example a MAVLink component, or "assumed").
    """

    t_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    pos_ned_m: tuple[float, float, float]
    vel_ned_m_s: tuple[float, float, float]
    attitude_valid: bool
    position_valid: bool
    source: str


@dataclass(frozen=True, slots=True)
class GimbalState:
    """Where the camera points at `t_s`: pitch up +, yaw right +, measured in `frame`; roll is held level."""

    t_s: float
    pitch_rad: float
    yaw_rad: float
    frame: GimbalFrame
    valid: bool
    source: str


@dataclass(frozen=True, slots=True)
class GimbalCommand:
    """A rate (pitch up +, yaw right +) and, where the gimbal is to be driven by angles, the angle to go to."""

    pitch_rate_rad_s: float
    yaw_rate_rad_s: float
    pitch_rad: float | None
    yaw_rad: float | None
    frame: GimbalFrame
    t_s: float
    reason: CommandReason


@dataclass(frozen=True, slots=True)
class VelocityCommand:
    """Velocity north, east, down and a yaw rate (right +) for the vehicle."""

    v_ned_m_s: tuple[float, float, float]
    yaw_rate_rad_s: float
    t_s: float
    reason: CommandReason


@dataclass(frozen=True, slots=True)
class FlightStatus:
    """What the autopilot says of itself, with the times (our clock) it was heard; -inf = never.

    `accepts_setpoints`: the mode is the one in which it obeys velocity setpoints (ArduPilot GUIDED). `mode` names it
    for logs. `failsafe`: it reports a critical or emergency state. `airborne`: landed state "in the air", so neither on
    the ground nor in take-off or landing. `position_good`: its estimator has a position. `t_timesync_s`: when it last
    answered quickly to a question about its time, so that what comes over the link is known to be young.
    """

    t_heartbeat_s: float
    mode: str
    accepts_setpoints: bool
    armed: bool
    failsafe: bool
    t_landed_state_s: float
    airborne: bool
    position_good: bool
    t_timesync_s: float
