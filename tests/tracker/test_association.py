"""Which candidate is the target: the gate first, then appearance and motion, each where it tells more."""

import math
from dataclasses import astuple, replace
from itertools import permutations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tracker.scripted import BAD, BOX, IMAGE, SIZE_PX, evidence, seen
from tracker.association import AssociationConfig, Judged, apart, associate, judge_all
from tracker.box import Box
from tracker.confidence.model import UNFITTED, ConfidenceModel
from tracker.filter import BoxFilter
from tracker.messages import Candidate

CONFIG = AssociationConfig()


def estimate(mirrored: bool = False) -> BoxFilter:
    """Of a target that moves 60 px/s right for half a second; predicted to its place at BOX."""
    made = BoxFilter()
    side = -1.0 if mirrored else 1.0
    centre = mirror(BOX) if mirrored else BOX
    made.start(replace(centre, cx_px=centre.cx_px - side * 30.0), 0.0)
    for k in range(1, 15):
        made.predict(k / 30)
        made.update(replace(centre, cx_px=centre.cx_px - side * (30.0 - 2.0 * k)), 0.9)
    made.predict(0.5)
    return made


def mirror(box: Box) -> Box:
    return replace(box, cx_px=IMAGE[0] - box.cx_px)


ESTIMATE, MIRRORED = estimate(), estimate(mirrored=True)  # nothing here changes them


def choose(
    *candidates: Candidate, model: ConfidenceModel = UNFITTED, config: AssociationConfig = CONFIG
) -> Judged | None:
    return associate(judge_all(candidates, ESTIMATE, model, None), config)


def at(sizes: float, score: float, **more) -> Candidate:
    return seen(score, sizes * SIZE_PX, **more)


def test_of_two_that_look_alike_the_motion_decides():
    near, better = at(0.0, 0.8), at(0.8, 0.95)
    assert all(j.inside for j in judge_all([near, better], ESTIMATE, UNFITTED, None))
    for order in ((near, better), (better, near)):
        assert choose(*order).candidate is near


def test_of_two_that_do_not_look_alike_the_appearance_decides():
    off, poor = at(0.5, 0.99), at(0.0, 0.5)
    for order in ((off, poor), (poor, off)):
        assert choose(*order).candidate is off
        assert choose(*order, config=AssociationConfig(motion_weight=3.0)).candidate is poor, "motion told too much"
    assert choose(at(0.0, 0.8), at(0.5, 0.99), config=AssociationConfig(motion_weight=0.0)).candidate == at(0.5, 0.99)


def test_two_boxes_of_one_thing_are_no_rivals_so_the_better_box_is_taken():
    assert choose(at(0.0, 0.8), at(0.25, 1.0)).candidate == at(0.25, 1.0)


def test_the_gate_comes_first():
    far, weak = at(5.0, 1.0), at(0.1, 0.3)
    found = choose(far, weak)
    assert found.candidate is weak
    assert found.inside


def test_outside_of_the_gate_the_best_appearance_counts():
    found = choose(at(5.0, 0.7), at(9.0, 0.9), at(7.0, 0.8))
    assert found.candidate == at(9.0, 0.9)
    assert not found.inside


def test_apart_is_measured_by_the_size_of_the_target():
    target, near, off = judge_all([at(0.0, 0.8), at(0.69, 0.8), at(0.71, 0.8)], ESTIMATE, UNFITTED, None)
    assert not apart(target, near)
    assert apart(target, off)


@pytest.mark.parametrize("bad", BAD)
def test_what_is_not_finite_is_left_out(bad):
    good = at(0.0, 0.3)
    for i in range(7):
        values = [*astuple(BOX), 0.9, 0.9, 0.9]
        values[i] = bad
        spoiled = Candidate(Box(*values[:4]), *values[4:])
        assert choose(spoiled, good).candidate is good
        assert choose(spoiled) is None
    judged = judge_all([seen(of=evidence(bad, second=bad, sharpness=bad, ln_scale=bad))], ESTIMATE, FITTED, None)
    assert all(0.0 <= p <= 1.0 for j in judged for p in (j.appearance, j.probability))


def test_nothing_found_is_nothing_chosen():
    assert choose() is None


@pytest.mark.parametrize("box", [Box(300.0, 200.0, 0.1, 60.0), Box(300.0, 200.0, 1e9, 60.0), Box(1e9, 0.0, 30.0, 60.0)])
def test_what_no_picture_holds_is_left_out(box):
    assert choose(Candidate(box, 0.9, 0.9, 0.9)) is None


FITTED = ConfidenceModel(("head_1", "exemplar", "nis"), (0.0, 0.5, 1.0), (1.0, 0.1, 1.0), (0.5, 1.0, -1.0), 0.0)


def test_a_fitted_model_judges_by_all_evidence_and_not_by_the_score():
    like, unlike = at(0.0, 0.3, of=evidence(0.9)), at(0.1, 0.99, of=evidence(0.1))
    found = choose(unlike, like, model=FITTED)
    assert found.candidate is like
    assert found.appearance > 0.9
    # The motion is in the probability and not in the appearance.
    here, there = judge_all([at(0.0, 0.5, of=evidence()), at(0.8, 0.5, of=evidence())], ESTIMATE, FITTED, None)
    assert here.appearance == there.appearance
    assert here.probability > there.probability


def test_the_total_falls_with_the_distance_and_rises_with_the_appearance():
    box = ESTIMATE.box
    places = [Candidate(replace(box, cx_px=box.cx_px + d * SIZE_PX), 0.8, 0.8, 0.8) for d in (0.0, 0.1, 0.3, 0.6, 1.0)]
    totals = [j.total(1.0) for j in judge_all(places, ESTIMATE, UNFITTED, None)]
    assert totals[0] == pytest.approx(math.log(0.8 / 0.2))
    assert totals == sorted(totals, reverse=True)
    looks = judge_all([Candidate(box, p, p, p) for p in (-1.0, 0.0, 0.2, 0.5, 0.9, 1.0, 7.0)], ESTIMATE, UNFITTED, None)
    totals = [j.total(1.0) for j in looks]
    assert totals == sorted(totals)
    assert all(math.isfinite(v) for v in totals)


found_boxes = st.builds(
    seen, st.floats(0.05, 1.0), st.floats(-80, 80), st.floats(-80, 80), zoom=st.sampled_from((0.8, 1.0, 1.3))
)
several = st.lists(found_boxes, min_size=1, max_size=4, unique_by=lambda c: c.score)


@given(several)
@settings(max_examples=30)
def test_the_order_of_the_candidates_does_not_matter(found):
    judged = judge_all(found, ESTIMATE, UNFITTED, None)
    assert len({associate(order, CONFIG).candidate for order in permutations(judged)}) == 1


@given(several)
@settings(max_examples=30)
def test_a_mirrored_picture_is_judged_alike(found):
    mirrored = [replace(c, box=mirror(c.box)) for c in found]
    here = associate(judge_all(found, ESTIMATE, UNFITTED, None), CONFIG)
    there = associate(judge_all(mirrored, MIRRORED, UNFITTED, None), CONFIG)
    assert found.index(here.candidate) == mirrored.index(there.candidate)
    assert here.motion.nis == pytest.approx(there.motion.nis, rel=1e-6, abs=1e-9)
    assert (here.inside, here.appearance) == (there.inside, there.appearance)


@pytest.mark.parametrize("value", [-0.1, 11.0, math.nan])
def test_config_names_field_and_value(value):
    with pytest.raises(ValueError, match=rf"association motion_weight is {value}, must lie in"):
        AssociationConfig(motion_weight=value)
