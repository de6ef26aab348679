"""Whether a box differs from what is round it: noise, grass, gravel and tiles look the same everywhere.

The box and the eight boxes of its size round it are compared by their distributions of colours and of edges. In a
texture these agree at every place, however rich it is; a thing that can be recognised differs from most of them.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from tracker.box import Box
from tracker.messages import Array, ImageU8
from tracker.selection.patch import Float32, cut_patch

SIZE_PX = 20  # the box, as sqrt(w h), is looked at in so many pixels: enough for a distribution
LEAST_SHARE = 0.5  # of a neighbour must lie in the picture to be compared with
LEAST_NEIGHBOURS = 4  # fewer are not "all round": large targets in small pictures are never judged
STEPS = 7  # of the range that the surroundings have: the contrast does not count
LEAST_RANGE = 16.0  # Lab units of 255: bins below 2 units would count noise
QUANTILES = (2.0, 98.0)
AROUND = ((-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1))


def difference(image_bgr_u8: ImageU8, box: Box) -> float:
    """How much a valid box differs from the half of its surroundings that is most like it, 0 (not at all) to 1.

    Distance of Hellinger between the distributions in the box and in a neighbour, of the channel (Lab, edges) that
    tells them apart best; of all neighbours the lower median. 1 when too few neighbours lie in the picture.
    """
    channels, x_px, y_px, scale = _channels(image_bgr_u8, box)
    if channels is None:
        return 1.0
    w, h = max(round(box.w_px * scale), 1), max(round(box.h_px * scale), 1)
    own = _distributions(channels, x_px, y_px, w, h)
    if own is None:
        return 1.0
    found = (_distributions(channels, x_px + dx * w, y_px + dy * h, w, h) for dx, dy in AROUND)
    apart = sorted(_hellinger(own, other) for other in found if other is not None)
    return apart[(len(apart) - 1) // 2] if len(apart) >= LEAST_NEIGHBOURS else 1.0


def _channels(image: ImageU8, box: Box) -> tuple[Float32 | None, int, int, float]:
    """Lab and edges (h, w, 4) in steps of their range, round the box; its corner there, and the scale."""
    scale = SIZE_PX / math.sqrt(box.w_px * box.h_px)
    side = 3.0 * max(box.w_px, box.h_px)
    patch = cut_patch(image, (box.cx_px, box.cy_px), side, max(1, round(side * scale)))
    if patch is None:
        return None, 0, 0, scale
    x1, y1, x2, y2 = (round(float(v)) for v in patch.to_patch(np.array([box.to_corners()]))[0])
    w, h = x2 - x1, y2 - y1
    left, top = max(x1 - w, 0), max(y1 - h, 0)
    lab = patch.lab[top : y2 + h, left : x2 + w]
    if lab.size == 0:
        return None, 0, 0, scale
    across, down = cv2.Sobel(lab, cv2.CV_32F, 1, 0), cv2.Sobel(lab, cv2.CV_32F, 0, 1)
    edges = np.sqrt(np.sum(across**2 + down**2, axis=2))
    channels = np.dstack((lab, edges))
    low, high = np.percentile(channels.reshape(-1, 4), QUANTILES, axis=0)
    steps = (channels - low) / np.maximum(high - low, LEAST_RANGE) * STEPS
    return np.clip(steps, 0.0, STEPS - 1e-3).astype(np.float32), x1 - left, y1 - top, patch.scale


def _distributions(channels: Float32, x_px: int, y_px: int, w_px: int, h_px: int) -> Array | None:
    """Soft histograms (4, STEPS + 1) of what of a place lies in the picture; None when that is too little."""
    part = channels[max(y_px, 0) : max(y_px + h_px, 0), max(x_px, 0) : max(x_px + w_px, 0)].reshape(-1, 4)
    if len(part) < LEAST_SHARE * w_px * h_px:
        return None
    index = part.astype(np.int64)
    share = part - index
    bins = STEPS + 1
    place = index + bins * np.arange(4)
    total = np.bincount(place.ravel(), (1 - share).ravel(), 4 * bins)
    total += np.bincount((place + 1).ravel(), share.ravel(), 4 * bins)
    return np.asarray(total.reshape(4, bins) / len(part))


def _hellinger(a: Array, b: Array) -> float:
    """Of distributions (n, bins): the largest of the n distances, each in [0, 1]."""
    return float(np.sqrt(np.maximum(1.0 - np.sqrt(a * b).sum(axis=1), 0.0)).max())
