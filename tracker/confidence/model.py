"""The probability that a candidate is the target: logistic regression, its numbers in the weights' card."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tracker.confidence.features import FEATURES, GROUPS, INDICATORS, Doubt, Motion, features
from tracker.confidence.reference import Reference
from tracker.messages import Array, Candidate

MAX_VALUE, MIN_SCALE = 1e6, 1e-6  # features are bounded by 1e2; what lies outside overflows sooner or later
MAX_WEIGHT = 100.0  # per deviation; a larger one is a fit that went wrong
_NUMBERS = ("mean", "scale", "weights")
_SINGLE = ("bias", "still_gain", "still_bias")


@dataclass(frozen=True, slots=True)
class ConfidenceModel:
    """p = sigmoid(bias + sum of weights (features - mean) / scale), over the features called `names`.

    A feature that was not measured counts as its mean. Where there is no motion to judge by, what remains is less sure:
    p = sigmoid(still_bias + still_gain * sum). Without names (`UNFITTED`) the candidate's score is the answer.
    """

    names: tuple[str, ...]
    mean: tuple[float, ...]
    scale: tuple[float, ...]
    weights: tuple[float, ...]
    bias: float
    still_gain: float = 1.0
    still_bias: float = 0.0

    def __post_init__(self) -> None:
        """Check names, lengths and ranges. Raises ValueError that says what is wrong."""
        unknown = [name for name in self.names if name not in FEATURES]
        if unknown or len(set(self.names)) != len(self.names):
            raise ValueError(f"confidence: names must be different features, unknown: {unknown or 'none'}")
        for name in _NUMBERS:
            values = getattr(self, name)
            if len(values) != len(self.names):
                raise ValueError(f"confidence: {name} has {len(values)} numbers for {len(self.names)} names")
            if not all(abs(v) <= MAX_VALUE for v in values):  # NaN never is
                raise ValueError(f"confidence: {name} has a value that is not finite, or beyond {MAX_VALUE:g}")
        if not all(v >= MIN_SCALE for v in self.scale):
            raise ValueError(f"confidence: every scale must be at least {MIN_SCALE:g}")
        if not all(abs(v) <= MAX_WEIGHT for v in (*self.weights, *(getattr(self, n) for n in _SINGLE))):
            raise ValueError(f"confidence: weights, biases and gain must lie in -{MAX_WEIGHT:g}..{MAX_WEIGHT:g}")

    @classmethod
    def from_card(cls, block: Mapping[str, Any]) -> ConfidenceModel:
        """From the `confidence` block of a weights card. Raises ValueError on what is missing or impossible."""
        if not isinstance(block, Mapping):
            raise ValueError("confidence: must be an object; fit it again")
        missing = [key for key in ("names", *_NUMBERS, *_SINGLE) if key not in block]
        if missing:
            raise ValueError(f"confidence: the block lacks {', '.join(missing)}; fit it again")
        try:
            numbers = [tuple(float(v) for v in block[key]) for key in _NUMBERS]
            names = tuple(str(name) for name in block["names"])
            if not names:
                raise ValueError("confidence: the block names no feature; fit it again, or remove it")
            return cls(names, numbers[0], numbers[1], numbers[2], *(float(block[key]) for key in _SINGLE))
        except (TypeError, OverflowError) as error:
            raise ValueError(f"confidence: an entry is of the wrong kind ({error}); fit it again") from error

    def to_card(self) -> dict[str, Any]:
        """What `from_card` reads."""
        lists = {key: list(getattr(self, key)) for key in ("names", *_NUMBERS)}
        return {**lists, **{key: getattr(self, key) for key in _SINGLE}}

    @property
    def fitted(self) -> bool:
        """Whether there is more than the score."""
        return bool(self.names)

    def probability(self, candidate: Candidate, motion: Motion | None, reference: Reference | None) -> float:
        """In [0, 1], never NaN: the score, when nothing was fitted or the candidate has no evidence."""
        if not self.fitted or candidate.evidence is None:
            return min(max(candidate.score, 0.0), 1.0) if math.isfinite(candidate.score) else 0.0
        total = float(self._contributions(features(candidate, motion, reference)).sum())
        logit = self.still_bias + self.still_gain * total if motion is None else self.bias + total
        return 0.5 * (1.0 + math.tanh(0.5 * logit))

    def reasons(self, candidate: Candidate, motion: Motion | None, reference: Reference | None) -> tuple[Doubt, ...]:
        """Kinds of evidence that speak against the candidate, strongest first; empty where there is only a score."""
        if not self.fitted or candidate.evidence is None:
            return ()
        each = dict(zip(self.names, self._contributions(features(candidate, motion, reference)), strict=True))
        sums = {doubt: sum(float(each.get(name, 0.0)) for name in group) for doubt, group in GROUPS.items()}
        return tuple(sorted((d for d, total in sums.items() if total < 0), key=lambda d: sums[d]))

    def _contributions(self, values: Array) -> Array:
        """Of each named feature to the logit, against the mean of what the model was fitted on; (len(names),)."""
        return np.array(self.weights) * standardised(values, self.names, np.array(self.mean), np.array(self.scale))


def standardised(values: Array, names: tuple[str, ...], mean: Array, scale: Array) -> Array:
    """The features called `names` of rows (..., len(FEATURES)) in deviations, (..., len(names)); 0: not measured."""
    return np.where(measured(values, names), (columns(values, names) - mean) / scale, 0.0)


def columns(values: Array, names: tuple[str, ...]) -> Array:
    """The features called `names` of rows (..., len(FEATURES))."""
    return np.asarray(values[..., [FEATURES.index(name) for name in names]], dtype=np.float64)


def measured(values: Array, names: tuple[str, ...]) -> npt.NDArray[np.bool_]:
    """Which of the features called `names` were measured, by their indicators; as `columns`."""
    always = np.ones(values.shape[:-1], bool)
    each = [values[..., FEATURES.index(INDICATORS[n])] > 0 if n in INDICATORS else always for n in names]
    return np.stack(each, axis=-1)


UNFITTED = ConfidenceModel((), (), (), (), 0.0)
