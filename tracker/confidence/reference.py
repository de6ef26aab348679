"""What the response to this very target is like: some targets give high and sharp peaks, others never do."""

from __future__ import annotations

import math

import numpy as np

from tracker.messages import Array, Candidate, Evidence

HEADS = 3  # as many classification outputs are looked at; a tracker with fewer has logit 0 in the rest
RESPONSE = (*(f"head_{i + 1}" for i in range(HEADS)), "margin", "sharpness", "exemplar", "recent")

MAX_LOGIT = 6.0  # 0.998: what is surer only tells how long the network was trained
MAX_SHARPNESS = 40.0  # deviations; a lone peak in 21 x 21 cells reaches 21
REFERENCE_S = 1.0  # the first confirmed second is that which the operator has looked at
MAX_GAP_S = 0.25  # what passed between two frames further apart was not seen
NEUTRAL_COSINE = 0.5  # stands for a cosine that was not computed: finite, and in the model without weight

_NO_HEAD = 0.5


def bounded(value: float | None, low: float, high: float, neutral: float) -> float:
    """The value held in low..high; `neutral` for None and NaN."""
    return neutral if value is None or math.isnan(value) else min(max(value, low), high)


def response(evidence: Evidence) -> Array:
    """The features of the response, (7,), named by RESPONSE: finite and bounded whatever the evidence holds.

    Logits of the heads, `margin` = 1 - second, ln(1 + sharpness), cosines (NEUTRAL_COSINE when not computed).
    """
    heads = (*evidence.heads, *(_NO_HEAD,) * HEADS)[:HEADS]
    return np.array(
        [
            *(_logit(p) for p in heads),
            bounded(1.0 - evidence.second, -1.0, 1.0, 0.0),
            math.log1p(bounded(evidence.sharpness, 0.0, MAX_SHARPNESS, 0.0)),
            bounded(evidence.exemplar, -1.0, 1.0, NEUTRAL_COSINE),
            bounded(evidence.recent, -1.0, 1.0, NEUTRAL_COSINE),
        ]
    )


def known(evidence: Evidence) -> Array:
    """Which of RESPONSE were measured, (7,) of 0 and 1: all but the cosines that were not computed."""
    cosines = [float(c is not None and not math.isnan(c)) for c in (evidence.exemplar, evidence.recent)]
    return np.array([*(1.0,) * (len(RESPONSE) - len(cosines)), *cosines])


class Reference:
    """Mean response of the target over its first confirmed second; afterwards it never changes."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget: another target."""
        self._sum = np.zeros(len(RESPONSE))
        self._count = np.zeros(len(RESPONSE))
        self._colour_sum, self._colours = 0.0, 0
        self._seen_s = 0.0
        self._last_s: float | None = None

    def add(self, candidate: Candidate, t_s: float) -> None:
        """Take a confirmed candidate of the picture of `t_s` (monotonic s).

        Without evidence, with a time that is not finite or not later than the last one, or once ready, nothing changes.
        """
        if candidate.evidence is None or self.ready or not math.isfinite(t_s):
            return
        if self._last_s is not None:
            if t_s <= self._last_s:
                return
            self._seen_s += min(t_s - self._last_s, MAX_GAP_S)
        self._last_s = t_s
        mask = known(candidate.evidence)
        self._sum += mask * response(candidate.evidence)
        self._count += mask
        colour = candidate.evidence.colour
        if colour is not None and math.isfinite(colour):
            self._colour_sum += colour
            self._colours += 1

    @property
    def ready(self) -> bool:
        """Whether the target was seen for a second in all."""
        return self._seen_s >= REFERENCE_S - 1e-6  # sums of frame times miss a second by rounding

    @property
    def exemplar(self) -> float | None:
        """Mean cosine with the first exemplar; None while not ready or never computed."""
        value = float(self.values[RESPONSE.index("exemplar")])
        return value if self.ready and math.isfinite(value) else None

    @property
    def colour(self) -> float | None:
        """Mean similarity of colours with those remembered; None while not ready or never compared."""
        return self._colour_sum / self._colours if self.ready and self._colours else None

    @property
    def values(self) -> Array:
        """Mean of each of RESPONSE, (7,); NaN where nothing was measured."""
        return np.where(self._count > 0, self._sum / np.maximum(self._count, 1.0), np.nan)


def _logit(p: float) -> float:
    low = 1.0 / (1.0 + math.exp(MAX_LOGIT))
    p = bounded(p, low, 1.0 - low, _NO_HEAD)
    return math.log(p / (1.0 - p))
