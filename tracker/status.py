"""The statuses of a target as a table: which event leads from which status where (design section 4).

    start -> ACQUIRING -> LOCKED <-> COASTING -> SEARCHING -> LOST
                 |           ^                       |
                 +-----------|--- not confirmed ---> |
                             +------ reacquired -----+

Two thresholds with hysteresis, both in seconds: a lock begins at `lock_confidence`, is sustained from `drop_confidence`
on, and below that ends when it has lasted `drop_s`. Every limit is a time, never a number of frames. Pure: the events
come in with their times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from tracker.agreement import TIME_EPS_S
from tracker.filter import check_range
from tracker.messages import TargetReason, TargetStatus

MAX_COAST_S = 5.0  # what the design allows a prediction to be reported as such

IDLE, ACQUIRING, LOCKED = TargetStatus.IDLE, TargetStatus.ACQUIRING, TargetStatus.LOCKED
COASTING, SEARCHING, LOST = TargetStatus.COASTING, TargetStatus.SEARCHING, TargetStatus.LOST
AT_REST = (IDLE, LOST)


class Event(str, Enum):
    """What happened to the target."""

    STARTED = "started"
    STOPPED = "stopped"
    SEEN = "seen"  # a candidate entered the estimate, confidently
    WEAK = "weak"  # one did, below the confidence that may begin a lock
    CONFIRMED = "confirmed"  # seen for long enough in a row
    DOUBTED = "doubted"  # weak for too long
    FALSE_LOCK = "false_lock"  # what is followed is something else
    MISSED = "missed"  # nothing entered the estimate
    NOT_CONFIRMED = "not_confirmed"
    COAST_OVER = "coast_over"
    GAVE_UP = "gave_up"


# What is not listed changes nothing.
TABLE: dict[tuple[TargetStatus, Event], TargetStatus] = {
    **{(status, Event.STARTED): ACQUIRING for status in TargetStatus},
    **{(status, Event.STOPPED): IDLE for status in TargetStatus},
    **{(status, Event.GAVE_UP): LOST for status in (ACQUIRING, LOCKED, COASTING, SEARCHING)},
    (ACQUIRING, Event.CONFIRMED): LOCKED,
    (ACQUIRING, Event.NOT_CONFIRMED): SEARCHING,
    (LOCKED, Event.MISSED): COASTING,
    (LOCKED, Event.DOUBTED): COASTING,
    (LOCKED, Event.FALSE_LOCK): SEARCHING,
    (LOCKED, Event.COAST_OVER): SEARCHING,  # a gap in the pictures longer than a coast
    (COASTING, Event.SEEN): LOCKED,
    (COASTING, Event.COAST_OVER): SEARCHING,
    (SEARCHING, Event.CONFIRMED): LOCKED,
}


@dataclass(frozen=True, slots=True)
class StatusConfig:
    """Thresholds (probabilities) and times of `StatusMachine`.

    A selection must be seen for `confirm_s` in a row before `acquire_s` is over. A prediction is reported for `coast_s`
    at most, for a target that stood still for `coast_still_s`. A coast of up to `trust_s` ends with the first confident
    sight, a longer one when it was seen for `resume_s` in a row; a target that was searched for must be seen for
    `reacquire_s`. After `give_up_s` unseen the target is LOST.
    """

    lock_confidence: float = 0.55
    drop_confidence: float = 0.40
    drop_s: float = 0.1
    confirm_s: float = 0.1
    acquire_s: float = 1.5
    coast_s: float = 1.5
    coast_still_s: float = 1.0
    trust_s: float = 0.3
    resume_s: float = 0.1
    reacquire_s: float = 0.2
    give_up_s: float = 10.0

    def __post_init__(self) -> None:
        """Check every range. Raises ValueError naming field, value and range."""
        for name, low, high in (
            ("lock_confidence", 0.0, 1.0),
            ("drop_confidence", 0.0, self.lock_confidence),
            ("drop_s", 0.0, 1.0),
            ("acquire_s", 0.1, 60.0),
            ("confirm_s", 0.0, self.acquire_s),
            ("coast_s", 0.0, MAX_COAST_S),
            ("coast_still_s", 0.0, self.coast_s),
            ("trust_s", 0.0, 10.0),
            ("resume_s", 0.0, 10.0),
            ("reacquire_s", 0.0, 10.0),
            ("give_up_s", max(self.acquire_s, self.coast_s), 3600.0),
        ):
            check_range("target", name, getattr(self, name), low, high)


class StatusMachine:
    """Holds the status and the times that its rules need. Never raises."""

    def __init__(self, config: StatusConfig) -> None:
        self._config = config
        self.status = IDLE
        self.seen_s = -math.inf  # last time at which a candidate of sufficient confidence entered the estimate
        self._start_s = -math.inf
        self._weak_since_s: float | None = None

    def happen(self, event: Event, t_s: float) -> TargetStatus:
        """Take an event of the time `t_s` (monotonic s); returns the status after it."""
        before = self.status
        self.status = TABLE.get((before, event), before)
        if event is Event.STARTED:
            self._start_s = self.seen_s = t_s
        if event in (Event.SEEN, Event.CONFIRMED, Event.STARTED) and self.status in (ACQUIRING, LOCKED):
            self.seen_s, self._weak_since_s = t_s, None
        if self.status is not LOCKED:
            self._weak_since_s = None
        return self.status

    def weak(self, t_s: float) -> TargetStatus:
        """A candidate entered below `drop_confidence`: a lock bears that for `drop_s`."""
        if self.status is not LOCKED:
            return self.happen(Event.WEAK, t_s)
        self._weak_since_s = t_s if self._weak_since_s is None else self._weak_since_s
        doubted = t_s - self._weak_since_s >= self._config.drop_s - TIME_EPS_S
        return self.happen(Event.DOUBTED if doubted else Event.WEAK, t_s)

    def expire(self, t_s: float, moving: bool, unsure: bool) -> TargetReason | None:
        """Let statuses end by time alone; returns why, or None. `unsure`: the prediction may lie outside the search."""
        c, unseen_s = self._config, t_s - self.seen_s + TIME_EPS_S
        if self.status in AT_REST:
            return None
        if unseen_s >= c.give_up_s:
            self.happen(Event.GAVE_UP, t_s)
            return TargetReason.GAVE_UP
        if self.status is ACQUIRING and t_s - self._start_s + TIME_EPS_S >= c.acquire_s:
            self.happen(Event.NOT_CONFIRMED, t_s)
            return TargetReason.NOT_CONFIRMED
        if self.status not in (LOCKED, COASTING):
            return None
        over = unseen_s >= (c.coast_s if moving else c.coast_still_s)
        if over or unsure:
            self.happen(Event.COAST_OVER, t_s)
            return TargetReason.COAST_EXPIRED if over else TargetReason.COAST_UNSURE
        return None
