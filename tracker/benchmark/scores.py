"""One-pass evaluation as the field does it: success over overlaps, precision over centre errors.

Success AUC is the mean over 21 overlap thresholds of the share of frames *strictly* above each, so a perfect track has
20/21 = 0.952. Precision is the share of centres within 20 px, normalised precision that within 0.2 of the truth's width
and height. Two ways of counting the frames without a target:

`honest`: they count for nothing, and a frame without a reported box is a miss in every score.
`toolkit`: as the toolkit behind published tables counts (siamapnpp.md 4.1): they stay in the denominator, fail in
success and are hits in precision. A truth whose centre is not inside the positive quadrant is such a hit too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from tracker.box import Box
from tracker.messages import Array

OVERLAP_THRESHOLDS = np.linspace(0.0, 1.0, 21)
PRECISION_THRESHOLDS_PX = np.linspace(0.0, 50.0, 51)
NORM_PRECISION_THRESHOLDS = np.linspace(0.0, 0.5, 51)
PRECISION_PX = 20.0
NORM_PRECISION = 0.2
ON_TARGET_IOU = 0.2  # a box that overlaps its target by less is on something else (docs/interfaces.md, section 4)

# The toolkit writes a failure as -1 and compares: below every overlap threshold, and within every centre error.
_FAILED_OVERLAP = -1.0
_TOOLKIT_HIT = -1.0

Flags = npt.NDArray[np.bool_]


class Mode(str, Enum):
    """What frames without a target count for."""

    HONEST = "honest"
    TOOLKIT = "toolkit"


@dataclass(frozen=True, slots=True)
class Scores:
    """`frames` is how many had a target; the two scores are None when none had."""

    frames: int
    auc: float | None
    p20: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """Shares of frames at the thresholds above: `success` (21), `precision` (51), `norm_precision` (51).

    `frames` is how many were counted: those with a target (honest) or all (toolkit).
    """

    frames: int
    success: Array
    precision: Array
    norm_precision: Array

    @property
    def auc(self) -> float:
        """Success AUC."""
        return float(self.success.mean())

    @property
    def p20(self) -> float:
        """Precision at 20 px."""
        return float(self.precision[int(PRECISION_PX)])

    @property
    def norm_p20(self) -> float:
        """Normalised precision at 0.2."""
        return float(self.norm_precision[_NORM_INDEX])

    @property
    def norm_auc(self) -> float:
        """Mean of the normalised precision over its 51 thresholds."""
        return float(self.norm_precision.mean())


_NORM_INDEX = int(np.argmin(np.abs(NORM_PRECISION_THRESHOLDS - NORM_PRECISION)))


def overlaps(boxes: Sequence[Box | None], truth: Sequence[Box | None]) -> Array:
    """IoU per frame: 0 without a usable box, NaN without a target. Raises ValueError when the lengths differ."""
    _same_length(boxes, truth)
    return np.array([_overlap(b, t) for b, t in zip(boxes, truth, strict=True)], dtype=np.float64)


def on_target(boxes: Sequence[Box | None], truth: Sequence[Box | None], iou: float = ON_TARGET_IOU) -> Flags:
    """Per frame: the target is present and the box overlaps it by `iou` or more. Raises ValueError for lengths."""
    found = overlaps(boxes, truth)
    return np.asarray(np.where(np.isfinite(found), found, _FAILED_OVERLAP) >= iou)


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


def curves(boxes: Sequence[Box | None], truth: Sequence[Box | None], mode: Mode = Mode.HONEST) -> Curves | None:
    """The three curves of one sequence; None when it has no frame to count. Raises ValueError when lengths differ."""
    _same_length(boxes, truth)
    pairs = [(b, t if _usable(t) else None) for b, t in zip(boxes, truth, strict=True)]
    if mode is Mode.HONEST:
        pairs = [(b, t) for b, t in pairs if t is not None]
    if not pairs:
        return None
    found = np.array([_FAILED_OVERLAP if t is None else _overlap(b, t) for b, t in pairs])
    errors = np.array([_centre_error(b, t, mode, normalised=False) for b, t in pairs])
    norm_errors = np.array([_centre_error(b, t, mode, normalised=True) for b, t in pairs])
    return Curves(
        frames=len(pairs),
        success=(found[:, None] > OVERLAP_THRESHOLDS).mean(axis=0),
        precision=(errors[:, None] <= PRECISION_THRESHOLDS_PX).mean(axis=0),
        norm_precision=(norm_errors[:, None] <= NORM_PRECISION_THRESHOLDS).mean(axis=0),
    )


def mean_curves(of: Iterable[Curves | None]) -> Curves | None:
    """Mean over sequences, each of the same weight whatever its length; None when none could be scored."""
    known = [c for c in of if c is not None]
    if not known:
        return None
    return Curves(
        frames=sum(c.frames for c in known),
        success=np.mean([c.success for c in known], axis=0),
        precision=np.mean([c.precision for c in known], axis=0),
        norm_precision=np.mean([c.norm_precision for c in known], axis=0),
    )


def score(boxes: Sequence[Box | None], truth: Sequence[Box | None], mode: Mode = Mode.HONEST) -> Scores:
    """Success AUC and precision of reported boxes. Raises ValueError when the lengths differ."""
    found = curves(boxes, truth, mode)
    return Scores(0, None, None) if found is None else Scores(found.frames, found.auc, found.p20)


def _overlap(box: Box | None, truth: Box | None) -> float:
    if not _usable(truth):
        return np.nan
    return box.iou(truth) if box is not None and truth is not None else 0.0


def _centre_error(box: Box | None, truth: Box | None, mode: Mode, *, normalised: bool) -> float:
    """Distance of the centres in pixels, or per axis in sizes of the truth; infinite without a usable box."""
    if truth is None or (mode is Mode.TOOLKIT and not _toolkit_sees(truth)):
        return _TOOLKIT_HIT
    if box is None:
        return np.inf
    dx, dy = box.cx_px - truth.cx_px, box.cy_px - truth.cy_px
    error = float(np.hypot(dx / truth.w_px, dy / truth.h_px) if normalised else np.hypot(dx, dy))
    return error if np.isfinite(error) else np.inf


def _toolkit_sees(truth: Box) -> bool:
    # its centre of a row is x + (w - 1) / 2, half a pixel less than ours; in distances the half cancels
    return truth.cx_px - 0.5 > 0 and truth.cy_px - 0.5 > 0


def _usable(truth: Box | None) -> bool:
    return truth is not None and truth.is_valid


def _same_length(boxes: Sequence[Box | None], truth: Sequence[Box | None]) -> None:
    if len(boxes) != len(truth):
        raise ValueError(f"{len(boxes)} boxes against {len(truth)} rows of truth: they must be as many")
