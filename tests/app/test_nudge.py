"""The operator moves or resizes the box of a live track; and what the tracker is told to remember."""

import math
from dataclasses import astuple

import pytest

from tests.app.test_app import CENTRED, HZ, ScriptedTracker, app, found, frame, telemetry
from tests.control.builders import CENTRE
from tracker.box import Box
from tracker.messages import MemorySlot, TargetReason, TargetStatus
from tracker.raw import RawTarget
from tracker.target import TargetTracker


class Picky(ScriptedTracker):
    """Takes no exemplar once it is told so; remembers, or fails to."""

    def __init__(self, answer):
        super().__init__(answer)
        self.exemplar, self.refuses, self.kept, self.forgetful = None, False, [], False

    def init(self, frame, box):
        if self.refuses:
            raise ValueError("the box lies outside the frame")
        self.exemplar = box

    def remember(self, frame, box, slot):
        if self.forgetful:
            raise RuntimeError("no memory today")
        self.kept.append((frame.seq, box, slot))


def flying(answer=lambda seq: found(*CENTRE), steps=40, target=None, box=CENTRED):
    """An application that follows since 2 s: it, its tracker, its last record."""
    tracker = Picky(answer)
    loop = app(tracker, target)
    record = loop.start(frame(0), box, telemetry(0.0), 0.0)
    for k in range(1, steps + 1):
        record = loop.step(frame(k), telemetry(k / HZ), k / HZ)
    return loop, tracker, record


@pytest.mark.parametrize("target", [None, RawTarget()], ids=["target", "raw"])
def test_a_nudge_moves_and_resizes_the_box_and_the_track_goes_on(target):
    loop, tracker, before = flying(target=target)
    state = loop.nudge(frame(40), (10.0, -4.0), (1.5, 0.5), 2.0)
    box = before.target.box
    wanted = (box.cx_px + 10.0, box.cy_px - 4.0, box.w_px * 1.5, box.h_px * 0.5)
    assert astuple(state.box) == pytest.approx(wanted)
    assert astuple(tracker.exemplar) == pytest.approx(wanted)
    assert (state.status, state.reason) == (TargetStatus.LOCKED, TargetReason.SELECTED)
    tracker.answer = lambda seq: found(CENTRE[0] + 10.0, CENTRE[1] - 4.0)
    after = loop.step(frame(41), telemetry(2.05), 2.05)
    assert (after.target.status, after.fault) == (TargetStatus.LOCKED, None)
    assert after.seq == before.seq + 1


def test_without_a_frame_the_candidates_source_keeps_its_exemplar():
    loop, tracker, _ = flying()
    loop.nudge(None, (5.0, 0.0), (1.0, 1.0), 2.0)
    assert tracker.exemplar == CENTRED


@pytest.mark.parametrize("factor", [0.6, 1.7])
def test_a_resized_box_is_the_same_target_at_the_same_range(factor):
    loop, tracker, before = flying()
    assert before.range_estimate.valid
    loop.nudge(frame(40), (0.0, 0.0), (factor, factor), 2.0)
    tracker.answer = lambda seq: found(*CENTRE, 40.0 * factor)
    for k in range(41, 50):
        after = loop.step(frame(k), telemetry(k / HZ), k / HZ)
    assert after.range_estimate.range_m == pytest.approx(before.range_estimate.range_m, rel=0.02)


def test_two_nudges_before_the_next_picture_add_up():
    loop, _, before = flying()
    loop.nudge(frame(40), (10.0, 0.0), (1.2, 1.2), 2.0)
    state = loop.nudge(frame(40), (5.0, 2.0), (0.5, 1.0), 2.0)
    box = before.target.box
    assert astuple(state.box) == pytest.approx(
        (box.cx_px + 15.0, box.cy_px + 2.0, box.w_px * 0.6, box.h_px * 1.2), rel=1e-6
    )


BAD_NUDGES = [
    ((math.nan, 0.0), (1.0, 1.0), 2.0),
    ((0.0, math.inf), (1.0, 1.0), 2.0),
    ((0.0, 0.0), (math.nan, 1.0), 2.0),
    ((0.0, 0.0), (1.0, 0.05), 2.0),
    ((0.0, 0.0), (11.0, 1.0), 2.0),
    ((0.0, 0.0), (-1.0, 1.0), 2.0),
    ((0.0, 0.0), (1.0, 1.0), 1.9),  # before the last picture
    ((0.0, 0.0), (1.0, 1.0), math.nan),
    ((0.0, 0.0), (1.0, 1.0), math.inf),
]


def test_a_nudge_that_cannot_be_changes_nothing():
    (loop, tracker, _), (twin, _, _) = flying(), flying()
    for move_px, resize, t_s in BAD_NUDGES:
        with pytest.raises(ValueError, match="nudge"):
            loop.nudge(frame(40), move_px, resize, t_s)
    tracker.refuses = True
    with pytest.raises(ValueError, match="outside the frame"):
        loop.nudge(frame(40), (10.0, 0.0), (1.5, 1.5), 2.0)
    assert_same(loop, tracker, twin)


def test_a_box_that_only_the_estimate_refuses_changes_nothing():
    """Smaller than any picture holds: 4 px, made a tenth of it."""
    small = Box(*CENTRE, 4.0, 4.0)
    (loop, tracker, _), (twin, _, _) = (flying(lambda seq: found(*CENTRE, 4.0), box=small) for _ in range(2))
    with pytest.raises(ValueError, match="box"):
        loop.nudge(frame(40), (0.0, 0.0), (0.1, 0.1), 2.0)
    assert_same(loop, tracker, twin, small)


@pytest.mark.parametrize("seq", [39, 41])
def test_the_frame_must_be_that_of_the_last_step(seq):
    """The exemplar would be cut out of another picture, where the box is not on the target."""
    (loop, tracker, _), (twin, _, _) = flying(), flying()
    with pytest.raises(ValueError, match="frame is not the one"):
        loop.nudge(frame(seq), (10.0, 0.0), (1.5, 1.5), 2.0)
    assert_same(loop, tracker, twin)


@pytest.mark.parametrize("t_s", [1.9, 52.0, math.nan])
def test_a_time_that_the_estimate_refuses_leaves_the_exemplar(t_s):
    """Refused before the tracker takes the box: else box and exemplar are no longer of one thing."""
    (loop, tracker, _), (twin, _, _) = flying(), flying()
    with pytest.raises(ValueError, match="nudge"):
        loop.nudge(frame(40), (10.0, 0.0), (1.5, 1.5), t_s)
    assert_same(loop, tracker, twin)


def assert_same(loop, tracker, twin, exemplar=CENTRED):
    assert tracker.exemplar == exemplar
    for k in range(41, 45):
        a, b = (one.step(frame(k), telemetry(k / HZ), k / HZ) for one in (loop, twin))
        assert (a.target.status, a.target.box, a.fault) == (b.target.status, b.target.box, None)
        assert a.range_estimate == b.range_estimate
        assert a.velocity_command == b.velocity_command


def test_there_must_be_a_track():
    with pytest.raises(ValueError, match="no track to nudge"):
        app(Picky(None)).nudge(frame(0), (0.0, 0.0), (1.0, 1.0), 0.0)
    loop, tracker, _ = flying()
    tracker.answer = lambda seq: ()
    for k in range(41, 300):
        record = loop.step(frame(k), telemetry(k / HZ), k / HZ)
    assert record.target.status is TargetStatus.LOST
    with pytest.raises(ValueError, match="no track to nudge"):
        loop.nudge(frame(300), (0.0, 0.0), (1.0, 1.0), 15.0)
    assert tracker.exemplar == CENTRED


# --- memory


def test_what_is_sure_is_remembered_in_its_own_picture():
    _, tracker, _ = flying(lambda seq: found(*CENTRE, score=0.95), 80)
    assert len(tracker.kept) >= 3
    for seq, box, slot in tracker.kept:
        assert 40 <= seq <= 80
        assert (box, slot) == (found(*CENTRE)[0].box, MemorySlot.RECENT)


def test_what_is_unsure_is_not_remembered():
    _, tracker, record = flying(lambda seq: found(*CENTRE, score=0.7), 80)
    assert record.target.status is TargetStatus.LOCKED
    assert tracker.kept == []


def test_a_tracker_that_fails_to_remember_costs_only_the_memory(caplog):
    (loop, tracker, _), (twin, _, _) = (flying(lambda seq: found(400, 180, score=0.95)) for _ in range(2))
    tracker.forgetful = True
    before = len(tracker.kept)
    for k in range(41, 81):
        a, b = (one.step(frame(k), telemetry(k / HZ), k / HZ) for one in (loop, twin))
        assert (a.target.status, a.fault) == (TargetStatus.LOCKED, None)
        assert a.velocity_command == b.velocity_command
        assert a.gimbal_command == b.gimbal_command
    assert "no memory today" in caplog.text
    assert len(tracker.kept) == before


def test_a_tracker_without_a_memory_flies_as_well():
    loop = app(ScriptedTracker(lambda seq: found(*CENTRE, score=0.95)), TargetTracker())
    loop.start(frame(0), CENTRED, telemetry(0.0), 0.0)
    records = [loop.step(frame(k), telemetry(k / HZ), k / HZ) for k in range(1, 81)]
    assert any(r.target.memory is not None for r in records)
    assert not any(r.fault for r in records)
