from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.measure import PERFECT, MeasuredBox, MeasurementModel, MeasurementParams
from sitl.scene import ObjectTruth
from tracker.box import Box

SIZE = (640.0, 480.0)
BOX = Box(300, 220, 60, 30)
SEEN = ObjectTruth("target", BOX, BOX, 1.0, 0.0, (300.0, 220.0), 23.0)
HIDDEN = ObjectTruth("target", BOX, None, 0.0, 0.0, (300.0, 220.0), 23.0)
TWIN_BOX = Box(360, 235, 58, 29)
TWIN = ObjectTruth("twin", TWIN_BOX, TWIN_BOX, 1.0, 0.0, (360.0, 235.0), 24.0)


def at(model: MeasurementModel, t_s: float, truth: ObjectTruth = SEEN, *others: ObjectTruth) -> tuple[MeasuredBox, ...]:
    return model.candidates({o.name: o for o in (truth, *others)}, "target", t_s, SIZE)


def mirrored(truth: ObjectTruth) -> ObjectTruth:
    def turned(box: Box | None) -> Box | None:
        return None if box is None else Box(SIZE[0] - box.cx_px, box.cy_px, box.w_px, box.h_px)

    return replace(truth, amodal=turned(truth.amodal), visible=turned(truth.visible))


def test_without_errors_it_is_the_truth() -> None:
    (found,) = at(MeasurementModel(PERFECT), 1.0)
    assert found.box == BOX
    assert found.score == PERFECT.score_whole


def test_part_of_the_target_gives_a_box_between_the_visible_and_the_whole_one_and_a_lower_score() -> None:
    model, part = MeasurementModel(PERFECT), Box(285, 220, 30, 30)
    middle = (PERFECT.whole_above + PERFECT.found_above) / 2
    (found,) = at(model, 1.0, replace(SEEN, visible=part, visibility=middle))
    assert found.box == Box(292.5, 220, 45, 30)
    assert found.score == pytest.approx((PERFECT.score_whole + PERFECT.score_least) / 2)
    (least,) = at(model, 1.0, replace(SEEN, visible=part, visibility=PERFECT.found_above))
    assert least.box == part
    assert least.score == pytest.approx(PERFECT.score_least)
    assert at(model, 1.0, replace(SEEN, visible=part, visibility=PERFECT.found_above - 0.01)) == ()


def test_a_target_cut_by_the_border_counts_as_partly_visible() -> None:
    (found,) = at(MeasurementModel(PERFECT), 1.0, replace(SEEN, truncation=0.5, visible=Box(285, 220, 30, 30)))
    assert found.box.w_px < 60
    assert found.score < PERFECT.score_whole


def test_a_hidden_target_gives_clutter_of_low_score_only() -> None:
    model = MeasurementModel(seed=3)
    found = [m for i in range(600) for m in at(model, i / 30, HIDDEN)]
    assert 0.4 * 600 < len(found) < 0.6 * 600
    assert max(m.score for m in found) < 0.55  # the application's threshold for a new lock
    reach = 2.26 * math.sqrt(60 * 30)
    assert all(max(abs(m.box.cx_px - 300), abs(m.box.cy_px - 220)) <= reach + 1e-9 for m in found)


def test_errors_have_the_sizes_of_the_parameters() -> None:
    p = MeasurementParams(drop_share=0.0)
    found = [at(MeasurementModel(p, seed), t_s)[0] for seed in range(60) for t_s in (0.0, 7.3, 19.1)]
    place = math.sqrt(p.bias_share**2 + p.wander_share**2 + p.white_share**2)
    size = math.sqrt(p.bias_size_share**2 + p.wander_size_share**2 + p.white_size_share**2)
    for values, sigma in (
        ([(m.box.cx_px - 300) / 60 for m in found], place),
        ([(m.box.cy_px - 220) / 30 for m in found], place),
        ([math.log(m.box.w_px / 60) for m in found], size),
        ([math.log(m.box.h_px / 30) for m in found], size),
    ):
        assert math.sqrt(sum(v * v for v in values) / len(values)) == pytest.approx(sigma, rel=0.3)


def test_the_wander_is_slow_and_the_bias_stays() -> None:
    quiet = replace(PERFECT, wander_share=0.1)
    model = MeasurementModel(quiet, 5)
    x = [at(model, i / 30)[0].box.cx_px for i in range(300)]
    steps = [abs(b - a) for a, b in pairwise(x)]
    assert max(x) - min(x) > 6.0
    assert max(steps) < 1.0
    biased = MeasurementModel(replace(PERFECT, bias_share=0.1), 5)
    assert len({at(biased, i / 30)[0].box for i in range(30)}) == 1
    assert at(biased, 0.0)[0].box.cx_px != 300


def test_the_overlap_with_the_truth_is_that_of_a_good_tracker() -> None:
    overlaps = [
        at(MeasurementModel(MeasurementParams(drop_share=0), seed), t)[0].box.iou(BOX)
        for seed in range(40)
        for t in (1, 2)
    ]
    assert 0.75 < sum(overlaps) / len(overlaps) < 0.95
    assert min(overlaps) > 0.5


def test_pictures_are_dropped_at_the_given_share() -> None:
    model = MeasurementModel(replace(PERFECT, drop_share=0.2), 1)
    empty = sum(at(model, i / 30) == () for i in range(1000))
    assert 150 < empty < 250


def test_a_look_alike_is_found_beside_the_target_and_in_its_place() -> None:
    model = MeasurementModel(seed=2, look_alikes=frozenset({"twin"}))
    beside = [at(model, i / 30, SEEN, TWIN) for i in range(300)]
    assert all(sum(m.box == TWIN_BOX for m in found) == 1 for found in beside)
    first = [pair[0].box != TWIN_BOX for pair in beside if len(pair) == 2]
    assert 0.85 < sum(first) / len(first) <= 1.0  # now and then the wrong one looks better
    instead = [
        max((m.score for m in at(model, i / 30, HIDDEN, TWIN) if m.box == TWIN_BOX), default=0) for i in range(300)
    ]
    assert 0.5 < sum(score >= 0.55 for score in instead) / 300 < 0.95
    stranger = MeasurementModel(seed=2)
    assert max(m.score for i in range(300) for m in at(stranger, i / 30, HIDDEN, TWIN)) < 0.7
    assert sum(m.score >= 0.55 for i in range(300) for m in at(stranger, i / 30, HIDDEN, TWIN)) < 10


def test_what_is_far_away_or_of_another_size_is_not_found() -> None:
    model = MeasurementModel(PERFECT, look_alikes=frozenset({"twin"}))
    far = Box(550, 220, 58, 29)
    big = Box(360, 235, 160, 80)
    assert len(at(model, 0.0, SEEN, replace(TWIN, visible=far))) == 1
    assert len(at(model, 0.0, SEEN, replace(TWIN, visible=big))) == 1
    assert len(at(model, 0.0, SEEN, replace(TWIN, visibility=0.1))) == 1
    assert len(at(model, 0.0, SEEN, TWIN)) == 2


def test_nothing_is_found_where_the_tracker_does_not_look_or_outside_of_the_picture() -> None:
    model = MeasurementModel(PERFECT)
    assert model.candidates({"target": SEEN}, "target", 0.0, SIZE, searched_px=[(310.0, 230.0)]) != ()
    assert model.candidates({"target": SEEN}, "target", 0.0, SIZE, searched_px=[(500.0, 220.0)]) == ()
    both = [(500.0, 220.0), (310.0, 230.0)]
    assert model.candidates({"target": SEEN}, "target", 0.0, SIZE, searched_px=both) != ()
    outside = Box(-5, 220, 60, 30)
    assert at(model, 0.0, replace(SEEN, amodal=outside, visible=outside, truncation=0.6)) == ()
    assert at(model, 0.0, replace(SEEN, amodal=None, visible=None)) == ()


@given(st.integers(0, 5), st.floats(0, 100), st.booleans(), st.booleans())
def test_a_mirrored_model_sees_the_mirror_image(seed: int, t_s: float, hide: bool, twin: bool) -> None:
    truths = [HIDDEN if hide else SEEN] + ([TWIN] if twin else [])
    names = frozenset({"twin"})
    ours = at(MeasurementModel(seed=seed, look_alikes=names), t_s, *truths)
    theirs = at(MeasurementModel(seed=seed, look_alikes=names, mirrored=True), t_s, *map(mirrored, truths))
    assert len(ours) == len(theirs)
    for a, b in zip(ours, theirs, strict=True):
        assert b.score == a.score
        assert b.box.cx_px == pytest.approx(SIZE[0] - a.box.cx_px)
        assert (b.box.cy_px, b.box.w_px, b.box.h_px) == (a.box.cy_px, a.box.w_px, a.box.h_px)


@given(st.integers(0, 3), st.lists(st.floats(0, 60), min_size=1, max_size=6))
def test_it_is_a_function_of_seed_and_time_in_whatever_order(seed: int, times: list[float]) -> None:
    one, other = MeasurementModel(seed=seed), MeasurementModel(seed=seed)
    forwards = {t: at(one, t) for t in times}
    backwards = {t: at(other, t) for t in reversed(times)}
    assert forwards == backwards


def test_another_seed_is_another_run() -> None:
    assert at(MeasurementModel(seed=1), 0.5) != at(MeasurementModel(seed=2), 0.5)


visibility = st.floats(0, 1)
sizes = st.floats(1, 400)
boxes = st.builds(Box, st.floats(-700, 1300), st.floats(-500, 900), sizes, sizes)


@given(st.none() | boxes, st.none() | boxes, visibility, visibility, st.floats(0, 10))
def test_every_find_is_valid_in_the_picture_scored_and_sorted(
    amodal: Box | None, visible: Box | None, seen: float, cut: float, t_s: float
) -> None:
    truth = ObjectTruth("target", amodal, visible, seen, cut, None, 20.0)
    found = at(MeasurementModel(seed=1), t_s, truth, TWIN)
    assert [m.score for m in found] == sorted((m.score for m in found), reverse=True)
    for m in found:
        assert m.box.is_valid
        assert 0.0 <= m.score <= 1.0
        assert 0.0 <= m.box.cx_px <= SIZE[0]
        assert 0.0 <= m.box.cy_px <= SIZE[1]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"white_share": -0.1}, "white_share"),
        ({"drop_share": math.nan}, "drop_share"),
        ({"score_whole": 1.2}, "score_whole"),
        ({"wander_time_s": 0.0}, "wander_time_s"),
        ({"found_above": 0.9}, "found_above"),
    ],
)
def test_parameters_are_checked(change: dict[str, float], expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        MeasurementParams(**change)


def test_a_bad_call_is_refused() -> None:
    with pytest.raises(ValueError, match="t_s"):
        at(MeasurementModel(), math.nan)
    with pytest.raises(KeyError):
        MeasurementModel().candidates({}, "target", 0.0, SIZE)
