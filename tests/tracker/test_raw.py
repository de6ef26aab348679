"""The raw target: the tracker's best box and nothing else."""

import math

import pytest

from tracker.box import Box
from tracker.messages import Candidate, TargetReason, TargetStatus
from tracker.raw import RawTarget

BOX = Box(100.0, 80.0, 20.0, 30.0)
IMAGE = (640.0, 360.0)


def candidate(box=BOX, score=0.1):
    return Candidate(box, score, score, score)


def test_it_takes_the_first_candidate_however_weak_or_far():
    raw = RawTarget()
    assert raw.start(BOX, 0.0).status is TargetStatus.LOCKED
    far = Box(600.0, 300.0, 5.0, 5.0)
    state = raw.step((candidate(far, 0.01), candidate(BOX, 0.9)), 0.1, IMAGE)
    assert (state.status, state.box, state.confidence) == (TargetStatus.LOCKED, far, 0.01)
    assert raw.hint() is None


@pytest.mark.parametrize("bad", [(), (candidate(Box(math.nan, 0, 1, 1)),), (candidate(BOX, math.inf),)])
def test_without_a_usable_candidate_it_reports_the_last_box_as_not_seen(bad):
    raw = RawTarget()
    raw.start(BOX, 0.0)
    state = raw.step(bad, 0.1, IMAGE)
    assert (state.status, state.reason) == (TargetStatus.SEARCHING, TargetReason.NO_CANDIDATE)
    assert (state.box, state.confidence) == (BOX, 0.0)


def test_before_the_start_it_is_idle_and_a_bad_box_is_refused():
    assert RawTarget().step((candidate(),), 0.0, IMAGE).status is TargetStatus.IDLE
    with pytest.raises(ValueError, match="box"):
        RawTarget().start(Box(1.0, 1.0, math.nan, 1.0), 0.0)


def test_a_nudge_takes_the_box_and_goes_on():
    raw = RawTarget()
    raw.start(BOX, 0.0)
    moved = Box(110.0, 85.0, 24.0, 36.0)
    state = raw.nudge(moved, 0.2)
    assert (state.t_s, state.status, state.reason) == (0.2, TargetStatus.LOCKED, TargetReason.SELECTED)
    assert state.box == moved
    assert raw.step((), 0.3, IMAGE).box == moved


@pytest.mark.parametrize("bad", [Box(math.nan, 1.0, 1.0, 1.0), Box(1.0, 1.0, 0.0, 1.0)])
def test_a_nudge_that_cannot_be_changes_nothing(bad):
    with pytest.raises(ValueError, match="no track to nudge"):
        RawTarget().nudge(BOX, 0.0)
    raw = RawTarget()
    raw.start(BOX, 0.0)
    with pytest.raises(ValueError, match="box"):
        raw.nudge(bad, 0.1)
    assert raw.step((), 0.2, IMAGE).box == BOX
