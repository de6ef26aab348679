"""One pair at a time with OpenCV: what the processors do while a batch is loaded."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from tracker.messages import Array, ImageU8
from tracker.siamapnpp.crop import EXEMPLAR_PX, MIN_SIDE_PX, SHRINK_FROM, exemplar_side_px
from tracker.training.augment import effects
from tracker.training.augment.geometry import label_box, one_placement
from tracker.training.augment.plan import Colour, Plan
from tracker.training.types import View

Corners = tuple[float, float, float, float]


def render_pair(
    exemplar: View, search: View, plan: Plan, row: int, search_px: int, seed: int
) -> tuple[ImageU8, ImageU8, Corners]:
    """Exemplar (127, 127, 3), search crop (search_px, search_px, 3), both BGR, and the label of `row` of the plan.

    The label is x1, y1, x2, y2 of the search view's target in crop pixels from the crop's centre. Both boxes must be
    valid. The noise depends on `seed` and on the plan's row. Without jitter the crops are those of `crop_square`.
    """
    template, _ = _placed(exemplar, plan, row, EXEMPLAR_PX, is_exemplar=True)
    template = _coloured(template, plan.exemplar_colour, row)
    template = effects.low_resolution(template, float(plan.exemplar_low_resolution[row]))
    crop, box = _placed(search, plan, row, search_px, is_exemplar=False)
    corners = (float(box[0]), float(box[1]), float(box[2]), float(box[3]))
    if plan.lookalike.applied[row]:
        effects.paste_lookalike(crop, box, plan.lookalike, row)
    if plan.occlusion.applied[row]:
        effects.occlude(crop, box, plan.occlusion, row)
    crop = _coloured(crop, plan.search_colour, row)
    crop = effects.degrade(crop, plan, row, seed)
    if plan.gray[row]:
        return effects.gray(template), effects.gray(crop), corners
    return template, crop, corners


def _placed(view: View, plan: Plan, row: int, out_px: int, is_exemplar: bool) -> tuple[ImageU8, Array]:
    """The crop and the target's label box (4,)."""
    turn, shift_px = one_placement(plan, row, is_exemplar)
    box = view.box
    linear = turn * (EXEMPLAR_PX / max(exemplar_side_px(box.w_px, box.h_px), MIN_SIDE_PX))
    crop = warp(view, linear, shift_px, out_px)
    low, high = label_box(linear, shift_px, np.array([box.w_px, box.h_px]))
    return crop, np.concatenate([low, high])


def warp(view: View, linear: Array, shift_px: Array, out_px: int) -> ImageU8:
    """The affine crop in which the target's centre lies `shift_px` (2,) from the crop's centre.

    `linear` (2, 2) goes from picture pixels to crop pixels. Where the crop shrinks the picture to less than half, its
    area is averaged first, as `crop_square` does.
    """
    inverse = np.linalg.inv(linear)
    step = 1.0 / math.sqrt(abs(float(np.linalg.det(linear))))  # picture pixels per crop pixel
    centre = np.array([view.box.cx_px, view.box.cy_px])
    half = out_px / 2
    corners = (np.array([[-half, half, -half, half], [-half, -half, half, half]]) - shift_px[:, None]).T @ inverse.T
    source, origin, shrink = _visible(
        view.image_bgr_u8, centre + corners.min(axis=0), centre + corners.max(axis=0), step
    )
    # Pixel u has its centre at u + 0.5, in the crop as in the picture.
    matrix = np.empty((2, 3))
    matrix[:, :2] = inverse / shrink
    matrix[:, 2] = (centre + inverse @ (0.5 - half - shift_px) - origin) / shrink - 0.5
    out = cv2.warpAffine(
        source,
        matrix,
        (out_px, out_px),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=view.fill_bgr,
    )
    return np.asarray(out, dtype=np.uint8)


def _visible(image: ImageU8, low: Array, high: Array, step: float) -> tuple[ImageU8, Array, float]:
    """What to sample, the place of its corner in the picture, and by how much it is smaller."""
    height, width = image.shape[:2]
    if step >= SHRINK_FROM:
        factor = int(step)  # leaves between 1x and 2x for the bilinear step
        left, top = (max(0, math.floor(v) - factor) for v in low)
        right, bottom = (min(n, math.ceil(v) + factor) for n, v in zip((width, height), high, strict=True))
        columns, rows = (right - left) // factor, (bottom - top) // factor
        if columns >= 1 and rows >= 1:
            part = image[top : top + rows * factor, left : left + columns * factor]
            small = cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA)
            return np.asarray(small, dtype=np.uint8), np.array([left, top], dtype=np.float64), float(factor)
    return image, np.zeros(2), 1.0


def _coloured(image: ImageU8, colour: Colour, row: int) -> ImageU8:
    gain, gamma = float(colour.gain[row]), float(colour.gamma[row])
    offset: npt.NDArray[np.float64] = colour.offset_bgr[row]
    if gain == 1.0 and gamma == 1.0 and not offset.any():
        return image
    return effects.look_up(image, effects.colour_curve(gain, offset, gamma))
