"""When what is seen may be remembered: after DAM4SAM (arXiv 2411.17576), with every limit in seconds and sizes.

A memory of a wrong thing is worse than none: it makes the tracker follow that thing for ever. So a place is kept only
when every gate passes, and whatever speaks against it freezes the memory for a while.

    RECENT   how it looks now: at most every half second, when nothing else is near
    ANCHOR   how it differs from what looks alike: when something like it was near, and the track is nevertheless sure
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum
from statistics import median

from tracker.agreement import TIME_EPS_S
from tracker.box import Box
from tracker.filter import check_range, usable_box
from tracker.messages import MemorySlot, TargetAlarm

SIZE_MEDIAN_S = 1.0 / 3.0  # DAM4SAM: 10 frames at 30 per second
MAX_KEPT = 512  # more than any camera gives in that time; a clock that stands still must not fill the memory
SIZE_MIN = 3  # sizes; the median of two is no judgement
OCCLUSION_S = 1.0  # a target that goes behind an edge at walking pace takes about this long to shrink
MAX_LN_SIZE = 20.0  # beyond, no picture holds it


class MemoryReason(str, Enum):
    """Why something is remembered, or why not."""

    WRITE_RECENT = "write_recent"
    WRITE_ANCHOR = "write_anchor"
    NOT_FINITE = "not_finite"
    TIME_WENT_BACK = "time_went_back"
    NOT_LOCKED = "not_locked"
    FALSE_LOCK = "false_lock"
    SETTLING = "settling"  # the lock is too young to be trusted
    UNCERTAIN = "uncertain"  # the confidence is not high enough, or has not been for long enough
    FROZEN = "frozen"  # there was good reason for doubt a moment ago
    UNLIKE_EXEMPLAR = "unlike_exemplar"
    AT_EDGE = "at_edge"
    OCCLUDED = "occluded"  # it has shrunk fast: part of it is probably hidden
    SIZE_JUMP = "size_jump"
    NO_HISTORY = "no_history"  # of sizes to compare with
    AMBIGUOUS = "ambiguous"  # something like it is near
    TOO_SOON = "too_soon"  # after the last one


@dataclass(frozen=True, slots=True)
class MemoryGatesConfig:
    """Gates of `MemoryGates`; times in seconds.

    A lock must have lasted `young_s` when it is the first one or comes after a break of `break_s` or more (a
    re-acquisition), else `settle_s`. The confidence must have been at least `recent_confidence` for `steady_s`, for an
    anchor be at least `anchor_confidence`; below `doubt_confidence` it freezes the memory for `freeze_s`, as does a
    false-lock alarm. The exemplar's cosine must be at least `exemplar_min`. `*_area` are the factors by which the area
    may differ from its median; one that fell by `occluded_ln_size` of ln(size) within a second is taken to be partly
    hidden. `edge_sizes` is the distance that the box must keep from the picture's edge. An anchor needs something
    alike in the last `rival_s`.
    """

    recent_s: float = 0.5
    anchor_s: float = 1.0
    young_s: float = 2.0
    settle_s: float = 0.5
    break_s: float = 0.5
    recent_confidence: float = 0.8
    anchor_confidence: float = 0.9
    steady_s: float = 0.3
    doubt_confidence: float = 0.5
    freeze_s: float = 1.0
    exemplar_min: float = 0.3  # 3 % of boxes on the target are below, 74 % of those beside it (12 validation sequences)
    recent_area: float = 1.4
    anchor_area: float = 1.2
    occluded_ln_size: float = 0.25
    edge_sizes: float = 0.05
    rival_s: float = 1.0

    def __post_init__(self) -> None:
        """Check every range. Raises ValueError naming field, value and range."""
        for name in ("recent_s", "anchor_s", "young_s", "settle_s", "break_s", "steady_s", "rival_s"):
            check_range("memory gates", name, getattr(self, name), 0.0, 60.0)
        for name, low, high in (
            ("freeze_s", 0.0, 60.0),
            ("recent_confidence", 0.0, 1.0),
            ("anchor_confidence", self.recent_confidence, 1.0),
            ("doubt_confidence", 0.0, self.recent_confidence),
            ("exemplar_min", -1.0, 1.0),
            ("recent_area", 1.01, 10.0),
            ("anchor_area", 1.01, self.recent_area),
            ("occluded_ln_size", 0.01, 5.0),
            ("edge_sizes", 0.0, 1.0),
        ):
            check_range("memory gates", name, getattr(self, name), low, high)


@dataclass(frozen=True, slots=True)
class MemoryFacts:
    """What is known of the target in one step.

    `t_s` in monotonic seconds; `box` in px and what would be remembered; `ln_size` = ln(sqrt(w h)) of what was found;
    `ambiguous`: something alike is near; `alike`: features and colours are the target's own; `exemplar`: cosine with
    the first exemplar, None when not computed.
    """

    t_s: float
    locked: bool
    confidence: float
    ambiguous: bool
    exemplar: float | None
    box: Box
    image_size_px: tuple[float, float]
    ln_size: float
    alarms: tuple[TargetAlarm, ...] = ()
    alike: bool = True


@dataclass(frozen=True, slots=True)
class MemoryDecision:
    """Where to remember it; None: not at all. And why."""

    slot: MemorySlot | None
    reason: MemoryReason


class MemoryGates:
    """Decides in every step whether what is seen is remembered. Never raises in the loop."""

    def __init__(self, config: MemoryGatesConfig | None = None) -> None:
        self._config = config or MemoryGatesConfig()
        self.reset(0.0)

    def reset(self, t_s: float) -> None:
        """Begin with a new target, selected at `t_s` (monotonic s; not finite: when the first step comes).

        Not needed at a re-acquisition, which is known from `MemoryFacts.locked`; it does no harm there.
        """
        self._t_s = t_s if math.isfinite(t_s) else -math.inf
        self._trusted_s = math.inf
        self._locked = False
        self._unlocked_s: float | None = None
        self._confident_since_s: float | None = None
        self._doubt_s = self._rival_s = -math.inf
        self._recent_s = self._anchor_s = self._t_s
        self._sizes: deque[tuple[float, float]] = deque(maxlen=MAX_KEPT)

    def step(self, facts: MemoryFacts) -> MemoryDecision:
        """Judge one step; a decision with a slot counts as carried out."""
        refusal = self._unusable(facts)
        if refusal is not None:
            return MemoryDecision(None, refusal)
        self._t_s = facts.t_s
        self._follow_lock(facts)
        self._follow_doubt(facts)
        refusal = self._distrust(facts) or self._look(facts)
        if refusal is not None:
            return MemoryDecision(None, refusal)
        return self._choose(facts)

    def _unusable(self, facts: MemoryFacts) -> MemoryReason | None:
        numbers = (facts.t_s, facts.confidence, facts.ln_size, *facts.image_size_px)
        if not all(math.isfinite(v) for v in numbers) or not usable_box(facts.box):
            self._doubt_s = self._t_s
            return MemoryReason.NOT_FINITE
        if abs(facts.ln_size) > MAX_LN_SIZE or not all(v > 0 for v in facts.image_size_px):
            return MemoryReason.NOT_FINITE
        return MemoryReason.TIME_WENT_BACK if facts.t_s < self._t_s else None

    def _follow_lock(self, facts: MemoryFacts) -> None:
        """From when on the lock is trusted, and the sizes that it saw."""
        if not facts.locked:
            if self._locked:
                self._unlocked_s = facts.t_s
            self._locked = False
            self._sizes.clear()
            return
        if not self._locked:
            self._trusted_s = self._trusted_from_s(facts.t_s)
            self._locked = True
        self._sizes.append((facts.t_s, facts.ln_size))
        while self._sizes[0][0] < facts.t_s - OCCLUSION_S - TIME_EPS_S:
            self._sizes.popleft()

    def _trusted_from_s(self, t_s: float) -> float:
        """For a lock that begins now. A short break does not cut short what a long one before it asked for."""
        c = self._config
        if self._unlocked_s is None or self._past(self._unlocked_s, c.break_s):
            return t_s + c.young_s
        return max(self._trusted_s, t_s + c.settle_s)

    def _follow_doubt(self, facts: MemoryFacts) -> None:
        c = self._config
        sure = facts.locked and facts.confidence >= c.recent_confidence
        if not sure:
            self._confident_since_s = None
        elif self._confident_since_s is None:
            self._confident_since_s = facts.t_s
        if facts.confidence < c.doubt_confidence or TargetAlarm.FALSE_LOCK in facts.alarms:
            self._doubt_s = facts.t_s
        if facts.ambiguous or TargetAlarm.DISTRACTOR in facts.alarms:
            self._rival_s = facts.t_s

    def _distrust(self, facts: MemoryFacts) -> MemoryReason | None:
        """What speaks against the track itself."""
        c = self._config
        if not facts.locked:
            return MemoryReason.NOT_LOCKED
        if TargetAlarm.FALSE_LOCK in facts.alarms:
            return MemoryReason.FALSE_LOCK
        if not self._past(self._trusted_s, 0.0):
            return MemoryReason.SETTLING
        if self._confident_since_s is None:
            return MemoryReason.UNCERTAIN
        if not self._past(self._doubt_s, c.freeze_s):
            return MemoryReason.FROZEN
        if not self._past(self._confident_since_s, c.steady_s):
            return MemoryReason.UNCERTAIN
        return None

    def _look(self, facts: MemoryFacts) -> MemoryReason | None:
        """What speaks against what is in the box."""
        c = self._config
        if not facts.alike or (facts.exemplar is not None and not facts.exemplar >= c.exemplar_min):
            return MemoryReason.UNLIKE_EXEMPLAR
        if _at_edge(facts.box, facts.image_size_px, c.edge_sizes):
            return MemoryReason.AT_EDGE
        if max(size for _, size in self._sizes) - facts.ln_size >= c.occluded_ln_size:
            return MemoryReason.OCCLUDED
        usual = self._usual_ln_size(facts.t_s)
        if usual is None:
            return MemoryReason.NO_HISTORY
        return MemoryReason.SIZE_JUMP if 2.0 * abs(facts.ln_size - usual) > math.log(c.recent_area) else None

    def _choose(self, facts: MemoryFacts) -> MemoryDecision:
        """An anchor when there is reason for one, else the recent one when its time has come."""
        c, usual = self._config, self._usual_ln_size(facts.t_s)
        steady = usual is not None and 2.0 * abs(facts.ln_size - usual) <= math.log(c.anchor_area)
        rival = not self._past(self._rival_s, c.rival_s)
        sure = facts.confidence >= c.anchor_confidence
        if rival and steady and sure and self._past(self._anchor_s, c.anchor_s):
            self._anchor_s = facts.t_s
            return MemoryDecision(MemorySlot.ANCHOR, MemoryReason.WRITE_ANCHOR)
        if facts.ambiguous:
            return MemoryDecision(None, MemoryReason.AMBIGUOUS)
        if not self._past(self._recent_s, c.recent_s):
            return MemoryDecision(None, MemoryReason.TOO_SOON)
        self._recent_s = facts.t_s
        return MemoryDecision(MemorySlot.RECENT, MemoryReason.WRITE_RECENT)

    def _past(self, since_s: float, span_s: float) -> bool:
        return self._t_s - since_s + TIME_EPS_S >= span_s

    def _usual_ln_size(self, t_s: float) -> float | None:
        """The median of the last third of a second, or of the last few pictures where there were not as many."""
        lately = sum(at_s >= t_s - SIZE_MEDIAN_S - TIME_EPS_S for at_s, _ in self._sizes)
        sizes = [size for _, size in self._sizes][-max(lately, SIZE_MIN) :]
        return median(sizes) if len(sizes) >= SIZE_MIN else None


def _at_edge(box: Box, image_size_px: tuple[float, float], edge_sizes: float) -> bool:
    """Whether the box comes so near to the picture's edge that the target may be cut off."""
    margin_px = edge_sizes * math.sqrt(box.w_px * box.h_px)
    x1, y1, x2, y2 = box.to_corners()
    width_px, height_px = image_size_px
    return x1 < margin_px or y1 < margin_px or x2 > width_px - margin_px or y2 > height_px - margin_px
