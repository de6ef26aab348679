"""A target tracker that is honest about losing its target: the same at every rate, never fooled for long."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.tracker.scripted import (
    BOX,
    EPS,
    IMAGE,
    RATES,
    SIZE_PX,
    Script,
    changes,
    evidence,
    play,
    reasons,
    seen,
    step_all,
    until,
)
from tracker.confidence.model import ConfidenceModel
from tracker.messages import (
    Candidate,
    Evidence,
    TargetAlarm,
    TargetReason,
    TargetState,
    TargetStatus,
)
from tracker.target import TargetConfig, TargetTracker

LOCKED, COASTING = TargetStatus.LOCKED, TargetStatus.COASTING
SEARCHING, LOST = TargetStatus.SEARCHING, TargetStatus.LOST
C = TargetConfig()

# --- the same at every rate and with dropped frames

UNTIL_S = 6.0
HIDDEN_S = (3.0, 4.0)


def winding(t_s: float) -> list[Candidate]:
    """Winds about at 1.4 sizes per second, shakes a little, is hidden for a second; another thing is far off."""
    dx, dy = 60.0 * t_s, 15.0 * math.sin(1.5 * t_s)
    shake_px = 0.03 * SIZE_PX
    zoom = math.exp(0.1 * math.sin(t_s) + 0.02 * math.sin(97.0 * t_s))
    target = seen(0.85, dx + shake_px * math.sin(131.0 * t_s), dy + shake_px * math.cos(117.0 * t_s), zoom=zoom)
    other = seen(0.4, -180.0, 60.0, of=evidence(0.2, second=1.5))
    hidden = HIDDEN_S[0] + EPS < t_s < HIDDEN_S[1] - EPS
    return [other] if hidden else [replace(target, evidence=evidence()), other]


@cache
def followed(fps: float, dropped: float = 0.0, seed: int = 0) -> list[TargetState]:
    """The states of a whole run, without the frames dropped."""
    rng = np.random.default_rng(seed)
    times = [k / fps for k in range(1, round(UNTIL_S * fps) + 1) if rng.random() >= dropped]
    tracker = TargetTracker()
    return [tracker.start(BOX, 0.0), *step_all(winding, times, tracker)]


def agree(one: list[TargetState], other: list[TargetState], period_s: float) -> int:
    """The same statuses at the same times, up to a period, or three where three sights are needed; and the same boxes,
    a little less so for predictions; the number of common times.
    """
    assert [s for _, s in changes(one)] == [s for _, s in changes(other)]
    for (a, status), (b, _) in zip(changes(one), changes(other), strict=True):
        assert abs(a - b) <= period_s * (3 if status is LOCKED else 1) + EPS
    at = {round(s.t_s, 3): s for s in other}
    common = [(s, at[round(s.t_s, 3)]) for s in one if s.t_s > 0.5 and round(s.t_s, 3) in at]
    for a, b in common:
        if a.status is b.status:
            near = 0.15 if a.status is LOCKED else 0.25
            assert math.hypot(a.box.cx_px - b.box.cx_px, a.box.cy_px - b.box.cy_px) < near * SIZE_PX
            assert abs(math.log(a.box.w_px * a.box.h_px / (b.box.w_px * b.box.h_px))) / 2 < 0.1
    return len(common)


def test_the_same_track_at_10_20_and_30_frames_a_second():
    runs = {fps: followed(fps) for fps in RATES}
    assert [s for _, s in changes(runs[30.0])] == [LOCKED, COASTING, LOCKED]
    for fps in (10.0, 20.0):
        assert agree(runs[fps], runs[30.0], 0.1) >= 55


@pytest.mark.parametrize("fps", RATES)
def test_the_same_track_with_a_third_of_the_frames_dropped(fps):
    whole = followed(fps)
    for seed in range(2):
        thinned = followed(fps, 0.3, seed)
        gap_s = float(np.diff([s.t_s for s in thinned]).max())
        assert gap_s > 1.5 / fps
        assert agree(thinned, whole, gap_s) > 30


@pytest.mark.parametrize("fps", RATES)
def test_a_loss_and_a_return_take_the_same_time(fps):
    def script(t: float) -> Sequence[Candidate]:
        return [] if 2 + EPS < t < 5 - EPS else [seen(0.8, 60 * t if t < 3 else 150.0, of=evidence())]

    times = {(status, k): t for k, (t, status) in enumerate(changes(play(script, 6.0, fps)))}
    period = 1 / fps
    assert [status for status, _ in times] == [LOCKED, COASTING, SEARCHING, LOCKED]
    assert list(times.values())[1:] == pytest.approx([2 + period, 3.5, 5.2], abs=EPS)


# --- only a target that moved coasts on its velocity


@pytest.mark.parametrize("direction", [(1.0, 0.0), (-0.6, 0.8)])
def test_a_moving_target_is_predicted_on_its_way(direction):
    def script(t: float) -> Sequence[Candidate]:
        way = 60.0 * t
        return [seen(0.8, way * direction[0], way * direction[1] / 2)] if t <= 2 + EPS else []

    states = [s for s in play(script, 3.0) if s.status is COASTING]
    assert states[-1].t_s == pytest.approx(3.0)
    moved = states[-1].box.cx_px - states[0].box.cx_px
    assert 0.5 < moved / (60.0 * direction[0]) < 1.0
    assert states[5].vel_px_s[0] == pytest.approx(60.0 * direction[0], rel=0.1)


@pytest.mark.parametrize("fps", RATES)
def test_a_still_target_is_predicted_where_it_stood(fps):
    """It trembles, and the last tremble is no motion."""

    def script(t: float) -> Sequence[Candidate]:
        return [seen(0.8, 0.06 * SIZE_PX * math.sin(41.0 * t))] if t <= 2 + EPS else []

    states = [s for s in play(script, 3.0, fps) if s.status is COASTING]
    assert {s.vel_px_s for s in states} == {(0.0, 0.0)}
    assert {s.box for s in states} == {states[0].box}
    assert states[0].box.cx_px == pytest.approx(BOX.cx_px, abs=0.1 * SIZE_PX)


def test_a_gap_in_the_pictures_is_borne_as_long_as_a_coast():
    tracker = TargetTracker()
    play(lambda t: [seen(0.8, 60 * t)], 2.0, 30.0, tracker)
    state = tracker.step([], 2.0 + C.status.coast_s - 0.2, IMAGE)
    assert (state.status, state.reason) == (COASTING, TargetReason.NO_CANDIDATE)


# --- reasons of a fitted confidence

NAMES = ("head_1", "margin", "exemplar", "scale_jump", "nis")
MODEL = ConfidenceModel(NAMES, (0.0, 0.4, 0.6, 0.0, 1.4), (1.0,) * 5, (1.0, 4.0, 6.0, -6.0, -2.0), -2.8)
UNCLEAR = {"heads": (0.5, 0.5, 0.5)}


@pytest.mark.parametrize(
    ("of", "dx_sizes", "reason"),
    [
        (evidence(heads=(0.004, 0.5, 0.5)), 0.0, TargetReason.LOW_PEAK),
        (evidence(second=1.6, **UNCLEAR), 0.0, TargetReason.AMBIGUOUS),
        (evidence(-0.2, **UNCLEAR), 0.0, TargetReason.UNLIKE_EXEMPLAR),
        (evidence(ln_scale=1.5, **UNCLEAR), 0.0, TargetReason.SHAPE_COLLAPSE),
        (evidence(0.5, second=0.7, **UNCLEAR), 0.7, TargetReason.INNOVATION_GATE),
    ],
)
def test_a_refusal_says_what_speaks_most_against_the_candidate(of: Evidence, dx_sizes, reason):
    tracker = locked_on_evidence()
    state = tracker.step([seen(0.99, dx_sizes * SIZE_PX, of=of)], 1.0 + 1 / 30, IMAGE)
    assert (state.status, state.reason) == (COASTING, reason)
    assert state.chosen is None


def locked_on_evidence() -> TargetTracker:
    tracker = TargetTracker(confidence=MODEL)
    assert play(lambda t: [seen(0.1, of=evidence())], 1.0, 30.0, tracker)[-1].status is LOCKED, "whatever the score is"
    return tracker


def test_the_confidence_is_that_of_the_model_and_fades():
    tracker = locked_on_evidence()
    sure = tracker.step([seen(0.1, of=evidence())], 1.1, IMAGE).confidence
    assert sure > 0.9
    assert tracker.step([seen(0.1, of=evidence(0.6))], 1.2, IMAGE).confidence < sure
    assert tracker.step([], 1.7, IMAGE).confidence < 0.5


def test_where_nothing_certain_speaks_against_it_the_confidence_is_simply_low():
    blind = ConfidenceModel(("head_1",), (0.0,), (1.0,), (0.0,), -2.0)
    states = play(lambda t: [seen(of=evidence())], 0.5, 30.0, TargetTracker(confidence=blind))
    assert reasons(states[1:]) == {TargetReason.LOW_CONFIDENCE}


def test_re_acquisition_needs_this_targets_appearance():
    """What is like it only by its score is not it, for a model that was fitted."""
    for of, status in ((evidence(), LOCKED), (evidence(-0.1), SEARCHING)):
        tracker = locked_on_evidence()
        step_all(lambda t: [], [1 + k / 30 for k in range(1, 90)], tracker)
        states = step_all(lambda t, of=of: [seen(0.99, 150.0, of=of)], [4 + k / 30 for k in range(12)], tracker)
        assert states[-1].status is status


# --- two that look alike


def crossing(offset_px: float, rival: float = 0.95, zoom: float = 1.0) -> Script:
    """The target goes right, something that looks better goes left; they meet at 2 s, `offset_px` apart."""

    def script(t: float) -> list[Candidate]:
        target = seen(0.8, 60 * (t - 2), of=evidence())
        other = seen(rival, -60 * (t - 2), offset_px, zoom=zoom, of=evidence(0.85))
        return sorted([target, other], key=lambda c: -c.score)

    return script


def cross(script: Script, fps: float = 30.0, until_s: float = 3.5) -> list[TargetState]:
    tracker = TargetTracker()
    tracker.start(replace(BOX, cx_px=BOX.cx_px - 120), 0.0)
    return step_all(script, [k / fps for k in range(1, round(until_s * fps) + 1)], tracker)


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize("offset_px", [10.0, 60.0])
def test_motion_decides_between_two_that_look_alike_and_the_alarm_is_reported(offset_px, fps):
    states = cross(crossing(offset_px), fps)
    sure = [s for s in states if s.status is LOCKED]
    assert len(sure) > 0.8 * len(states)
    for s in sure:
        assert abs(s.box.cx_px - (BOX.cx_px + 60 * (s.t_s - 2))) < 0.3 * SIZE_PX
        assert s.chosen.score == 0.8, "though the other one looks better"
    assert states[-1].status is LOCKED
    together = [s for s in states if 0.5 < s.t_s < 1.5 or s.t_s > 2.8]
    assert all(TargetAlarm.DISTRACTOR in s.alarms for s in together)


@pytest.mark.parametrize("fps", RATES)
def test_two_that_melt_into_one_are_told_apart_afterwards(fps):
    """While they overlap there is one response, and it goes with the rival."""

    def script(t: float) -> list[Candidate]:
        both = crossing(8.0)(t)
        return both if abs(t - 2) > 0.25 else both[:1]

    states = cross(script, fps)
    for s in states:
        if s.status is LOCKED and abs(s.t_s - 2) > 0.5:
            assert abs(s.box.cx_px - (BOX.cx_px + 60 * (s.t_s - 2))) < 0.5 * SIZE_PX
    assert states[-1].status is LOCKED


def test_where_motion_does_not_tell_either_the_target_coasts_as_ambiguous():
    """One response between two that were told apart a moment before."""

    def script(t: float) -> list[Candidate]:
        both = [seen(0.8, of=evidence()), seen(0.8, 46.0, of=evidence())]
        return both if t <= 2 + EPS else [seen(0.8, 23.0, of=evidence())]

    state = play(script, 2.1)[-1]
    assert (state.status, state.reason) == (COASTING, TargetReason.AMBIGUOUS)


def test_a_chosen_one_of_lower_rank_gives_its_size_to_the_hint():
    """The tracker's own size is that of its best candidate, which is the other thing."""
    tracker = TargetTracker()
    tracker.start(replace(BOX, cx_px=BOX.cx_px - 120), 0.0)
    script = crossing(60.0, zoom=1.4)
    for k in range(1, 46):
        found = script(k / 30)
        state = tracker.step(found, k / 30, IMAGE)
        assert state.chosen is found[1]
        assert tracker.hint().size_px == (BOX.w_px, BOX.h_px)


def test_alone_there_is_no_alarm():
    states = play(lambda t: [seen(of=evidence()), seen(0.4, 100.0, of=evidence())], 3.0)
    assert {s.alarms for s in states} == {()}


# --- a lock on something else

LIKE, UNLIKE = seen(of=evidence()), seen(of=evidence(0.2))


def grows(t: float) -> Candidate:
    """From 2 s on the box spreads over what is around, and looks ever less like the target, but not unlike it."""
    return seen(0.85, zoom=math.exp(min(1.2 * (t - 2), 0.84)), of=evidence(0.55)) if t > 2 + EPS else LIKE


@pytest.mark.parametrize("fps", RATES)
def test_a_lock_on_what_does_not_look_like_the_target_ends_at_once(fps):
    states = play(until(3, [LIKE], [UNLIKE]), 8.0, fps)
    ended = next(s for s in states if s.t_s > 3 + EPS)
    assert (ended.status, ended.reason) == (COASTING, TargetReason.UNLIKE_EXEMPLAR)
    assert (ended.chosen, ended.memory) == (None, None)
    assert all(s.status in (COASTING, SEARCHING) for s in states if s.t_s > ended.t_s)


@pytest.mark.parametrize("fps", RATES)
def test_a_false_lock_ends_the_lock_and_is_not_at_once_locked_again(fps):
    states = play(lambda t: [grows(t)], 8.0, fps)
    ended = next(s for s in states if s.t_s > 2 + EPS and s.status is not LOCKED)
    assert (ended.status, ended.reason) == (SEARCHING, TargetReason.FALSE_LOCK)
    assert ended.t_s <= 3.0 + EPS
    assert ended.alarms == (TargetAlarm.FALSE_LOCK,)
    assert (ended.chosen, ended.memory, ended.confidence) == (None, None, 0.0)
    assert all(s.status is SEARCHING for s in states if s.t_s > ended.t_s)


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize("gone_s", [3.2, 9.0])
def test_after_a_false_lock_what_was_seen_beside_it_may_be_the_target(gone_s, fps):
    """And the alarm ends with the false lock, so that it cannot tear the next one."""
    target = seen(0.8, -150.0, of=evidence())

    def script(t: float) -> list[Candidate]:
        return [*([grows(t)] if t < gone_s else []), *([target] if t > 2.2 else [])]

    states = play(script, 8.0, fps)
    ended = next(k for k, s in enumerate(states) if s.reason is TargetReason.FALSE_LOCK)
    assert {s.chosen for s in states[ended:]} == {None, target}
    assert states[-1].status is LOCKED
    assert not any(TargetAlarm.FALSE_LOCK in s.alarms for s in states[ended + 1 :])


def test_after_a_false_lock_the_target_itself_is_found_again():
    """In the same place, and elsewhere once the false one is gone; a moment later it was never false."""
    for back in (seen(of=evidence()), seen(0.7, 150.0, of=evidence())):
        states = play(lambda t, back=back: [LIKE] if t <= 3 + EPS else [UNLIKE] if t < 4.5 else [back], 6.0)
        again = next(s for s in states if s.t_s > 4.4 and s.status is LOCKED)
        assert again.t_s < 5.5
        assert again.reason is TargetReason.REACQUIRED
        assert all(s.status is LOCKED for s in states if s.t_s > again.t_s)
        assert states[-1].alarms == ()


def test_after_a_false_lock_the_target_elsewhere_is_found_though_the_false_one_stays():
    def script(t: float) -> list[Candidate]:
        if t <= 3 + EPS:
            return [LIKE]
        return [UNLIKE] if t < 4.5 else [UNLIKE, seen(0.8, 150.0, of=evidence())]

    states = play(script, 8.0)
    assert states[-1].status is LOCKED
    assert states[-1].box.cx_px == pytest.approx(BOX.cx_px + 150.0, abs=2.0)


def test_a_false_lock_that_stays_does_not_keep_the_search_alive_for_ever():
    states = play(until(3, [LIKE], [UNLIKE]), 4.0 + C.status.give_up_s + 1.0, 10.0)
    assert states[-1].status is LOST


@pytest.mark.parametrize("hidden_s", [0.6, 3.0])
@pytest.mark.parametrize(
    ("back", "taken"),
    [
        (evidence(0.9), True),
        (evidence(0.2, recent=0.8), True),  # as it looked lately
        (evidence(0.4), False),
        (evidence(0.4, recent=None), False),
    ],
)
def test_what_is_found_after_a_longer_absence_must_look_like_the_target(back, taken, hidden_s):
    states = play(lambda t: [LIKE] if t <= 2 + EPS else [] if t < 2 + hidden_s else [seen(0.9, of=back)], 6.0)
    assert (LOCKED in {s.status for s in states if s.t_s > 2 + EPS}) is taken
    if not taken:
        assert TargetReason.UNLIKE_EXEMPLAR in reasons(states)


@pytest.mark.parametrize("hidden_s", [0.6, 3.0])
def test_what_was_not_compared_does_not_end_a_longer_absence_but_holds_its_place(hidden_s):
    """Only the first in rank is compared: another one must be looked at again before it is the target."""
    back_s = 2 + hidden_s

    def script(compared_s: float) -> Script:
        def found(t: float) -> list[Candidate]:
            if t <= 2 + EPS:
                return [LIKE]
            of = evidence() if t > compared_s else evidence(None, recent=None)
            return [seen(0.9, 8.0, of=of)] if t > back_s else []

        return found

    never = [s for s in play(script(math.inf), 6.0) if s.t_s > back_s + 0.3]
    assert LOCKED not in {s.status for s in never}
    assert TargetReason.CONFIRMING in reasons(never)
    states = play(script(back_s + 0.4), 6.0)
    again = next(s.t_s for s in states if s.t_s > 2 + EPS and s.status is LOCKED)
    assert again == pytest.approx(back_s + 0.4, abs=1.1 / 30)


def test_a_short_absence_and_a_tracker_without_evidence_need_no_comparison():
    for back, hidden_s in ((evidence(None, recent=None), 0.2), (None, 3.0)):
        first = seen(of=None if back is None else evidence())
        states = play(
            lambda t, b=back, h=hidden_s, f=first: [f] if t <= 2 + EPS else [] if t < 2 + h else [seen(of=b)], 6.0
        )
        assert states[-1].status is LOCKED


def test_a_selection_does_not_jump_to_what_is_only_a_little_like_it():
    far = seen(0.95, 6 * SIZE_PX, of=evidence(0.4))
    states = play(lambda t: [far], 0.6)
    assert reasons(states[1:]) == {TargetReason.UNLIKE_EXEMPLAR}
    like = seen(0.95, 6 * SIZE_PX, of=evidence())
    assert any(s.chosen is like for s in play(lambda t: [like], 0.6)), "else it proves nothing"


@pytest.mark.parametrize("dx", [0.0, 6 * SIZE_PX])
def test_what_does_not_look_like_the_selected_is_not_acquired(dx):
    """Neither in its place nor elsewhere, however good its score is."""
    states = play(lambda t: [seen(0.95, dx, of=evidence(0.05))], 3.0)
    assert {s.status for s in states} <= {TargetStatus.ACQUIRING, SEARCHING}
    assert TargetReason.UNLIKE_EXEMPLAR in reasons(states)
    assert play(lambda t: [seen(0.95, dx, of=evidence())], 3.0)[-1].status is LOCKED, "else it proves nothing"


@pytest.mark.parametrize(("likeness", "taken"), [(0.9, True), (0.5, False)])
def test_a_lock_does_not_jump_to_what_does_not_look_like_the_target(likeness, taken):
    far = seen(0.95, 6 * SIZE_PX, of=evidence(likeness))
    states = play(until(2, [LIKE], [far]), 3.0)
    assert any(s.chosen is far for s in states) is taken
    assert taken or TargetReason.UNLIKE_EXEMPLAR in reasons(states)


@pytest.mark.parametrize(("back", "taken"), [(0.1, False), (0.2, True)])
def test_a_target_that_hardly_looked_like_itself_is_not_recognised_by_chance(back, taken):
    """Known by the recent exemplar alone; of a cosine with the first that is as low, most is chance."""
    first = [seen(of=evidence(0.08, recent=0.6))]
    states = play(lambda t: first if t <= 2 + EPS else [] if t < 5 else [seen(0.9, 90.0, of=evidence(back))], 7.0)
    assert states[60].status is LOCKED
    assert (states[-1].status is LOCKED) is taken


def test_a_target_that_turns_and_is_known_from_the_memory_is_no_false_lock():
    turned = seen(of=evidence(0.2, recent=0.8))
    states = play(until(3, [LIKE], [turned]), 6.0)
    assert all(s.status is LOCKED for s in states if s.t_s > 1)
