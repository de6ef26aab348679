"""From one click to boxes: candidates of all scales and shapes round the point, and what speaks for each.

At scales a factor of sqrt(2) apart a window round the click is looked at in the same number of pixels. In each, the
thing under the click is segmented by colour, and a grid of boxes of several aspects and offsets is laid round the
click. All are judged by the same cues (tracker/selection/contrast.py) and ranked by how much they look like one whole
thing (tracker/selection/objectness.py). About 90 ms of one core at 640 x 480.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tracker.box import Box
from tracker.messages import Array, ImageU8
from tracker.selection.contrast import CUES, ContrastCues
from tracker.selection.network import Scorer
from tracker.selection.objectness import objectness
from tracker.selection.patch import Patch, cut_patch
from tracker.selection.ranking import MAX_PROPOSALS, Proposal, Reason, distinct, rejudged
from tracker.selection.segment import segment

LEAST_SIZE_PX = 9.0  # sqrt(w h) of the smallest candidate: one of 8 x 8 is the smallest that can be tracked
LARGEST_AREA = 0.5  # of the frame
SCALE_STEP = math.sqrt(2.0)
WINDOW_SIZES = 3.2  # side of the window in sizes of that scale: a box of aspect 3 with its ring still fits
PATCH_PX = 64  # of a window: 20 px for the thing itself
ASPECTS = (0.33, 0.5, 0.72, 1.0, 1.4, 2.0, 3.0)
HALF_STEPS = (1.0, 2.0**0.25)
OFFSETS = ((0.0, 0.0), (0.13, 0.0), (-0.13, 0.0), (0.0, 0.13), (0.0, -0.13))  # of the sides: nobody clicks the middle
FEATURES = (*CUES, "off_centre", "aspect2", "ln_size", "ln_size2", "agree_mean", "agree_best", "is_segment", "inside")


LOOKED_THROUGH = 200  # best candidates among which distinct ones are sought; the rest are never among the first


def propose(image_bgr_u8: ImageU8, point_px: tuple[float, float], scorer: Scorer | None = None) -> tuple[Proposal, ...]:
    """Boxes for what is at a point of a picture (H, W, 3), best first, distinct; each lies inside the picture.

    `score` is about the overlap to be expected, with a scorer by both. Empty when the point is not
    finite or outside, or the picture too small to hold a target.
    """
    height, width = image_bgr_u8.shape[:2]
    if not all(math.isfinite(v) for v in point_px) or not (0 <= point_px[0] < width and 0 <= point_px[1] < height):
        return ()
    pool = gather(image_bgr_u8, point_px)
    scores = objectness(pool.features, FEATURES)
    order = np.argsort(-scores, kind="stable")[:LOOKED_THROUGH]
    ranked = [
        Proposal(
            Box.from_corners(*(float(v) for v in pool.boxes[i])),
            float(scores[i]),
            Reason.SEGMENT if pool.segmented[i] else Reason.OUTLINE,
        )
        for i in order
    ]
    found = distinct(ranked, at_most=MAX_PROPOSALS)
    return found if scorer is None else rejudged(image_bgr_u8, found, scorer)


@dataclass(frozen=True, slots=True, eq=False)
class Pool:
    """Candidates: corners (n, 4) in frame px, features (n, len(FEATURES)), and which were segmented (n,)."""

    boxes: Array
    features: Array
    segmented: Array


def gather(image_bgr_u8: ImageU8, point_px: tuple[float, float]) -> Pool:
    """Every candidate round a point inside the picture, with its features."""
    height, width = image_bgr_u8.shape[:2]
    levels = _levels(image_bgr_u8, point_px)
    segments = _segments(levels, point_px)
    boxes, cues = [], []
    for size, patch in levels:
        near = segments[(_sizes(segments) >= size / 2**0.25) & (_sizes(segments) < size * 2**0.25)]
        mine = np.concatenate((near, _inside(_grid(point_px, size), width, height)))
        if len(mine):
            boxes.append(mine)
            cues.append(ContrastCues(patch).of(patch.to_patch(mine)))
    if not boxes:
        return Pool(np.zeros((0, 4)), np.zeros((0, len(FEATURES))), np.zeros(0, dtype=bool))
    all_boxes, all_cues = np.concatenate(boxes), np.concatenate(cues)
    overlap = iou(all_boxes, segments)
    segmented = overlap.max(axis=1, initial=0.0) > 0.999
    features = np.column_stack((all_cues, _shape(all_boxes, point_px, width, height, overlap, segmented)))
    return Pool(all_boxes, features, segmented)


def _levels(image: ImageU8, point_px: tuple[float, float]) -> list[tuple[float, Patch]]:
    height, width = image.shape[:2]
    size, found = LEAST_SIZE_PX, []
    while size * size <= LARGEST_AREA * width * height:
        patch = cut_patch(image, point_px, WINDOW_SIZES * size, PATCH_PX)
        if patch is not None:
            found.append((size, patch))
        size *= SCALE_STEP
    return found


def _segments(levels: list[tuple[float, Patch]], point_px: tuple[float, float]) -> Array:
    """Corners (n, 4) in frame px of what was segmented at each scale."""
    found = []
    for size, patch in levels:
        x, y = patch.to_patch(np.array([[*point_px, *point_px]]))[0, :2]
        box = segment(patch, (float(x), float(y)), size * patch.scale)
        if box is not None:
            found.append(patch.to_frame(box[None])[0])
    return np.array(found).reshape(-1, 4)


def _grid(point_px: tuple[float, float], size: float) -> Array:
    boxes = []
    for aspect in ASPECTS:
        for step in HALF_STEPS:
            w, h = size * step * math.sqrt(aspect), size * step / math.sqrt(aspect)
            for dx, dy in OFFSETS:
                cx, cy = point_px[0] + dx * w, point_px[1] + dy * h
                boxes.append((cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2))
    return np.array(boxes)


def _inside(boxes: Array, width: int, height: int) -> Array:
    """Boxes held inside the frame; those of which less than 0.7 lies inside are left out."""
    held = np.clip(boxes, 0.0, np.array([width, height, width, height], dtype=np.float64))
    keep = _sizes(held) ** 2 >= 0.7 * _sizes(boxes) ** 2
    return np.asarray(held[keep])


def _sizes(boxes: Array) -> Array:
    return np.sqrt(np.maximum((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]), 0.0))


def _shape(
    boxes: Array, point_px: tuple[float, float], width: int, height: int, overlap: Array, segmented: Array
) -> Array:
    """The features that look at place and shape of a box, not at the picture."""
    w, h = boxes[:, 2] - boxes[:, 0], boxes[:, 3] - boxes[:, 1]
    dx = np.abs(boxes[:, 0] + w / 2 - point_px[0]) / w
    dy = np.abs(boxes[:, 1] + h / 2 - point_px[1]) / h
    ln_size = np.log(np.sqrt(w * h) / math.sqrt(width * height)) / math.log(10)
    count = max(overlap.shape[1], 1)
    mean, best = overlap.sum(axis=1) / count, overlap.max(axis=1, initial=0.0)
    ends = np.stack((boxes[:, 0], boxes[:, 1], width - boxes[:, 2], height - boxes[:, 3]))
    return np.column_stack((
        2 * np.hypot(dx, dy), np.log(w / h) ** 2, ln_size, ln_size**2, mean, best, segmented, ends.min(axis=0) > 1.0,
    ))  # fmt: skip


def iou(a: Array, b: Array) -> Array:
    """Intersection over union of corners (n, 4) with corners (m, 4): (n, m)."""
    low, high = np.maximum(a[:, None, :2], b[None, :, :2]), np.minimum(a[:, None, 2:], b[None, :, 2:])
    inter = np.prod(np.maximum(high - low, 0.0), axis=2)
    area_a, area_b = np.prod(a[:, 2:] - a[:, :2], axis=1), np.prod(b[:, 2:] - b[:, :2], axis=1)
    return np.asarray(inter / np.maximum(area_a[:, None] + area_b[None] - inter, 1e-9))
