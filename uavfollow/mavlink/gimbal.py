"""Gimbal messages: GIMBAL_MANAGER_SET_ATTITUDE (282) and taking or releasing control (command 1001).

282 is what both ArduPilot and PX4 handle; PX4 ignores GIMBAL_MANAGER_SET_PITCHYAW (287).
"""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega

from control.messages import GimbalCommand, GimbalFrame
from uavfollow.mavlink.ids import (
    AUTOPILOT_COMPONENT,
    CMD_GIMBAL_MANAGER_CONFIGURE,
    CONFIGURE_KEEP,
    CONFIGURE_RELEASE,
    FOLLOW_FLAGS,
    LOCK_FLAGS,
)
from uavfollow.mavlink.packer import Message
from uavfollow.mavlink.setpoints import checked, checked_id

# At exactly straight down the receiver's Euler angles of a float32 quaternion lose the yaw (it comes out as noise);
# 0.1 degrees short of it the yaw is right to 0.01 degrees.
MAX_PITCH_RAD = math.radians(89.9)
_IGNORED = math.nan  # what 282 means by "not commanded"
_FLAGS = {GimbalFrame.VEHICLE: FOLLOW_FLAGS, GimbalFrame.EARTH: LOCK_FLAGS}


def gimbal_rate(
    command: GimbalCommand, device_id: int, target_system: int, manager_component: int = AUTOPILOT_COMPONENT
) -> Message:
    """GIMBAL_MANAGER_SET_ATTITUDE (282) with rates in rad/s (pitch up +, yaw right +) and a quaternion of NaN.

    `device_id` 0 means all gimbals of the manager. ArduPilot turns on for ever after one such message: end with a
    zero rate. Raises `SetpointError`.
    """
    pitch_rate = checked("pitch_rate_rad_s", command.pitch_rate_rad_s)
    yaw_rate = checked("yaw_rate_rad_s", command.yaw_rate_rad_s)
    # The roll rate is 0, not NaN: ArduPilot stores it unchecked and some gimbal drivers fail on it.
    rates = (0.0, pitch_rate, yaw_rate)
    return _set_attitude(command, device_id, target_system, manager_component, [_IGNORED] * 4, rates)


def gimbal_angle(
    command: GimbalCommand, device_id: int, target_system: int, manager_component: int = AUTOPILOT_COMPONENT
) -> Message:
    """GIMBAL_MANAGER_SET_ATTITUDE (282) with the angles in rad (pitch up +, yaw right +), roll 0 and rates of NaN.

    Pitch is held within `MAX_PITCH_RAD`. `device_id` 0 means all gimbals of the manager. Raises `SetpointError`, also
    when the command has no angles.
    """
    pitch = max(-MAX_PITCH_RAD, min(MAX_PITCH_RAD, checked("pitch_rad", command.pitch_rad)))
    yaw = checked("yaw_rad", command.yaw_rad)
    rates = (_IGNORED, _IGNORED, _IGNORED)
    return _set_attitude(command, device_id, target_system, manager_component, _quaternion(pitch, yaw), rates)


def gimbal_take_control(
    own_system: int,
    own_component: int,
    target_system: int,
    device_id: int = 0,
    manager_component: int = AUTOPILOT_COMPONENT,
) -> Message:
    """COMMAND_LONG (76) DO_GIMBAL_MANAGER_CONFIGURE (1001): primary control to the ids given, secondary unchanged.

    Explicit ids: PX4 reads the "-2, myself" of the standard as the autopilot. Raises `SetpointError`.
    """
    primary = (
        float(checked_id("own_system", own_system, 1)),
        float(checked_id("own_component", own_component, 1)),
    )
    return _configure(primary, target_system, device_id, manager_component)


def gimbal_release_control(
    target_system: int, device_id: int = 0, manager_component: int = AUTOPILOT_COMPONENT
) -> Message:
    """COMMAND_LONG (76) DO_GIMBAL_MANAGER_CONFIGURE (1001): give primary control up if it is ours.

    Raises `SetpointError`.
    """
    return _configure((CONFIGURE_RELEASE, CONFIGURE_RELEASE), target_system, device_id, manager_component)


def _set_attitude(
    command: GimbalCommand,
    device_id: int,
    target_system: int,
    manager_component: int,
    quaternion: list[float],
    rates_rad_s: tuple[float, float, float],
) -> Message:
    return ardupilotmega.MAVLink_gimbal_manager_set_attitude_message(
        target_system=checked_id("target_system", target_system, 1),
        target_component=checked_id("manager_component", manager_component, 1),
        flags=_FLAGS[command.frame],
        gimbal_device_id=checked_id("device_id", device_id, 0),
        q=quaternion,
        angular_velocity_x=rates_rad_s[0],
        angular_velocity_y=rates_rad_s[1],
        angular_velocity_z=rates_rad_s[2],
    )


def _configure(primary: tuple[float, float], target_system: int, device_id: int, manager_component: int) -> Message:
    return ardupilotmega.MAVLink_command_long_message(
        target_system=checked_id("target_system", target_system, 1),
        target_component=checked_id("manager_component", manager_component, 1),
        command=CMD_GIMBAL_MANAGER_CONFIGURE,
        confirmation=0,
        param1=primary[0],
        param2=primary[1],
        param3=CONFIGURE_KEEP,
        param4=CONFIGURE_KEEP,
        param5=0.0,
        param6=0.0,
        param7=float(checked_id("device_id", device_id, 0)),
    )


def _quaternion(pitch_rad: float, yaw_rad: float) -> list[float]:
    """Yaw, then pitch, roll 0; w, x, y, z."""
    cos_pitch, sin_pitch = math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
    cos_yaw, sin_yaw = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    return [cos_yaw * cos_pitch, -sin_yaw * sin_pitch, cos_yaw * sin_pitch, sin_yaw * cos_pitch]
