"""Every frame and angle of the project, documented once, with the rotations between them.

All frames are right-handed. A matrix named `a_from_b` turns the components of a vector in b into those in a.

IMAGE (pixels, continuous, see tracker/box.py)    CAMERA (unit rays; z is the optical axis)

    o------> x  right, 0 .. width                            ^ z  forward, into the scene
    |                                                       /
    |                                                      o------> x  right in the image
    v  y  down, 0 .. height                                |
                                                           v  y  down in the image

GIMBAL, the line of sight (FRD)                   BODY of the vehicle (FRD)

         ^ x  forward, along the optical axis                ^ x  forward, through the nose
        /                                                   /
       o------> y  right                                   o------> y  right
       |                                                   |
       v  z  down                                          v  z  down

NED, local (from the estimator's origin)          HEADING, the base of a gimbal in the VEHICLE frame

         ^ x  north                                          ^ x  where the nose points, levelled
        /                                                   /
       o------> y  east                                    o------> y  right, horizontal
       |                                                   |
       v  z  down                                          v  z  down

Angles, in radians: roll right side down +, pitch nose up +, yaw clockwise from above +, in the order yaw, pitch, roll
(ZYX). An azimuth is counted like yaw and an elevation like pitch, so a target right of the image centre has a
positive azimuth, and a target BELOW the centre has a NEGATIVE elevation.

Gimbal pitch and yaw: in `GimbalFrame.VEHICLE` yaw is measured from the vehicle's heading, in `GimbalFrame.EARTH` from
north. In both, pitch is measured from the horizon and the camera's roll is held level: the vehicle's roll and pitch do
not enter. (MAVLink gimbal protocol v2, flags ROLL_LOCK and PITCH_LOCK.)

Quaternions are unit, (w, x, y, z) as in MAVLink, and carry the same rotation as the matrix `ned_from_body`.
"""

from __future__ import annotations

import math

import numpy as np

from control.messages import GimbalFrame
from tracker.messages import Array

# gimbal x = camera z (forward), gimbal y = camera x (right), gimbal z = camera y (down)
GIMBAL_FROM_CAMERA: Array = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
GIMBAL_FROM_CAMERA.setflags(write=False)

# A quaternion or a direction shorter than this has no direction left in double precision.
MIN_NORM = 1e-9


def wrap_pi(angle_rad: float) -> float:
    """The same angle in (-pi, pi]; NaN when it is not finite."""
    if not math.isfinite(angle_rad):
        return math.nan
    wrapped = math.remainder(angle_rad, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


def rotation_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """Matrix `ned_from_body`, (3, 3), of ZYX Euler angles."""
    sr, cr = math.sin(roll_rad), math.cos(roll_rad)
    sp, cp = math.sin(pitch_rad), math.cos(pitch_rad)
    sy, cy = math.sin(yaw_rad), math.cos(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rpy_from_rotation(ned_from_body: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw of a rotation matrix. At pitch +-90 degrees, where only yaw -+ roll is defined, roll is 0."""
    m = ned_from_body
    pitch_rad = math.atan2(-m[2, 0], math.hypot(m[0, 0], m[1, 0]))
    if math.hypot(m[0, 0], m[1, 0]) < MIN_NORM:
        return 0.0, pitch_rad, math.atan2(-m[0, 1], m[1, 1])
    return math.atan2(m[2, 1], m[2, 2]), pitch_rad, math.atan2(m[1, 0], m[0, 0])


def quaternion_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """Unit quaternion (w, x, y, z), shape (4,), with w >= 0, of ZYX Euler angles."""
    sr, cr = math.sin(roll_rad / 2), math.cos(roll_rad / 2)
    sp, cp = math.sin(pitch_rad / 2), math.cos(pitch_rad / 2)
    sy, cy = math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)
    q = np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )
    return -q if q[0] < 0 else q


def rotation_from_quaternion(q_wxyz: Array) -> Array:
    """Matrix (3, 3) of a quaternion (w, x, y, z) of any length. Raises ValueError when it is zero or not finite."""
    norm = float(np.linalg.norm(q_wxyz))
    if not (math.isfinite(norm) and norm > MIN_NORM):
        raise ValueError(f"quaternion {q_wxyz} has no direction: its length must be finite and above {MIN_NORM}")
    w, x, y, z = np.asarray(q_wxyz, dtype=np.float64) / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rpy_from_quaternion(q_wxyz: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw of a quaternion (w, x, y, z). Raises ValueError when it has no length or is not finite."""
    return rpy_from_rotation(rotation_from_quaternion(q_wxyz))


def quaternion_from_rotation(ned_from_body: Array) -> Array:
    """Unit quaternion (w, x, y, z), shape (4,), with w >= 0, of a rotation matrix; through its Euler angles."""
    return quaternion_from_rpy(*rpy_from_rotation(ned_from_body))


def gimbal_rotation(pitch_rad: float, yaw_rad: float) -> Array:
    """Matrix `base_from_gimbal`, (3, 3); the base is HEADING or NED, whichever the yaw is measured in."""
    return rotation_from_rpy(0.0, pitch_rad, yaw_rad)


def ned_from_gimbal(pitch_rad: float, yaw_rad: float, frame: GimbalFrame, vehicle_yaw_rad: float) -> Array:
    """Matrix (3, 3) from the gimbal's axes to NED. `vehicle_yaw_rad` (right of north +) matters in VEHICLE only."""
    base_yaw_rad = vehicle_yaw_rad if frame is GimbalFrame.VEHICLE else 0.0
    return gimbal_rotation(pitch_rad, yaw_rad + base_yaw_rad)


def direction_from_angles(azimuth_rad: float, elevation_rad: float) -> Array:
    """Unit vector (3,) in an x forward, y right, z down frame; azimuth right +, elevation up +."""
    horizontal = math.cos(elevation_rad)
    return np.array([horizontal * math.cos(azimuth_rad), horizontal * math.sin(azimuth_rad), -math.sin(elevation_rad)])


def angles_from_direction(direction: Array) -> tuple[float, float]:
    """Azimuth (right +) and elevation (up +) of a vector (3,) of any length; azimuth 0 straight up or down."""
    x, y, z = (float(v) for v in direction)
    return math.atan2(y, x), math.atan2(-z, math.hypot(x, y))
