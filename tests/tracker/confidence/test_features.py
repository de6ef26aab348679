"""Features and the target's own reference: finite and bounded for everything, neutral for what is not known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tracker.confidence.candidates import BOX, EVIDENCE, bare, candidate
from tracker.box import Box
from tracker.confidence.features import FEATURES, GROUPS, INDICATORS, Motion, features
from tracker.confidence.reference import MAX_LOGIT, NEUTRAL_COSINE, RESPONSE, Reference
from tracker.filter import BoxFilter
from tracker.messages import Candidate, Evidence

anything = st.floats(width=64)
cosine = st.none() | anything


def named(found: Candidate, motion: Motion | None = None, reference: Reference | None = None) -> dict[str, float]:
    return dict(zip(FEATURES, features(found, motion, reference), strict=True))


def seen_for(seconds: float, step_s: float = 0.1, **evidence: float) -> Reference:
    reference = Reference()
    for k in range(round(seconds / step_s) + 1):
        reference.add(candidate(**evidence), 5.0 + k * step_s)
    return reference


@given(
    st.lists(anything, max_size=5).map(tuple), anything, anything, cosine, cosine, anything, anything, anything,
    st.none() | st.builds(Motion, anything, anything, anything),
)  # fmt: skip
def test_features_are_finite_and_bounded_whatever_comes(
    heads, second, sharpness, exemplar, recent, ln_scale, ln_aspect, search_scale, motion
) -> None:
    evidence = Evidence(heads, second, sharpness, exemplar, recent, ln_scale, ln_aspect, search_scale)
    found = Candidate(BOX, 0.5, 0.5, 0.5, evidence)
    reference = seen_for(1.0)
    for given_reference in (None, reference):
        values = features(found, motion, given_reference)
        assert values.shape == (len(FEATURES),)
        assert np.isfinite(values).all()
        assert np.abs(values).max() <= 2 * MAX_LOGIT
    reference.clear()
    reference.add(found, 1.0)
    reference.add(found, float("nan"))
    assert not np.isinf(reference.values).any()


def test_values_of_a_usual_candidate() -> None:
    values = named(candidate(search_scale=2.0), Motion(math.e - 1, math.e - 1, -0.3))
    assert values["head_1"] == pytest.approx(math.log(9))
    assert values["margin"] == pytest.approx(0.6)
    assert values["sharpness"] == pytest.approx(math.log(9))
    assert (values["exemplar"], values["recent"]) == (0.9, 0.8)
    assert (values["scale_jump"], values["aspect_jump"]) == (0.1, 0.2)
    assert (values["nis"], values["innovation"]) == (pytest.approx(1), pytest.approx(1))
    assert values["size_innovation"] == pytest.approx(0.3)
    assert values["search_scale"] == pytest.approx(math.log(2))
    assert [values[n] for n in FEATURES if n.startswith("has_")] == [1, 1, 1, 0]
    assert all(values[f"{n}_change"] == 0 for n in RESPONSE)


def test_what_was_not_measured_is_neutral_and_says_so() -> None:
    values = named(candidate(exemplar=None, recent=float("nan"), heads=(0.9,)))
    assert (values["exemplar"], values["recent"]) == (NEUTRAL_COSINE, NEUTRAL_COSINE)
    assert (values["has_exemplar"], values["has_recent"], values["has_motion"]) == (0, 0, 0)
    assert (values["head_2"], values["head_3"], values["nis"]) == (0, 0, 0)
    with pytest.raises(ValueError, match="no evidence"):
        features(bare(0.5), None, None)


def test_groups_and_indicators_name_features() -> None:
    grouped = [name for group in GROUPS.values() for name in group]
    assert len(set(grouped)) == len(grouped)
    assert set(grouped) == {n for n in FEATURES if n != "search_scale" and not n.startswith("has_")}
    assert set(INDICATORS) <= set(FEATURES)
    assert set(INDICATORS.values()) == {n for n in FEATURES if n.startswith("has_")}


def test_motion_is_measured_against_the_prediction_in_target_sizes() -> None:
    box_filter = BoxFilter()
    box_filter.start(BOX, 1.0)
    size = math.sqrt(BOX.w_px * BOX.h_px)
    moved = Motion.of(box_filter, Box(BOX.cx_px + 3 * size, BOX.cy_px - 4 * size, 60.0, 40.0), 0.9)
    assert moved is not None
    assert moved.pos_sizes == pytest.approx(5.0)
    assert moved.ln_size == pytest.approx(math.log(2))
    assert moved.nis > 100
    assert Motion.of(box_filter, Box(float("nan"), 0.0, 1.0, 1.0), 0.9) is None
    assert Motion.of(box_filter, BOX, float("nan")) is None


@pytest.mark.parametrize("step_s", [1 / 30, 1 / 10, 0.25])
def test_a_reference_is_ready_after_a_second_at_any_frame_rate(step_s: float) -> None:
    reference = Reference()
    for k in range(round(1 / step_s)):
        reference.add(candidate(), k * step_s)
        assert not reference.ready
    reference.add(candidate(), 1.0)
    assert reference.ready


def test_a_gap_does_not_count_as_seen() -> None:
    reference = Reference()
    for t_s in (0.0, 10.0, 20.0):
        reference.add(candidate(), t_s)
    assert not reference.ready


def test_a_reference_is_the_mean_and_then_stays() -> None:
    reference = Reference()
    for k in range(11):
        reference.add(candidate(second=0.2 if k < 5 else 0.4, exemplar=0.9 if k == 3 else None), k / 10)
    margin = RESPONSE.index("margin")
    wanted = (5 * 0.8 + 6 * 0.6) / 11
    assert reference.values[margin] == pytest.approx(wanted)
    assert reference.values[RESPONSE.index("exemplar")] == pytest.approx(0.9), "only where it was measured"
    reference.add(candidate(second=1.0), 3.0)
    assert reference.values[margin] == pytest.approx(wanted)
    reference.clear()
    assert not reference.ready
    assert np.isnan(reference.values).all()


def test_times_that_do_not_go_on_and_candidates_without_evidence_change_nothing() -> None:
    reference = Reference()
    reference.add(candidate(), 1.0)
    before = reference.values
    reference.add(candidate(second=0.0), 1.0)
    reference.add(candidate(second=0.0), 0.5)
    reference.add(candidate(second=0.0), float("inf"))
    reference.add(bare(0.9), 1.1)
    assert np.array_equal(reference.values, before)


def test_changes_are_against_the_reference_once_it_is_ready() -> None:
    early, ready = seen_for(0.5, second=0.1), seen_for(1.0, second=0.1)
    worse = candidate(second=0.7, recent=None)
    assert named(worse, reference=early)["margin_change"] == 0
    values = named(worse, reference=ready)
    assert values["margin_change"] == pytest.approx(-0.6)
    assert values["has_reference"] == 1
    assert values["recent_change"] == 0
    assert named(candidate(second=0.1), reference=ready)["head_1_change"] == pytest.approx(0)


def test_a_cosine_without_reference_has_no_change() -> None:
    reference = Reference()
    for k in range(11):
        reference.add(candidate(exemplar=None), k / 10)
    assert named(candidate(), reference=reference)["exemplar_change"] == 0
    assert EVIDENCE.exemplar is not None
