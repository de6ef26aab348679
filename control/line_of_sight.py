"""From a pixel to what the two joints of a yaw-pitch gimbal must do.

The gimbal's base is HEADING or NED (control/frames.py). The direction of the target is computed in the base; its
azimuth and elevation are the joint angles that would centre it. This is exact for any pitch: an azimuth error e in the
picture is a yaw error of about e / cos(pitch).

Straight up and down (the poles) the yaw joint turns about the line of sight and azimuth is not defined. Within about 10
degrees of a pole the yaw demand fades, so that its gain over the picture's error is at most 1 / `MIN_COS`.
"""

from __future__ import annotations

import math

import numpy as np

from control.camera import Intrinsics
from control.frames import GIMBAL_FROM_CAMERA, angles_from_direction, gimbal_rotation, wrap_pi
from tracker.messages import Array

# cos of 80 degrees: bounds the yaw gain to 5.8 times that at the horizon, and pixel noise in yaw likewise.
MIN_COS = math.cos(math.radians(80.0))
# Up to here yaw and pitch work together (no target in a picture of 90 degrees is further off at pitch 0); from here to
# 90 degrees the pitch demand falls to zero.
FULL_PITCH_YAW_RAD = math.radians(60.0)


def sight_in_base(intrinsics: Intrinsics, x_px: float, y_px: float, pitch_rad: float, yaw_rad: float) -> Array:
    """Unit vector (3,) of a pixel's line of sight in the gimbal's base (x forward or north, y right, z down)."""
    base: Array = gimbal_rotation(pitch_rad, yaw_rad) @ GIMBAL_FROM_CAMERA @ intrinsics.ray(x_px, y_px)
    return base


def joint_error(sight: Array, pitch_rad: float, yaw_rad: float) -> tuple[float, float]:
    """How far the pitch and the yaw joint are from the direction `sight` (3,), base axes: pitch up +, yaw right +.

    The yaw error fades near a pole, where a small error in the picture is a large one at the joint. The pitch error
    fades when yaw has more than `FULL_PITCH_YAW_RAD` to go: a target beside or behind the pole is not reached by
    pitching up, which would turn the camera away from it.
    """
    azimuth_rad, elevation_rad = angles_from_direction(sight)
    yaw_error = wrap_pi(azimuth_rad - yaw_rad)
    pitch_error = elevation_rad - pitch_rad
    facing = min(1.0, max(0.0, math.cos(yaw_error) / math.cos(FULL_PITCH_YAW_RAD)))
    return pitch_error * facing, yaw_error * pole_weight(pitch_rad, elevation_rad)


def joint_rate(
    sight: Array, sight_rate: Array, camera_rate_rad_s: tuple[float, float], yaw_rad: float
) -> tuple[float, float]:
    """Elevation and azimuth rate (rad/s) of a target in the base: what the joints must do to stay with it.

    `sight` (3,) and `sight_rate` (3,) are the line of sight and its apparent velocity with the camera taken as still,
    both in base axes; `camera_rate_rad_s` is the pitch and yaw rate of the joints at the same time, which is added.
    """
    pitch_rate, yaw_rate = camera_rate_rad_s
    pitch_axis = np.array([-math.sin(yaw_rad), math.cos(yaw_rad), 0.0])
    spin = np.array([0.0, 0.0, yaw_rate]) + pitch_rate * pitch_axis
    x, y, _ = (float(v) for v in sight)
    vx, vy, vz = (float(v) for v in sight_rate + np.cross(spin, sight))
    horizontal = max(math.hypot(x, y), MIN_COS)
    return -vz / horizontal, (x * vy - y * vx) / horizontal**2


def pole_weight(pitch_rad: float, elevation_rad: float) -> float:
    """1 away from the poles, falling to 0 when the camera and the target are both at one."""
    return min(1.0, max(abs(math.cos(pitch_rad)), abs(math.cos(elevation_rad))) / MIN_COS)
