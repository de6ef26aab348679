"""NanoTrack's two maps to boxes and scores, in plain numpy: no state, no network.

Coordinates are those of the search crop relative to its centre, in crop pixels.
"""

from __future__ import annotations

import numpy as np

from tracker.messages import Array
from tracker.siamapnpp.decode import MIN_BOX_PX, Decoded, FloatMap, footprint, hann

STRIDE_PX = 16


def decode(classes: FloatMap, sides: FloatMap) -> Decoded:
    """Boxes and scores of every cell of `classes` (2, M, M) and `sides` (4, M, M).

    `classes` are the logits of background and target, `sides` the distances in crop pixels from the cell to the left,
    upper, right and lower side of the box. Never raises on bad numbers: such cells are marked as not usable.
    """
    with np.errstate(all="ignore"):
        # Class 1 of a two-way softmax is the sigmoid of the difference.
        logit = (classes[1].astype(np.float64) - classes[0].astype(np.float64)).ravel()
        score = 0.5 * (1.0 + np.tanh(0.5 * logit))
        left, top, right, bottom = sides.astype(np.float64).reshape(4, -1)
        x, y = grid(classes.shape[-1])
        cx, cy = x + (right - left) / 2.0, y + (bottom - top) / 2.0
        # A box that is inside out is of one pixel, as in the published tracker: the shape penalty sees to it.
        w, h = np.maximum(left + right, MIN_BOX_PX), np.maximum(top + bottom, MIN_BOX_PX)
        usable = np.isfinite(score) & np.isfinite(cx) & np.isfinite(cy) & np.isfinite(w) & np.isfinite(h)
    score = np.where(usable, score, 0.0)
    return Decoded(
        cx=np.where(usable, cx, 0.0),
        cy=np.where(usable, cy, 0.0),
        w=np.where(usable, w, 1.0),
        h=np.where(usable, h, 1.0),
        ranking=score,
        confidence=score,
        similarity=score,
        heads=score[None],
        usable=usable,
    )


def grid(cells: int) -> tuple[Array, Array]:
    """x and y of the cells, flattened row-major (y outer): 16 i - 112 for 15 cells."""
    axis = (np.arange(cells) - cells // 2) * float(STRIDE_PX)
    return np.tile(axis, cells), np.repeat(axis, cells)


def rank(decoded: Decoded, penalty: Array, window: float) -> Array:
    """Penalised and windowed score of each cell; -inf where it is not usable."""
    hanning = hann(round(len(decoded.cx) ** 0.5))
    ranked = penalty * decoded.ranking * (1.0 - window) + hanning * window
    return np.where(decoded.usable, ranked, -np.inf)


def apart(target_w: float, target_h: float) -> tuple[float, float]:
    """How far from a peak, across and down in crop pixels, other peaks are still the same target's."""
    across, down = footprint(target_w, target_h)
    return max(across, float(STRIDE_PX)), max(down, float(STRIDE_PX))
