"""Which candidate is the target: appearance and motion together.

    total = (1 - w) appearance + w affinity,   affinity = exp(-NIS / 8)

`appearance` is the probability by appearance alone (or the score, where no model is fitted), NIS the squared innovation
of place and size by its covariance: 0.6 one sigma off in each of four, near 0 at the gate. The weight w rises with the
ambiguity: when another place looks nearly as good, appearance tells little (Yang et al. 2024, SAMURAI, section 3, who
mix the overlap with the prediction; a small target at 10 pictures per second overlaps nothing).
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

AFFINITY_NIS = 8.0  # twice the degrees of freedom: a true measurement has an affinity of 0.6 at the median
APART_SIZES = 0.7  # two boxes nearer than this to each other are one thing


@dataclass(frozen=True, slots=True)
class AssociationConfig:
    """Weights of the motion when one candidate stands out, and when another looks as good."""

    affinity_weight: float = 0.3
    ambiguous_weight: float = 0.7
    rival_share: float = 0.8  # of the best appearance: from there on another candidate is a rival

    def __post_init__(self) -> None:
        """Check every range. Raises ValueError naming field, value and range."""
        check_range("association", "affinity_weight", self.affinity_weight, 0.0, 1.0)
        check_range("association", "ambiguous_weight", self.ambiguous_weight, self.affinity_weight, 1.0)
        check_range("association", "rival_share", self.rival_share, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Judged:
    """A candidate against the estimate: probability by appearance alone and with motion, whether inside the gate."""

    candidate: Candidate
    motion: Motion
    appearance: float
    probability: float
    inside: bool

    @property
    def affinity(self) -> float:
        """How well it fits the motion, in [0, 1]."""
        return math.exp(-self.motion.nis / AFFINITY_NIS)


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
    top = max(j.appearance for j in inside)
    alike = [j for j in inside if j.appearance >= config.rival_share * top]
    several = any(apart(a, b) for a in alike for b in alike)
    weight = config.ambiguous_weight if several else config.affinity_weight
    return max(inside, key=lambda j: (1.0 - weight) * j.appearance + weight * j.affinity)


def apart(a: Judged, b: Judged) -> bool:
    """Whether two candidates are at different places, measured by the size of the first."""
    first, second = a.candidate.box, b.candidate.box
    size_px = math.sqrt(first.w_px * first.h_px)
    return math.hypot(first.cx_px - second.cx_px, first.cy_px - second.cy_px) > APART_SIZES * size_px


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
