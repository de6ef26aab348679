"""One-pass evaluation as the field does it: success AUC over 21 thresholds, precision at 20 px.

`honest` scoring (the only one so far): frames whose truth is absent (NaN, or no positive size) count for neither
score, and a frame without a reported box is a miss in both. A perfect track scores 20/21 = 0.952, because the
overlap must be strictly above each threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tracker.box import Box
from tracker.messages import Array

OVERLAP_THRESHOLDS = np.linspace(0.0, 1.0, 21)
PRECISION_PX = 20.0


@dataclass(frozen=True, slots=True)
class Scores:
    """`frames` is how many had a target; the two scores are None when none had."""

    frames: int
    auc: float | None
    p20: float | None


def centre_errors_px(boxes: Sequence[Box | None], truth: Sequence[Box | None]) -> Array:
    """Distance of the centres per frame; NaN where either is absent. Raises ValueError when the lengths differ."""
    _same_length(boxes, truth)
    pairs = zip(boxes, truth, strict=True)
    return np.array(
        [
            np.hypot(b.cx_px - t.cx_px, b.cy_px - t.cy_px) if b is not None and t is not None else np.nan
            for b, t in pairs
        ]
    )


def score(boxes: Sequence[Box | None], truth: Sequence[Box | None]) -> Scores:
    """Success AUC and precision of reported boxes. Raises ValueError when the lengths differ."""
    _same_length(boxes, truth)
    present = [(b, t) for b, t in zip(boxes, truth, strict=True) if t is not None and t.is_valid]
    if not present:
        return Scores(0, None, None)
    overlaps = np.array([b.iou(t) if b is not None else -1.0 for b, t in present])
    errors = centre_errors_px([b for b, _ in present], [t for _, t in present])
    auc = float(np.mean([(overlaps > threshold).mean() for threshold in OVERLAP_THRESHOLDS]))
    hits = np.where(np.isfinite(errors), errors, np.inf) <= PRECISION_PX
    return Scores(len(present), auc, float(hits.mean()))


def _same_length(boxes: Sequence[Box | None], truth: Sequence[Box | None]) -> None:
    if len(boxes) != len(truth):
        raise ValueError(f"{len(boxes)} boxes against {len(truth)} rows of truth: they must be as many")
