"""What the operator should know beside the status: something alike is near; what is followed is hardly the target.

The first alarm is here, the second in `false_lock`. Evidence that is missing (None) only switches off what needs it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum

from tracker.agreement import TIME_EPS_S
from tracker.box import Box
from tracker.false_lock import FalseLock, FalseLockConfig, FalseLockReason, FalseLockReport, LockFacts
from tracker.filter import check_range, usable_box
from tracker.messages import Candidate, TargetAlarm

__all__ = [
    "AlarmFacts",
    "Alarms",
    "DistractorAlarm",
    "DistractorConfig",
    "DistractorReason",
    "DistractorReport",
    "FalseLock",
    "FalseLockConfig",
    "FalseLockReason",
    "FalseLockReport",
    "LockFacts",
    "active",
]


class DistractorReason(str, Enum):
    """Why the distractor alarm is on or off."""

    NONE_ALIKE = "none_alike"
    NOT_CHOSEN = "not_chosen"  # there is no target to compare with in this step
    TOO_SHORT = "too_short"  # something alike is there, not yet for long enough
    ALIKE = "alike"
    FADING = "fading"  # something alike was there a moment ago
    NO_TIME = "no_time"  # the time is not finite or went back: all is held


@dataclass(frozen=True, slots=True)
class DistractorConfig:
    """Limits of `DistractorAlarm`.

    A rival is at least `apart_sizes` from the target, of its size within a factor e^`ln_size`, with a score of at least
    `enter_share` of the target's (`stay_share` once the alarm is on) and at least `min_score`, and with a cosine with
    the exemplar of at least `exemplar_share` of the target's. The alarm comes when a rival was seen over `on_s`,
    without gaps above `gap_s`, and is forgotten `off_s` after the last one.
    """

    apart_sizes: float = 0.7
    ln_size: float = 0.5
    min_score: float = 0.3
    enter_share: float = 0.85
    stay_share: float = 0.7
    exemplar_share: float = 0.7  # the cosine of the true target itself falls to this in one of five pictures
    on_s: float = 0.1
    gap_s: float = 0.25
    off_s: float = 0.5

    def __post_init__(self) -> None:
        """Check every range. Raises ValueError naming field, value and range."""
        for name, low, high in (
            ("apart_sizes", 0.1, 10.0),
            ("ln_size", 0.01, 5.0),
            ("min_score", 0.0, 1.0),
            ("enter_share", 0.0, 10.0),
            ("stay_share", 0.0, self.enter_share),
            ("exemplar_share", 0.0, 1.0),
            ("on_s", 0.0, 10.0),
            ("gap_s", 0.0, 10.0),
            ("off_s", 0.0, 10.0),
        ):
            check_range("distractor alarm", name, getattr(self, name), low, high)


@dataclass(frozen=True, slots=True)
class DistractorReport:
    """Whether the alarm is on, where the rival was last seen (None: nowhere lately), and why."""

    on: bool
    rival: Box | None
    reason: DistractorReason


class DistractorAlarm:
    """Something that looks like the target is at another place. Never raises in the loop."""

    def __init__(self, config: DistractorConfig | None = None) -> None:
        self._config = config or DistractorConfig()
        self.reset()

    def reset(self) -> None:
        """Forget all, as for a new target."""
        self._on = False
        self._rival: Box | None = None
        self._t_s = self._first_s = self._last_s = -math.inf

    def shift(self, dx_px: float, dy_px: float) -> None:
        """Move with the picture (ego-motion); nothing when not finite."""
        if self._rival is not None and math.isfinite(dx_px) and math.isfinite(dy_px):
            self._rival = replace(self._rival, cx_px=self._rival.cx_px + dx_px, cy_px=self._rival.cy_px + dy_px)

    def step(self, candidates: Iterable[Candidate], chosen: Candidate | None, t_s: float) -> DistractorReport:
        """Take all candidates of the picture of `t_s` (monotonic s) and the one that is the target (None: none)."""
        if not (math.isfinite(t_s) and t_s >= self._t_s):
            return DistractorReport(self._on, self._rival, DistractorReason.NO_TIME)
        self._t_s = t_s
        known = chosen is not None and _usable(chosen)
        rival = self._strongest(candidates, chosen) if chosen is not None and known else None
        if rival is not None:
            return self._seen(rival.box, t_s)
        if t_s - self._last_s > self._config.off_s - TIME_EPS_S:
            self._on, self._rival = False, None
            return DistractorReport(False, None, _absent(known))
        reason = DistractorReason.FADING if self._on else _absent(known)
        return DistractorReport(self._on, self._rival, reason)

    def _seen(self, rival: Box, t_s: float) -> DistractorReport:
        c = self._config
        if t_s - self._last_s > c.gap_s + TIME_EPS_S:
            self._first_s = t_s
        self._rival, self._last_s = rival, t_s
        self._on = self._on or t_s - self._first_s + TIME_EPS_S >= c.on_s
        return DistractorReport(self._on, rival, DistractorReason.ALIKE if self._on else DistractorReason.TOO_SHORT)

    def _strongest(self, candidates: Iterable[Candidate], chosen: Candidate) -> Candidate | None:
        rivals = [c for c in candidates if _usable(c) and self._is_alike(c, chosen)]
        return max(rivals, key=lambda c: c.score, default=None)

    def _is_alike(self, other: Candidate, chosen: Candidate) -> bool:
        c = self._config
        size_px = math.sqrt(chosen.box.w_px * chosen.box.h_px)
        apart_px = math.hypot(other.box.cx_px - chosen.box.cx_px, other.box.cy_px - chosen.box.cy_px)
        if apart_px < c.apart_sizes * size_px:
            return False
        sides = (other.box.w_px / chosen.box.w_px, other.box.h_px / chosen.box.h_px)
        if abs(sum(math.log(v) for v in sides)) / 2.0 > c.ln_size:
            return False
        share = c.stay_share if self._on else c.enter_share
        if other.score < max(c.min_score, share * chosen.score):
            return False
        theirs, ours = _exemplar(other), _exemplar(chosen)
        return theirs is None or ours is None or theirs >= c.exemplar_share * ours


@dataclass(frozen=True, slots=True)
class AlarmFacts:
    """All that the alarms look at in one step: every candidate, the chosen one (None: none), and the lock."""

    candidates: Sequence[Candidate]
    chosen: Candidate | None
    lock: LockFacts


class Alarms:
    """Both alarms under one roof."""

    def __init__(self, distractor: DistractorConfig | None = None, false_lock: FalseLockConfig | None = None) -> None:
        self.distractor = DistractorAlarm(distractor)
        self.false_lock = FalseLock(false_lock)

    def reset(self) -> None:
        """Forget all, as for a new target."""
        self.distractor.reset()
        self.false_lock.reset()

    def shift(self, dx_px: float, dy_px: float) -> None:
        """Move with the picture (ego-motion)."""
        self.distractor.shift(dx_px, dy_px)

    def step(self, facts: AlarmFacts) -> tuple[DistractorReport, FalseLockReport]:
        """Take one step's facts."""
        rival = self.distractor.step(facts.candidates, facts.chosen, facts.lock.t_s)
        return rival, self.false_lock.step(facts.lock)


def active(distractor: DistractorReport, false_lock: FalseLockReport) -> tuple[TargetAlarm, ...]:
    """The alarms that are on, as `TargetState.alarms` has them."""
    both = ((distractor.on, TargetAlarm.DISTRACTOR), (false_lock.on, TargetAlarm.FALSE_LOCK))
    return tuple(alarm for on, alarm in both if on)


def _absent(known: bool) -> DistractorReason:
    return DistractorReason.NONE_ALIKE if known else DistractorReason.NOT_CHOSEN


def _exemplar(candidate: Candidate) -> float | None:
    value = None if candidate.evidence is None else candidate.evidence.exemplar
    return value if value is not None and math.isfinite(value) else None


def _usable(candidate: Candidate) -> bool:
    return usable_box(candidate.box) and math.isfinite(candidate.score)
