"""What the confidence is computed from: numbers of one candidate, all finite and bounded.

Three kinds: the response itself, the same relative to what this target usually gives, and how well place and size fit
the motion. A number that was not measured has a neutral value and its indicator `has_...` at 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from tracker.box import Box
from tracker.confidence.reference import RESPONSE, Reference, bounded, known, response
from tracker.filter import BoxFilter
from tracker.messages import Array, Candidate, Evidence

MAX_LN = 2.0  # a factor of 7: beyond, a box is simply wrong
MAX_NIS = 1e4  # squared deviations; a jump over the whole picture
MAX_SIZES = 20.0  # target sizes; the same
MAX_SCALE = 8.0  # of a search window

_RELATIVE = tuple(f"{name}_change" for name in RESPONSE)
_SHAPE = ("scale_jump", "aspect_jump")
_MOTION = ("nis", "innovation", "size_innovation")
_HAS = ("has_exemplar", "has_recent", "has_motion", "has_reference")
FEATURES: tuple[str, ...] = (*RESPONSE, *_RELATIVE, *_SHAPE, *_MOTION, "search_scale", *_HAS)


class Doubt(str, Enum):
    """A kind of evidence that can speak against a candidate."""

    LOW_PEAK = "low_peak"
    AMBIGUOUS = "ambiguous"
    UNLIKE_EXEMPLAR = "unlike_exemplar"
    SHAPE_COLLAPSE = "shape_collapse"
    INNOVATION_GATE = "innovation_gate"


def _with_change(*names: str) -> tuple[str, ...]:
    return (*names, *(f"{name}_change" for name in names))


GROUPS: dict[Doubt, tuple[str, ...]] = {
    Doubt.LOW_PEAK: _with_change("head_1", "head_2", "head_3", "sharpness"),
    Doubt.AMBIGUOUS: _with_change("margin"),
    Doubt.UNLIKE_EXEMPLAR: _with_change("exemplar", "recent"),
    Doubt.SHAPE_COLLAPSE: _SHAPE,
    Doubt.INNOVATION_GATE: _MOTION,
}
# What says whether a feature was measured at all; the rest always is.
INDICATORS: dict[str, str] = {
    "exemplar": "has_exemplar",
    "recent": "has_recent",
    **dict.fromkeys(_MOTION, "has_motion"),
    **dict.fromkeys(_RELATIVE, "has_reference"),
}


@dataclass(frozen=True, slots=True)
class Motion:
    """A candidate against the prediction: normalised innovation squared (4 degrees of freedom), distance of the centres
    in target sizes sqrt(w h), difference in ln(size).
    """

    nis: float
    pos_sizes: float
    ln_size: float

    @classmethod
    def of(cls, box_filter: BoxFilter, box: Box, score: float) -> Motion | None:
        """Of a box against a filter's present estimate; None when the box is not usable."""
        judged = box_filter.innovation(box, score)
        if judged.nis is None or judged.y is None:
            return None
        prior = box_filter.box
        size_px = math.sqrt(prior.w_px * prior.h_px)
        dx, dy, dw, dh = judged.y
        return cls(judged.nis, math.hypot(dx, dy) / size_px, (dw + dh) / 2.0)


def features(candidate: Candidate, motion: Motion | None, reference: Reference | None) -> Array:
    """The features, (len(FEATURES),), named by FEATURES; finite and bounded. Raises ValueError without evidence.

    `nis`, `innovation` and `sharpness` are ln(1 + value), `search_scale` its logarithm, jumps and size innovation are
    absolute values of logarithms.
    """
    evidence = candidate.evidence
    if evidence is None:
        raise ValueError("the candidate has no evidence; its score is all that is known of it")
    change, has_reference = _change(evidence, reference)
    mask = known(evidence)
    return np.array(
        [
            *response(evidence),
            *change,
            _jump(evidence.ln_scale),
            _jump(evidence.ln_aspect),
            *_motion(motion),
            math.log(bounded(evidence.search_scale, 1.0 / MAX_SCALE, MAX_SCALE, 1.0)),
            mask[RESPONSE.index("exemplar")],
            mask[RESPONSE.index("recent")],
            float(motion is not None),
            has_reference,
        ]
    )


def _change(evidence: Evidence, reference: Reference | None) -> tuple[Array, float]:
    """The response less the reference, 0 where either is not known; and whether there is a reference."""
    if reference is None or not reference.ready:
        return np.zeros(len(RESPONSE)), 0.0
    change = np.where(known(evidence) > 0, response(evidence) - reference.values, 0.0)
    return np.nan_to_num(change, nan=0.0), 1.0


def _motion(motion: Motion | None) -> tuple[float, float, float]:
    if motion is None:
        return 0.0, 0.0, 0.0
    return (
        math.log1p(bounded(motion.nis, 0.0, MAX_NIS, MAX_NIS)),
        math.log1p(bounded(motion.pos_sizes, 0.0, MAX_SIZES, MAX_SIZES)),
        _jump(motion.ln_size),
    )


def _jump(ln: float) -> float:
    return bounded(abs(ln), 0.0, MAX_LN, MAX_LN)
