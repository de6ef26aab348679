"""A target that goes behind something: the estimate goes on from before its box shrank."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import pytest

from tests.tracker.scripted import RATES
from tracker.admission import COVERED_S
from tracker.box import Box
from tracker.collapse import (
    COLLAPSE_LN_SIZE,
    MAX_STATES,
    MEMORY_S,
    MOVING_S,
    MOVING_SIZES_S,
    SUDDEN_LN_SIDE,
    SUDDEN_S,
    SizeMemory,
)
from tracker.filter import BoxFilter, FilterState
from tracker.messages import Candidate, TargetReason, TargetState, TargetStatus
from tracker.target import TargetTracker

IMAGE = (640.0, 480.0)
FPS = 30.0
W_PX, H_PX = 60.0, 40.0
SPEED_PX_S = 40.0
EDGE_PX = 300.0  # x of the occluder's left edge; the target comes from the left
WIDTH_PX = 90.0  # of the occluder


def visible(t_s: float) -> tuple[Candidate, ...]:
    """What is left of a box that moves right at `SPEED_PX_S` behind an occluder, as a tracker finds it."""
    left = 160.0 + SPEED_PX_S * t_s
    right = min(left + W_PX, EDGE_PX)
    after = max(left, EDGE_PX + WIDTH_PX)
    spans = [(left, right), (after, left + W_PX)]
    start, end = max(spans, key=lambda s: s[1] - s[0])
    share = (end - start) / W_PX
    if share < 0.2:
        return ()
    box = Box((start + end) / 2, 200.0, end - start, H_PX * (0.5 + 0.5 * share))
    score = 0.9 if share > 0.35 else 0.5
    return (Candidate(box, score, score, score),)


def true_centre(t_s: float) -> float:
    return 160.0 + SPEED_PX_S * t_s + W_PX / 2


def lose(tracker: TargetTracker, pan_px_s: float = 0.0, ego: bool = True) -> tuple[float, TargetState]:
    """Follow the target behind the occluder until it is first not LOCKED; `ego`: the camera's motion is told."""
    tracker.start(visible(0.0)[0].box, 0.0)
    locked = False
    for k in range(1, 200):
        t_s = k / FPS
        if ego:
            tracker.shift(pan_px_s / FPS, 0.0)
        found = tuple(replace(c, box=replace(c.box, cx_px=c.box.cx_px + pan_px_s * t_s)) for c in visible(t_s))
        state = tracker.step(found, t_s, IMAGE)
        locked = locked or state.status is TargetStatus.LOCKED
        if locked and state.status is not TargetStatus.LOCKED:
            return t_s, state
    raise AssertionError("it was never lost")


def size_px(box: Box) -> float:
    return math.sqrt(box.w_px * box.h_px)


# --- the memory by itself


def state(w_px: float, h_px: float, t_s: float, cx_px: float = 300.0) -> FilterState:
    f = BoxFilter()
    f.start(Box(cx_px, 200.0, w_px, h_px), t_s)
    return f.state()


def remembered(*sizes: tuple[float, float, float]) -> SizeMemory:
    memory = SizeMemory()
    for t_s, w_px, h_px in sizes:
        memory.add(state(w_px, h_px, t_s))
    return memory


def box_of(ln_w: float, ln_h: float) -> Box:
    """One that differs by so much of ln(w) and ln(h)."""
    return Box(300.0, 200.0, W_PX * math.exp(ln_w), H_PX * math.exp(ln_h))


@pytest.mark.parametrize(
    ("ln_w", "ln_h", "collapses"),
    [
        (0.0, 0.0, False),
        (-SUDDEN_LN_SIDE - 0.01, 0.0, True),  # one side alone
        (0.0, -SUDDEN_LN_SIDE - 0.01, True),
        (-SUDDEN_LN_SIDE + 0.01, 0.0, False),
        (-COLLAPSE_LN_SIZE - 0.01, -COLLAPSE_LN_SIZE - 0.01, True),  # both
        (-COLLAPSE_LN_SIZE + 0.01, -COLLAPSE_LN_SIZE + 0.01, False),
        (1.0, 1.0, False),  # growing is none
        (0.6, -0.35, False),  # a turn: one side grows
    ],
)
def test_what_is_a_sudden_collapse(ln_w, ln_h, collapses):
    memory = remembered((0.9, W_PX, H_PX), (1.0, W_PX, H_PX))
    assert memory.collapses(box_of(ln_w, ln_h), 1.03) is collapses
    assert memory.collapses(box_of(ln_w, ln_h), 1.0 + SUDDEN_S) is collapses
    assert not memory.collapses(box_of(ln_w, ln_h), 1.0 + SUDDEN_S + 0.01), "too long ago to be sudden"


def test_without_sizes_or_with_a_box_that_is_none_nothing_collapses():
    assert not SizeMemory().collapses(box_of(-1.0, -1.0), 1.0)
    memory = remembered((1.0, W_PX, H_PX))
    assert not memory.collapses(Box(300.0, 200.0, math.nan, 40.0), 1.0)
    assert not memory.collapses(Box(300.0, 200.0, 0.0, 40.0), 1.0)
    assert remembered().before_collapse() is None


def test_the_freshest_whole_state_is_given_back_and_none_where_nothing_shrank():
    whole = [(k / 10, W_PX, H_PX) for k in range(5)]
    shrinking = [(0.5 + k / 10, W_PX * 0.8**k, H_PX) for k in range(1, 6)]
    before = remembered(*whole, *shrinking).before_collapse()
    assert before.t_s == 0.4
    assert before.ln_size == pytest.approx(math.log(size_px(box_of(0.0, 0.0))))
    assert remembered(*whole).before_collapse() is None
    assert remembered(*((k / 10, W_PX * 1.2**k, H_PX) for k in range(5))).before_collapse() is None


def test_what_is_older_than_the_memory_is_forgotten_and_the_rest_moves_with_the_picture():
    memory = remembered((0.0, 2 * W_PX, 2 * H_PX), (1.0, W_PX, H_PX), (MEMORY_S + 0.1, 0.5 * W_PX, 0.5 * H_PX))
    assert not memory.places_hold
    memory.shift(7.0, -3.0)
    assert memory.places_hold
    before = memory.before_collapse()
    assert before.t_s == 1.0
    assert tuple(before.x[:2]) == (307.0, 197.0)
    memory.clear()
    assert memory.before_collapse() is None


# --- in the target's estimate


def test_behind_an_edge_the_whole_target_is_predicted():
    t_s, state = lose(TargetTracker())
    assert (state.status, state.reason) == (TargetStatus.COASTING, TargetReason.SHAPE_COLLAPSE)
    assert size_px(state.box) == pytest.approx(math.sqrt(W_PX * H_PX), rel=0.15)
    assert state.box.cx_px == pytest.approx(true_centre(t_s), abs=12.0)


@pytest.mark.parametrize("pan_px_s", [0.0, 30.0])
def test_behind_an_edge_it_goes_on_as_fast_as_before(pan_px_s):
    """And not as the strip, which stood still; the camera's turn is not in it either."""
    t_s, state = lose(TargetTracker(), pan_px_s)
    assert state.vel_px_s[0] == pytest.approx(SPEED_PX_S, rel=0.3)
    assert state.box.cx_px == pytest.approx(true_centre(t_s) + pan_px_s * t_s, abs=14.0)


@cache
def collapsed(fps: float, w: float, h: float) -> list[TargetState]:
    """A still target whose box collapses suddenly from 2 s to 2.5 s."""
    tracker = TargetTracker()
    states = [tracker.start(Box(320, 240, W_PX, H_PX), 0.0)]
    for k in range(1, round(3.5 * fps) + 1):
        hidden = 2.0 + 1e-5 < k / fps < 2.5 - 1e-5
        box = Box(320, 240, W_PX * (w if hidden else 1.0), H_PX * (h if hidden else 1.0))
        states.append(tracker.step((Candidate(box, 0.9, 0.9, 0.9),), k / fps, IMAGE))
    return states


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize(("w", "h"), [(0.6, 1.0), (1.0, 0.6), (0.75, 0.75)])
def test_a_sudden_collapse_is_an_occlusion_with_the_size_of_before(w, h, fps):
    states = collapsed(fps, w, h)
    first = next(s for s in states if s.t_s > 2.0 + 1e-5)
    assert (first.status, first.reason) == (TargetStatus.COASTING, TargetReason.SHAPE_COLLAPSE)
    assert (first.box.w_px, first.box.h_px) == pytest.approx((W_PX, H_PX), rel=0.02)
    assert first.chosen is None
    assert (states[-1].status, states[-1].reason) == (TargetStatus.LOCKED, TargetReason.SEEN)
    assert (states[-1].box.w_px, states[-1].box.h_px) == pytest.approx((W_PX, H_PX), rel=0.05)


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize(("w", "h"), [(0.6, 1.0), (1.0, 0.6), (0.75, 0.75)])
def test_it_stays_an_occlusion_for_as_long_as_the_box_is_collapsed(w, h, fps):
    hidden = [s for s in collapsed(fps, w, h) if 2.0 + 1e-5 < s.t_s < 2.5 - 1e-5]
    assert {s.status for s in hidden} == {TargetStatus.COASTING}
    assert all(size_px(s.box) == pytest.approx(math.sqrt(W_PX * H_PX), rel=0.05) for s in hidden)


@pytest.mark.parametrize("fps", RATES)
def test_what_stays_smaller_is_no_longer_covered(fps):
    """It has turned, or moved away: nothing slides along an edge for as long."""
    tracker = TargetTracker()
    tracker.start(Box(320, 240, W_PX, H_PX), 0.0)
    after = []
    for k in range(1, round(4 * fps) + 1):
        box = Box(320, 240, W_PX * (0.65 if k / fps > 2.0 + 1e-5 else 1.0), H_PX)
        after.append(tracker.step((Candidate(box, 0.9, 0.9, 0.9),), k / fps, IMAGE))
    again = next(s for s in after if s.t_s > 2.0 + 1e-5 and s.status is TargetStatus.LOCKED)
    assert 2.0 + COVERED_S - 1e-5 < again.t_s < 2.0 + COVERED_S + 0.4
    assert after[-1].status is TargetStatus.LOCKED
    assert after[-1].box.w_px == pytest.approx(0.65 * W_PX, rel=0.03)


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize("rate_per_s", [0.25, 0.4])
def test_one_that_drives_away_stays_locked_at_every_rate(rate_per_s, fps):
    tracker = TargetTracker()
    tracker.start(Box(320, 240, W_PX, H_PX), 0.0)
    for k in range(1, round(4 * fps) + 1):
        box = box_of(-rate_per_s * k / fps, -rate_per_s * k / fps)
        state = tracker.step((Candidate(box, 0.9, 0.9, 0.9),), k / fps, IMAGE)
        assert state.status is TargetStatus.LOCKED or k / fps < 0.35
        assert size_px(state.box) == pytest.approx(size_px(box), rel=0.1)


def test_one_that_only_drives_away_keeps_its_size():
    tracker = TargetTracker()
    tracker.start(Box(320, 240, W_PX, H_PX), 0.0)
    for k in range(1, 121):
        shrunk = math.exp(-0.1 * k / FPS)
        box = Box(320, 240, W_PX * shrunk, H_PX * shrunk)
        state = tracker.step((Candidate(box, 0.9, 0.9, 0.9),) if k < 120 else (), k / FPS, IMAGE)
    assert state.reason is TargetReason.NO_CANDIDATE
    assert state.box.w_px == pytest.approx(W_PX * math.exp(-0.4), rel=0.05)


def test_the_search_is_for_what_was_found_and_for_the_whole_target_while_it_is_not_seen():
    tracker = TargetTracker()
    lose(tracker)
    assert math.prod(tracker.hint().size_px) == pytest.approx(W_PX * H_PX, rel=0.3)
    tracker.start(visible(0.0)[0].box, 0.0)
    for k in range(1, 30):
        tracker.step(visible(k / FPS), k / FPS, IMAGE)
        assert tracker.hint().size_px == (visible(k / FPS)[0].box.w_px, visible(k / FPS)[0].box.h_px)


def test_without_the_cameras_motion_only_the_size_is_taken_back():
    """A camera that pans unknown to the tracker: the place from before the collapse is a place in another picture."""
    tracker, pan_px_s = TargetTracker(), -60.0
    tracker.start(visible(0.0)[0].box, 0.0)
    before = None
    for k in range(1, 200):
        t_s = k / FPS
        found = tuple(
            Candidate(Box(c.box.cx_px - pan_px_s * t_s, c.box.cy_px, c.box.w_px, c.box.h_px), c.score, 0.9, 0.9)
            for c in visible(t_s)
        )
        state = tracker.step(found, t_s, IMAGE)
        if state.status is TargetStatus.COASTING:
            break
        before = state
    assert state.reason is TargetReason.SHAPE_COLLAPSE
    assert math.sqrt(state.box.w_px * state.box.h_px) == pytest.approx(math.sqrt(W_PX * H_PX), rel=0.15)
    assert state.box.cx_px == pytest.approx(before.box.cx_px + before.vel_px_s[0] / FPS, abs=2.0)


def test_whether_places_hold_is_asked_anew_for_a_new_target():
    tracker = TargetTracker()
    lose(tracker)
    assert tracker._sizes.places_hold, "the camera's motion was told"
    _, state = lose(tracker, pan_px_s=30.0, ego=False)
    twin = TargetTracker()
    _, expected = lose(twin, pan_px_s=30.0, ego=False)
    assert state.box == expected.box


# --- whether it moved


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize(
    ("sizes_s", "seconds", "moving"),
    [
        (0.0, 1.0, False),
        (0.8 * MOVING_SIZES_S, 1.0, False),
        (1.3 * MOVING_SIZES_S, 1.0, True),
        (2.0, 0.5 * MOVING_S, False),
    ],
)
def test_moving_is_what_went_far_on_the_average(sizes_s, seconds, moving, fps):
    size = math.sqrt(W_PX * H_PX)
    for sign in (1.0, -1.0):
        memory, estimate = SizeMemory(), BoxFilter()
        for k in range(round(seconds * fps) + 1):
            estimate.start(Box(300.0 + sign * sizes_s * size * k / fps, 200.0, W_PX, H_PX), k / fps)
            memory.add(estimate.state())
        assert memory.is_moving(math.inf) is moving


def test_a_shake_is_no_motion():
    memory, estimate = SizeMemory(), BoxFilter()
    for k in range(31):
        estimate.start(Box(300.0 + 8.0 * (-1) ** k, 200.0, W_PX, H_PX), k / 30)
        memory.add(estimate.state())
    assert not memory.is_moving(math.inf)


def test_a_clock_that_stands_still_does_not_fill_the_memory():
    memory, estimate = SizeMemory(), BoxFilter()
    estimate.start(Box(300.0, 200.0, W_PX, H_PX), 1.0)
    for _ in range(3 * MAX_STATES):
        memory.add(estimate.state())
    assert len(memory._states) == MAX_STATES
