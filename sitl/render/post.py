"""The camera's own part in a picture: motion blur, lens blur, darker corners, noise of the sensor."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from sitl.render.projection import View
from sitl.scene import CameraModel, CameraPose

FloatArray = npt.NDArray[np.float64]
ImageU8 = npt.NDArray[np.uint8]

LENS_SIGMA_PX = 0.5
BLUR_FROM_PX = 0.7  # a shorter way during the exposure is not seen
BLUR_MOST_PX = 41.0  # a longer one leaves nothing to see either
CORNER_LOSS = 0.16  # light missing in the corners
NOISE_SIGMA = 2.1  # of 255, common to the channels
COLOUR_NOISE_SIGMA = 1.3  # of each channel on its own
NOISE_FRAMES = 3  # drawn ahead; a picture takes a random part of one
NOISE_MARGIN_PX = 61


class Post:
    """The chain after drawing. The noise of a picture follows from the seed and the number of the frame alone."""

    def __init__(self, camera: CameraModel, seed: int, mirrored: bool, scale: float) -> None:
        self._camera, self._seed, self._mirrored, self._scale = camera, seed, mirrored, scale
        self._vignette = _vignette(camera.width_px, camera.height_px)
        self._bank = _noise_bank(camera.width_px + NOISE_MARGIN_PX, camera.height_px + NOISE_MARGIN_PX, seed)

    def apply(self, image: ImageU8, view: View, pose: CameraPose, frame_index: int) -> ImageU8:
        """The picture (H, W, 3) as the camera gives it, from one of four channels."""
        image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGRA2BGR), dtype=np.uint8)
        way = blur_way_px(self._camera, view, pose, self._scale)
        if math.hypot(*way) >= BLUR_FROM_PX:
            image = np.asarray(cv2.filter2D(image, -1, line_kernel(way)), dtype=np.uint8)
        image = np.asarray(cv2.GaussianBlur(image, (3, 3), LENS_SIGMA_PX), dtype=np.uint8)
        cv2.multiply(image, self._vignette, image, 1 / 255)
        rng = np.random.default_rng([self._seed, frame_index % (1 << 32)])
        plus, minus = self._bank[int(rng.integers(len(self._bank)))]
        x, y = (int(v) for v in rng.integers(0, NOISE_MARGIN_PX, 2))
        height, width = image.shape[:2]
        parts = [noise[y : y + height, x : x + width] for noise in (plus, minus)]
        if self._mirrored:
            parts = [np.ascontiguousarray(part[:, ::-1]) for part in parts]
        cv2.add(image, parts[0], image)
        cv2.subtract(image, parts[1], image)
        return image


def blur_way_px(camera: CameraModel, view: View, pose: CameraPose, scale: float) -> tuple[float, float]:
    """How far the middle of the picture moves (right, down) during the exposure."""
    pitch_rate, yaw_rate = (min(max(v, -100.0), 100.0) for v in pose.rates_rad_s[1:])
    velocity = view.axes @ np.clip(np.asarray(pose.vel_ned_m_s, np.float64), -1e4 * scale, 1e4 * scale)
    down = float(view.axes[2, 2])
    depth = view.height_m / down if down > 1e-3 and view.height_m > 0 else math.inf
    depth = min(max(depth, 1.0 * scale), 1000.0 * scale)
    right_px = view.focal_px * (-yaw_rate - float(velocity[0]) / depth) * camera.exposure_s
    down_px = view.focal_px * (pitch_rate - float(velocity[1]) / depth) * camera.exposure_s
    length = math.hypot(right_px, down_px)
    limit = min(1.0, BLUR_MOST_PX / length) if length > 0 else 1.0
    return right_px * limit, down_px * limit


def line_kernel(way_px: tuple[float, float]) -> FloatArray:
    """Kernel (odd, odd) of an even motion along a line through its middle; sums to one."""
    dx, dy = way_px
    half_x, half_y = math.ceil(abs(dx) / 2), math.ceil(abs(dy) / 2)
    kernel = np.zeros((2 * half_y + 1, 2 * half_x + 1))
    steps = max(3, 4 * math.ceil(math.hypot(dx, dy)))
    for share in (np.arange(steps) + 0.5) / steps - 0.5:
        x, y = half_x + share * dx, half_y + share * dy
        ix, iy = math.floor(x), math.floor(y)
        for oy, wy in ((0, 1 - (y - iy)), (1, y - iy)):
            for ox, wx in ((0, 1 - (x - ix)), (1, x - ix)):
                if wx * wy > 0:
                    kernel[iy + oy, ix + ox] += wx * wy
    return np.asarray(kernel / kernel.sum())


def _vignette(width: int, height: int) -> ImageU8:
    x = (np.arange(width) + 0.5 - width / 2)[None] / (width / 2)
    y = (np.arange(height) + 0.5 - height / 2)[:, None] / (width / 2)
    square = x**2 + y**2
    loss = CORNER_LOSS * square / float(square.max())
    return np.repeat(np.round(255 * (1 - loss)).astype(np.uint8)[..., None], 3, axis=2)


def _noise_bank(width: int, height: int, seed: int) -> list[tuple[ImageU8, ImageU8]]:
    """Frames of noise, each as what is added and what is taken off."""
    rng = np.random.default_rng([seed, 0x4E01])
    bank = []
    for _ in range(NOISE_FRAMES):
        common = rng.standard_normal((height, width, 1), dtype=np.float32) * NOISE_SIGMA
        own = rng.standard_normal((height, width, 3), dtype=np.float32) * COLOUR_NOISE_SIGMA
        noise = np.round(common + own)
        bank.append((np.maximum(noise, 0).astype(np.uint8), np.maximum(-noise, 0).astype(np.uint8)))
    return bank
