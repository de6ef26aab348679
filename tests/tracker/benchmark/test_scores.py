"""Success and precision against values computed by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tracker.benchmark.scores import Scores, centre_errors_px, score
from tracker.box import Box

BOX = Box(100.0, 100.0, 40.0, 40.0)


def moved(dx_px, dy_px=0.0):
    return Box(BOX.cx_px + dx_px, BOX.cy_px + dy_px, BOX.w_px, BOX.h_px)


def test_a_perfect_track_scores_20_of_21_because_the_threshold_is_strict():
    assert score([BOX] * 3, [BOX] * 3) == Scores(3, pytest.approx(20 / 21), 1.0)


def test_half_an_overlap_by_hand():
    # shift by 10 of 40: IoU = 30 / 50 = 0.6, above 0, 0.05 .. 0.55: 12 of 21 thresholds
    assert score([moved(10)], [BOX]) == Scores(1, pytest.approx(12 / 21), 1.0)


@pytest.mark.parametrize(("dx_px", "hit"), [(20.0, 1.0), (20.001, 0.0)])
def test_precision_counts_up_to_and_with_20_px(dx_px, hit):
    assert score([moved(dx_px)], [BOX]).p20 == hit


@pytest.mark.parametrize("absent", [None, Box(math.nan, 1, 1, 1), Box(1, 1, 0, 0)])
def test_frames_without_a_target_count_for_nothing(absent):
    truth = [BOX, absent, BOX]
    assert score([BOX, moved(300), BOX], truth) == Scores(2, pytest.approx(20 / 21), 1.0)
    assert score([BOX], [absent]) == Scores(0, None, None)


@pytest.mark.parametrize("miss", [None, Box(math.nan, 100, 40, 40), Box(math.inf, 100, 40, 40)])
def test_a_frame_without_a_usable_box_is_a_miss_in_both(miss):
    assert score([BOX, miss], [BOX, BOX]) == Scores(2, pytest.approx(10 / 21), 0.5)


def test_centre_errors_are_nan_where_either_is_absent():
    errors = centre_errors_px([moved(3, 4), None, BOX], [BOX, BOX, None])
    assert errors[0] == pytest.approx(5.0)
    assert np.isnan(errors[1:]).all()


@pytest.mark.parametrize("function", [score, centre_errors_px])
def test_lengths_must_agree(function):
    with pytest.raises(ValueError, match="2 boxes against 1"):
        function([BOX, BOX], [BOX])


@given(st.lists(st.floats(0, 60), min_size=2, max_size=8), st.floats(0, 60))
def test_a_farther_box_never_scores_better(shifts, more):
    truth = [BOX] * len(shifts)
    near = score([moved(s) for s in shifts], truth)
    far = score([moved(s + more) for s in shifts], truth)
    assert far.auc <= near.auc + 1e-12
    assert far.p20 <= near.p20
