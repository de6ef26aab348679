"""What travels from the camera to the target estimate: frame, search hint, candidate, target state."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from tracker.box import Box

ImageU8 = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One picture. `image_bgr_u8` is (H, W, 3); times are monotonic seconds of our clock."""

    image_bgr_u8: ImageU8
    seq: int
    t_capture_s: float
    t_receive_s: float


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a tracker's network says of a candidate beside its score. Every number is finite.

    `heads` are the classification outputs in [0, 1] (SiamAPN++: anchor overlap, foreground, centre-ness). `second` is
    the rank of the strongest other peak, a target's own footprint away, as a share of this one's: 0 when there is none,
    above 1 for a candidate that is not the best. `sharpness` is (peak - mean) / deviation of the response outside of
    the footprint. `exemplar` and `recent` are cosines in [-1, 1] of the deep features at the candidate with those of
    the first exemplar and with the best match in the rest of the memory; None when not computed. `ln_scale` and
    `ln_aspect` are how the box found, before smoothing, differs in ln(size) and ln(w/h) from the size searched with.
    `search_scale` is that of the window it was found in (1: normal). `colour` is how alike the colours in the box are
    to the most alike of those remembered, the first exemplar's among them, in [0, 1]; None when not compared.
    """

    heads: tuple[float, ...]
    second: float
    sharpness: float
    exemplar: float | None
    recent: float | None
    ln_scale: float
    ln_aspect: float
    search_scale: float = 1.0
    colour: float | None = None


@dataclass(frozen=True, slots=True)
class Candidate:
    """A place where the target may be.

    `score` is the tracker's own score in [0, 1]; `peak` the height of the response map's chosen cell after penalty
    and window; `similarity` the appearance match with the exemplar in [0, 1] (the share of the classification that
    does not look at the box's shape). `evidence` is None from trackers that give none.
    """

    box: Box
    score: float
    peak: float
    similarity: float
    evidence: Evidence | None = None


@dataclass(frozen=True, slots=True)
class SearchTile:
    """One more window to search: its centre, and its size relative to the normal one."""

    center_px: tuple[float, float]
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class SearchHint:
    """Where to look: centre, its covariance (xx, xy, yy), relative search size, at most this many network calls.

    `size_px` is what the target's width and height must be taken to be: the tracker's own last size is that of its best
    candidate, which need not be the target. None: the tracker knows better. `tiles` are searched after the
    window at the centre, as far as `max_calls` reaches. `sure`: the target is slow and its place well known, so a
    tracker that can may search a smaller window.
    """

    center_px: tuple[float, float]
    cov_px2: tuple[float, float, float]
    scale: float = 1.0
    max_calls: int = 1
    size_px: tuple[float, float] | None = None
    tiles: tuple[SearchTile, ...] = ()
    sure: bool = False


class MemorySlot(str, Enum):
    """Where a new exemplar is kept beside the first one, which is kept for ever."""

    RECENT = "recent"  # one, replaced
    ANCHOR = "anchor"  # a few, the oldest replaced: how the target looked when something like it was near


@dataclass(frozen=True, slots=True)
class MemoryWrite:
    """The wish that the tracker remember what is in `box` of the picture just searched."""

    slot: MemorySlot
    box: Box


class Tracker(Protocol):
    """Appearance tracker: told once what to look for, then asked frame by frame. Holds no clock."""

    def init(self, frame: Frame, box: Box) -> None:
        """Take the exemplar. Raises ValueError when the box is not valid or lies outside the frame."""

    def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
        """Candidates, best first; an empty tuple when nothing finite was found."""


@runtime_checkable
class RemembersExemplars(Protocol):
    """A tracker with a memory of more than the first exemplar."""

    def remember(self, frame: Frame, box: Box, slot: MemorySlot) -> None:
        """Keep what is in the box of this frame. Raises ValueError when the box is not valid or outside the frame."""


class TargetStatus(str, Enum):
    """What is known of the target now (docs/interfaces.md, section 4)."""

    IDLE = "IDLE"
    ACQUIRING = "ACQUIRING"
    LOCKED = "LOCKED"
    COASTING = "COASTING"
    SEARCHING = "SEARCHING"
    LOST = "LOST"


class TargetReason(str, Enum):
    """Why the status is what it is; logged with every step."""

    NOT_STARTED = "not_started"
    STOPPED = "stopped"
    SELECTED = "selected"
    CONFIRMING = "confirming"
    CONFIRMED = "confirmed"
    NOT_CONFIRMED = "not_confirmed"
    SEEN = "seen"
    LOW_SCORE = "low_score"
    INNOVATION_GATE = "innovation_gate"
    NO_CANDIDATE = "no_candidate"
    LOW_PEAK = "low_peak"  # nothing in the response that could be a target
    LOW_CONFIDENCE = "low_confidence"  # all evidence together says that it is probably not the target
    AMBIGUOUS = "ambiguous"  # two alike, and the motion does not tell which
    UNLIKE_EXEMPLAR = "unlike_exemplar"
    FALSE_LOCK = "false_lock"  # good scores for long, but of something that moves or looks otherwise
    NOT_FINITE = "not_finite"  # or of a size or place that no picture holds
    OUT_OF_FRAME = "out_of_frame"
    COAST_EXPIRED = "coast_expired"
    COAST_UNSURE = "coast_unsure"  # the prediction could be outside of what is searched
    SHAPE_COLLAPSE = "shape_collapse"  # its box shrinks suddenly: hidden by something, not further away
    REACQUIRED = "reacquired"
    GAVE_UP = "gave_up"
    TIME_WENT_BACK = "time_went_back"
    FAULT = "fault"


class TargetAlarm(str, Enum):
    """What the operator should know beside the status."""

    DISTRACTOR = "distractor"  # something that looks alike is near: motion decides
    FALSE_LOCK = "false_lock"  # what is followed is probably not the target


@dataclass(frozen=True, slots=True, eq=False)
class TargetState:
    """The estimate that control sees.

    `box` is the filter's posterior when LOCKED or ACQUIRING, its prediction when COASTING or SEARCHING, None when IDLE
    or LOST and for the reason FAULT (the estimate itself raised an error). `vel_px_s` is the velocity of the centre.
    `cov` is (4, 4), of (cx_px, cy_px, ln w, ln h). `confidence` is the probability that the box is on the target
    (overlap of 0.2 or more). `growth_per_s` is the rate of ln(size): positive when the target grows in the picture.
    `chosen` is the candidate that entered the estimate in this step; `memory` what the tracker should remember of it.
    """

    t_s: float
    status: TargetStatus
    reason: TargetReason
    box: Box | None
    vel_px_s: tuple[float, float]
    growth_per_s: float
    cov: Array | None
    confidence: float
    alarms: tuple[TargetAlarm, ...] = ()
    chosen: Candidate | None = None
    memory: MemoryWrite | None = None
