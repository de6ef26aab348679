import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.camera import Intrinsics
from control.frames import GIMBAL_FROM_CAMERA, angles_from_direction
from tests.control.builders import CAMERA

OFF_CENTRE = Intrinsics(500.0, 480.0, 300.0, 200.0, 640.0, 360.0)
xs, ys, speeds = st.floats(0, 640), st.floats(0, 360), st.floats(-500, 500)


def test_from_hfov_has_its_principal_point_at_half_the_width():
    assert (CAMERA.cx_px, CAMERA.cy_px) == (320.0, 180.0)
    assert CAMERA.fx_px == CAMERA.fy_px == pytest.approx(492.75, abs=0.01)
    assert CAMERA.sight_angles(640, 180) == pytest.approx((math.radians(33), 0.0))


@pytest.mark.parametrize("name", ["fx_px", "fy_px", "cx_px", "cy_px", "width_px", "height_px"])
@pytest.mark.parametrize("bad", [-1.0, math.nan, math.inf])
def test_bad_intrinsics_name_the_field(name, bad):
    values = {f: getattr(OFF_CENTRE, f) for f in ("fx_px", "fy_px", "cx_px", "cy_px", "width_px", "height_px")}
    with pytest.raises(ValueError, match=f"Intrinsics.{name}"):
        Intrinsics(**(values | {name: bad}))


@pytest.mark.parametrize("hfov", [0.0, -1.0, math.pi, math.nan])
def test_bad_field_of_view_is_refused(hfov):
    with pytest.raises(ValueError, match="hfov_rad"):
        Intrinsics.from_hfov(640, 360, hfov)


@given(xs, ys)
def test_pixel_and_ray_round_trip(x, y):
    ray = OFF_CENTRE.ray(x, y)
    assert np.linalg.norm(ray) == pytest.approx(1.0)
    assert OFF_CENTRE.pixel(12.0 * ray) == pytest.approx((x, y), abs=1e-8)


@pytest.mark.parametrize("ray", [(0, 0, -1), (1, 0, 0), (0, 0, 0), (math.nan, 0, 1)])
def test_nothing_behind_or_beside_the_camera_has_a_pixel(ray):
    assert OFF_CENTRE.pixel(np.array(ray, dtype=float)) is None


@given(xs, ys)
def test_sight_angles_are_those_of_the_ray(x, y):
    expected = angles_from_direction(GIMBAL_FROM_CAMERA @ OFF_CENTRE.ray(x, y))
    assert OFF_CENTRE.sight_angles(x, y) == pytest.approx(expected, abs=1e-12)


def test_right_is_positive_and_below_is_negative():
    azimuth, elevation = CAMERA.sight_angles(400, 300)
    assert azimuth > 0 > elevation


@given(xs, ys, speeds, speeds)
def test_rates_are_the_derivatives(x, y, vx, vy):
    h = 1e-5
    before, after = (x - vx * h, y - vy * h), (x + vx * h, y + vy * h)
    angles = (np.array(OFF_CENTRE.sight_angles(*after)) - OFF_CENTRE.sight_angles(*before)) / (2 * h)
    assert OFF_CENTRE.sight_rate(x, y, vx, vy) == pytest.approx(angles, abs=1e-6)
    ray = (OFF_CENTRE.ray(*after) - OFF_CENTRE.ray(*before)) / (2 * h)
    assert OFF_CENTRE.ray_rate(x, y, vx, vy) == pytest.approx(ray, abs=1e-6)


def test_rate_is_pixels_over_focal_length_only_at_the_centre():
    assert CAMERA.sight_rate(320, 180, 100, 0)[0] == pytest.approx(100 / CAMERA.fx_px)
    assert CAMERA.sight_rate(640, 180, 100, 0)[0] == pytest.approx(100 / CAMERA.fx_px * math.cos(math.radians(33)) ** 2)
