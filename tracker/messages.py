"""What travels from the camera to the target estimate: frame, search hint, candidate, target state."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

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
class Candidate:
    """A place where the target may be.

    `score` is the tracker's confidence in [0, 1]; `peak` the height of the response map's chosen cell after penalty
    and window; `similarity` the appearance match with the exemplar in [0, 1] (the share of the classification that
    does not look at the box's shape).
    """

    box: Box
    score: float
    peak: float
    similarity: float


@dataclass(frozen=True, slots=True)
class SearchHint:
    """Where to look: centre, its covariance (xx, xy, yy), relative search size, at most this many network calls.

    `size_px` is what the target's width and height must be taken to be: given while it is not seen, when the tracker's
    own last size is that of what it found instead. None: the tracker knows better.
    """

    center_px: tuple[float, float]
    cov_px2: tuple[float, float, float]
    scale: float = 1.0
    max_calls: int = 1
    size_px: tuple[float, float] | None = None


class Tracker(Protocol):
    """Appearance tracker: told once what to look for, then asked frame by frame. Holds no clock."""

    def init(self, frame: Frame, box: Box) -> None:
        """Take the exemplar. Raises ValueError when the box is not valid or lies outside the frame."""

    def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
        """Candidates, best first; an empty tuple when nothing finite was found."""


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
    GATED = "outside_gate"
    NO_CANDIDATE = "no_candidate"
    NOT_FINITE = "not_finite"  # or of a size or place that no picture holds
    OUT_OF_VIEW = "out_of_view"
    COAST_EXPIRED = "coast_expired"
    COAST_UNSURE = "coast_unsure"  # the prediction could be outside of what is searched
    SHAPE_COLLAPSE = "shape_collapse"  # lost after its box had shrunk: hidden by something, not further away
    REACQUIRED = "reacquired"
    GAVE_UP = "gave_up"
    TIME_WENT_BACK = "time_went_back"
    FAULT = "fault"


@dataclass(frozen=True, slots=True, eq=False)
class TargetState:
    """The estimate that control sees.

    `box` is the filter's posterior when LOCKED or ACQUIRING, its prediction when COASTING or SEARCHING, None when IDLE
    or LOST and for the reason FAULT (the estimate itself raised an error). `vel_px_s` is the velocity of the centre.
    `cov` is (4, 4), of (cx_px, cy_px, ln w, ln h). `confidence` in [0, 1]. `growth_per_s` is the rate of ln(size):
    positive when the target grows in the picture.
    """

    t_s: float
    status: TargetStatus
    reason: TargetReason
    box: Box | None
    vel_px_s: tuple[float, float]
    growth_per_s: float
    cov: Array | None
    confidence: float
