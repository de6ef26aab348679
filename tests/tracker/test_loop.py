"""One track over pictures: what the tracker is told, what the target is given, what is remembered and when not."""

import numpy as np
import pytest

from tests.tracker.scripted import BOX, IMAGE, SIZE_PX, evidence, seen
from tracker.box import Box
from tracker.loop import TrackLoop
from tracker.messages import Candidate, Frame, MemorySlot, SearchHint, TargetReason, TargetStatus
from tracker.raw import RawTarget
from tracker.target import TargetTracker

FPS = 20


class Scripted:
    """Answers from a function of the frame's time."""

    def __init__(self, answer):
        self.answer, self.hints, self.selected = answer, [], None

    def init(self, frame: Frame, box: Box) -> None:
        if not box.is_valid:
            raise ValueError("the box is not valid")
        self.selected = (frame.seq, box)

    def update(self, frame: Frame, hint: SearchHint | None = None) -> list[Candidate]:
        self.hints.append(hint)
        return self.answer(frame.t_capture_s)


class Remembering(Scripted):
    """Has a memory."""

    def __init__(self, answer):
        super().__init__(answer)
        self.kept = []

    def remember(self, frame: Frame, box: Box, slot: MemorySlot) -> None:
        self.kept.append((frame.seq, box, slot))


def frame(k: int) -> Frame:
    return Frame(np.zeros((360, 640, 3), np.uint8), k, k / FPS, k / FPS + 0.01)


def run(tracker, target, steps: int, unreadable=()):
    loop = TrackLoop(tracker, target)
    states = [loop.start(frame(0), BOX)]
    for k in range(1, steps + 1):
        states.append(loop.step(None if k in unreadable else frame(k), k / FPS))
    return loop, states


def moving(t_s: float) -> list[Candidate]:
    return [seen(0.95, 60.0 * t_s, of=evidence())]


def test_the_tracker_is_told_where_the_target_will_be_in_this_very_picture():
    tracker = Scripted(moving)
    loop, states = run(tracker, TargetTracker(), 40)
    assert tracker.selected == (0, BOX)
    assert states[0].reason is TargetReason.SELECTED
    assert states[-1].status is TargetStatus.LOCKED
    assert [s.t_s for s in states] == [k / FPS for k in range(41)]
    assert tracker.hints[-1].center_px[0] == pytest.approx(BOX.cx_px + 60.0 * 2.0, abs=0.05 * SIZE_PX)
    assert loop.candidates == tuple(moving(2.0))


def test_the_target_is_told_width_and_height_of_the_picture():
    target = Told()
    run(Scripted(lambda t: []), target, 2)
    assert target.sizes == [IMAGE, IMAGE]


class Told(RawTarget):
    """Keeps what it was told."""

    def __init__(self):
        super().__init__()
        self.sizes = []

    def step(self, candidates, t_s, image_size_px):
        self.sizes.append(image_size_px)
        return super().step(candidates, t_s, image_size_px)


def test_a_picture_that_cannot_be_read_is_a_step_without_candidates():
    tracker, target = Scripted(moving), Told()
    loop, states = run(tracker, target, 30, unreadable=(30,))
    assert loop.candidates == ()
    assert len(tracker.hints) == 29
    assert (states[-1].t_s, states[-1].status) == (1.5, TargetStatus.SEARCHING)
    assert target.sizes[-1] == IMAGE
    _, states = run(Scripted(moving), TargetTracker(), 30, unreadable=(20, 30))
    assert [k for k, s in enumerate(states) if s.status is TargetStatus.COASTING] == [20, 30]


def test_what_the_target_wants_kept_goes_to_a_tracker_with_a_memory_with_its_picture():
    tracker = Remembering(moving)
    _, states = run(tracker, TargetTracker(), 80)
    asked = [(k, s.memory.box, s.memory.slot) for k, s in enumerate(states) if s.memory is not None]
    assert len(asked) >= 3
    assert tracker.kept == asked
    assert all(box == moving(k / FPS)[0].box for k, box, _ in asked)


def test_a_tracker_without_a_memory_is_asked_nothing():
    _, states = run(Scripted(moving), TargetTracker(), 80)
    assert any(s.memory is not None for s in states)
    assert states[-1].status is TargetStatus.LOCKED


def test_an_unreadable_picture_is_not_remembered():
    tracker = Remembering(moving)
    run(tracker, TargetTracker(), 80)
    wanted = tracker.kept[0][0]
    again = Remembering(moving)
    run(again, TargetTracker(), 80, unreadable=(wanted,))
    assert wanted not in [k for k, _, _ in again.kept]
    assert again.kept


def test_a_box_that_cannot_be_selected_is_refused():
    loop = TrackLoop(Scripted(moving), TargetTracker())
    with pytest.raises(ValueError, match="box"):
        loop.start(frame(0), Box(1.0, 1.0, 0.0, 1.0))


@pytest.mark.parametrize("late_s", [-0.02, float("nan")])
def test_a_picture_out_of_time_is_not_remembered(late_s):
    tracker = Remembering(moving)
    run(tracker, TargetTracker(), 80)
    loop, target = TrackLoop(tracker, TargetTracker()), tracker.kept[0][0]
    loop.start(frame(0), BOX)
    for k in range(1, target + 1):
        loop.step(frame(k), k / FPS)
    before = len(tracker.kept)
    state = loop.step(frame(target + 1), target / FPS + late_s)
    assert state.reason in (TargetReason.TIME_WENT_BACK, TargetReason.NOT_FINITE)
    assert (state.memory, state.chosen) == (None, None)
    assert len(tracker.kept) == before
