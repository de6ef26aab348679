import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.frames import (
    GIMBAL_FROM_CAMERA,
    angles_from_direction,
    direction_from_angles,
    gimbal_rotation,
    ned_from_gimbal,
    quaternion_from_rotation,
    quaternion_from_rpy,
    rotation_from_quaternion,
    rotation_from_rpy,
    rpy_from_quaternion,
    rpy_from_rotation,
    wrap_pi,
)
from control.messages import GimbalFrame

turn = st.floats(-3.1, 3.1)
tilt = st.floats(-1.55, 1.55)


@given(turn, tilt, turn)
def test_euler_angles_survive_matrix_and_quaternion(roll, pitch, yaw):
    matrix = rotation_from_rpy(roll, pitch, yaw)
    assert np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    assert rpy_from_rotation(matrix) == pytest.approx((roll, pitch, yaw), abs=1e-9)
    quaternion = quaternion_from_rpy(roll, pitch, yaw)
    assert quaternion[0] >= 0
    assert np.linalg.norm(quaternion) == pytest.approx(1.0)
    assert np.allclose(rotation_from_quaternion(quaternion), matrix, atol=1e-12)
    assert np.allclose(rotation_from_quaternion(-3.0 * quaternion), matrix, atol=1e-12)
    assert rpy_from_quaternion(quaternion) == pytest.approx((roll, pitch, yaw), abs=1e-9)
    assert np.allclose(rotation_from_quaternion(quaternion_from_rotation(matrix)), matrix, atol=1e-9)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
@pytest.mark.parametrize("yaw", [-2.0, 0.0, 1.0])
def test_straight_up_and_down_keep_the_rotation(pitch, yaw):
    matrix = rotation_from_rpy(0.3, pitch, yaw)
    roll, pitch_back, yaw_back = rpy_from_rotation(matrix)
    assert (roll, pitch_back) == pytest.approx((0.0, pitch))
    assert np.allclose(rotation_from_rpy(roll, pitch_back, yaw_back), matrix, atol=1e-9)


@pytest.mark.parametrize(
    ("angles", "body", "ned"),
    [
        ((0, 0, math.pi / 2), (1, 0, 0), (0, 1, 0)),  # yaw right of north: the nose points east
        ((0, math.pi / 2, 0), (1, 0, 0), (0, 0, -1)),  # pitch up: the nose points up
        ((math.pi / 2, 0, 0), (0, 1, 0), (0, 0, 1)),  # roll right: the right side points down
    ],
)
def test_signs_of_roll_pitch_yaw(angles, body, ned):
    assert np.allclose(rotation_from_rpy(*angles) @ np.array(body, dtype=float), ned, atol=1e-12)


def test_a_yaw_quaternion_is_w_first():
    assert np.allclose(quaternion_from_rpy(0, 0, math.pi / 2), [math.sqrt(0.5), 0, 0, math.sqrt(0.5)])


@pytest.mark.parametrize("bad", [[0, 0, 0, 0], [math.nan, 0, 0, 1], [math.inf, 0, 0, 0]])
def test_a_quaternion_without_direction_is_refused(bad):
    with pytest.raises(ValueError, match="quaternion"):
        rotation_from_quaternion(np.array(bad, dtype=float))


def test_camera_axes_to_gimbal_axes():
    assert np.array_equal(GIMBAL_FROM_CAMERA @ [0, 0, 1.0], [1, 0, 0])  # optical axis is forward
    assert np.array_equal(GIMBAL_FROM_CAMERA @ [1.0, 0, 0], [0, 1, 0])  # right is right
    assert np.array_equal(GIMBAL_FROM_CAMERA @ [0, 1.0, 0], [0, 0, 1])  # down is down


@given(turn, st.floats(-1.5, 1.5))
def test_directions_and_angles_round_trip(azimuth, elevation):
    direction = direction_from_angles(azimuth, elevation)
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    assert angles_from_direction(7.0 * direction) == pytest.approx((azimuth, elevation), abs=1e-9)
    # the optical axis of a gimbal points where its pitch and yaw say
    assert np.allclose(gimbal_rotation(elevation, azimuth)[:, 0], direction, atol=1e-12)


def test_angles_of_right_and_down():
    assert angles_from_direction(np.array([1.0, 1.0, 0.0])) == pytest.approx((math.pi / 4, 0.0))
    assert angles_from_direction(np.array([1.0, 0.0, 1.0])) == pytest.approx((0.0, -math.pi / 4))


def test_gimbal_frames_differ_by_the_heading():
    follow = ned_from_gimbal(-0.5, 0.2, GimbalFrame.VEHICLE, 1.0)
    lock = ned_from_gimbal(-0.5, 1.2, GimbalFrame.EARTH, 1.0)
    assert np.allclose(follow, lock)
    assert np.allclose(lock, ned_from_gimbal(-0.5, 1.2, GimbalFrame.EARTH, -2.0))


@given(st.floats(-1000, 1000))
def test_wrap_pi_is_the_same_angle_in_range(angle):
    wrapped = wrap_pi(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0)


def test_wrap_pi_at_the_seam_and_not_finite():
    assert wrap_pi(-math.pi) == math.pi
    assert wrap_pi(math.pi) == math.pi
    assert all(math.isnan(wrap_pi(v)) for v in (math.nan, math.inf, -math.inf))
