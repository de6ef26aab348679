"""The regression of the confidence, and how good it is on sequences that it was not fitted on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from tracker.benchmark.reliability import Reliability, reliability
from tracker.confidence.features import FEATURES, GROUPS, Doubt
from tracker.confidence.model import MAX_WEIGHT, ConfidenceModel, columns, measured, standardised
from tracker.messages import Array
from tracker.training.confidence.samples import Table
from tracker.training.errors import TrainingError

L2 = 0.005  # beside a mean log-likelihood: from 0.001 to 0.03 the ranking is the same; less is better calibrated
L2_STILL = 1e-4  # two numbers for thousands of samples need none, but samples without an error do
MIN_SCALE = 1e-6  # a feature that never changed has no deviation, and gets no weight
DIGITS = 4  # of figures in a card
# Whether something was measured tells how old a track is, and old tracks have drifted more often: no evidence.
FITTED = tuple(name for name in FEATURES if not name.startswith("has_"))
FREE = ("search_scale",)  # may speak for or against
Bounds = tuple[float, float]
AGAINST = frozenset(name for d in (Doubt.SHAPE_COLLAPSE, Doubt.INNOVATION_GATE) for name in GROUPS[d])


@dataclass(frozen=True, slots=True)
class CrossValidated:
    """Each sequence judged by a model fitted on all the others.

    `track`: samples of following and drifting, as in flight; `all`: also the probes. `appearance` and `score`: the
    samples of `track`, judged without the motion and by the tracker's own score. `without`: ROC AUC of `track` when a
    kind of evidence is left out.
    """

    track: Reliability
    all: Reliability
    appearance: Reliability
    score: Reliability
    without: dict[Doubt, float | None]


@dataclass(frozen=True, slots=True)
class Fitted:
    """A model, on how much it was fitted, and its figures on held-out sequences."""

    model: ConfidenceModel
    sequences: tuple[str, ...]
    samples: int
    cross_validated: CrossValidated

    def to_card(self) -> dict[str, Any]:
        """The `confidence` block of a weights card."""
        return {**self.model.to_card(), "fit": self.fit_block()}

    def fit_block(self) -> dict[str, Any]:
        """Where the numbers come from."""
        found = self.cross_validated
        return {
            "sequences": list(self.sequences),
            "samples": self.samples,
            "method": f"logistic regression, L2 {L2:g}; figures: each sequence by a model fitted on the others",
            "cross_validated": {
                "track": _figures(found.track),
                "track_and_probes": _figures(found.all),
                "track_without_motion": _figures(found.appearance),
                "track_by_score": _figures(found.score),
            },
            "roc_auc_without": {doubt.value: _rounded(auc) for doubt, auc in found.without.items()},
        }


def fit(table: Table, names: Sequence[str] = FITTED, l2: float = L2) -> ConfidenceModel:
    """The most likely weights under a Gaussian prior, each of the sign that its feature can only have.

    Without the signs, features that say nearly the same get large weights against each other, and a worse innovation
    could make a target more probable. Raises TrainingError when the samples are of one kind only.
    """
    if not 0 < int(table.on_target.sum()) < len(table):
        raise TrainingError(
            f"confidence: {len(table)} samples, {int(table.on_target.sum())} on target: both kinds are needed; "
            "give more or longer sequences"
        )
    mean, scale = _moments(table, names)
    x = standardised(table.features, tuple(names), mean, scale)
    bounds = [_sign_bounds(name) for name in names]
    weights, bias = _regress(x, table, bounds, l2)
    # Candidates are compared by appearance alone, and that must be a probability too.
    total = standardised(table.without_motion().features, tuple(names), mean, scale) @ weights
    gain, still_bias = _regress(total[:, None], table, [(0.0, MAX_WEIGHT)], L2_STILL)
    return ConfidenceModel(
        tuple(names), _floats(mean), _floats(scale), _floats(weights), bias, float(gain[0]), still_bias
    )


def _regress(x: Array, table: Table, bounds: Sequence[Bounds], l2: float) -> tuple[Array, float]:
    """Weights within bounds and bias of a logistic regression over rows x (N, K)."""
    target, weight = table.on_target.astype(np.float64), table.weight / table.weight.sum()

    def loss(parameters: Array) -> tuple[float, Array]:
        w, bias = parameters[:-1], parameters[-1]
        logit = x @ w + bias
        value = float(weight @ (np.logaddexp(0.0, logit) - target * logit)) + 0.5 * l2 * float(w @ w)
        rest = weight * (_sigmoid(logit) - target)
        return value, np.append(x.T @ rest + l2 * w, rest.sum())

    limits = [*bounds, (-MAX_WEIGHT, MAX_WEIGHT)]
    found = minimize(loss, np.zeros(x.shape[1] + 1), jac=True, method="L-BFGS-B", bounds=limits)
    return found.x[:-1], float(found.x[-1])


def probabilities(model: ConfidenceModel, table: Table) -> Array:
    """What the model says of each sample, (N,)."""
    x = standardised(table.features, model.names, np.array(model.mean), np.array(model.scale))
    total = x @ np.array(model.weights)
    moving = table.features[:, FEATURES.index("has_motion")] > 0
    return _sigmoid(np.where(moving, model.bias + total, model.still_bias + model.still_gain * total))


def held_out(table: Table, judged: Iterable[str], names: Sequence[str] = FITTED, view: Table | None = None) -> Array:
    """Probabilities (N,) of the samples of the sequences `judged`, each by a model fitted on all others; else NaN.

    `view`: the samples as they are judged, when not as they are.
    """
    view = table if view is None else view
    result = np.full(len(table), np.nan)
    for name in judged:
        rows = table.rows_of([name])
        model = fit(table.only(~rows), names)
        result[rows] = probabilities(model, view.only(rows))
    return result


def cross_validate(table: Table, judged: Sequence[str]) -> CrossValidated:
    """Figures over the sequences `judged`; the others of the table are only fitted on. Raises TrainingError."""
    if len(table.sequences) < 2:
        raise TrainingError("confidence: one sequence with samples; at least two are needed to judge one by another")
    rows = table.rows_of(judged)
    track = rows & ~table.probe
    said, true = held_out(table, judged), table.on_target
    by_look = held_out(table, judged, view=table.without_motion())
    without = {}
    for doubt, group in GROUPS.items():
        kept = [name for name in FITTED if name not in group]
        without[doubt] = reliability(held_out(table, judged, kept)[track], true[track]).roc_auc
    return CrossValidated(
        track=reliability(said[track], true[track]),
        all=reliability(said[rows], true[rows]),
        appearance=reliability(by_look[track], true[track]),
        score=reliability(np.clip(table.score[track], 0.0, 1.0), true[track]),
        without=without,
    )


def fitted(table: Table, judged: Sequence[str]) -> Fitted:
    """Fit on everything, with the figures of `judged`. Raises TrainingError."""
    return Fitted(fit(table), table.sequences, len(table), cross_validate(table, judged))


def _moments(table: Table, names: Sequence[str]) -> tuple[Array, Array]:
    """Weighted mean and deviation of each feature where it was measured."""
    values = columns(table.features, tuple(names))
    weight = table.weight[:, None] * measured(table.features, tuple(names))
    total = np.maximum(weight.sum(axis=0), MIN_SCALE)
    mean = (weight * values).sum(axis=0) / total
    deviation = np.sqrt((weight * (values - mean) ** 2).sum(axis=0) / total)
    return mean, np.where(deviation > MIN_SCALE, deviation, 1.0)


def _sign_bounds(name: str) -> Bounds:
    if name in FREE:
        return -MAX_WEIGHT, MAX_WEIGHT
    return (-MAX_WEIGHT, 0.0) if name in AGAINST else (0.0, MAX_WEIGHT)


def _sigmoid(logit: Array) -> Array:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * logit)), dtype=np.float64)


def _floats(values: Array) -> tuple[float, ...]:
    return tuple(float(v) for v in values)


def _figures(found: Reliability) -> dict[str, Any]:
    numbers = {"roc_auc": found.roc_auc, "ece": found.ece, "brier": found.brier, "on_target": found.on_target_share}
    return {"samples": found.frames, **{key: _rounded(value) for key, value in numbers.items()}}


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, DIGITS)
