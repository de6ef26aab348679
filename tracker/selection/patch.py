"""A window of the picture at a workable scale: what all cues of a selection are computed on."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from tracker.box import Box
from tracker.messages import Array, ImageU8

Float32 = npt.NDArray[np.float32]
Index = npt.NDArray[np.int64]

LEAST_WINDOW_PX = 4.0  # a smaller window holds no picture
LIGHT_SIGMA_PX = 0.8  # of the patch: sensor noise, which would be an edge everywhere, is blurred away


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """Part of a picture, resampled: Lab in 0..255, (h, w, 3); frame pixel (x, y) lies at (x - x0_px) * scale."""

    bgr_u8: ImageU8
    lab: Float32
    x0_px: float
    y0_px: float
    scale: float

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in patch pixels."""
        return self.lab.shape[1], self.lab.shape[0]

    def to_patch(self, boxes: Array) -> Array:
        """Corners (n, 4) from frame pixels to patch pixels."""
        origin = np.array([self.x0_px, self.y0_px, self.x0_px, self.y0_px])
        return np.asarray((boxes - origin) * self.scale, dtype=np.float64)

    def to_frame(self, boxes: Array) -> Array:
        """Corners (n, 4) from patch pixels to frame pixels."""
        origin = np.array([self.x0_px, self.y0_px, self.x0_px, self.y0_px])
        return np.asarray(boxes / self.scale + origin, dtype=np.float64)


def cut_patch(image_bgr_u8: ImageU8, centre_px: tuple[float, float], side_px: float, out_px: int) -> Patch | None:
    """The square of `side_px` round a point, as far as the picture has it, with `side_px` made into `out_px`.

    None when less than LEAST_WINDOW_PX of it lies in the picture.
    """
    height, width = image_bgr_u8.shape[:2]
    half = side_px / 2
    left, right = (min(max(centre_px[0] + d, 0.0), float(width)) for d in (-half, half))
    top, bottom = (min(max(centre_px[1] + d, 0.0), float(height)) for d in (-half, half))
    x0, y0, x1, y1 = int(left), int(top), int(np.ceil(right)), int(np.ceil(bottom))
    if min(x1 - x0, y1 - y0) < LEAST_WINDOW_PX:
        return None
    scale = out_px / side_px
    size = (max(1, round((x1 - x0) * scale)), max(1, round((y1 - y0) * scale)))
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    bgr = np.asarray(cv2.resize(image_bgr_u8[y0:y1, x0:x1], size, interpolation=way), dtype=np.uint8)
    smooth = cv2.GaussianBlur(bgr, (0, 0), LIGHT_SIGMA_PX)
    lab = np.asarray(cv2.cvtColor(smooth, cv2.COLOR_BGR2LAB), dtype=np.float32)
    return Patch(bgr, lab, float(x0), float(y0), scale)


def corners(boxes: tuple[Box, ...] | list[Box]) -> Array:
    """Boxes as an (n, 4) array of x1, y1, x2, y2."""
    return np.array([b.to_corners() for b in boxes], dtype=np.float64).reshape(-1, 4)


def integral(image: npt.NDArray[np.generic]) -> Array:
    """Sums from the top-left corner, one row and column larger, of (h, w) or of every channel of (h, w, n)."""
    table = cv2.integral(np.ascontiguousarray(image))
    return np.asarray(table.reshape(image.shape[0] + 1, image.shape[1] + 1, *image.shape[2:]))


def box_sums(table: Array, boxes: Index) -> Array:
    """Sums of an `integral` over whole-pixel corners (n, 4), which are held inside; (n, ...)."""
    height, width = table.shape[0] - 1, table.shape[1] - 1
    x = np.minimum(np.maximum(boxes[:, 0::2], 0), width)
    y = np.minimum(np.maximum(boxes[:, 1::2], 0), height)
    x1, x2, y1, y2 = x[:, 0], x[:, 1], y[:, 0], y[:, 1]
    return np.asarray(table[y2, x2] - table[y1, x2] - table[y2, x1] + table[y1, x1], dtype=np.float64)


def box_areas(boxes: Index, size: tuple[int, int]) -> Array:
    """Whole-pixel areas (n,) of what lies in a patch of (width, height)."""
    w = np.clip(boxes[:, 2], 0, size[0]) - np.clip(boxes[:, 0], 0, size[0])
    h = np.clip(boxes[:, 3], 0, size[1]) - np.clip(boxes[:, 1], 0, size[1])
    return np.asarray(np.maximum(w, 0) * np.maximum(h, 0), dtype=np.float64)
