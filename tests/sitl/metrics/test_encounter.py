from __future__ import annotations

from dataclasses import replace

import pytest

from sitl.metrics.encounter import encounter_metrics
from sitl.metrics.sample import Sample
from tests.sitl.metrics.samples import BOX, DT_S, FAR_BOX, HIDDEN, TRUTH, run
from tracker.box import Box


def hidden(first: int, last: int, unlocked: int, found: int, i: int, s: Sample) -> Sample:
    """Hidden whole in [first, last), not LOCKED in [unlocked, found)."""
    if first <= i < last:
        s = replace(s, truth=HIDDEN)
    return replace(s, status="COASTING") if unlocked <= i < found else s


def seen(share: float) -> object:
    return replace(TRUTH, visibility=share, visible=Box(305, 240, 10, 20))


def test_never_hidden_and_never_locked_say_nothing() -> None:
    assert set(encounter_metrics(run(60)).values()) == {None}
    assert set(encounter_metrics(run(60, lambda i, s: replace(s, status="ACQUIRING", truth=HIDDEN))).values()) == {None}
    assert encounter_metrics([])["reacquired"] is None


def test_back_and_locked_soon() -> None:
    found = encounter_metrics(run(150, lambda i, s: hidden(30, 75, 32, 84, i, s)))
    assert found["hidden_longest_s"] == pytest.approx(45 * DT_S)
    assert found["visible_again_s"] == pytest.approx((149 - 75) * DT_S)
    assert found["reacquire_s"] == pytest.approx(9 * DT_S)
    assert found["reacquired"] == 1.0
    assert found["leave_locked_s"] is None, "it came back: no true loss"


def test_back_counts_from_half_of_it_in_sight() -> None:
    def change(i: int, s: Sample) -> Sample:
        s = hidden(30, 75, 32, 95, i, s)
        return replace(s, truth=seen(0.3)) if 75 <= i < 90 else s

    found = encounter_metrics(run(200, change))
    assert found["reacquire_s"] == pytest.approx(5 * DT_S)
    assert found["hidden_longest_s"] == pytest.approx(45 * DT_S)
    # LOCKED while less than half was to be seen is no later than at once.
    early = encounter_metrics(
        run(200, lambda i, s: replace(change(i, s), status="LOCKED") if i >= 80 else change(i, s))
    )
    assert early["reacquire_s"] == 0.0


@pytest.mark.parametrize(("found_at", "reacquired"), [(75 + 60, 1.0), (75 + 61, 0.0)])
def test_two_seconds_are_soon(found_at: int, reacquired: float) -> None:
    assert encounter_metrics(run(200, lambda i, s: hidden(30, 75, 30, found_at, i, s)))["reacquired"] == reacquired


def test_lost_again_at_the_end_or_locked_on_something_else_is_not_reacquired() -> None:
    def lost(i: int, s: Sample) -> Sample:
        return replace(hidden(30, 75, 32, 80, i, s), status="SEARCHING") if i > 120 else hidden(30, 75, 32, 80, i, s)

    assert encounter_metrics(run(150, lost))["reacquired"] == 0.0

    def other(i: int, s: Sample) -> Sample:
        return replace(hidden(30, 75, 32, 75, i, s), box=FAR_BOX) if i >= 75 else hidden(30, 75, 32, 75, i, s)

    found = encounter_metrics(run(150, other))
    assert found["reacquired"] == 0.0
    assert found["reacquire_s"] is None


def test_what_was_never_held_is_neither_reacquired_nor_let_go() -> None:
    back = encounter_metrics(
        run(150, lambda i, s: replace(hidden(30, 75, 32, 80, i, s), box=FAR_BOX if i < 75 else BOX))
    )
    assert back["reacquired"] is None
    gone = encounter_metrics(run(90, lambda i, s: replace(hidden(30, 999, 32, 999, i, s), box=FAR_BOX)))
    assert gone["leave_locked_s"] is None


def test_of_several_hidden_times_the_longest_counts() -> None:
    def change(i: int, s: Sample) -> Sample:
        return hidden(30, 40, 30, 41, i, hidden(60, 90, 60, 93, i, hidden(110, 115, 999, 0, i, s)))

    found = encounter_metrics(run(200, change))
    assert found["hidden_longest_s"] == pytest.approx(30 * DT_S)
    assert found["reacquire_s"] == pytest.approx(3 * DT_S)
    assert found["visible_again_s"] == pytest.approx(20 * DT_S), "until it is hidden again"


def test_gone_for_good() -> None:
    found = encounter_metrics(run(90, lambda i, s: hidden(30, 999, 36, 999, i, s)))
    assert found["leave_locked_s"] == pytest.approx(6 * DT_S)
    assert found["hidden_longest_s"] == pytest.approx(59 * DT_S)
    assert (found["reacquired"], found["visible_again_s"]) == (None, None)
    assert encounter_metrics(run(90, lambda i, s: hidden(30, 999, 28, 999, i, s)))["leave_locked_s"] == 0.0
    assert encounter_metrics(run(90, lambda i, s: hidden(30, 999, 999, 0, i, s)))["leave_locked_s"] is None


def test_the_loss_begins_when_the_box_leaves_the_target_for_good() -> None:
    def drifts(i: int, s: Sample) -> Sample:
        return replace(hidden(30, 999, 36, 999, i, s), box=FAR_BOX) if i >= 20 else s

    assert encounter_metrics(run(90, drifts))["leave_locked_s"] == pytest.approx(16 * DT_S)

    def comes_back(i: int, s: Sample) -> Sample:
        return replace(s, box=FAR_BOX) if 15 <= i < 20 else hidden(30, 999, 36, 999, i, s)

    assert encounter_metrics(run(90, comes_back))["leave_locked_s"] == pytest.approx(6 * DT_S)

    def on_the_rest(i: int, s: Sample) -> Sample:  # the box is on what is left of the target: that is no loss
        return replace(s, truth=seen(0.1), box=Box(305, 240, 9, 18)) if 20 <= i < 30 else hidden(30, 999, 36, 999, i, s)

    assert encounter_metrics(run(90, on_the_rest))["leave_locked_s"] == pytest.approx(6 * DT_S)
