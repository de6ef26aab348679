"""What is watched beside the status: alarms for the operator, and what the tracker should remember."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tracker.alarms import AlarmFacts, Alarms, LockFacts, active
from tracker.association import Judged
from tracker.filter import BoxFilter
from tracker.memory_gates import MemoryFacts, MemoryGates
from tracker.messages import Candidate, MemoryWrite, TargetAlarm


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """One step as it was seen: `chosen` entered the estimate (None: nothing did); sizes in px, time in monotonic s.

    `ego_known`: the camera's own motion is taken off, so that the estimate's velocity is the target's. `alike`: what
    was chosen looks like the target by features and colours.
    """

    t_s: float
    locked: bool
    confidence: float
    candidates: Sequence[Candidate]
    chosen: Judged | None
    estimate: BoxFilter
    image_size_px: tuple[float, float]
    ego_known: bool
    alike: bool


class Watch:
    """Alarms and memory gates over the steps of one target. Never raises in the loop."""

    def __init__(self) -> None:
        self._alarms = Alarms()
        self._gates = MemoryGates()

    def reset(self, t_s: float) -> None:
        """Begin with a new target, selected at `t_s`."""
        self._alarms.reset()
        self._gates.reset(t_s)

    def end_of_lock(self) -> None:
        """A false lock was ended: what spoke against it says nothing about the next one."""
        self._alarms.false_lock.relock()

    def shift(self, dx_px: float, dy_px: float) -> None:
        """Move with the picture (ego-motion)."""
        self._alarms.shift(dx_px, dy_px)

    def step(self, seen: Sight) -> tuple[tuple[TargetAlarm, ...], MemoryWrite | None]:
        """The alarms that are on, and the wish to remember what was chosen, when every gate passes."""
        evidence = seen.chosen.candidate.evidence if seen.chosen is not None else None
        exemplar = evidence.exemplar if evidence is not None else None
        alarms = self._alarm(seen, exemplar, evidence.recent if evidence is not None else None)
        box = seen.chosen.candidate.box if seen.chosen is not None else seen.estimate.box
        facts = MemoryFacts(
            seen.t_s,
            locked=seen.locked and seen.chosen is not None and TargetAlarm.FALSE_LOCK not in alarms,
            confidence=seen.confidence,
            ambiguous=TargetAlarm.DISTRACTOR in alarms,
            exemplar=exemplar,
            box=box,
            image_size_px=seen.image_size_px,
            ln_size=0.5 * math.log(box.w_px * box.h_px),
            alarms=alarms,
            alike=seen.alike,
        )
        decision = self._gates.step(facts)
        return alarms, MemoryWrite(decision.slot, box) if decision.slot is not None else None

    def _alarm(self, seen: Sight, exemplar: float | None, recent: float | None) -> tuple[TargetAlarm, ...]:
        box = seen.estimate.box
        ln_size = 0.5 * math.log(box.w_px * box.h_px)
        lock = LockFacts(
            seen.t_s,
            seen.locked,
            exemplar=exemplar,
            recent=recent,
            ln_size=ln_size,
            nis=seen.chosen.motion.nis if seen.chosen is not None else None,
            speed_sizes_s=math.hypot(*seen.estimate.vel_px_s) / math.exp(ln_size) if seen.ego_known else None,
        )
        chosen = seen.chosen.candidate if seen.chosen is not None else None
        return active(*self._alarms.step(AlarmFacts(seen.candidates, chosen, lock)))
