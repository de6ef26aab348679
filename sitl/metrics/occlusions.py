"""Metrics of hidden times: when the target was not to be seen, and what the application said meanwhile."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from sitl.metrics.picture import on_target
from sitl.metrics.sample import LOCKED, Sample, since_lock

# Less than a tenth of a car is a mirror or a wheel: nothing to recognise it by.
HIDDEN_BELOW = 0.1
# Shorter ones are a lamp post; no tracker has to notice.
MIN_HIDDEN_S = 0.1
# A target found again this long after it came out was found again, not met by chance.
SURVIVED_WITHIN_S = 2.0


@dataclass(frozen=True, slots=True)
class Occlusion:
    """The target is hidden from `start_s` (first sample hidden) to `end_s` (first sample seen again), exposure times.

    `declared_s`: first sample in it that is not LOCKED, None when all are. `found_s`: first sample from `end_s` on that
    is LOCKED on the target and not in a later occlusion, None when there is none.
    """

    start_s: float
    end_s: float
    declared_s: float | None
    found_s: float | None

    @property
    def duration_s(self) -> float:
        """How long it was hidden."""
        return self.end_s - self.start_s

    @property
    def survived(self) -> bool:
        """Whether it was locked on again soon after."""
        return self.found_s is not None and self.found_s - self.end_s <= SURVIVED_WITHIN_S


def occlusions(samples: Sequence[Sample]) -> tuple[Occlusion, ...]:
    """Every hidden time after the first lock that ends before the samples do and lasts 0.1 s or more."""
    seen = since_lock(samples)
    runs: list[tuple[int, int]] = []
    start: int | None = None
    for index, sample in enumerate(seen):
        # A target that the camera looks past is not hidden by anything; one without a picture is.
        if sample.visibility < HIDDEN_BELOW and (sample.truth is None or sample.in_picture):
            start = index if start is None else start
        elif start is not None:
            if sample.t_s - seen[start].t_s >= MIN_HIDDEN_S - 1e-9:
                runs.append((start, index))
            start = None
    ends = [first for first, _ in runs[1:]] + [len(seen)]
    return tuple(_describe(seen, first, stop, end) for (first, stop), end in zip(runs, ends, strict=False))


def _describe(seen: Sequence[Sample], first: int, stop: int, end: int) -> Occlusion:
    declared = next((s.t_s for s in seen[first:stop] if s.status != LOCKED), None)
    found = next((s.t_s for s in seen[stop:end] if on_target(s)), None)
    return Occlusion(seen[first].t_s, seen[stop].t_s, declared, found)


def occlusion_metrics(samples: Sequence[Sample]) -> dict[str, float | None]:
    """The metrics of hidden times; all None when there was none.

    `occlusion_longest_survived_s`: the longest after which the target was locked on again within 2 s; 0 when none was.
    `reacquire_median_s`: from coming out to that lock, of the hidden times in which the lock was given up; one never
    found again counts as infinite, and an infinite median is None.
    `declare_loss_median_s`: from going hidden to the first sample not LOCKED; one never declared counts as infinite.
    """
    found = occlusions(samples)
    lost = [o for o in found if o.declared_s is not None]
    return {
        "occlusion_longest_survived_s": max((o.duration_s if o.survived else 0.0 for o in found), default=None),
        "reacquire_median_s": _median([_after(o.found_s, o.end_s) for o in lost]),
        "declare_loss_median_s": _median([_after(o.declared_s, o.start_s) for o in found]),
    }


def _after(time_s: float | None, reference_s: float) -> float:
    return float("inf") if time_s is None else time_s - reference_s


def _median(values: Sequence[float]) -> float | None:
    """None of nothing, and when half or more of the values are infinite."""
    if not values:
        return None
    middle = statistics.median(values)
    return middle if middle != float("inf") else None
