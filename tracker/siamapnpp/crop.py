"""Square crops around the target, at any position and scale, without copying or padding the frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from tracker.messages import ImageU8

EXEMPLAR_PX = 127
CONTEXT = 0.5  # share of (w + h) added to each side: the paper's context amount
MIN_SIDE_PX = 2.0  # below two pixels a crop holds no picture
SHRINK_FROM = 2.0  # above this reduction bilinear sampling skips pixels, so the area is averaged first


@dataclass(frozen=True, slots=True)
class CropGeometry:
    """Where a crop lies in the frame: centre and side in frame pixels, side of the crop in its own pixels."""

    cx_px: float
    cy_px: float
    side_px: float
    out_px: int

    @property
    def scale(self) -> float:
        """Crop pixels per frame pixel."""
        return self.out_px / self.side_px


def exemplar_side_px(w_px: float, h_px: float) -> float:
    """Side of the square that becomes the exemplar: sqrt((w + p)(h + p)) with p = (w + h)/2 (section III of SiamFC)."""
    context = CONTEXT * (w_px + h_px)
    return math.sqrt((w_px + context) * (h_px + context))


def crop_square(image_bgr_u8: ImageU8, geometry: CropGeometry, fill_bgr: tuple[float, float, float]) -> ImageU8:
    """The square of `geometry`, resized to (out, out, 3); what lies outside the frame is `fill_bgr`.

    Sub-pixel exact: the centre of the crop is the centre of `geometry`. Only the visible part is ever touched, so a
    window of many frames' size costs no more than a small one.
    """
    side = max(geometry.side_px, MIN_SIDE_PX)
    step = side / geometry.out_px
    x0, y0 = geometry.cx_px - side / 2, geometry.cy_px - side / 2
    source, origin_x, origin_y, shrink = _visible(image_bgr_u8, x0, y0, side, step)
    # Output pixel u has its centre at u + 0.5; so have the pixels of the source.
    a = step / shrink
    bx = (x0 - origin_x + 0.5 * step) / shrink - 0.5
    by = (y0 - origin_y + 0.5 * step) / shrink - 0.5
    matrix = np.array([[a, 0.0, bx], [0.0, a, by]])
    out = cv2.warpAffine(
        source,
        matrix,
        (geometry.out_px, geometry.out_px),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=fill_bgr,
    )
    return np.asarray(out, dtype=np.uint8)


def _visible(image: ImageU8, x0: float, y0: float, side: float, step: float) -> tuple[ImageU8, float, float, float]:
    """The source to sample: the frame itself, or its visible part averaged down when the crop shrinks it a lot."""
    factor = int(step)  # leaves between 1x and 2x for the bilinear step
    if step < SHRINK_FROM:
        return image, 0.0, 0.0, 1.0
    height, width = image.shape[:2]
    left, top = max(0, math.floor(x0) - factor), max(0, math.floor(y0) - factor)
    right, bottom = min(width, math.ceil(x0 + side) + factor), min(height, math.ceil(y0 + side) + factor)
    columns, rows = (right - left) // factor, (bottom - top) // factor
    if columns < 1 or rows < 1:
        return image, 0.0, 0.0, 1.0
    part = image[top : top + rows * factor, left : left + columns * factor]
    small = cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8), float(left), float(top), float(factor)
