"""The picture under work, and the blending that everything drawn into it shares."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sitl.render.projection import View
from sitl.world.light import Light

FloatArray = npt.NDArray[np.float64]
ImageU8 = npt.NDArray[np.uint8]
Rect = tuple[int, int, int, int]

HAZE_LENGTH_M = 1500.0  # contrast falls to 1/e
LEAST_HAZE = 0.04  # less is not seen
COVERED = 128  # alpha from which on a pixel counts as covered
POINT_SHIFT = 3  # polygons are given to cv2 in eighths of a pixel


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The picture (H, W, 4) and, at each pixel, the number of the mover seen there (0 = none).

    The picture's fourth channel means nothing: cv2 warps and blends four channels faster than three.
    `tracked` holds the rectangles (x0, y0, x1, y1) in which movers may be: elsewhere the numbers need no care.
    `sun_right` is the component of the sun's direction to the right of the picture.
    Make one by `new`.
    """

    image: ImageU8
    ids: ImageU8
    view: View
    light: Light
    scale: float
    exposure_bgr: FloatArray
    haze_bgr: FloatArray
    sun_right: float
    tracked: tuple[tuple[float, float, float, float], ...] = ()

    @classmethod
    def new(cls, image: ImageU8, ids: ImageU8, view: View, light: Light, scale: float) -> Surface:
        """A surface without movers; the colours are as they appear in the picture."""
        exposure = light.exposure_bgr
        sun_right = float(view.axes[0] @ np.asarray(light.to_sun))
        return cls(image, ids, view, light, scale, exposure, np.asarray(light.haze_bgr) * exposure, sun_right)

    def haze(self, distance_m: float) -> float:
        """Share of haze at a distance, 0 when too little to be seen."""
        share = 1 - math.exp(-distance_m / (HAZE_LENGTH_M * self.scale))
        return share if share > LEAST_HAZE else 0.0

    def matters(self, rect: Rect) -> bool:
        """Whether a mover may be seen in a rectangle."""
        x0, y0, x1, y1 = rect
        return any(x0 < b[2] and b[0] < x1 and y0 < b[3] and b[1] < y1 for b in self.tracked)


def blend(part: ImageU8, premultiplied: ImageU8) -> None:
    """Put a premultiplied BGRA picture over a part of the image (four channels)."""
    rest = cv2.cvtColor(cv2.bitwise_not(cv2.extractChannel(premultiplied, 3)), cv2.COLOR_GRAY2BGRA)
    cv2.multiply(part, rest, part, 1 / 255)
    cv2.add(part, premultiplied, part)


def covering(premultiplied: ImageU8) -> ImageU8:
    """Mask (255) of the pixels that a premultiplied BGRA picture covers."""
    _, mask = cv2.threshold(cv2.extractChannel(premultiplied, 3), COVERED - 1, 255, cv2.THRESH_BINARY)
    return np.asarray(mask, dtype=np.uint8)


def shifted(matrix: FloatArray, x0: float, y0: float) -> FloatArray:
    """A homography (3, 3) from pixels to texels as cv2 wants it for a window at (x0, y0).

    cv2 puts whole numbers at the middles of pixels and texels, we at their corners.
    """
    moved = matrix.copy()
    moved[:, 2] += matrix[:, 0] * (x0 + 0.5) + matrix[:, 1] * (y0 + 0.5)
    moved[:2] -= 0.5 * moved[2]
    return np.asarray(moved)
