"""Metrics of the one encounter that a short run is about: hidden whole and back again, or gone for good."""

from __future__ import annotations

from collections.abc import Sequence

from sitl.metrics.occlusions import SURVIVED_WITHIN_S
from sitl.metrics.picture import FALSE_IOU, IN_SIGHT_VISIBILITY, final_locked_on_target, on_target
from sitl.metrics.sample import LOCKED, Sample, since_lock

NAMES = ("hidden_longest_s", "visible_again_s", "reacquired", "reacquire_s", "leave_locked_s")


def encounter_metrics(samples: Sequence[Sample]) -> dict[str, float | None]:
    """From the first lock on; all None without one.

    `hidden_longest_s`: the longest time without any of the target visible, whether or not the run ends in it.
    `visible_again_s`: how long after it the target is in sight (half of it or more) before it is hidden whole again or
    the run ends; None when it does not come back into sight. The three that follow need a lock on the target before:
    `reacquire_s`: from being in sight again to the first sample LOCKED on the target (0 when it is so already).
    `reacquired`: 1 when that takes 2 s at most and the run ends LOCKED on the target, else 0; None with no return.
    `leave_locked_s`: from a true loss to the first sample not LOCKED; None when the run does not end in one, or LOCKED
    to its end. A true loss: hidden whole until the run ends; sooner, when the box left the target before and stayed
    off until then.
    """
    seen = since_lock(samples)
    found: dict[str, float | None] = dict.fromkeys(NAMES)
    spans = _hidden(seen)
    if not spans:
        return found
    first, last = max(spans, key=lambda span: _end_s(seen, span[1]) - seen[span[0]].t_s)
    found["hidden_longest_s"] = _end_s(seen, last) - seen[first].t_s
    following = next((a for a, _ in spans if a >= last), len(seen))
    back = next((i for i in range(last, following) if seen[i].visibility >= IN_SIGHT_VISIBILITY), None)
    if back is not None:
        found["visible_again_s"] = _end_s(seen, following) - seen[back].t_s
        if any(on_target(s) for s in seen[:first]):
            found |= _return(seen, last, back)
    if spans[-1][1] == len(seen):
        found["leave_locked_s"] = _leave_s(seen, spans[-1][0])
    return found


def _hidden(seen: Sequence[Sample]) -> list[tuple[int, int]]:
    """Stretches [first, last) without any of the target visible; a picture that shows nothing hides it too."""
    spans: list[tuple[int, int]] = []
    for i, sample in enumerate(seen):
        if sample.visibility > 0:
            continue
        spans = [*spans[:-1], (spans[-1][0], i + 1)] if spans and spans[-1][1] == i else [*spans, (i, i + 1)]
    return spans


def _end_s(seen: Sequence[Sample], index: int) -> float:
    """When a stretch that ends before `index` is over."""
    return seen[min(index, len(seen) - 1)].t_s


def _return(seen: Sequence[Sample], emerged: int, back: int) -> dict[str, float | None]:
    again = next((s for s in seen[emerged:] if on_target(s)), None)
    if again is None:
        return {"reacquired": 0.0, "reacquire_s": None}
    taken_s = max(0.0, again.t_s - seen[back].t_s)
    soon = taken_s <= SURVIVED_WITHIN_S
    return {"reacquired": float(soon and final_locked_on_target(seen) == 1.0), "reacquire_s": taken_s}


def _leave_s(seen: Sequence[Sample], hidden: int) -> float | None:
    if not any(on_target(s) for s in seen[:hidden]):
        return None  # what was never held cannot be let go
    lost = hidden
    while _is_off(seen[lost - 1]):  # ends at the latest at the sample that was on target
        lost -= 1
    left = next((s for s in seen[lost:] if s.status != LOCKED), None)
    return None if left is None else left.t_s - seen[lost].t_s


def _is_off(sample: Sample) -> bool:
    """LOCKED on something else: neither on the whole silhouette nor on the part of it that is to be seen."""
    if sample.status != LOCKED or sample.iou >= FALSE_IOU:
        return False
    part = sample.truth.visible if sample.truth is not None else None
    return sample.box is None or part is None or sample.box.iou(part) < FALSE_IOU
