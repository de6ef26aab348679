"""Velocity setpoints: SET_POSITION_TARGET_LOCAL_NED (84) from a VelocityCommand."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega

from control.messages import VelocityCommand
from uavfollow.mavlink.ids import AUTOPILOT_COMPONENT, FRAME_LOCAL_NED, VELOCITY_YAW_RATE_MASK
from uavfollow.mavlink.packer import Message

TIME_BOOT_MODULUS_MS = 2**32  # time_boot_ms is 32 bits and wraps after 49.7 days
FLOAT32_MAX = 3.4028234663852886e38  # what the wire's float carries; beyond it the value would be infinite
_AXES = ("north", "east", "down")


class SetpointError(ValueError):
    """A value that must not reach the wire; names the field. The limiter before this stage is to have stopped it."""


def velocity_setpoint(command: VelocityCommand, target_system: int, now_s: float) -> Message:
    """SET_POSITION_TARGET_LOCAL_NED (84): velocity north, east, down in m/s and yaw rate in rad/s, right +.

    Frame LOCAL_NED, mask 1479, to the autopilot (component 1) of `target_system` (1..255). `now_s` is monotonic
    seconds, sent as `time_boot_ms`. Raises `SetpointError`, also for NaN and infinity.
    """
    if len(command.v_ned_m_s) != len(_AXES):
        raise SetpointError(f"v_ned_m_s has {len(command.v_ned_m_s)} numbers; give north, east and down")
    north, east, down = (
        checked(f"v_ned_m_s ({axis})", value) for axis, value in zip(_AXES, command.v_ned_m_s, strict=True)
    )
    yaw_rate = checked("yaw_rate_rad_s", command.yaw_rate_rad_s)
    unused = 0.0  # never NaN, even where the mask says "ignore"
    return ardupilotmega.MAVLink_set_position_target_local_ned_message(
        time_boot_ms=time_boot_ms(now_s),
        target_system=checked_id("target_system", target_system, 1),
        target_component=AUTOPILOT_COMPONENT,
        coordinate_frame=FRAME_LOCAL_NED,
        type_mask=VELOCITY_YAW_RATE_MASK,
        x=unused,
        y=unused,
        z=unused,
        vx=north,
        vy=east,
        vz=down,
        afx=unused,
        afy=unused,
        afz=unused,
        yaw=unused,
        yaw_rate=yaw_rate,
    )


def time_boot_ms(now_s: float) -> int:
    """Monotonic seconds as the 32-bit milliseconds of MAVLink; wraps. Raises `SetpointError` when not finite."""
    return int(checked("now_s", now_s) * 1000) % TIME_BOOT_MODULUS_MS


def checked(field: str, value: float | None) -> float:
    """`value` as a float that the wire can carry; raises `SetpointError` naming `field` otherwise."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not abs(number) <= FLOAT32_MAX:
        raise SetpointError(f"{field} is {value!r}, not a finite number; nothing is sent, look at the stage before it")
    return number


def checked_id(field: str, value: int, minimum: int) -> int:
    """`value` as a MAVLink id from `minimum` to 255; raises `SetpointError` naming `field` otherwise.

    A minimum of 1 keeps out 0, which addresses every vehicle that hears it.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not minimum <= value <= 255:
        raise SetpointError(f"{field} is {value!r}; give a whole number from {minimum} to 255")
    return value
