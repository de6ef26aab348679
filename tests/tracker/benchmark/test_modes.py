"""The two ways of counting frames without a target, the curves, and means over sequences and attributes."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker.benchmark.attributes import FLAGS, NAMES, by_attribute
from tracker.benchmark.scores import Mode, curves, mean_curves, on_target, overlaps, score
from tracker.box import Box

QUICK = settings(max_examples=25, deadline=None)  # arrays are cheap, drawing them is not
BOX = Box(100.0, 100.0, 40.0, 80.0)
NAN = Box(math.nan, math.nan, math.nan, math.nan)

places = st.floats(-200, 200)
boxes = st.builds(Box, places, places, st.floats(1, 90), st.floats(1, 90))
frames = st.lists(st.tuples(st.none() | boxes, st.none() | boxes), min_size=1, max_size=12)


def moved(dx_px, dy_px=0.0):
    return Box(BOX.cx_px + dx_px, BOX.cy_px + dy_px, BOX.w_px, BOX.h_px)


@pytest.mark.parametrize("mode", Mode)
@QUICK
@given(st.lists(boxes, min_size=1, max_size=8))
def test_a_perfect_track_has_20_of_21_and_all_the_rest_in_both_modes(mode, truth):
    perfect = curves(truth, truth, mode)
    assert perfect.frames == len(truth)
    assert perfect.auc == pytest.approx(20 / 21)
    assert (perfect.p20, perfect.norm_p20, perfect.norm_auc) == (1.0, 1.0, 1.0)


@pytest.mark.parametrize("absent", [None, NAN])
def test_absent_frames_lower_the_auc_and_raise_the_precision_of_the_toolkit_only(absent):
    reported, truth = [moved(30), moved(30), moved(0)], [BOX, absent, BOX]
    honest, toolkit = (curves(reported, truth, mode) for mode in Mode)
    # IoU of the first is 10 / 70: above 0, 0.05, 0.1 of 21 thresholds; its centre is 30 px off
    assert (honest.frames, toolkit.frames) == (2, 3)
    assert honest.auc == pytest.approx((3 + 20) / 42)
    assert toolkit.auc == pytest.approx((3 + 20) / 63)
    assert (honest.p20, toolkit.p20) == (0.5, pytest.approx(2 / 3))
    assert toolkit.precision[0] == pytest.approx(2 / 3)


@QUICK
@given(frames)
def test_the_toolkit_is_never_kinder_in_success_nor_harder_in_precision(pairs):
    reported, truth = map(list, zip(*pairs, strict=True))
    honest, toolkit = (curves(reported, truth, mode) for mode in Mode)
    if honest is None:
        assert (toolkit.auc, toolkit.p20) == (0.0, 1.0)
        return
    assert (toolkit.success <= honest.success + 1e-12).all()
    assert (toolkit.precision >= honest.precision - 1e-12).all()
    assert (toolkit.norm_precision >= honest.norm_precision - 1e-12).all()


@QUICK
@given(frames, boxes)
def test_what_is_reported_while_the_target_is_absent_changes_nothing(pairs, other):
    reported, truth = map(list, zip(*pairs, strict=True))
    changed = [other if t is None else b for b, t in pairs]
    for mode in Mode:
        assert score(reported, truth, mode) == score(changed, truth, mode)


@QUICK
@given(frames, st.integers(0, 99))
def test_mirrored_pictures_and_another_order_score_the_same(pairs, seed):
    def mirrored(box):
        return None if box is None else Box(640 - box.cx_px, box.cy_px, box.w_px, box.h_px)

    order = np.random.default_rng(seed).permutation(len(pairs))
    turned = [tuple(map(mirrored, pairs[i])) for i in order]
    plain, other = (curves(*map(list, zip(*p, strict=True))) for p in (pairs, turned))
    if plain is None:
        assert other is None
        return
    # rounding may move a single value over a threshold, by one frame
    assert plain.auc == pytest.approx(other.auc, abs=1 / 21 + 1e-9)
    assert np.abs(plain.precision - other.precision).sum() <= 1 + 1e-9


def test_the_toolkit_takes_a_truth_beyond_the_picture_s_corner_for_absent_in_precision():
    outside = Box(0.5, 50.0, 20.0, 20.0)  # its centre by x + (w - 1) / 2 is 0: not above
    inside = Box(0.6, 50.0, 20.0, 20.0)
    far = Box(300.0, 300.0, 20.0, 20.0)
    assert score([far], [outside], Mode.TOOLKIT).p20 == 1.0
    assert score([far], [inside], Mode.TOOLKIT).p20 == 0.0
    assert score([far], [outside], Mode.HONEST).p20 == 0.0
    assert score([outside], [outside], Mode.TOOLKIT).auc == pytest.approx(20 / 21)  # success still counts it


@pytest.mark.parametrize("miss", [None, NAN])
@pytest.mark.parametrize("mode", Mode)
def test_a_frame_without_a_box_misses_in_every_score(mode, miss):
    found = curves([miss], [BOX], mode)
    assert (found.auc, found.p20, found.norm_p20, found.norm_auc) == (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(("dx_px", "dy_px", "hit"), [(8, 0, 1.0), (8.1, 0, 0.0), (0, 16, 1.0), (0, 16.2, 0.0)])
def test_normalised_precision_measures_in_sizes_of_the_truth_per_axis(dx_px, dy_px, hit):
    assert curves([moved(dx_px, dy_px)], [BOX]).norm_p20 == hit  # 0.2 of 40 wide, of 80 high


def test_normalised_auc_by_hand():
    # 0.2505 of the width: within 0.26 .. 0.50, 25 of 51 thresholds
    assert curves([moved(0.2505 * 40)], [BOX]).norm_auc == pytest.approx(25 / 51)


def test_curves_fall_and_rise_as_they_must():
    found = curves([moved(d) for d in range(0, 60, 4)], [BOX] * 15)
    assert (len(found.success), len(found.precision), len(found.norm_precision)) == (21, 51, 51)
    assert (np.diff(found.success) <= 0).all()
    assert (np.diff(found.precision) >= 0).all()
    assert found.success[-1] == 0.0


def test_sequences_weigh_the_same_whatever_their_length():
    long, short = curves([moved(300)] * 9, [BOX] * 9), curves([BOX], [BOX])
    mean = mean_curves([long, None, short])
    assert (mean.frames, mean.auc, mean.p20) == (10, pytest.approx(10 / 21), 0.5)
    assert mean_curves([None]) is None


def test_means_by_attribute():
    good, bad = curves([BOX], [BOX]), curves([moved(300)], [BOX])
    table = by_attribute(
        [(frozenset({"SV", "CM"}), good), (frozenset({"SV"}), bad), (frozenset({"OV"}), None), (frozenset(), good)]
    )
    assert list(table) == ["CM", "SV"]
    assert [(count, found.p20) for count, found in table.values()] == [(1, 1.0), (2, 0.5)]


def test_every_attribute_has_a_name():
    assert {flag for flags in FLAGS.values() for flag in flags} == set(NAMES)


def test_overlap_is_unknown_without_a_target_and_on_target_begins_at_0_2():
    truth = [BOX, None, BOX, BOX, NAN]
    third = Box(100.0, 100.0, 40.0, 16.0)  # a fifth of the target
    found = overlaps([None, BOX, third, moved(27), BOX], truth)
    np.testing.assert_allclose(found, [0.0, math.nan, 0.2, 13 / 67, math.nan])
    assert on_target([None, BOX, third, moved(27), BOX], truth).tolist() == [False, False, True, False, False]
    with pytest.raises(ValueError, match="1 boxes against 2"):
        overlaps([BOX], [BOX, BOX])
