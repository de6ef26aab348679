"""Which candidate is the target: appearance and motion together.

    total = ln(p / (1 - p)) - motion_weight NIS / 2

p is the probability by appearance alone (or the score, where no model is fitted), NIS the squared innovation of place
and size by its covariance: both terms are log-likelihoods, of look and of motion. So the more alike two candidates
look, the more motion decides; one that stands out wins even where it was not expected, as far as the gate reaches.
(SAMURAI, Yang et al. 2024, mixes score and overlap with the prediction; a small target at 10 pictures per second
overlaps nothing.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tracker.confidence.features import Motion
from tracker.confidence.model import ConfidenceModel
from tracker.confidence.reference import Reference
from tracker.filter import BoxFilter, check_range, usable_box
from tracker.messages import Candidate

MAX_LOGIT = 6.0  # 0.998: surer than that an appearance cannot be
APART_SIZES = 0.7  # two boxes nearer than this to each other are one thing


@dataclass(frozen=True, slots=True)
class AssociationConfig:
    """`motion_weight`: 1 trusts the covariance as it is, less thinks of it as too small."""

    motion_weight: float = 1.0

    def __post_init__(self) -> None:
        """Check every range. Raises ValueError naming field, value and range."""
        check_range("association", "motion_weight", self.motion_weight, 0.0, 10.0)


@dataclass(frozen=True, slots=True)
class Judged:
    """A candidate against the estimate: probability by appearance alone and with motion, whether inside the gate."""

    candidate: Candidate
    motion: Motion
    appearance: float
    probability: float
    inside: bool

    def total(self, motion_weight: float) -> float:
        """Log-likelihood of look and motion."""
        p = min(max(self.appearance, 0.0), 1.0)
        logit = math.log(max(p, 1e-9) / max(1.0 - p, 1e-9))
        return min(max(logit, -MAX_LOGIT), MAX_LOGIT) - 0.5 * motion_weight * self.motion.nis


def judge_all(
    candidates: Sequence[Candidate], estimate: BoxFilter, model: ConfidenceModel, reference: Reference | None
) -> list[Judged]:
    """Every usable candidate judged against the prediction; what is not finite is left out."""
    return [j for c in candidates if (j := _judge(c, estimate, model, reference)) is not None]


def associate(judged: Sequence[Judged], config: AssociationConfig) -> Judged | None:
    """Choose; None of nothing. Those inside the gate come first: outside of it only the best appearance counts."""
    if not judged:
        return None
    inside = [j for j in judged if j.inside]
    if not inside:
        return max(judged, key=_appearance)
    return max(inside, key=lambda j: j.total(config.motion_weight))


def apart(a: Judged, b: Judged, sizes: float = APART_SIZES) -> bool:
    """Whether two candidates are at different places, at least so many sizes of the first apart."""
    first, second = a.candidate.box, b.candidate.box
    size_px = math.sqrt(first.w_px * first.h_px)
    return math.hypot(first.cx_px - second.cx_px, first.cy_px - second.cy_px) > sizes * size_px


def _judge(
    candidate: Candidate, estimate: BoxFilter, model: ConfidenceModel, reference: Reference | None
) -> Judged | None:
    numbers = (candidate.score, candidate.peak, candidate.similarity)
    if not (usable_box(candidate.box) and all(math.isfinite(v) for v in numbers)):
        return None
    appearance = model.probability(candidate, None, reference)
    motion = Motion.of(estimate, candidate.box, appearance)
    if motion is None:
        return None
    inside = estimate.innovation(candidate.box, appearance).accepted
    return Judged(candidate, motion, appearance, model.probability(candidate, motion, reference), inside)


def _appearance(judged: Judged) -> float:
    return judged.appearance
