"""What may enter the estimate, end a coast or a search, or move a prediction: by its look, its size, its place."""

import math
from collections.abc import Sequence

import pytest

from tests.tracker.scripted import BOX, IMAGE, RATES, SIZE_PX, evidence, seen, step_all
from tracker.messages import Candidate, TargetReason, TargetState, TargetStatus
from tracker.target import TargetConfig, TargetTracker

ACQUIRING, LOCKED = TargetStatus.ACQUIRING, TargetStatus.LOCKED
COASTING, SEARCHING = TargetStatus.COASTING, TargetStatus.SEARCHING
C = TargetConfig()
USUAL = 0.9


def alike(exemplar: float, dx: float = 0.0, score: float = 0.8, recent: float | None = None) -> Candidate:
    return seen(score, dx, of=evidence(exemplar, recent=recent))


def times(from_s: float, until_s: float, fps: float) -> list[float]:
    return [k / fps for k in range(round(from_s * fps) + 1, round(until_s * fps) + 1)]


def known(fps: float = 30.0, ego: bool = False) -> TargetTracker:
    """Locked for two seconds on a target whose usual likeness is USUAL."""
    tracker = TargetTracker()
    tracker.start(BOX, 0.0)
    if ego:
        assert tracker.shift(0.0, 0.0)
    assert step_all(lambda t: [alike(USUAL)], times(0.0, 2.0, fps), tracker)[-1].status is LOCKED
    return tracker


def after_gap(
    tracker: TargetTracker, found: Sequence[Candidate], gap_s: float, fps: float, until_s: float
) -> list[TargetState]:
    """Nothing for `gap_s` from 2 s on, then `found`; the states from then on."""
    step_all(lambda t: [], times(2.0, 2.0 + gap_s, fps), tracker)
    return step_all(lambda t: found, times(2.0 + gap_s, until_s, fps), tracker)


HALF = 0.55 * USUAL  # enough for a lock to go on, not for one to begin


@pytest.mark.parametrize("fps", RATES)
def test_a_lock_goes_on_with_a_look_that_does_not_end_a_coast(fps: float) -> None:
    on = step_all(lambda t: [alike(HALF)], times(2.0, 2.6, fps), known(fps))
    assert {s.status for s in on} == {LOCKED}
    back = after_gap(known(fps), [alike(HALF)], 0.2, fps, 2.9)
    assert {s.status for s in back} == {COASTING}
    assert {s.reason for s in back} == {TargetReason.UNLIKE_EXEMPLAR}
    assert after_gap(known(fps), [alike(0.75 * USUAL)], 0.2, fps, 3.0)[0].status is LOCKED


@pytest.mark.parametrize("fps", RATES)
def test_a_target_whose_look_has_changed_comes_back_from_a_coast_as_it_was_last(fps: float) -> None:
    tracker = known(fps)
    step_all(lambda t: [alike(HALF)], times(2.0, 5.0, fps), tracker)
    step_all(lambda t: [], times(5.0, 5.2, fps), tracker)
    assert step_all(lambda t: [alike(0.85 * HALF)], times(5.2, 5.3, fps), tracker)[0].status is LOCKED


@pytest.mark.parametrize(("share", "found"), [(0.75, False), (0.85, True)])
@pytest.mark.parametrize("gap_s", [2.5, 6.0])
def test_a_search_asks_for_more_than_a_coast(share: float, found: bool, gap_s: float) -> None:
    assert C.alike_share < 0.75 < C.found_share < 0.85
    back = after_gap(known(), [alike(share * USUAL, 80.0)], gap_s, 30.0, 2.0 + gap_s + 1.0)
    assert (back[-1].status is LOCKED) is found
    if not found:
        assert TargetReason.UNLIKE_EXEMPLAR in {s.reason for s in back}


def test_what_the_memory_knows_counts_as_much_as_the_first_exemplar() -> None:
    back = after_gap(known(), [alike(0.5 * USUAL, 80.0, recent=0.9 * USUAL)], 3.0, 30.0, 6.0)
    assert back[-1].status is LOCKED


@pytest.mark.parametrize(("dx", "exemplar", "taken"), [(0.8, 0.4, True), (1.2, 0.4, False), (1.2, 0.6, True)])
def test_before_it_is_confirmed_only_what_is_near_may_look_otherwise(dx: float, exemplar: float, taken: bool) -> None:
    tracker = TargetTracker()
    tracker.start(BOX, 0.0)
    step_all(lambda t: [], times(0.0, 0.5, 30.0), tracker)
    state = tracker.step([alike(exemplar, dx * SIZE_PX)], 0.53, IMAGE)
    assert (state.chosen is not None) is taken


# --- what moves a prediction


def faint(dx: float, exemplar: float = 0.2) -> Candidate:
    return alike(exemplar, dx, score=0.05)


@pytest.mark.parametrize("fps", RATES)
def test_without_ego_motion_a_faint_response_moves_the_prediction_but_is_no_sight(fps: float) -> None:
    states = after_gap(known(fps), [faint(0.3 * SIZE_PX)], 0.1, fps, 4.5)
    assert LOCKED not in {s.status for s in states}
    assert {s.status for s in states} == {COASTING, SEARCHING}
    assert all(s.chosen is None and s.memory is None for s in states)
    assert states[-1].box is not None
    assert states[-1].box.cx_px == pytest.approx(BOX.cx_px + 0.3 * SIZE_PX, abs=0.1 * SIZE_PX)
    assert states[-1].confidence < 0.1


@pytest.mark.parametrize(("exemplar", "moves"), [(0.2, False), (USUAL, False)])
def test_with_ego_motion_no_faint_response_moves_a_coast(exemplar: float, moves: bool) -> None:
    states = after_gap(known(ego=True), [faint(0.3 * SIZE_PX, exemplar)], 0.1, 30.0, 2.9)
    assert {s.status for s in states} == {COASTING}
    assert states[-1].box is not None
    moved = (states[-1].box.cx_px - BOX.cx_px) / SIZE_PX
    assert moved == pytest.approx(0.3 if moves else 0.0, abs=0.1)


def test_a_prediction_is_not_moved_by_what_is_left_of_a_covered_target() -> None:
    left = seen(0.8, -0.2 * SIZE_PX, zoom=0.6, of=evidence(0.3, recent=None))
    states = step_all(lambda t: [left], times(2.0, 2.4, 30.0), known())
    assert {s.reason for s in states} == {TargetReason.SHAPE_COLLAPSE}
    assert states[-1].box is not None
    assert states[-1].box.cx_px == pytest.approx(BOX.cx_px, abs=0.02 * SIZE_PX)
    assert states[-1].box.w_px == pytest.approx(BOX.w_px, rel=0.02)


# --- what is no collapse


def shrinking(zoom: float, exemplar: float) -> Candidate:
    return seen(0.9, zoom=zoom, of=evidence(exemplar, recent=None))


@pytest.mark.parametrize(("exemplar", "collapses"), [(USUAL, False), (USUAL - 0.05, False), (USUAL - 0.2, True)])
def test_a_box_that_shrinks_while_the_look_stays_is_no_collapse(exemplar: float, collapses: bool) -> None:
    states = step_all(lambda t: [shrinking(0.65, exemplar)], times(2.0, 2.3, 30.0), known())
    assert (TargetReason.SHAPE_COLLAPSE in {s.reason for s in states}) is collapses


def test_a_box_that_was_measured_too_large_may_shrink_again() -> None:
    """Grown by a half in 0.6 s and back: faster than anything comes near."""

    def zoom(t: float) -> float:
        return 1.0 + 0.5 * max(0.0, 1.0 - abs(t - 2.6) / 0.6)

    states = step_all(lambda t: [seen(0.9, zoom=zoom(t))], times(2.0, 3.6, 30.0), _blind())
    assert {s.status for s in states} == {LOCKED}
    at_once = step_all(lambda t: [seen(0.9, zoom=0.6)], times(2.0, 2.2, 30.0), _blind())
    assert TargetReason.SHAPE_COLLAPSE in {s.reason for s in at_once}


def _blind() -> TargetTracker:
    """Locked for two seconds on a target without evidence."""
    tracker = TargetTracker()
    tracker.start(BOX, 0.0)
    step_all(lambda t: [seen(0.9)], times(0.0, 2.0, 30.0), tracker)
    return tracker


# --- the second look of a search


@pytest.mark.parametrize(("score", "again"), [(0.3, True), (0.1, False)])
def test_what_a_wide_window_shows_uncertainly_is_looked_at_in_a_narrow_one(score: float, again: bool) -> None:
    tracker = known()
    step_all(lambda t: [], times(2.0, 5.0, 30.0), tracker)
    away = seen(score, 150.0, 60.0, of=evidence(None, recent=None, search_scale=2.0))
    assert tracker.step([away], 5.0 + 1 / 30, IMAGE).status is SEARCHING
    hint = tracker.hint()
    assert hint is not None
    assert 1 + len(hint.tiles) <= hint.max_calls
    found = [t for t in hint.tiles if math.dist(t.center_px, (BOX.cx_px + 150.0, BOX.cy_px + 60.0)) < 1e-6]
    assert bool(found) is again
    assert all(t.scale == 1.0 for t in found)


def test_the_memory_takes_only_what_a_coast_could_end_with() -> None:
    for exemplar, kept in ((0.75 * USUAL, True), (HALF, False)):
        states = step_all(lambda t, e=exemplar: [alike(e, score=0.95)], times(2.0, 6.0, 30.0), known())  # type: ignore[misc]
        assert {s.status for s in states} == {LOCKED}
        assert any(s.memory is not None for s in states) is kept
