"""A tracker as a judge of boxes: an exemplar that holds one whole thing finds itself again, at its place and size.

Each box is an exemplar once, and searched for a little beside its place. Three things speak for it:

    consistency   overlap of the box with what its own exemplar finds, times the tracker's score
    support       overlap with what the exemplars of the other boxes find: a part of a thing often finds the whole
    sharpness     of the response, when the tracker gives evidence
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from tracker.box import Box
from tracker.messages import Candidate, Frame, ImageU8, SearchHint, Tracker

MAX_BOXES = 6  # judged by the network, each with one exemplar and one search: half a second of a slow core
SHIFT_SIZES = 0.25  # the search is centred this far beside the box, so that finding it again is no accident
SHIFT_DIRECTIONS = ((1.0, 0.0), (-0.6, 0.8))  # alternating, so that no direction is preferred
FULL_SHARPNESS = 100.0  # none of the clicks had a sharper one
# Fitted together with NETWORK_SHARE (tracker/selection/ranking.py) on 40 clicks into 20 sequences, so that the box that
# is ranked first overlaps the truth most; numbers are reported of 66 clicks into 22 other sequences.
CONSISTENCY, SUPPORT, SHARPNESS = 0.52, 0.21, 0.27


class Scorer(Protocol):
    """Judges boxes of one picture."""

    def score(self, image_bgr_u8: ImageU8, boxes: Sequence[Box]) -> tuple[float | None, ...]:
        """A number in [0, 1] for each box, larger for better ones; None for a box that was not judged."""


@dataclass(frozen=True, slots=True)
class _Finding:
    """What a box's own exemplar found: None when nothing."""

    box: Box | None
    score: float
    sharpness: float


class SelfConsistency:
    """Implements `Scorer` with any tracker: consistency, support and sharpness of the boxes of one click.

    `make_tracker` gives a tracker that nobody else uses. Boxes after the first MAX_BOXES are not judged.
    """

    def __init__(self, make_tracker: Callable[[], Tracker], max_boxes: int = MAX_BOXES) -> None:
        self._make_tracker = make_tracker
        self._tracker: Tracker | None = None
        self._max_boxes = max_boxes

    def score(self, image_bgr_u8: ImageU8, boxes: Sequence[Box]) -> tuple[float | None, ...]:
        """A number in [0, 1] for each box; None beyond the first `max_boxes`, and where the tracker takes no box."""
        if self._tracker is None:
            self._tracker = self._make_tracker()
        frame = Frame(image_bgr_u8, 0, 0.0, 0.0)
        judged = boxes[: self._max_boxes]
        found = [_find(self._tracker, frame, box, i) for i, box in enumerate(judged)]
        values = [_value(i, box, found) for i, box in enumerate(judged)]
        return (*values, *(None for _ in boxes[self._max_boxes :]))


def _find(tracker: Tracker, frame: Frame, box: Box, number: int) -> _Finding | None:
    try:
        tracker.init(frame, box)
    except ValueError:  # below the tracker's own least size, or partly outside
        return None
    dx, dy = SHIFT_DIRECTIONS[number % len(SHIFT_DIRECTIONS)]
    step = SHIFT_SIZES * math.sqrt(box.w_px * box.h_px)
    hint = SearchHint((box.cx_px + dx * step, box.cy_px + dy * step), (step * step, 0.0, step * step))
    candidates = tracker.update(frame, hint)
    if not candidates or not math.isfinite(candidates[0].score):
        return _Finding(None, 0.0, 0.0)
    best = candidates[0]
    return _Finding(_unsmoothed(best, box), best.score, 0.0 if best.evidence is None else best.evidence.sharpness)


def _value(number: int, box: Box, found: Sequence[_Finding | None]) -> float | None:
    own = found[number]
    if own is None:
        return None
    others = [_overlap(box, f) for k, f in enumerate(found) if k != number and f is not None]
    support = sum(others) / max(len(others), 1)
    sharpness = min(max(own.sharpness / FULL_SHARPNESS, 0.0), 1.0)
    value = CONSISTENCY * _overlap(box, own) * own.score + SUPPORT * support + SHARPNESS * sharpness
    return min(max(value, 0.0), 1.0) if math.isfinite(value) else 0.0


def _overlap(box: Box, finding: _Finding) -> float:
    return 0.0 if finding.box is None else box.iou(finding.box)


def _unsmoothed(candidate: Candidate, searched: Box) -> Box:
    """The box that the network itself saw: what a tracker reports is mostly the size that it searched with."""
    evidence = candidate.evidence
    if evidence is None:
        return candidate.box
    size, half = math.exp(evidence.ln_scale), math.exp(evidence.ln_aspect / 2)
    return Box(candidate.box.cx_px, candidate.box.cy_px, searched.w_px * size * half, searched.h_px * size / half)
