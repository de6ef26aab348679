"""ROC AUC against counted pairs, calibration against data that is calibrated by construction."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker.benchmark.reliability import BINS, reliability

QUICK = settings(max_examples=25, deadline=None)  # arrays are cheap, drawing them is not
# few different values, so that ties are common
cases = st.lists(st.tuples(st.sampled_from([0.0, 0.1, 0.25, 0.5, 0.9, 1.0]), st.booleans()), min_size=1, max_size=30)


def pairs_won(said, true):
    """Share of pairs (on target, not on target) in which the first has more confidence; a tie is half a win."""
    wins = [(a > b) + 0.5 * (a == b) for a, on in zip(said, true, strict=True) if on for b in off(said, true)]
    return sum(wins) / len(wins) if wins else None


def off(said, true):
    return [b for b, on in zip(said, true, strict=True) if not on]


@QUICK
@given(cases)
def test_roc_auc_is_the_share_of_pairs_won(found):
    said, true = zip(*found, strict=True)
    expected = pairs_won(said, true)
    assert reliability(said, true).roc_auc == (None if expected is None else pytest.approx(expected))


@QUICK
@given(cases)
def test_roc_auc_turns_over_with_the_outcome(found):
    said, true = zip(*found, strict=True)
    auc, other = reliability(said, true).roc_auc, reliability(said, [not t for t in true]).roc_auc
    assert other == (None if auc is None else pytest.approx(1 - auc))


def test_a_calibrated_confidence_has_almost_no_error_and_a_boastful_one_has():
    rng = np.random.default_rng(0)
    said = rng.uniform(size=20000)
    true = rng.uniform(size=said.size) < said
    assert reliability(said, true).ece < 0.015
    assert reliability(np.sqrt(said), true).ece > 0.1
    assert reliability(said, true).brier == pytest.approx(1 / 6, abs=0.01)  # mean of p (1 - p)


def test_bins_by_hand():
    found = reliability([0.05, 0.1, 0.15, 0.95, 1.0], [False, True, False, True, True])
    assert [b.count for b in found.bins] == [1, 2, 0, 0, 0, 0, 0, 0, 0, 2]
    assert (found.bins[0].low, found.bins[-1].high, len(found.bins)) == (0.0, 1.0, BINS)
    assert (found.bins[1].mean_confidence, found.bins[1].on_target_share) == (pytest.approx(0.125), 0.5)
    assert (found.bins[2].mean_confidence, found.bins[2].on_target_share) == (None, None)
    assert found.ece == pytest.approx((0.05 + 2 * 0.375 + 2 * 0.025) / 5)
    assert found.brier == pytest.approx((0.05**2 + 0.9**2 + 0.15**2 + 0.05**2) / 5)
    assert (found.frames, found.on_target_share) == (5, pytest.approx(0.6))


@QUICK
@given(cases)
def test_bins_hold_every_frame_once(found):
    said, true = zip(*found, strict=True)
    bins = reliability(said, true).bins
    assert sum(b.count for b in bins) == len(said)
    assert all(b.mean_confidence is None or b.low <= b.mean_confidence + 1e-12 <= b.high + 2e-12 for b in bins)


def test_no_frames_and_one_kind_only():
    empty = reliability([], [])
    assert (empty.frames, empty.on_target_share, empty.roc_auc, empty.ece, empty.brier) == (0, None, None, None, None)
    assert reliability([0.5, 1.0], [True, True]).roc_auc is None


@pytest.mark.parametrize("bad", [float("nan"), -0.01, 1.01, float("inf")])
def test_what_is_no_probability_is_an_error_that_names_the_frame(bad):
    with pytest.raises(ValueError, match="of frame 1"):
        reliability([0.5, bad], [True, False])


def test_lengths_must_agree():
    with pytest.raises(ValueError, match="2 confidences against 1"):
        reliability([0.5, 0.5], [True])
