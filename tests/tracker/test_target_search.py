"""What the target tracker asks of the search and of the tracker's memory, and the operator's nudge."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.scripted import (
    BOX,
    EPS,
    IMAGE,
    RATES,
    SIZE_PX,
    changes,
    evidence,
    future,
    locked,
    play,
    reasons,
    seen,
    step_all,
    until,
)
from tracker.admission import SIZE_LN, SIZE_LN_S
from tracker.box import Box
from tracker.messages import (
    Candidate,
    MemorySlot,
    SearchHint,
    TargetReason,
    TargetState,
    TargetStatus,
)
from tracker.search_plan import CORE_SIDES
from tracker.siamapnpp.crop import EXEMPLAR_PX, exemplar_side_px
from tracker.status import StatusConfig
from tracker.target import MAX_NUDGE_S, TargetConfig, TargetTracker

LOCKED, SEARCHING = TargetStatus.LOCKED, TargetStatus.SEARCHING
C = TargetConfig()

# --- the search


def windows(hint: SearchHint) -> list[tuple[float, float, float]]:
    """Centre and half side of the core of every window, as far as the calls reach."""
    side_px = exemplar_side_px(*hint.size_px) * 287.0 / EXEMPLAR_PX
    every = [(hint.center_px, hint.scale), *((t.center_px, t.scale) for t in hint.tiles)]
    return [(x, y, CORE_SIDES * side_px * scale / 2) for (x, y), scale in every[: hint.max_calls]]


def searched(max_calls: int, until_s: float) -> list[SearchHint]:
    """The hints while SEARCHING for a still target that was lost at 1 s."""
    tracker = locked(TargetTracker(TargetConfig(max_calls=max_calls)))
    hints = []
    for k in range(31, round(30 * until_s)):
        if tracker.step((), k / 30, IMAGE).status is SEARCHING:
            hints.append(tracker.hint())
    return hints


@pytest.mark.parametrize("max_calls", [1, 2, 4])
def test_a_search_grows_around_the_prediction_then_tiles_the_picture_within_its_calls(max_calls):
    hints = searched(max_calls, 9.0)
    assert all(1 + len(h.tiles) <= h.max_calls == max_calls for h in hints)
    near = hints[:25]
    widest = [max(half for _, _, half in windows(h)) for h in near]
    if max_calls > 1:
        assert widest == sorted(widest)
        own = [windows(h)[0] == windows(near[0])[0] for h in hints]
        assert all(own[: len(near)])
        assert all(any(own[i : i + 11]) for i in range(len(own) - 11)), "the prediction is looked at every 0.3 s"
    assert max(widest) > 1.3 * min(widest)
    assert all(h.center_px == pytest.approx((BOX.cx_px, BOX.cy_px)) for h in near)
    seen_at = np.zeros((36, 64), bool)
    ys, xs = np.mgrid[5:360:10, 5:640:10]
    for hint in hints:
        for x, y, half in windows(hint):
            seen_at |= (abs(xs - x) <= half + 0.01) & (abs(ys - y) <= half + 0.01)
    assert seen_at.all(), "every place was in the core of a window"


@pytest.mark.parametrize("max_calls", [2, 4])
def test_what_was_found_in_a_search_is_looked_at_again_in_the_next_picture(max_calls):
    away = seen(0.8, -200.0, 100.0)
    tracker = locked(TargetTracker(TargetConfig(max_calls=max_calls)))
    step_all(lambda t: [], [1 + k / 30 for k in range(1, 70)], tracker)
    states = []
    for k in range(70, 77):
        states.append(tracker.step([away], 1 + k / 30, IMAGE))
        hint = tracker.hint()
        if states[-1].status is SEARCHING:
            assert hint.tiles[0].center_px == (away.box.cx_px, away.box.cy_px)
            assert hint.tiles[0].scale == 1.0
            assert 1 + len(hint.tiles) <= max_calls
    assert states[-1].status is LOCKED


def test_with_one_call_what_was_found_is_what_is_searched():
    away = seen(0.8, -200.0, 100.0)
    tracker = locked(TargetTracker(TargetConfig(max_calls=1)))
    step_all(lambda t: [], [1 + k / 30 for k in range(1, 70)], tracker)
    tracker.step([away], 1 + 70 / 30, IMAGE)
    assert [w[:2] for w in windows(tracker.hint())] == [(away.box.cx_px, away.box.cy_px)]
    assert tracker.hint().tiles == ()


def test_a_strong_candidate_outside_of_the_gate_is_looked_at_again():
    tracker = locked()
    far = seen(0.8, 6 * SIZE_PX)
    tracker.step([far], 1 + 1 / 30, IMAGE)
    assert [t.center_px for t in tracker.hint().tiles] == [(far.box.cx_px, far.box.cy_px)]
    tracker.step([seen()], 1 + 2 / 30, IMAGE)
    assert tracker.hint().tiles == ()


@pytest.mark.parametrize("lost_s", [0.0, 1.5, 3.0])
def test_the_windows_move_with_the_picture(lost_s):
    """A camera that turns between two pictures, its rates given: all that is to be searched moves."""
    tracker = locked()
    step_all(lambda t: [], [1 + k / 30 for k in range(1, round(30 * lost_s))], tracker)
    tracker.step([seen(0.8, -80.0)], 1 + lost_s + 0.05, IMAGE)
    before = windows(tracker.hint())
    assert len(before) == 2
    tracker.shift(30.0, -10.0)
    after = windows(tracker.hint())
    assert [w[:2] for w in after] == [pytest.approx((x + 30.0, y - 10.0)) for x, y, _ in before]


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_what_is_found_again_must_have_a_size_that_it_can_have_by_then(sign, fps):
    """The bound grows while it is not seen: what is refused now is taken when it still is there later."""
    far_s = 2.0  # of the unseen time at which this size becomes possible
    zoom = math.exp(sign * (SIZE_LN + SIZE_LN_S * far_s))
    found_s, lost_s = 2.8, 1.0
    tracker = locked(fps=fps)
    times = [1 + k / fps for k in range(1, round(4 * fps))]
    states = step_all(lambda t: [] if t < found_s else [seen(0.8, 60.0, zoom=zoom)], times, tracker)
    again = next(s for s in states if s.status is LOCKED)
    period_s = 1 / fps
    assert again.t_s == pytest.approx(lost_s + far_s + C.status.reacquire_s, abs=2.5 * period_s)
    assert again.reason is TargetReason.REACQUIRED
    refused = {s.reason for s in states if found_s + EPS < s.t_s < lost_s + far_s - EPS}
    assert refused == {TargetReason.SHAPE_COLLAPSE}


# --- the small search crop


def test_sure_is_a_slow_target_that_is_surely_seen_and_alone():
    def sure(velocity_px_s: float, score: float, rival: bool = False) -> bool:
        more = [seen(score, 120.0, of=evidence())] if rival else []
        tracker = TargetTracker()
        play(lambda t: [seen(score, velocity_px_s * t, of=evidence()), *more], 2.0, 30.0, tracker)
        return tracker.hint().sure

    assert sure(0.0, 0.95)
    assert not sure(0.0, C.sure_confidence - 0.05)
    assert not sure(1.5 * C.sure_sizes_s * SIZE_PX, 0.95)
    assert not sure(0.0, 0.95, rival=True)
    tracker = locked()
    tracker.step([], 1.1, IMAGE)
    assert not tracker.hint().sure


# --- memory


def writes(states: Sequence[TargetState]) -> list[tuple[float, MemorySlot]]:
    return [(s.t_s, s.memory.slot) for s in states if s.memory is not None]


@pytest.mark.parametrize("fps", RATES)
def test_the_memory_is_written_every_half_second_while_locked_and_sure(fps):
    states = play(lambda t: [seen(0.95, 20 * t, of=evidence())], 5.0, fps)
    times = [t for t, slot in writes(states) if slot is MemorySlot.RECENT]
    assert times[0] == pytest.approx(2.2, abs=0.2)
    assert np.diff(times) == pytest.approx(0.5, abs=EPS)
    assert all(s.memory.box == s.chosen.box and s.status is LOCKED for s in states if s.memory is not None)


@pytest.mark.parametrize(
    "doubtful",
    [
        [seen(0.7, of=evidence())],  # locked, but not sure
        [seen(0.95, of=evidence(0.1, recent=0.8))],  # not like the first exemplar
        [],
        [seen(0.95, zoom=1.25, of=evidence())],  # another size at once
    ],
)
def test_nothing_doubtful_is_remembered(doubtful):
    good = [seen(0.95, of=evidence())]
    assert writes(play(lambda t: good, 3.0)), "else it proves nothing"
    states = play(until(2.05, good, doubtful), 2.2)
    assert writes(states) == []


def test_uncertainty_freezes_the_memory_for_a_while():
    def script(t: float) -> list[Candidate]:
        return [seen(0.45 if 2.9 < t < 3.0 else 0.95, of=evidence())]

    states = play(script, 5.0)
    assert all(s.status is LOCKED for s in states if s.t_s > 1)
    assert not [t for t, _ in writes(states) if 2.9 < t < 3.95]
    assert [t for t, _ in writes(states) if t > 3.95]


def test_beside_something_alike_an_anchor_is_kept_and_no_recent_one():
    states = play(lambda t: [seen(0.95, of=evidence()), seen(0.9, 120.0, of=evidence())], 5.0)
    slots = {slot for _, slot in writes(states)}
    assert slots == {MemorySlot.ANCHOR}


def test_after_a_re_acquisition_the_memory_waits():
    good = [seen(0.95, of=evidence())]
    states = play(lambda t: good if t <= 3 + EPS or t >= 5 else [], 9.0)
    again = next(s.t_s for s in states if s.reason is TargetReason.REACQUIRED)
    after = [t for t, _ in writes(states) if t > 3]
    assert after[0] == pytest.approx(again + 2.0, abs=0.2)


# --- the operator's hand


def test_a_nudge_moves_the_live_track_and_keeps_status_and_motion():
    tracker = TargetTracker()
    before = play(lambda t: [seen(0.8, 60 * t)], 2.0, 30.0, tracker)[-1]
    box = Box(before.box.cx_px + 8.0, before.box.cy_px - 5.0, 40.0, 40.0)
    state = tracker.nudge(box, 2.0)
    assert (state.status, state.reason, state.t_s) == (LOCKED, TargetReason.SELECTED, 2.0)
    assert (state.box.cx_px, state.box.cy_px, state.box.w_px, state.box.h_px) == pytest.approx(
        (box.cx_px, box.cy_px, 40.0, 40.0)
    )
    assert state.vel_px_s == before.vel_px_s
    after = tracker.step([Candidate(replace(box, cx_px=box.cx_px + 2.0), 0.8, 0.8, 0.8)], 2.0 + 1 / 30, IMAGE)
    assert (after.status, after.reason) == (LOCKED, TargetReason.SEEN)
    assert after.box.w_px == pytest.approx(40.0, rel=0.02)


def test_after_a_nudge_the_search_is_for_the_new_size():
    tracker = locked()
    tracker.nudge(Box(BOX.cx_px, BOX.cy_px, 60.0, 60.0), 1.0)
    assert tracker.hint().size_px == pytest.approx((60.0, 60.0))


@pytest.mark.parametrize("zoom", [3.5, 0.28])
def test_a_redrawn_box_is_no_false_lock(zoom):
    tracker = TargetTracker()
    play(lambda t: [seen()], 2.0, 30.0, tracker)
    tracker.nudge(Box(BOX.cx_px, BOX.cy_px, BOX.w_px * zoom, BOX.h_px * zoom), 2.0)
    states = step_all(lambda t: [seen(zoom=zoom)], [2 + k / 30 for k in range(1, 40)], tracker)
    assert TargetReason.FALSE_LOCK not in reasons(states)


def test_a_slightly_redrawn_box_is_no_collapse():
    tracker = TargetTracker()
    play(lambda t: [seen(of=evidence())], 2.0, 30.0, tracker)
    tracker.nudge(Box(BOX.cx_px, BOX.cy_px, BOX.w_px * 0.6, BOX.h_px * 0.6), 2.0)
    states = step_all(lambda t: [seen(zoom=0.6, of=evidence())], [2 + k / 30 for k in range(1, 40)], tracker)
    assert all(s.status is LOCKED for s in states)


@pytest.mark.parametrize("unseen_s", [0.5, 2.0])
def test_a_nudge_of_what_is_not_seen_selects_it_anew(unseen_s):
    """However long it was not seen before: the operator sees it, and nothing of the old loss counts."""
    tracker = locked()
    states = step_all(lambda t: [], [1 + k / 30 for k in range(1, round(30 * unseen_s) + 1)], tracker)
    assert states[-1].status is (SEARCHING if unseen_s > 1 else TargetStatus.COASTING)
    t_s = states[-1].t_s
    state = tracker.nudge(Box(500.0, 100.0, 30.0, 60.0), t_s)
    assert (state.status, state.reason) == (TargetStatus.ACQUIRING, TargetReason.SELECTED)
    assert tracker.step([], t_s + 1 / 30, IMAGE).status is TargetStatus.ACQUIRING
    assert tracker.hint().center_px == pytest.approx((500.0, 100.0))
    found = Candidate(Box(503.0, 100.0, 30.0, 60.0), 0.8, 0.8, 0.8)
    assert step_all(lambda t: [found], [t_s + k / 30 for k in range(2, 10)], tracker)[-1].status is LOCKED


def test_a_nudge_just_before_giving_up_is_not_given_up_with_the_old_loss():
    tracker = locked()
    last_s = 1 + C.status.give_up_s - 0.1
    states = step_all(lambda t: [], [1 + k / 10 for k in range(1, round(10 * (last_s - 1)) + 1)], tracker)
    assert states[-1].status is SEARCHING
    tracker.nudge(Box(500.0, 100.0, 30.0, 60.0), last_s)
    found = Candidate(Box(500.0, 100.0, 30.0, 60.0), 0.8, 0.8, 0.8)
    assert step_all(lambda t: [found], [last_s + k / 10 for k in range(1, 6)], tracker)[-1].status is LOCKED


def test_a_nudge_forgets_what_was_seen_beside_another_box():
    """The operator points at what was taken for the other thing."""
    other = seen(0.8, 120.0, of=evidence())
    tracker = TargetTracker()
    play(lambda t: [seen(0.8, of=evidence()), other], 2.0, 30.0, tracker)
    tracker.nudge(other.box, 2.0)
    states = step_all(lambda t: [other], [2 + k / 30 for k in range(1, 10)], tracker)
    assert all(s.status is LOCKED and s.chosen is other for s in states)


def test_a_nudge_needs_a_track_and_usable_numbers():
    with pytest.raises(ValueError, match="no track to nudge"):
        TargetTracker().nudge(BOX, 0.0)
    tracker = locked()
    before = future(tracker, 1.0)
    late_s = 1.0 + MAX_NUDGE_S + 0.1
    small, nowhere = replace(BOX, w_px=0.1), replace(BOX, cx_px=math.inf)
    for box, t_s in ((BOX, 0.9), (BOX, math.nan), (BOX, math.inf), (BOX, late_s), (small, 1.5), (nowhere, 1.5)):
        with pytest.raises(ValueError, match=r"nudge|cannot be taken"):
            tracker.nudge(box, t_s)
        assert future(tracker, 1.0) == before, "moved before it was refused"
    assert tracker.nudge(BOX, 1.0 + MAX_NUDGE_S).status is LOCKED


def test_settings_reach_the_status():
    config = TargetConfig(status=StatusConfig(coast_still_s=0.5))
    times = {s: t for t, s in changes(play(until(1, [seen()], []), 3.0, 30.0, TargetTracker(config)))}
    assert times[SEARCHING] == pytest.approx(1.5)
