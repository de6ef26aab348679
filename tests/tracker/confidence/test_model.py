"""The fitted model: a probability for everything, reasons that fit, cards that cannot be nonsense."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tracker.confidence.candidates import bare, candidate
from tracker.confidence.features import FEATURES, Doubt, Motion
from tracker.confidence.model import MAX_VALUE, MAX_WEIGHT, MIN_SCALE, UNFITTED, ConfidenceModel

anything = st.floats(width=64)


def model(bias: float = 0.0, **weights: float) -> ConfidenceModel:
    """Over the named features, against mean 0.5 and scale 0.5."""
    count = len(weights)
    return ConfidenceModel(tuple(weights), (0.5,) * count, (0.5,) * count, tuple(weights.values()), bias, 1.0, bias)


JUDGE = model(1.0, head_1=1.0, margin=2.0, exemplar=3.0, scale_jump=-2.0, nis=-1.0)


@given(anything, anything, st.none() | anything, anything, st.none() | st.builds(Motion, anything, anything, anything))
def test_a_probability_is_in_range_whatever_comes(second, sharpness, cosine, score, motion) -> None:
    whole = ConfidenceModel(
        FEATURES, (0.0,) * len(FEATURES), (1e-3,) * len(FEATURES), (50.0,) * len(FEATURES), -3.0, 0.5, 2.0
    )
    found = candidate(score, second=second, sharpness=sharpness, exemplar=cosine)
    for judge in (whole, JUDGE, UNFITTED):
        assert 0.0 <= judge.probability(found, motion, None) <= 1.0
        assert 0.0 <= judge.probability(bare(score), motion, None) <= 1.0
        assert set(judge.reasons(found, motion, None)) <= set(Doubt)


def test_the_probability_is_that_of_the_regression() -> None:
    judge = model(0.3, margin=2.0)
    assert judge.probability(candidate(second=0.5), None, None) == pytest.approx(1 / (1 + math.exp(-0.3)))
    better = judge.probability(candidate(second=0.25), None, None)
    assert better == pytest.approx(1 / (1 + math.exp(-0.3 - 2.0 * 0.5)))


def test_without_motion_the_rest_is_weighed_by_its_own_gain() -> None:
    judge = ConfidenceModel(("margin", "nis"), (0.5, 0.0), (0.5, 1.0), (2.0, -1.0), 0.3, 0.5, -0.2)
    found = candidate(second=0.25)
    assert judge.probability(found, None, None) == pytest.approx(1 / (1 + math.exp(0.2 - 0.5)))
    assert judge.probability(found, Motion(0.0, 0.0, 0.0), None) == pytest.approx(1 / (1 + math.exp(-0.3 - 1.0)))


def test_without_a_model_or_evidence_the_score_is_the_answer() -> None:
    assert not UNFITTED.fitted
    assert UNFITTED.probability(candidate(0.37), None, None) == 0.37
    assert JUDGE.probability(bare(0.61), None, None) == 0.61
    assert JUDGE.probability(bare(float("nan")), None, None) == 0.0
    assert UNFITTED.probability(bare(1.7), None, None) == 1.0
    assert UNFITTED.reasons(candidate(), None, None) == JUDGE.reasons(bare(0.1), None, None) == ()


def test_what_was_not_measured_counts_as_usual() -> None:
    judge = model(0.4, exemplar=5.0, nis=-5.0)
    assert judge.probability(candidate(exemplar=None), None, None) == pytest.approx(1 / (1 + math.exp(-0.4)))
    assert judge.probability(candidate(exemplar=0.0), None, None) < 0.1
    assert judge.reasons(candidate(exemplar=None), None, None) == ()


@pytest.mark.parametrize(
    ("evidence", "motion", "doubt"),
    [
        ({"heads": (0.02, 0.9, 0.9)}, None, Doubt.LOW_PEAK),
        ({"second": 1.0}, None, Doubt.AMBIGUOUS),
        ({"exemplar": -0.5}, None, Doubt.UNLIKE_EXEMPLAR),
        ({"ln_scale": -1.5}, None, Doubt.SHAPE_COLLAPSE),
        ({}, Motion(200.0, 4.0, 0.0), Doubt.INNOVATION_GATE),
    ],
)
def test_the_strongest_doubt_comes_first(evidence: dict[str, Any], motion: Motion | None, doubt: Doubt) -> None:
    assert JUDGE.reasons(candidate(**evidence), motion, None)[0] is doubt
    assert doubt not in JUDGE.reasons(candidate(), Motion(0.1, 0.1, 0.0), None)


def test_doubts_are_in_order_of_their_weight() -> None:
    found = candidate(second=1.0, exemplar=-0.5)
    assert JUDGE.reasons(found, None, None)[:2] == (Doubt.UNLIKE_EXEMPLAR, Doubt.AMBIGUOUS)


def test_a_card_keeps_the_model() -> None:
    block = {**JUDGE.to_card(), "fit": {"samples": 3}}
    assert ConfidenceModel.from_card(block) == JUDGE
    assert ConfidenceModel.from_card({**block, "bias": 2}).bias == 2.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"names": ["head_1", "head_1", "nis", "margin", "exemplar"]}, "different features"),
        ({"names": ["head_9", "margin", "exemplar", "scale_jump", "nis"]}, "head_9"),
        ({"mean": [0.0]}, "mean has 1 numbers for 5 names"),
        ({"scale": [1, 1, 1, 1, 0]}, "scale must be at least 1e-06"),
        ({"scale": [1, 1, 1, 1, 1e-300]}, "scale must be at least 1e-06"),
        ({"scale": [1, 1, 1, 1, -1]}, "scale must be at least 1e-06"),
        ({"mean": [0, 0, 0, 0, 1e300]}, "mean has a value that is not finite, or beyond 1e\\+06"),
        ({"weights": [1, 1, 1, 1, float("nan")]}, "weights has a value that is not finite"),
        ({"weights": [1, 1, 1, 1, 1e9]}, "weights has a value that is not finite, or beyond 1e\\+06"),
        ({"weights": [1, 1, 1, 1, -101]}, "must lie in -100..100"),
        ({"names": [], "mean": [], "scale": [], "weights": []}, "names no feature"),
        ({"bias": float("inf")}, "must lie in -100..100"),
        ({"bias": None}, "wrong kind"),
        ({"mean": "abcde"}, "could not convert"),
        ({"mean": 3}, "wrong kind"),
    ],
)
def test_a_card_that_makes_no_sense_is_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        ConfidenceModel.from_card({**JUDGE.to_card(), **change})


def test_the_worst_card_that_is_taken_gives_a_probability_and_no_overflow() -> None:
    every = len(FEATURES)
    worst = ConfidenceModel(FEATURES, (MAX_VALUE,) * every, (MIN_SCALE,) * every, (MAX_WEIGHT,) * every, 0.0)
    mixed = tuple(MAX_WEIGHT * (-1) ** k for k in range(every))
    with np.errstate(all="raise"):
        for judge in (worst, ConfidenceModel(FEATURES, worst.mean, worst.scale, mixed, 0.0)):
            for motion in (None, Motion(1e300, 1e300, 1e300)):
                assert 0.0 <= judge.probability(candidate(sharpness=1e300), motion, None) <= 1.0


def test_an_incomplete_block_names_what_it_lacks() -> None:
    with pytest.raises(ValueError, match="lacks mean, bias, still_gain"):
        ConfidenceModel.from_card({"names": [], "scale": [], "weights": [], "still_bias": 0.0})
    with pytest.raises(ValueError, match="must be an object"):
        ConfidenceModel.from_card([1, 2])  # type: ignore[arg-type]
