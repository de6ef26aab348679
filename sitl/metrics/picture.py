"""Metrics of what was seen: status and box against the truth in the picture."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sitl.metrics.sample import LOCKED, Sample, since_lock, since_selection

# Below this overlap the box is on something else (docs/interfaces.md, section 4: false-confirmed).
FALSE_IOU = 0.2
# Above it the box is plainly right, and an honest tracker should say so.
GOOD_IOU = 0.5
# A target more than half covered need not be locked on.
IN_SIGHT_VISIBILITY = 0.5
# The end of a run is judged by this much of it: 15 pictures at 30 fps, longer than a flicker of the status.
FINAL_S = 0.5


def on_target(sample: Sample) -> bool:
    """LOCKED, and on the right thing."""
    return sample.status == LOCKED and sample.iou >= FALSE_IOU


def lock_share(samples: Sequence[Sample]) -> float | None:
    """Of the samples since the selection with the target in sight, the share LOCKED on it (overlap 0.2 or more)."""
    return _share([on_target(s) for s in since_selection(samples) if s.visibility >= IN_SIGHT_VISIBILITY])


def in_picture_share(samples: Sequence[Sample]) -> float | None:
    """Of the samples since the selection with a picture, the share with the target in it, covered or not."""
    return _share([s.in_picture for s in since_selection(samples) if s.truth is not None])


def honest_lock_share(samples: Sequence[Sample]) -> float | None:
    """Of the samples whose box overlaps the truth by more than 0.5 while any of it is visible, the share LOCKED."""
    good = [s for s in since_selection(samples) if s.visibility > 0 and s.iou > GOOD_IOU]
    return _share([s.status == LOCKED for s in good])


def false_confirmed_share(samples: Sequence[Sample]) -> float | None:
    """Of all samples since the selection, the share LOCKED with the target hidden or the overlap below 0.2."""
    return _share([s.status == LOCKED and (s.visibility == 0 or s.iou < FALSE_IOU) for s in since_selection(samples)])


def iou_mean(samples: Sequence[Sample]) -> float | None:
    """Mean overlap since the selection with the target in sight; a sample without a box counts 0."""
    overlaps = [s.iou for s in since_selection(samples) if s.visibility >= IN_SIGHT_VISIBILITY]
    return float(np.mean(overlaps)) if overlaps else None


def final_locked_on_target(samples: Sequence[Sample]) -> float | None:
    """1 when most samples of the last 0.5 s are LOCKED with an overlap of 0.2 or more, else 0."""
    if not samples:
        return None
    last = [on_target(s) for s in samples if s.t_s > samples[-1].t_s - FINAL_S]
    return float(sum(last) > len(last) / 2)


def centre_errors_px(samples: Sequence[Sample]) -> list[float]:
    """Distance of the target's true projected middle from the aim point, since the first lock, while visible."""
    return [
        math.dist(s.truth.centre_px, s.aim_px)
        for s in since_lock(samples)
        if s.truth is not None and s.truth.centre_px is not None and s.visibility > 0
    ]


def centre_metrics(samples: Sequence[Sample], focal_px: float) -> dict[str, float | None]:
    """`centre_err_rms_px`, `centre_err_p95_px`, `centre_err_rms_deg` (the angle of that distance at the middle)."""
    errors_px = centre_errors_px(samples)
    if not errors_px:
        return dict.fromkeys(("centre_err_rms_px", "centre_err_p95_px", "centre_err_rms_deg"))
    return {
        "centre_err_rms_px": rms(errors_px),
        "centre_err_p95_px": float(np.percentile(errors_px, 95)),
        "centre_err_rms_deg": rms([math.degrees(math.atan2(e, focal_px)) for e in errors_px]),
    }


def rms(values: Sequence[float]) -> float | None:
    """Root of the mean square, None of nothing."""
    return math.sqrt(sum(v * v for v in values) / len(values)) if values else None


def _share(flags: Sequence[bool]) -> float | None:
    return sum(flags) / len(flags) if flags else None
