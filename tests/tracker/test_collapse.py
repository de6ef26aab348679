"""A target that goes behind something: the estimate goes on from before its box shrank."""

from __future__ import annotations

import math

import pytest

from tracker.box import Box
from tracker.messages import Candidate, TargetReason, TargetStatus
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


def test_behind_an_edge_the_whole_target_is_predicted():
    tracker = TargetTracker()
    tracker.start(visible(0.0)[0].box, 0.0)
    tracker.shift(0.0, 0.0)  # the camera's motion is known: there is none
    lost = None
    for k in range(1, 200):
        t_s = k / FPS
        state = tracker.step(visible(t_s), t_s, IMAGE)
        if state.status is TargetStatus.COASTING and lost is None:
            lost = (t_s, state)
    assert lost is not None
    t_s, state = lost
    assert state.reason is TargetReason.SHAPE_COLLAPSE
    assert math.sqrt(state.box.w_px * state.box.h_px) == pytest.approx(math.sqrt(W_PX * H_PX), rel=0.15)
    assert state.vel_px_s[0] == pytest.approx(SPEED_PX_S, rel=0.25), "and not that of the strip, which stood still"
    assert state.box.cx_px == pytest.approx(true_centre(t_s), abs=12.0)


def test_one_that_only_drives_away_keeps_its_size():
    tracker = TargetTracker()
    tracker.start(Box(320, 240, W_PX, H_PX), 0.0)
    for k in range(1, 121):
        shrunk = math.exp(-0.1 * k / FPS)
        box = Box(320, 240, W_PX * shrunk, H_PX * shrunk)
        state = tracker.step((Candidate(box, 0.9, 0.9, 0.9),) if k < 120 else (), k / FPS, IMAGE)
    assert state.reason is TargetReason.NO_CANDIDATE
    assert state.box.w_px == pytest.approx(W_PX * math.exp(-0.4), rel=0.05)


def test_the_memory_moves_with_the_picture():
    tracker = TargetTracker()
    tracker.start(visible(0.0)[0].box, 0.0)
    t_s, moved = 0.0, 0.0
    while True:
        t_s += 1 / FPS
        # The camera turns left at 30 px/s from 1 s on: everything moves right.
        if t_s > 1.0:
            tracker.shift(30.0 / FPS, 0.0)
            moved += 30.0 / FPS
        found = tuple(
            Candidate(Box(c.box.cx_px + moved, c.box.cy_px, c.box.w_px, c.box.h_px), c.score, c.peak, c.similarity)
            for c in visible(t_s)
        )
        state = tracker.step(found, t_s, IMAGE)
        if state.status is TargetStatus.COASTING:
            break
        assert t_s < 6.0
    assert state.reason is TargetReason.SHAPE_COLLAPSE
    assert state.box.cx_px == pytest.approx(true_centre(t_s) + moved, abs=14.0)
    assert state.vel_px_s[0] == pytest.approx(SPEED_PX_S, rel=0.3), "the camera's turn is not in it"


def test_while_it_is_not_seen_the_search_is_for_the_whole_target():
    tracker = TargetTracker()
    tracker.start(visible(0.0)[0].box, 0.0)
    assert tracker.hint().size_px is None, "while it is seen the tracker knows its size better"
    for k in range(1, 200):
        state = tracker.step(visible(k / FPS), k / FPS, IMAGE)
        if state.status is TargetStatus.COASTING:
            break
        assert tracker.hint().size_px is None
    width_px, height_px = tracker.hint().size_px
    assert math.sqrt(width_px * height_px) == pytest.approx(math.sqrt(W_PX * H_PX), rel=0.15)


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
