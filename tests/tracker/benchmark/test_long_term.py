"""Honesty and re-acquisition against sequences written by hand: one letter a frame."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker.benchmark.long_term import LongTerm, long_term, pooled
from tracker.benchmark.shares import Share
from tracker.box import Box
from tracker.messages import TargetStatus

QUICK = settings(max_examples=25, deadline=None)  # arrays are cheap, drawing them is not
TARGET = Box(100.0, 100.0, 40.0, 40.0)
NEAR = Box(120.0, 100.0, 40.0, 40.0)  # IoU 1/3: on target, but not right
ELSEWHERE = Box(400.0, 100.0, 40.0, 40.0)
STATUS = {"L": TargetStatus.LOCKED, "C": TargetStatus.COASTING, "S": TargetStatus.SEARCHING, "X": TargetStatus.LOST}
BOX = {"+": TARGET, "~": NEAR, "-": ELSEWHERE, ".": None}


def measured(statuses, reported, truth, fps=10.0, **more):
    """`truth`: T present, _ absent."""
    return long_term(
        [BOX[b] for b in reported],
        [STATUS[s] for s in statuses],
        [TARGET if t == "T" else None for t in truth],
        fps,
        **more,
    )


def test_false_confirmations_are_locked_frames_off_the_target_or_without_one():
    #                  right, near, off, no box, absent; then the same not LOCKED
    found = measured("LLLLL" + "CSXCS", "+~-.+" * 2, "TTTT_" * 2)
    assert found.false_confirmed == Share(3, 10)


def test_honest_lock_share_asks_for_locked_only_where_the_box_is_right():
    found = measured("LLCCCL", "++++~-", "TTT_TT")
    assert found.honest_lock == Share(2, 3)


def test_time_to_leave_locked_after_the_target_went():
    found = measured("LLLLLCCC", "++++++++", "TT______")
    assert found.locked_after_loss_s == (pytest.approx(0.3),)
    assert (found.losses, found.leave_s, found.never_left) == (1, pytest.approx(0.3), 0)
    assert found.left_in_time == Share(1, 1)


@pytest.mark.parametrize(("locked", "in_time"), [(7, 1), (8, 0)])
def test_seven_tenths_of_a_second_is_the_limit(locked, in_time):
    found = measured("LL" + "L" * locked + "SSS", "+" * (locked + 5), "TT" + "_" * (locked + 3))
    assert found.left_in_time == Share(in_time, 1)


def test_a_status_that_leaves_at_once_or_before_has_stayed_no_time():
    assert measured("LLSS", "++..", "TT__").locked_after_loss_s == (0.0,)
    # it was coasting already when the target went: nothing was lost silently
    assert measured("LCCC", "++++", "TT__").losses == 0


def test_a_box_that_drifts_off_is_a_loss_only_while_locked():
    assert measured("LLLLSS", "++----", "TTTTTT").locked_after_loss_s == (pytest.approx(0.2),)
    assert measured("LLSSSS", "++----", "TTTTTT").losses == 0


def test_a_loss_ends_when_the_target_is_followed_again_and_then_was_never_left():
    found = measured("LLLLLL", "++--++", "TTTTTT")
    assert found.locked_after_loss_s == (pytest.approx(0.2),)
    assert (found.never_left, found.left_in_time) == (1, Share(0, 0))  # it never said so: no honest exit


def test_one_loss_is_not_counted_again_before_the_target_was_followed():
    found = measured("LLLSLLSL", "++----.-", "TT__TT__")
    assert (found.losses, found.locked_after_loss_s) == (1, (pytest.approx(0.1),))


def test_a_raw_tracker_counts_as_locked_whatever_it_says():
    found = measured("LSSSS", "+----", "TTT__", raw=True)
    assert found.false_confirmed == Share(4, 5)
    assert (found.never_left, found.locked_after_loss_s) == (1, (pytest.approx(0.4),))


def comes_back(delay, seen=40, gone=5):
    """Absent for `gone` frames, then seen for `seen`, followed from `delay` frames after the return on."""
    late = min(delay, seen)
    return ("LL" + "S" * (gone + late) + "L" * (seen - late), "++" + "-" * (gone + late) + "+" * (seen - late))


@pytest.mark.parametrize(("delay", "frames", "second"), [(0, 1, 1), (9, 1, 1), (10, 1, 0), (29, 1, 0), (30, 0, 0)])
def test_reacquired_within_30_frames_and_within_a_second(delay, frames, second):
    found = measured(*comes_back(delay), "TT" + "_" * 5 + "T" * 40)
    assert found.back_in_frames == Share(frames, 1)
    assert found.back_in_s == Share(second, 1)


def test_locked_on_something_else_is_not_reacquired():
    found = measured("LL" + "S" * 5 + "L" * 40, "++" + "-" * 45, "TT" + "_" * 5 + "T" * 40)
    assert (found.back_in_frames, found.back_in_s) == (Share(0, 1), Share(0, 1))


def test_chances_shorter_than_the_window_are_left_out_even_when_they_were_taken():
    found = measured(*comes_back(0, seen=20), "TT" + "_" * 5 + "T" * 20)
    assert (found.back_in_frames, found.back_in_s) == (Share(0, 0), Share(1, 1))
    flashes = "TT" + "__TTT" * 10
    assert measured("L" * 52, "+" * 52, flashes).back_in_s == Share(0, 0)


def test_a_drift_with_the_target_in_view_is_a_chance_too():
    found = measured("LLL" + "S" * 6 + "L" * 40, "++-" + "-" * 6 + "+" * 40, "T" * 49)
    assert (found.back_in_frames, found.back_in_s) == (Share(1, 1), Share(1, 1))


def test_a_second_is_a_second_at_any_rate():
    letters = (*comes_back(20), "TT" + "_" * 5 + "T" * 40)
    assert measured(*letters, fps=30.0).back_in_s == Share(1, 1)
    assert measured(*letters, fps=20.0).back_in_s == Share(0, 1)
    assert measured(*letters, fps=0.5).back_in_s == Share(0, 1)  # one frame at least


def test_memory_writes_off_the_target_are_wrong():
    writes = [TARGET, None, NEAR, ELSEWHERE, TARGET, TARGET]
    assert measured("LLLLLL", "++++++", "TTTTT_", writes=writes).wrong_writes == Share(2, 5)
    assert measured("L", "+", "T", writes=[None]).wrong_writes == Share(0, 0)
    assert measured("L", "+", "T").wrong_writes == Share(0, 0)


def test_pooled_counts_add_up():
    one = measured("LLLLSS", "++----", "TTTTTT")
    two = measured("LLLL", "++++", "TT__", writes=[TARGET, None, None, TARGET])
    both = pooled([one, two])
    assert both.false_confirmed == Share(4, 10)
    assert both.locked_after_loss_s == (pytest.approx(0.2), pytest.approx(0.2))
    assert (both.losses, both.never_left, both.wrong_writes) == (2, 1, Share(1, 2))
    assert pooled([]) == LongTerm()
    assert (LongTerm().false_confirmed.value, LongTerm().leave_s) == (None, None)


@pytest.mark.parametrize("fps", [0.0, -1.0, float("nan")])
def test_the_rate_must_be_positive(fps):
    with pytest.raises(ValueError, match="fps"):
        measured("L", "+", "T", fps=fps)


@pytest.mark.parametrize("letters", [("LL", "+", "T"), ("L", "++", "T"), ("L", "+", "TT")])
def test_lengths_must_agree(letters):
    with pytest.raises(ValueError, match="against"):
        measured(*letters)


def test_as_many_writes_as_frames():
    with pytest.raises(ValueError, match="writes"):
        measured("LL", "++", "TT", writes=[None])


frames = st.lists(st.tuples(st.sampled_from("LCSX"), st.sampled_from("+~-."), st.sampled_from("T_")), max_size=40)


@QUICK
@given(frames)
def test_shares_are_shares_and_never_locking_confirms_nothing_falsely(letters):
    statuses, reported, truth = zip(*letters, strict=True) if letters else ("", "", "")
    found = measured(statuses, reported, truth)
    for share in (found.false_confirmed, found.honest_lock, found.left_in_time, found.back_in_s, found.back_in_frames):
        assert 0 <= share.hits <= share.of
    assert found.never_left <= found.losses == found.left_in_time.of
    silent = measured("S" * len(letters), reported, truth)
    assert (silent.false_confirmed.hits, silent.losses, silent.honest_lock.hits) == (0, 0, 0)
    raw = measured(statuses, reported, truth, raw=True)
    assert raw.false_confirmed.hits >= found.false_confirmed.hits
    assert raw.never_left == raw.losses
