"""Noise as surfaces have it: many scales at once, and tiles of it that repeat without a seam."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

FloatImage = npt.NDArray[np.float32]

CUBIC_ABOVE = 12.0  # pixels a cell


def octaves(rng: np.random.Generator, size_px: tuple[int, int], cells: tuple[int, ...], fall: float) -> FloatImage:
    """Noise (height, width) of mean 0 and deviation 1, the sum of layers with `cells` cells across the width.

    Layer i has the strength fall**i. Opposite sides fit together.
    """
    height, width = size_px
    total = np.zeros((height, width), np.float32)
    for i, count in enumerate(cells):
        rows = max(1, round(count * height / width))
        total += np.float32(fall**i) * _smooth(rng.standard_normal((rows, count)).astype(np.float32), size_px)
    total -= total.mean()
    return np.asarray(total / max(float(total.std()), 1e-6), dtype=np.float32)


def _smooth(grid: FloatImage, size_px: tuple[int, int]) -> FloatImage:
    height, width = size_px
    rows, columns = grid.shape
    if (rows, columns) == size_px:
        return grid
    pad = 2
    wrapped = np.pad(grid, pad, mode="wrap")
    scale_y, scale_x = height / rows, width / columns
    # Sampling positions of a resize, shifted by the wrapped border.
    matrix = np.array([[1 / scale_x, 0, pad + 0.5 / scale_x - 0.5], [0, 1 / scale_y, pad + 0.5 / scale_y - 0.5]])
    # Fine layers need no smooth interpolation, and linear is four times faster.
    kind = cv2.INTER_CUBIC if scale_x > CUBIC_ABOVE else cv2.INTER_LINEAR
    flags = kind | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(wrapped, matrix, (width, height), flags=flags), dtype=np.float32)


def to_factor_u8(noise: FloatImage, amplitude: float) -> npt.NDArray[np.uint8]:
    """Noise as factors for `cv2.multiply(..., scale=1/128)`: 128 means one."""
    return np.asarray(np.clip(128 * (1 + amplitude * noise), 20, 250).astype(np.uint8))


def pyramid(image: npt.NDArray[np.uint8], least_px: int = 4) -> tuple[npt.NDArray[np.uint8], ...]:
    """The image, then each level half as large in both directions, down to `least_px` on the shorter side."""
    levels = [np.ascontiguousarray(image)]
    while min(levels[-1].shape[:2]) // 2 >= least_px:
        height, width = levels[-1].shape[:2]
        size = (max(1, width // 2), max(1, height // 2))
        levels.append(np.asarray(cv2.resize(levels[-1], size, interpolation=cv2.INTER_AREA), dtype=np.uint8))
    return tuple(levels)


class Grain:
    """A large tile of fine noise (mean 0, deviation 1) of which pieces are cut: cheaper than drawing each anew."""

    SIDE_PX = 1024

    def __init__(self, rng: np.random.Generator) -> None:
        side = self.SIDE_PX
        self._tile = octaves(rng, (side, side), (24, 64, 128, 256, 512, 1024), 1.06)

    @property
    def tile(self) -> FloatImage:
        """The whole tile, without seams."""
        return self._tile

    def piece(self, rng: np.random.Generator, size_px: tuple[int, int]) -> FloatImage:
        """A piece (height, width) from a random place."""
        rows = (int(rng.integers(self.SIDE_PX)) + np.arange(size_px[0])) % self.SIDE_PX
        columns = (int(rng.integers(self.SIDE_PX)) + np.arange(size_px[1])) % self.SIDE_PX
        return self._tile[np.ix_(rows, columns)]
