from __future__ import annotations

import math

import numpy as np
import pytest

from sitl.render.post import BLUR_FROM_PX, Post, blur_way_px, line_kernel
from sitl.render.projection import View
from sitl.scene import CameraModel, CameraPose

CAMERA = CameraModel(320, 240, exposure_s=0.01)
FOCAL = 160 / math.tan(CAMERA.hfov_rad / 2)


def way(
    rates: tuple[float, float, float], velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[float, float]:
    pose = CameraPose((0.0, 0.0, -10.0), 0.0, -math.pi / 2, 0.0, rates, velocity)
    return blur_way_px(CAMERA, View(CAMERA, pose), pose, 1.0)


def test_the_scene_moves_against_the_camera() -> None:
    assert way((0.0, 0.0, 1.0)) == pytest.approx((-FOCAL * 0.01, 0.0), abs=1e-9)  # turns right: scene goes left
    assert way((0.0, 1.0, 0.0)) == pytest.approx((0.0, FOCAL * 0.01), abs=1e-9)  # nose up: scene goes down
    # Straight down from 10 m, the top of the picture is north: flying north the scene goes down, flying east left.
    assert way((0.0, 0.0, 0.0), (5.0, 0.0, 0.0)) == pytest.approx((0.0, FOCAL * 0.5 * 0.01), abs=1e-9)
    assert way((0.0, 0.0, 0.0), (0.0, 5.0, 0.0)) == pytest.approx((-FOCAL * 0.5 * 0.01, 0.0), abs=1e-9)


@pytest.mark.parametrize("vector", [(5.0, 0.0), (0.0, -7.0), (3.0, 4.0), (-2.5, 0.7)])
def test_line_kernel_is_even_and_as_long_as_the_way(vector: tuple[float, float]) -> None:
    kernel = line_kernel(vector)
    assert kernel.sum() == pytest.approx(1.0)
    assert kernel == pytest.approx(kernel[::-1, ::-1])
    y, x = np.indices(kernel.shape) - (np.array(kernel.shape) // 2)[:, None, None]
    along = (x * vector[0] + y * vector[1]) / math.hypot(*vector)
    length = math.hypot(*vector)
    # Variance of an even line is length^2 / 12; the pixels' own width adds up to a quarter.
    assert float((kernel * along**2).sum()) == pytest.approx(length**2 / 12, abs=0.26)


def test_fast_turns_blur_and_slow_ones_do_not() -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(40, 200, (240, 320, 3)).astype(np.uint8)
    post = Post(CAMERA, 0, False, 1.0)

    def contrast(rate: float) -> float:
        pose = CameraPose((0.0, 0.0, -10.0), 0.0, -1.0, 0.0, (0.0, 0.0, rate))
        return float(np.diff(post.apply(image.copy(), View(CAMERA, pose), pose, 1).astype(float), axis=1).std())

    slow = 0.5 * BLUR_FROM_PX / FOCAL / 0.01
    assert contrast(0.0) == contrast(slow)
    assert contrast(2.0) < 0.6 * contrast(0.0)


def test_noise_has_its_size_and_follows_the_frame() -> None:
    post = Post(CAMERA, 0, False, 1.0)
    pose = CameraPose((0.0, 0.0, -10.0), 0.0, -1.0, 0.0)
    grey = np.full((240, 320, 3), 128, np.uint8)
    a, b = (post.apply(grey.copy(), View(CAMERA, pose), pose, i).astype(float) for i in (1, 2))
    assert float((a - b).std()) / math.sqrt(2) == pytest.approx(2.5, abs=0.4)
    again = post.apply(grey.copy(), View(CAMERA, pose), pose, 1)
    assert np.array_equal(again, a)
    assert a[:20, :20].mean() < a[110:130, 150:170].mean() - 8  # darker corners
