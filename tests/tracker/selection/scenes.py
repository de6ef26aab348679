"""Drawn pictures with a known thing in them."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.box import Box
from tracker.messages import ImageU8

SIZE = (320, 240)


def ground(seed: int = 3, size: tuple[int, int] = SIZE) -> ImageU8:
    """Soft texture with spots that optical flow can follow."""
    rng = np.random.default_rng(seed)
    fine = rng.normal(0, 1, (size[1], size[0])).astype(np.float32)
    coarse = cv2.GaussianBlur(fine, (0, 0), 4) * 30 + cv2.GaussianBlur(fine, (0, 0), 1.2) * 12
    return np.clip(np.array([90, 120, 100]) + coarse[..., None], 0, 255).astype(np.uint8)


def with_car(box: Box, seed: int = 3, size: tuple[int, int] = SIZE) -> ImageU8:
    """A red car from above, with glass, that fills the box."""
    return put_car(ground(seed, size), box)


def put_car(image: ImageU8, box: Box) -> ImageU8:
    out = image.copy()
    x1, y1, x2, y2 = (round(v) for v in box.to_corners())
    cv2.rectangle(out, (x1, y1), (x2 - 1, y2 - 1), (40, 40, 200), -1)
    w, h = x2 - x1, y2 - y1
    glass = (x1 + round(0.6 * w), y1 + round(0.15 * h)), (x1 + round(0.75 * w), y1 + round(0.85 * h))
    cv2.rectangle(out, *glass, (70, 60, 50), -1)
    return np.asarray(cv2.GaussianBlur(out, (3, 3), 0), dtype=np.uint8)


def plain(value: int = 140, size: tuple[int, int] = SIZE) -> ImageU8:
    """A sky: a slope of light and a little noise."""
    rng = np.random.default_rng(0)
    slope = np.linspace(0, 25, size[1])[:, None, None]
    return np.clip(value + slope + rng.normal(0, 1.5, (size[1], size[0], 3)), 0, 255).astype(np.uint8)
