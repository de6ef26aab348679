"""One track over pictures: tracker and target in turn, as the application drives them, without vehicle and laws."""

from __future__ import annotations

from typing import Protocol

from tracker.box import Box
from tracker.messages import Candidate, Frame, RemembersExemplars, SearchHint, TargetState, Tracker


class TargetLike(Protocol):
    """What makes candidates into a target state: `tracker.target.TargetTracker` or `tracker.raw.RawTarget`."""

    def start(self, box: Box, t_s: float) -> TargetState:
        """Take a new target."""

    def step(self, candidates: tuple[Candidate, ...], t_s: float, image_size_px: tuple[float, float]) -> TargetState:
        """Take what was found in one picture."""

    def hint(self, t_s: float | None = None) -> SearchHint | None:
        """Where to search next."""


class TrackLoop:
    """Tracker and target over the frames of a sequence; time is that of the frames."""

    def __init__(self, tracker: Tracker, target: TargetLike) -> None:
        self._tracker = tracker
        self._target = target
        self._size_px = (0.0, 0.0)
        self.candidates: tuple[Candidate, ...] = ()

    def start(self, frame: Frame, box: Box) -> TargetState:
        """Select. Raises ValueError when tracker or target cannot take the box."""
        self._tracker.init(frame, box)
        height_px, width_px = frame.image_bgr_u8.shape[:2]
        self._size_px, self.candidates = (float(width_px), float(height_px)), ()
        return self._target.start(box, frame.t_capture_s)

    def step(self, frame: Frame | None, t_s: float) -> TargetState:
        """One frame, or None for one that could not be read."""
        if frame is None:
            self.candidates = ()
            return self._target.step((), t_s, self._size_px)
        self.candidates = tuple(self._tracker.update(frame, self._target.hint(t_s)))
        state = self._target.step(self.candidates, t_s, self._size_px)
        remember(self._tracker, frame, state)
        return state


def remember(tracker: Tracker, frame: Frame, state: TargetState) -> None:
    """Let a tracker that can keep what the target's estimate wants kept."""
    if state.memory is not None and isinstance(tracker, RemembersExemplars):
        tracker.remember(frame, state.memory.box, state.memory.slot)
