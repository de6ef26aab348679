"""The table of the statuses, event by event, and the times of its rules."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker.messages import TargetReason, TargetStatus
from tracker.status import MAX_COAST_S, TABLE, Event, StatusConfig, StatusMachine

IDLE, ACQUIRING, LOCKED = TargetStatus.IDLE, TargetStatus.ACQUIRING, TargetStatus.LOCKED
COASTING, SEARCHING, LOST = TargetStatus.COASTING, TargetStatus.SEARCHING, TargetStatus.LOST
RATES = (10.0, 20.0, 30.0)
C = StatusConfig()

WAY = {
    IDLE: (),
    ACQUIRING: (Event.STARTED,),
    LOCKED: (Event.STARTED, Event.CONFIRMED),
    COASTING: (Event.STARTED, Event.CONFIRMED, Event.MISSED),
    SEARCHING: (Event.STARTED, Event.CONFIRMED, Event.MISSED, Event.COAST_OVER),
    LOST: (Event.STARTED, Event.CONFIRMED, Event.MISSED, Event.COAST_OVER, Event.GAVE_UP),
}
COLUMNS = (IDLE, ACQUIRING, LOCKED, COASTING, SEARCHING, LOST)
# By event: where it leads from each of COLUMNS.
EXPECTED = {
    Event.STARTED: (ACQUIRING,) * 6,
    Event.STOPPED: (IDLE,) * 6,
    Event.SEEN: (IDLE, ACQUIRING, LOCKED, LOCKED, SEARCHING, LOST),
    Event.WEAK: COLUMNS,
    Event.CONFIRMED: (IDLE, LOCKED, LOCKED, COASTING, LOCKED, LOST),
    Event.DOUBTED: (IDLE, ACQUIRING, COASTING, COASTING, SEARCHING, LOST),
    Event.FALSE_LOCK: (IDLE, ACQUIRING, SEARCHING, COASTING, SEARCHING, LOST),
    Event.MISSED: (IDLE, ACQUIRING, COASTING, COASTING, SEARCHING, LOST),
    Event.NOT_CONFIRMED: (IDLE, SEARCHING, LOCKED, COASTING, SEARCHING, LOST),
    Event.COAST_OVER: (IDLE, ACQUIRING, SEARCHING, SEARCHING, SEARCHING, LOST),
    Event.GAVE_UP: (IDLE, LOST, LOST, LOST, LOST, LOST),
}
CELLS = [(event, before, after) for event, row in EXPECTED.items() for before, after in zip(COLUMNS, row, strict=True)]


def machine(status: TargetStatus, t_s: float = 0.0, config: StatusConfig = C) -> StatusMachine:
    """One that came to a status by events, all at one time."""
    made = StatusMachine(config)
    for event in WAY[status]:
        made.happen(event, t_s)
    assert made.status is status
    return made


def test_the_expectation_covers_every_event_and_every_entry_of_the_table():
    assert set(EXPECTED) == set(Event)
    assert set(COLUMNS) == set(TargetStatus)
    listed = {(before, event): after for event, before, after in CELLS}
    assert all(listed[key] is after for key, after in TABLE.items())


@pytest.mark.parametrize(("event", "before", "after"), CELLS, ids=[f"{e.value}-{b.value}" for e, b, _ in CELLS])
def test_every_event_in_every_status(event, before, after):
    made = machine(before, 1.0)
    told_s = made.seen_s
    assert made.happen(event, 2.0) is after
    assert made.status is after
    if event not in (Event.STARTED, Event.SEEN, Event.CONFIRMED):
        assert made.seen_s == told_s, "only a sighting renews the time of the last one"
    elif after is ACQUIRING or after is LOCKED:
        assert made.seen_s == 2.0


@pytest.mark.parametrize("fps", RATES)
def test_a_lock_bears_doubt_for_the_same_time_at_every_rate(fps):
    made = machine(LOCKED)
    ended = next(k / fps for k in range(1, 60) if made.weak(1.0 + k / fps) is not LOCKED)
    assert made.status is COASTING
    assert ended - 1 / fps == pytest.approx(C.drop_s, abs=1 / fps - 1e-6)


@pytest.mark.parametrize("fps", RATES)
def test_one_good_sighting_ends_the_doubt(fps):
    made = machine(LOCKED)
    for k in range(1, 200):
        good = k % 2 == 0  # never doubtful for longer than one period
        status = made.happen(Event.SEEN, k / fps) if good else made.weak(k / fps)
        assert status is LOCKED


def test_doubt_does_not_outlive_the_lock():
    made = machine(LOCKED)
    made.weak(1.0)
    made.happen(Event.MISSED, 1.05)
    made.happen(Event.SEEN, 5.0)
    assert made.weak(5.02) is LOCKED, "the doubt of the lock before is not counted"
    assert made.weak(5.02 + C.drop_s) is COASTING


@pytest.mark.parametrize("status", [s for s in TargetStatus if s is not LOCKED])
def test_a_weak_sighting_moves_no_other_status(status):
    made = machine(status)
    assert all(made.weak(k / 10) is status for k in range(1, 30))


def expires(status: TargetStatus, fps: float, moving: bool, unsure: bool = False) -> tuple[float, TargetReason]:
    made = machine(status)
    for k in range(1, 2000):
        reason = made.expire(k / fps, moving, unsure)
        if reason is not None:
            assert made.status is not status
            return k / fps, reason
        assert made.status is status
    raise AssertionError(f"{status} never ends")


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize(
    ("status", "moving", "after_s", "reason"),
    [
        (ACQUIRING, False, C.acquire_s, TargetReason.NOT_CONFIRMED),
        (COASTING, True, C.coast_s, TargetReason.COAST_EXPIRED),
        (COASTING, False, C.coast_still_s, TargetReason.COAST_EXPIRED),
        (LOCKED, True, C.coast_s, TargetReason.COAST_EXPIRED),  # a gap in the pictures
        (LOCKED, False, C.coast_still_s, TargetReason.COAST_EXPIRED),
        (SEARCHING, True, C.give_up_s, TargetReason.GAVE_UP),
    ],
)
def test_each_status_ends_after_its_time_at_every_rate(status, moving, after_s, reason, fps):
    assert expires(status, fps, moving) == (pytest.approx(after_s, abs=1e-5), reason)


def test_an_unsure_prediction_ends_a_coast_and_nothing_else():
    assert expires(COASTING, 10.0, True, unsure=True) == (0.1, TargetReason.COAST_UNSURE)
    for status in (ACQUIRING, SEARCHING):
        assert machine(status).expire(0.1, True, True) is None
    for status in (IDLE, LOST):
        made = machine(status)
        assert made.expire(1e6, True, True) is None
        assert made.status is status


def test_being_seen_starts_every_time_anew():
    made = machine(COASTING)
    made.happen(Event.SEEN, 1.4)
    made.happen(Event.MISSED, 1.5)
    assert made.expire(1.4 + C.coast_s - 0.01, True, False) is None
    assert made.expire(1.4 + C.coast_s, True, False) is TargetReason.COAST_EXPIRED
    assert made.expire(1.4 + C.give_up_s - 0.01, True, False) is None
    assert made.expire(1.4 + C.give_up_s, True, False) is TargetReason.GAVE_UP


def test_a_selection_that_is_seen_but_not_confirmed_ends_in_its_time_all_the_same():
    made = machine(ACQUIRING)
    reasons = [(made.happen(Event.SEEN, k / 30), made.expire(k / 30, False, False))[1] for k in range(1, 46)]
    assert reasons[-1] is TargetReason.NOT_CONFIRMED
    assert not any(reasons[:-1])


steps = st.tuples(
    st.sampled_from([*Event, "weak", "expire", "expire", "expire"]),
    st.floats(0.0, 2.0),
    st.booleans(),
    st.booleans(),
)


@given(st.lists(steps, max_size=30))
@settings(max_examples=60)
def test_locked_comes_only_from_a_sighting_and_nothing_comes_back_from_rest(done):
    made, t_s = StatusMachine(C), 0.0
    for what, dt_s, moving, unsure in done:
        before, t_s = made.status, t_s + dt_s
        if what == "weak":
            made.weak(t_s)
        elif what == "expire":
            reason = made.expire(t_s, moving, unsure)
            assert (reason is not None) == (made.status is not before)
            assert not (made.status in (LOCKED, COASTING) and t_s - made.seen_s > C.coast_s)
            assert not (made.status is SEARCHING and t_s - made.seen_s > C.give_up_s)
        else:
            made.happen(what, t_s)
        if made.status is LOCKED and before is not LOCKED:
            assert what is Event.CONFIRMED or (what is Event.SEEN and before is COASTING)
        if before in (IDLE, LOST) and made.status is not before:
            assert what in (Event.STARTED, Event.STOPPED)
        assert made.seen_s <= t_s


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("lock_confidence", 1.5),
        ("lock_confidence", math.nan),
        ("drop_confidence", 0.9),  # above lock_confidence
        ("drop_s", -0.1),
        ("confirm_s", 2.0),  # above acquire_s
        ("acquire_s", math.nan),
        ("coast_s", MAX_COAST_S + 0.1),
        ("coast_still_s", 1.6),  # above coast_s
        ("trust_s", -0.1),
        ("resume_s", math.nan),
        ("reacquire_s", -1.0),
        ("give_up_s", 1.0),  # below coast_s
    ],
)
def test_config_names_field_and_value(field, value):
    with pytest.raises(ValueError, match=rf"target {field} is {value}, must lie in"):
        StatusConfig(**{field: value})
