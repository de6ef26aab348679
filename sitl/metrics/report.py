"""The content of run.json (docs/interfaces.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from sitl.metrics.criteria import CriterionResult, all_passed
from sitl.metrics.names import METRIC_NAMES

SCHEMA = 1


def run_json(
    *,
    scenario: str,
    seed: int,
    flavour: str,
    engine: str,
    versions: Mapping[str, str],
    commit: str | None,
    metrics: Mapping[str, float | None],
    criteria: Sequence[CriterionResult],
    pending: Sequence[str] = (),
    interrupted: bool = False,
    about: Mapping[str, object] | None = None,
) -> dict[str, object]:
    """A mapping that `json.dumps(..., allow_nan=False)` takes; undefined and non-finite numbers are null.

    `commit` None: not known. `pending`: why the scenario could not run as it stands. `passed` is False for one that is
    pending or was interrupted. `about`: what else the run was, taken over as it is.
    """
    known = [name for name in METRIC_NAMES if name in metrics]
    others = [name for name in metrics if name not in METRIC_NAMES]
    return {
        "schema": SCHEMA,
        "scenario": scenario,
        "seed": seed,
        "flavour": flavour,
        "engine": engine,
        "versions": dict(versions),
        "commit": commit,
        "pending": list(pending),
        "interrupted": interrupted,
        "passed": not pending and not interrupted and all_passed(criteria),
        **(about or {}),
        "metrics": {name: _number(metrics[name]) for name in known + others},
        "criteria": [_criterion(result) for result in criteria],
    }


def _criterion(result: CriterionResult) -> dict[str, object]:
    c = result.criterion
    return {
        "metric": c.metric,
        "min": _number(c.minimum),
        "max": _number(c.maximum),
        "when": None if c.when is None else c.when.value,
        "value": _number(result.value),
        "verdict": result.verdict.value,
        "reason": result.reason,
    }


def _number(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None
