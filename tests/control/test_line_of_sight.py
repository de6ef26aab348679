import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from control.frames import GIMBAL_FROM_CAMERA, angles_from_direction, direction_from_angles, gimbal_rotation, wrap_pi
from control.line_of_sight import MIN_COS, joint_error, joint_rate, sight_in_base
from tests.control.builders import CAMERA, CENTRE, pixel_of

pitches = st.floats(-1.2, 0.5)
yaws = st.floats(-3.1, 3.1)
offsets = st.floats(-0.2, 0.2)


@given(pitches, yaws, offsets, offsets)
def test_error_is_what_the_joints_lack(pitch, yaw, up, right):
    elevation, azimuth = pitch + up, yaw + right
    assume(elevation > -1.35)
    pixel = pixel_of(azimuth, elevation, pitch, yaw)
    sight = sight_in_base(CAMERA, *pixel, pitch, yaw)
    assert joint_error(sight, pitch, yaw) == pytest.approx((up, right), abs=1e-9)


def test_picture_error_grows_by_the_cosine_of_the_pitch():
    pitch = math.radians(-60)
    sight = sight_in_base(CAMERA, CENTRE[0] + 5, CENTRE[1], pitch, 0.0)
    assert joint_error(sight, pitch, 0.0)[1] == pytest.approx(5 / CAMERA.fx_px / math.cos(pitch), rel=1e-3)


@pytest.mark.parametrize("pitch_deg", [-80, -85, -89, -90])
def test_yaw_gain_is_bounded_near_nadir(pitch_deg):
    pitch = math.radians(pitch_deg)
    sight = sight_in_base(CAMERA, CENTRE[0] + 2, CENTRE[1], pitch, 0.0)
    assert 0 < joint_error(sight, pitch, 0.0)[1] <= math.pi / 2 / MIN_COS * 2 / CAMERA.fx_px


def test_a_target_beside_nadir_turns_before_it_pitches():
    pitch = -math.pi / 2
    pitch_error, yaw_error = joint_error(direction_from_angles(math.pi / 2, math.radians(-88)), pitch, 0.0)
    assert yaw_error > 0
    assert abs(pitch_error) < math.radians(2) * 0.25  # not lifted away from the target


@given(pitches, yaws, offsets, offsets, st.floats(-1, 1), st.floats(-1, 1), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_rate_is_that_of_the_target_whatever_the_camera_does(pitch, yaw, up, right, el_rate, az_rate, p_rate, y_rate):
    assume(pitch + up > -1.35)
    h = 1e-6

    def pixel(t):
        return np.array(
            pixel_of(yaw + right + az_rate * t, pitch + up + el_rate * t, pitch + p_rate * t, yaw + y_rate * t)
        )

    velocity = (pixel(h) - pixel(-h)) / (2 * h)
    sight = sight_in_base(CAMERA, *pixel(0), pitch, yaw)
    apparent = gimbal_rotation(pitch, yaw) @ GIMBAL_FROM_CAMERA @ CAMERA.ray_rate(*pixel(0), *velocity)
    assert joint_rate(sight, apparent, (p_rate, y_rate), yaw) == pytest.approx((el_rate, az_rate), abs=1e-4)


def test_rate_is_finite_at_nadir():
    sight = np.array([0.0, 0.0, 1.0])
    assert np.isfinite(joint_rate(sight, np.array([0.1, 0.1, 0.0]), (1.0, 1.0), 0.0)).all()


@given(pitches, yaws, st.floats(0, 640), st.floats(0, 360))
def test_mirrored_picture_gives_mirrored_error(pitch, yaw, x, y):
    pitch_a, yaw_a = joint_error(sight_in_base(CAMERA, x, y, pitch, yaw), pitch, yaw)
    pitch_b, yaw_b = joint_error(sight_in_base(CAMERA, 640 - x, y, pitch, yaw), pitch, yaw)
    assert pitch_a == pytest.approx(pitch_b, abs=1e-9)
    assert wrap_pi(yaw_a + yaw_b) == pytest.approx(0.0, abs=1e-9)


def test_error_across_the_seam_is_the_short_way():
    sight = direction_from_angles(-3.0, 0.0)
    assert joint_error(sight, 0.0, 3.0)[1] == pytest.approx(math.tau - 6.0)
    assert angles_from_direction(sight)[0] == pytest.approx(-3.0)
