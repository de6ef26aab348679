from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.metrics import picture
from sitl.metrics.sample import Sample
from sitl.scene import ObjectTruth
from tests.sitl.metrics.samples import BOX, FAR_BOX, GOOD, HIDDEN, TRUTH, run
from tracker.box import Box


def idle_until(first: int, i: int, s: Sample) -> Sample:
    return replace(s, status="IDLE", box=None) if i < first else s


def test_a_perfect_run() -> None:
    samples = run(90)
    assert picture.lock_share(samples) == 1.0
    assert picture.honest_lock_share(samples) == 1.0
    assert picture.false_confirmed_share(samples) == 0.0
    assert picture.iou_mean(samples) == 1.0
    assert picture.final_locked_on_target(samples) == 1.0
    assert picture.centre_metrics(samples, 500.0) == {
        "centre_err_rms_px": 0.0,
        "centre_err_p95_px": 0.0,
        "centre_err_rms_deg": 0.0,
    }


def test_nothing_is_none_and_before_the_selection_nothing_counts() -> None:
    assert picture.lock_share([]) is None
    assert picture.final_locked_on_target([]) is None
    idle = run(30, lambda i, s: idle_until(99, i, s))
    for metric in (picture.lock_share, picture.honest_lock_share, picture.false_confirmed_share, picture.iou_mean):
        assert metric(idle) is None
    assert picture.final_locked_on_target(idle) == 0.0
    half = run(60, lambda i, s: idle_until(30, i, s))
    assert picture.lock_share(half) == 1.0
    assert picture.centre_metrics(idle, 500.0)["centre_err_p95_px"] is None


def test_lock_share_counts_sight_only_and_no_false_lock() -> None:
    def change(i: int, s: Sample) -> Sample:
        if i < 10:
            return replace(s, truth=HIDDEN, status="COASTING")  # hidden: does not count
        if i < 20:
            return replace(s, box=FAR_BOX)  # locked, on something else
        return s if i < 40 else replace(s, status="SEARCHING")

    assert picture.lock_share(run(50, change)) == 20 / 40


def test_false_confirmed_is_locked_while_hidden_or_elsewhere() -> None:
    changed = [
        GOOD,
        replace(GOOD, truth=HIDDEN),
        replace(GOOD, truth=None),  # a black picture
        replace(GOOD, box=FAR_BOX),
        replace(GOOD, box=None),
        replace(GOOD, truth=replace(TRUTH, amodal=None)),
        replace(GOOD, box=FAR_BOX, status="COASTING"),
        replace(GOOD, truth=HIDDEN, status="SEARCHING"),
    ]
    assert picture.false_confirmed_share(changed) == 5 / 8


def test_a_tracker_that_is_always_locked_has_false_confirmations_where_it_misses() -> None:
    """docs/interfaces.md: the share of a raw tracker is that of its misses."""
    assert picture.false_confirmed_share(run(100, lambda i, s: s if i < 70 else replace(s, box=FAR_BOX))) == 0.3


def test_honest_lock_share() -> None:
    def change(i: int, s: Sample) -> Sample:
        if i < 10:
            return replace(s, box=FAR_BOX, status="SEARCHING")  # not a good box: does not count
        return replace(s, status="COASTING") if i < 20 else s

    assert picture.honest_lock_share(run(60, change)) == 40 / 50


def test_iou_mean_takes_a_missing_box_as_zero() -> None:
    half = Box(BOX.cx_px + BOX.w_px / 2, BOX.cy_px, BOX.w_px, BOX.h_px)  # IoU 1/3
    assert picture.iou_mean([GOOD, replace(GOOD, box=None), replace(GOOD, box=half)]) == pytest.approx((1 + 1 / 3) / 3)


@pytest.mark.parametrize(("bad_of_last_15", "expected"), [(0, 1.0), (7, 1.0), (8, 0.0), (15, 0.0)])
def test_the_end_is_the_most_of_the_last_half_second(bad_of_last_15: int, expected: float) -> None:
    samples = run(90, lambda i, s: replace(s, status="COASTING") if i >= 90 - bad_of_last_15 else s)
    assert picture.final_locked_on_target(samples) == expected


def test_a_lock_on_something_else_at_the_end_is_none() -> None:
    assert picture.final_locked_on_target(run(60, lambda i, s: replace(s, box=FAR_BOX))) == 0.0


def test_centre_errors_count_visible_samples_since_the_first_lock() -> None:
    def change(i: int, s: Sample) -> Sample:
        if i < 10:
            return replace(s, status="ACQUIRING", truth=replace(TRUTH, centre_px=(0.0, 0.0)))
        if i < 20:
            return replace(s, truth=replace(HIDDEN, centre_px=(0.0, 0.0)))
        return replace(s, truth=replace(TRUTH, centre_px=(323.0, 244.0)))

    found = picture.centre_metrics(run(60, change), 500.0)
    assert found["centre_err_rms_px"] == pytest.approx(5.0)
    assert found["centre_err_p95_px"] == pytest.approx(5.0)
    assert found["centre_err_rms_deg"] == pytest.approx(math.degrees(math.atan2(5, 500)))


boxes = st.builds(Box, st.floats(0, 640), st.floats(0, 480), st.floats(5, 80), st.floats(5, 80))
truths = st.builds(
    ObjectTruth,
    st.just("target"),
    st.none() | boxes,
    st.none() | boxes,
    st.floats(0, 1),
    st.floats(0, 1),
    st.none() | st.tuples(st.floats(-100, 800), st.floats(-100, 600)),
    st.floats(1, 50),
)
statuses = st.sampled_from(["IDLE", "ACQUIRING", "LOCKED", "COASTING", "SEARCHING", "LOST"])


@given(st.lists(st.tuples(statuses, st.none() | boxes, st.none() | truths), max_size=25))
def test_shares_lie_between_zero_and_one(rows: list[tuple[str, Box | None, ObjectTruth | None]]) -> None:
    samples = [
        replace(s, status=status, box=box, truth=truth)
        for s, (status, box, truth) in zip(run(len(rows)), rows, strict=True)
    ]
    for metric in (
        picture.lock_share,
        picture.honest_lock_share,
        picture.false_confirmed_share,
        picture.iou_mean,
        picture.final_locked_on_target,
    ):
        value = metric(samples)
        assert value is None or 0.0 <= value <= 1.0
