"""Where things come to lie in a crop: the same arithmetic for numpy (one row or many) and torch (a batch on a device).

All in crop pixels from the crop's centre, x right, y down. A box is x1, y1, x2, y2 in the last dimension.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import torch

from tracker.messages import Array
from tracker.training.augment import ranges
from tracker.training.augment.plan import Flags, Placement, Plan

Numbers = TypeVar("Numbers", Array, torch.Tensor)


def deformation(placement: Placement, flip: Flags) -> Array:
    """(..., 2, 2) from the target's own axes, in pixels of the undisturbed crop, to crop pixels: flip, stretch, turn.

    The arrays of `placement` may be of one row (no dimension) or of many.
    """
    sign = np.where(flip, -1.0, 1.0)
    x = sign * np.exp(placement.log_scale + placement.log_aspect)
    y = np.exp(placement.log_scale - placement.log_aspect)
    c, s = np.cos(placement.angle_rad), np.sin(placement.angle_rad)
    return np.stack([np.stack([c * x, -s * y], -1), np.stack([s * x, c * y], -1)], -2)


def one_placement(plan: Plan, row: int, exemplar: bool) -> tuple[Array, Array]:
    """The deformation (2, 2) and the shift (2,) of one crop."""
    part = plan.exemplar if exemplar else plan.search
    one = Placement(part.shift_px[row], part.log_scale[row], part.log_aspect[row], part.angle_rad[row])
    return deformation(one, plan.flip[row]), one.shift_px


def label_box(linear: Numbers, shift_px: Numbers, size_px: Numbers) -> tuple[Numbers, Numbers]:
    """Low and high corner (..., 2) of the label: `linear` (..., 2, 2) from picture to crop, `size_px` in the picture.

    The upright hull of the turned ELLIPSE inscribed in the target's box: targets seldom fill the corners of their
    boxes, so the hull of the turned corners would teach boxes that are too large.
    """
    w, h = size_px[..., 0:1], size_px[..., 1:2]
    half = ((linear[..., 0] * w / 2) ** 2 + (linear[..., 1] * h / 2) ** 2) ** 0.5
    return shift_px - half, shift_px + half


def occluder(
    low: Numbers, high: Numbers, share: Numbers, place: Numbers, source: Numbers, side_px: int
) -> tuple[Numbers, Numbers, Numbers]:
    """First pixel (..., 2), size, and first pixel of the source of the patch, whole pixels from the crop's corner."""
    size = (((high - low) * share) // 1.0).clip(ranges.OCCLUSION_MIN_PX, side_px / 2)
    span = high - low + (2 * ranges.OCCLUSION_OUT - 1.0) * size
    first = (low + side_px / 2 - ranges.OCCLUSION_OUT * size + place * span) // 1.0
    return first, size, (source * (side_px - size)) // 1.0


def free_place(low: Numbers, high: Numbers, centres: Numbers, scale: Numbers) -> tuple[Numbers, Numbers]:
    """The first of the centres (..., tries, 2) where a copy of `scale` (..., 1) leaves the target's box alone.

    Returns the centre (..., 2) and 1 where there is one, else 0 (..., 1).
    """
    size, middle = high - low, (low + high) / 2
    chosen, found = middle, 0.0 * scale
    for i in range(centres.shape[-2]):
        centre = centres[..., i, :]
        apart = ((centre - middle) ** 2) ** 0.5
        shared = (size * (1.0 + scale) / 2 - apart).clip(0.0, None) / size
        covered = shared[..., 0:1] * shared[..., 1:2]
        take = (1.0 - found) * (covered <= ranges.LOOKALIKE_OVERLAP)
        chosen = chosen + take * (centre - chosen)
        found = found + take
    return chosen, found
