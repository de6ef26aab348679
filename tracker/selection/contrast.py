"""How much a box stands out: edges along its border, colours inside against around, regions it keeps whole.

Every cue is a number in about [0, 1], larger for boxes that hold one thing and nothing else:

    edge_mean, edge_least   gradient across the four sides, relative to the patch's strong edges: mean and weakest side
    quiet                   edges in the ring round the box are fewer than on its border
    colour                  chi-square distance of the colours inside and in the ring (Alexe et al. 2012: CC)
    step                    distance of the mean colours, against their spread
    whole                   superpixels do not straddle the border (Alexe et al. 2012: SS)
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tracker.messages import Array
from tracker.selection.patch import Index, Patch, box_areas, box_sums, integral

CUES = ("edge_mean", "edge_least", "quiet", "colour", "step", "whole")
RING = 0.25  # of the box's side is added on each side: the surroundings that it is compared with
RING_PX = 2.0  # at least
BAND_PX = 1  # half the width of the band along a side in which its edge may lie
STRONG_QUANTILE = 95.0  # of the gradients in the patch: what counts as a full edge
LEAST_STRONG = 24.0  # Lab units per Sobel kernel: a patch without any edge must not make edges of its noise
BINS = 8  # of each of the three colour channels
COLOUR_QUANTILES = (2.0, 98.0)  # the bins span what the patch has: in haze all colours are close together
LEAST_SPAN = 16.0  # Lab units: bins below 2 units would count noise
SEED_STEP_PX = 8  # superpixels of about 8 x 8 patch pixels
STEP_EPS = 8.0  # Lab units: spread of one colour by noise and light


class ContrastCues:
    """The cues of boxes on one patch; everything that does not depend on the box is computed once."""

    def __init__(self, patch: Patch) -> None:
        self._size = patch.size
        across, down = _gradients(patch.lab)
        strong = max(float(np.percentile(np.maximum(across, down), STRONG_QUANTILE)), LEAST_STRONG)
        self._across = integral(np.minimum(across / strong, 1.0))
        self._down = integral(np.minimum(down / strong, 1.0))
        self._both = integral(np.minimum(np.hypot(across, down) / strong, 1.0))
        self._histogram = integral(_bins(patch.lab))
        self._colour = integral(np.concatenate((patch.lab, patch.lab**2), axis=2))
        self._regions = integral(_superpixels(patch))

    def of(self, boxes: Array) -> Array:
        """Cues (n, len(CUES)) of corners (n, 4) in patch pixels. Always finite."""
        inner = np.rint(boxes).astype(np.int64)
        outer = _ring(inner)
        area = np.maximum(box_areas(inner, self._size), 1.0)
        ring_area = np.maximum(box_areas(outer, self._size) - area, 1.0)
        sides = self._sides(inner)
        border = sides.mean(axis=1)
        rim = _grown(inner, BAND_PX + 1)  # the ring without the border's own edge
        far_area = np.maximum(box_areas(outer, self._size) - box_areas(rim, self._size), 1.0)
        ring_edges = (box_sums(self._both, outer) - box_sums(self._both, rim)) / far_area
        colour, step = self._colours(inner, outer, area, ring_area)
        cues = (border, sides.min(axis=1), border - ring_edges, colour, step, self._whole(inner, area))
        return np.asarray(np.nan_to_num(np.stack(cues, axis=1)))

    def _sides(self, b: Index) -> Array:
        """Mean gradient across left, right, top and bottom side, (n, 4); the best row of the band counts."""
        found = []
        for side, table, vertical in ((0, self._across, True), (2, self._across, True),
                                      (1, self._down, False), (3, self._down, False)):  # fmt: skip
            rows = []
            for offset in range(-BAND_PX - 1, BAND_PX + 1):
                at = b[:, side] + offset
                line = np.stack((at, b[:, 1], at + 1, b[:, 3]) if vertical else (b[:, 0], at, b[:, 2], at + 1), axis=1)
                length = np.maximum((b[:, 3] - b[:, 1]) if vertical else (b[:, 2] - b[:, 0]), 1)
                rows.append(box_sums(table, line) / length)
            found.append(np.max(rows, axis=0))
        return np.stack(found, axis=1)

    def _colours(self, inner: Index, outer: Index, area: Array, ring_area: Array) -> tuple[Array, Array]:
        inside = box_sums(self._histogram, inner)
        ring = (box_sums(self._histogram, outer) - inside) / ring_area[:, None]
        inside = inside / area[:, None]
        chi = 0.5 * np.sum((inside - ring) ** 2 / (inside + ring + 1e-9), axis=1) / 3.0
        sums = box_sums(self._colour, inner)
        ring_sums = (box_sums(self._colour, outer) - sums) / ring_area[:, None]
        means = sums / area[:, None]
        spread = np.maximum(means[:, 3:] - means[:, :3] ** 2, 0) + np.maximum(
            ring_sums[:, 3:] - ring_sums[:, :3] ** 2, 0
        )
        away = np.sum((means[:, :3] - ring_sums[:, :3]) ** 2, axis=1)
        step = away / (away + 0.5 * spread.sum(axis=1) + STEP_EPS**2)
        return chi, step

    def _whole(self, inner: Index, area: Array) -> Array:
        inside = box_sums(self._regions, inner)
        total = self._regions[-1, -1]
        cut = np.minimum(inside, total - inside).sum(axis=1)
        return np.asarray(1.0 - np.minimum(cut / area, 1.0))


def _gradients(lab: npt.NDArray[np.float32]) -> tuple[Array, Array]:
    """Colour gradients across (d/dx) and down (d/dy), lengths over the three channels."""
    across = cv2.Sobel(lab, cv2.CV_32F, 1, 0, ksize=3)
    down = cv2.Sobel(lab, cv2.CV_32F, 0, 1, ksize=3)
    return np.sqrt(np.sum(across**2, axis=2)).astype(np.float64), np.sqrt(np.sum(down**2, axis=2)).astype(np.float64)


def _bins(lab: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    """One-hot bins of the three channels, (h, w, 3 BINS)."""
    low, high = np.percentile(lab.reshape(-1, 3)[::3], COLOUR_QUANTILES, axis=0)
    share = (lab - low) / np.maximum(high - low, LEAST_SPAN)
    index = np.clip((share * BINS).astype(np.int64), 0, BINS - 1)
    hot = index[..., None] == np.arange(BINS)
    return np.asarray(hot.reshape(*lab.shape[:2], 3 * BINS), dtype=np.uint8)


def _superpixels(patch: Patch) -> npt.NDArray[np.uint8]:
    """One-hot superpixels (h, w, n) by a watershed from a grid of seeds; its lines belong to none."""
    width, height = patch.size
    rows, columns = (range(min(SEED_STEP_PX, n) // 2, n, SEED_STEP_PX) for n in (height, width))
    labels = np.zeros((height, width), np.int32)
    labels[np.ix_(list(rows), list(columns))] = np.arange(1, len(rows) * len(columns) + 1).reshape(len(rows), -1)
    smooth = np.ascontiguousarray(patch.lab).astype(np.uint8)
    cv2.watershed(smooth, labels)
    return np.asarray(labels[..., None] == np.arange(1, len(rows) * len(columns) + 1), dtype=np.uint8)


def _grown(boxes: Index, by_px: int) -> Index:
    return np.asarray(boxes + np.array([-by_px, -by_px, by_px, by_px]))


def _ring(boxes: Index) -> Index:
    side = np.stack((boxes[:, 2] - boxes[:, 0], boxes[:, 3] - boxes[:, 1]), axis=1)
    grow = np.rint(np.maximum(side * RING, RING_PX)).astype(np.int64)
    return np.concatenate((boxes[:, :2] - grow, boxes[:, 2:] + grow), axis=1)
