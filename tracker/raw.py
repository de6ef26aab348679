"""A raw tracker's view of its target: LOCKED on the best candidate, as short-term trackers are benchmarked."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tracker.box import Box
from tracker.messages import Candidate, SearchHint, TargetReason, TargetState, TargetStatus


class RawTarget:
    """Stands where `TargetTracker` stands, without filter, gate or states: for measuring the tracker alone."""

    def __init__(self) -> None:
        self._box: Box | None = None

    def start(self, box: Box, t_s: float) -> TargetState:
        """Take the selected box. Raises ValueError when it is not valid."""
        if not box.is_valid:
            raise ValueError("the selected box has a value that is not finite or a size that is not positive")
        self._box = box
        return _state(TargetStatus.LOCKED, box, t_s, 1.0, TargetReason.SELECTED)

    def step(self, candidates: Sequence[Candidate], t_s: float, image_size_px: tuple[float, float]) -> TargetState:
        """The best candidate; without one the last box, SEARCHING, so that nothing moves by it."""
        if self._box is None:
            return TargetState(t_s, TargetStatus.IDLE, TargetReason.NOT_STARTED, None, (0.0, 0.0), 0.0, None, 0.0)
        best = next((c for c in candidates if c.box.is_valid and math.isfinite(c.score)), None)
        if best is None:
            return _state(TargetStatus.SEARCHING, self._box, t_s, 0.0, TargetReason.NO_CANDIDATE)
        self._box = best.box
        return _state(TargetStatus.LOCKED, best.box, t_s, best.score, TargetReason.SEEN)

    def hint(self, t_s: float | None = None) -> SearchHint | None:
        """None: the tracker searches around its own last place."""
        return None

    def shift(self, dx_px: float, dy_px: float) -> bool:
        """Nothing to move: the bare tracker searches where it saw the target last. False."""
        return False

    def nudge(self, box: Box, t_s: float) -> TargetState:
        """Take the operator's box. Raises ValueError when it is not valid or nothing is tracked."""
        if self._box is None:
            raise ValueError("there is no track to nudge: select a target first")
        return self.start(box, t_s)


def _state(status: TargetStatus, box: Box, t_s: float, confidence: float, reason: TargetReason) -> TargetState:
    return TargetState(t_s, status, reason, box, (0.0, 0.0), 0.0, None, confidence)
