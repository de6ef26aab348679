"""Where the camera under the gimbal is and how it moves: the chain vehicle, gimbal, camera, put together exactly."""

from __future__ import annotations

import math

from sitl.plant.gimbal import GimbalPlant
from sitl.plant.quadrotor import Quadrotor
from sitl.scene import CameraPose, Vector

_Matrix = tuple[Vector, Vector, Vector]

# The camera of a small quadrotor hangs a hand's breadth ahead of and below the centre of gravity.
DEFAULT_MOUNT_OFFSET_M: Vector = (0.10, 0.0, 0.12)


def camera_pose(quad: Quadrotor, gimbal: GimbalPlant, mount_offset_m: Vector = DEFAULT_MOUNT_OFFSET_M) -> CameraPose:
    """The pose of the optical axes at this instant; `mount_offset_m` is (forward, right, down) in the body.

    Yaw = heading + gimbal yaw + misalignment, pitch = gimbal pitch + misalignment, roll = misalignment; the tilt that
    the gimbal's stabilisation lets through turns all of it. Rates are about the optical axes.
    """
    p = gimbal.params
    heading = quad.yaw_rad
    leak_roll, leak_pitch = gimbal.leak_rad
    base = _rotation(leak_roll, leak_pitch, heading)
    head = _product(base, _rotation(0.0, 0.0, gimbal.yaw_rad + p.misalignment_yaw_rad))
    pitch = gimbal.pitch_rad + p.misalignment_pitch_rad
    optical = _product(head, _rotation(p.misalignment_roll_rad, pitch, 0.0))

    leak_roll_rate, leak_pitch_rate = gimbal.leak_rates_rad_s
    turning = quad.euler_rates_rad_s[2]
    c, s = math.cos(heading), math.sin(heading)
    base_rate = (c * leak_roll_rate - s * leak_pitch_rate, s * leak_roll_rate + c * leak_pitch_rate, turning)
    spin_ned = _sum(
        base_rate,
        _sum(_apply(base, (0.0, 0.0, gimbal.yaw_rate_rad_s)), _apply(head, (0.0, gimbal.pitch_rate_rad_s, 0.0))),
    )
    body = _rotation(quad.roll_rad, quad.pitch_rad, heading)
    arm = _apply(body, mount_offset_m)
    swing = _apply(body, _cross(quad.rates_rad_s, mount_offset_m))
    roll, pitch, yaw = _euler(optical)
    return CameraPose(
        pos_ned_m=_sum(quad.pos_ned_m, arm),
        roll_rad=roll,
        pitch_rad=pitch,
        yaw_rad=yaw,
        rates_rad_s=_apply_transposed(optical, spin_ned),
        vel_ned_m_s=_sum(quad.vel_ned_m_s, swing),
    )


def _rotation(roll: float, pitch: float, yaw: float) -> _Matrix:
    """Columns are the turned axes: vector in the turned frame -> vector in the frame that it was turned from."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def _euler(m: _Matrix) -> Vector:
    """Roll, pitch, yaw of a rotation; straight up or down the roll is 0 and yaw tells the rest."""
    sine = max(-1.0, min(1.0, -m[2][0]))
    if abs(sine) > 1.0 - 1e-12:
        return 0.0, math.copysign(math.pi / 2.0, sine), math.atan2(-m[0][1], m[1][1])
    return math.atan2(m[2][1], m[2][2]), math.asin(sine), math.atan2(m[1][0], m[0][0])


def _product(a: _Matrix, b: _Matrix) -> _Matrix:
    x, y, z = (_apply(a, (b[0][j], b[1][j], b[2][j])) for j in range(3))
    return (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])


def _apply(m: _Matrix, v: Vector) -> Vector:
    return (
        m[0][0] * v[0] + m[0][1] * v[1] + m[0][2] * v[2],
        m[1][0] * v[0] + m[1][1] * v[1] + m[1][2] * v[2],
        m[2][0] * v[0] + m[2][1] * v[1] + m[2][2] * v[2],
    )


def _apply_transposed(m: _Matrix, v: Vector) -> Vector:
    return (
        m[0][0] * v[0] + m[1][0] * v[1] + m[2][0] * v[2],
        m[0][1] * v[0] + m[1][1] * v[1] + m[2][1] * v[2],
        m[0][2] * v[0] + m[1][2] * v[1] + m[2][2] * v[2],
    )


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]
