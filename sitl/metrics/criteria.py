"""Criteria: what a run's metrics must reach, and the verdict on each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum


class Source(str, Enum):
    """Where the candidates of a run come from: the network on pictures, or the geometry camera."""

    PIXELS = "pixels"
    GEOMETRY = "geometry"


class Verdict(str, Enum):
    """`NOT_APPLICABLE`: the criterion is one for runs of the other source."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_APPLICABLE = "not_applicable"


@dataclass(frozen=True, slots=True)
class Criterion:
    """`metric` must be at least `minimum` and at most `maximum` (None: no bound), in runs of `when` (None: in all)."""

    metric: str
    minimum: float | None = None
    maximum: float | None = None
    when: Source | None = None


@dataclass(frozen=True, slots=True)
class CriterionResult:
    """One criterion judged; `value` is None when the metric is undefined, `reason` one line for people."""

    criterion: Criterion
    value: float | None
    verdict: Verdict
    reason: str


def judge(
    criteria: Sequence[Criterion], metrics: Mapping[str, float | None], source: Source
) -> tuple[CriterionResult, ...]:
    """The verdict on each criterion, in their order. An undefined, missing or non-finite metric fails its criterion."""
    return tuple(_judge_one(criterion, metrics.get(criterion.metric), source) for criterion in criteria)


def all_passed(results: Sequence[CriterionResult]) -> bool:
    """Whether nothing failed and something was judged: a run without a criterion that applies has shown nothing."""
    verdicts = [r.verdict for r in results]
    return Verdict.FAILED not in verdicts and Verdict.PASSED in verdicts


def _judge_one(criterion: Criterion, value: float | None, source: Source) -> CriterionResult:
    name = criterion.metric
    if criterion.when is not None and criterion.when is not source:
        return CriterionResult(
            criterion, value, Verdict.NOT_APPLICABLE, f"{name}: for {criterion.when.value} runs only"
        )
    if value is None or not math.isfinite(value):
        return CriterionResult(criterion, None, Verdict.FAILED, f"{name}: undefined in this run")
    if criterion.minimum is not None and value < criterion.minimum:
        return CriterionResult(
            criterion, value, Verdict.FAILED, f"{name}: {value:.4g} is below the least, {criterion.minimum:g}"
        )
    if criterion.maximum is not None and value > criterion.maximum:
        return CriterionResult(
            criterion, value, Verdict.FAILED, f"{name}: {value:.4g} is above the most, {criterion.maximum:g}"
        )
    bounds = [
        f"{word} {b:g}"
        for word, b in (("at least", criterion.minimum), ("at most", criterion.maximum))
        if b is not None
    ]
    return CriterionResult(criterion, value, Verdict.PASSED, f"{name}: {value:.4g} ({', '.join(bounds)})")
