"""A tracker as a judge of boxes: an exemplar that holds one whole thing finds itself again, at its place and size."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

from tracker.box import Box
from tracker.messages import Candidate, Frame, ImageU8, SearchHint, Tracker

MAX_BOXES = 6  # judged by the network, each with one exemplar and one search: half a second of a slow core
SHIFT_SIZES = 0.25  # the search is centred this far beside the box, so that finding it again is no accident
SHIFT_DIRECTIONS = ((1.0, 0.0), (-0.6, 0.8))  # alternating, so that no direction is preferred


class Scorer(Protocol):
    """Judges boxes of one picture."""

    def score(self, image_bgr_u8: ImageU8, boxes: Sequence[Box]) -> tuple[float | None, ...]:
        """A number in [0, 1] for each box, larger for better ones; None for a box that was not judged."""


class SelfConsistency:
    """Implements `Scorer` with any tracker: overlap of the box with what its exemplar finds, times the tracker's score.

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
        judged = [_consistency(self._tracker, frame, box, i) for i, box in enumerate(boxes[: self._max_boxes])]
        return (*judged, *(None for _ in boxes[self._max_boxes :]))


def _consistency(tracker: Tracker, frame: Frame, box: Box, number: int) -> float | None:
    try:
        tracker.init(frame, box)
    except ValueError:  # below the tracker's own least size, or partly outside
        return None
    dx, dy = SHIFT_DIRECTIONS[number % len(SHIFT_DIRECTIONS)]
    step = SHIFT_SIZES * math.sqrt(box.w_px * box.h_px)
    hint = SearchHint((box.cx_px + dx * step, box.cy_px + dy * step), (step * step, 0.0, step * step))
    found = tracker.update(frame, hint)
    if not found:
        return 0.0
    value = box.iou(_unsmoothed(found[0], box)) * found[0].score
    return min(max(value, 0.0), 1.0) if math.isfinite(value) else 0.0


def _unsmoothed(candidate: Candidate, searched: Box) -> Box:
    """The box that the network itself saw: what a tracker reports is mostly the size that it searched with."""
    evidence = candidate.evidence
    if evidence is None:
        return candidate.box
    size, half = math.exp(evidence.ln_scale), math.exp(evidence.ln_aspect / 2)
    return Box(candidate.box.cx_px, candidate.box.cy_px, searched.w_px * size * half, searched.h_px * size / half)
