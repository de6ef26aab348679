"""Both alarms on scripted facts: when they come, when they go, and that neither depends on the frame rate."""

import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker.alarms import (
    AlarmFacts,
    Alarms,
    DistractorAlarm,
    DistractorConfig,
    DistractorReason,
    DistractorReport,
    FalseLock,
    FalseLockConfig,
    FalseLockReason,
    FalseLockReport,
    LockFacts,
    active,
)
from tracker.box import Box
from tracker.false_lock import MAX_KEPT
from tracker.messages import Candidate, Evidence, TargetAlarm

BOX = Box(300.0, 200.0, 30.0, 60.0)
SIZE_PX = math.sqrt(30.0 * 60.0)
RATES = (10.0, 20.0, 30.0)
BAD = (math.nan, math.inf, -math.inf)
DC, FC = DistractorConfig(), FalseLockConfig()
UNLIKE, WANDERED = FalseLockReason.UNLIKE_EXEMPLAR, FalseLockReason.SIZE_WANDERED
WRONG, STOPPED = FalseLockReason.MOTION_WRONG, FalseLockReason.STOPPED_DEAD


def candidate(dx_sizes: float = 0.0, score: float = 0.8, exemplar: float | None = None, zoom: float = 1.0) -> Candidate:
    box = Box(BOX.cx_px + dx_sizes * SIZE_PX, BOX.cy_px, BOX.w_px * zoom, BOX.h_px * zoom)
    return Candidate(box, score, score, score, Evidence((0.8, 0.8, 0.8), 0.5, 9.0, exemplar, None, 0.0, 0.0))


TARGET = candidate(exemplar=0.9)
RIVAL = candidate(2.0, 0.75, 0.7)


def watch(
    rivals: Callable[[float], list[Candidate]], until_s: float, fps: float
) -> list[tuple[float, DistractorReport]]:
    alarm = DistractorAlarm()
    times = [k / fps for k in range(round(until_s * fps) + 1)]
    return [(t, alarm.step([TARGET, *rivals(t)], TARGET, t)) for t in times]


def switches(played: list[tuple[float, Any]]) -> list[float]:
    """Times at which an alarm came or went."""
    on = [(t, report.on) for t, report in played]
    return [t for (_, a), (t, b) in zip([(0.0, False), *on], on, strict=False) if a != b]


@pytest.mark.parametrize("fps", RATES)
def test_a_rival_raises_the_alarm_in_its_time_and_is_forgotten_in_its_time(fps: float) -> None:
    came, went = switches(watch(lambda t: [RIVAL] if 1.01 < t < 2.01 else [], 4.0, fps))
    assert came == pytest.approx(1.01 + DC.on_s, abs=1.01 / fps)
    assert went == pytest.approx(2.01 + DC.off_s, abs=1.01 / fps)


def test_the_report_names_rival_and_reason() -> None:
    played = watch(lambda t: [RIVAL] if 0.49 < t < 1.01 else [], 2.0, 10.0)
    reasons = [report.reason for _, report in played]
    assert reasons[:5] == [DistractorReason.NONE_ALIKE] * 5
    assert reasons[5] is DistractorReason.TOO_SHORT
    assert reasons[6:11] == [DistractorReason.ALIKE] * 5
    assert reasons[11] is DistractorReason.FADING
    assert reasons[-1] is DistractorReason.NONE_ALIKE
    assert [report.rival for _, report in played[4:12]] == [None] + [RIVAL.box] * 7
    assert played[-1][1].rival is None


@pytest.mark.parametrize(
    "other",
    [
        candidate(0.6, 0.8, 0.9),  # the target itself
        candidate(2.0, 0.66, 0.9),  # worse than the target by far
        candidate(2.0, 0.8, 0.6),  # looks otherwise
        candidate(2.0, 0.8, 0.9, zoom=1.7),
        candidate(2.0, 0.8, 0.9, zoom=0.58),
        Candidate(Box(math.nan, 0.0, 1.0, 1.0), 0.9, 0.9, 0.9),
        candidate(2.0, math.nan, 0.9),
    ],
)
def test_what_is_not_alike_raises_nothing(other: Candidate) -> None:
    assert not switches(watch(lambda t: [other], 1.0, 30.0))
    assert switches(watch(lambda t: [other, RIVAL], 1.0, 30.0))


def test_weak_candidates_are_no_rivals_of_a_weak_target() -> None:
    alarm = DistractorAlarm()
    weak, other = candidate(0.0, 0.25), candidate(2.0, 0.25)
    assert not any(alarm.step([weak, other], weak, k / 30).on for k in range(30))


def test_without_cosines_the_score_decides() -> None:
    assert switches(watch(lambda t: [candidate(2.0, 0.7)], 1.0, 30.0))
    bare = Candidate(RIVAL.box, 0.75, 0.75, 0.75)
    assert switches(watch(lambda t: [bare], 1.0, 30.0))


def test_an_alarm_is_sustained_by_less_than_raises_it() -> None:
    middle = candidate(2.0, 0.6, 0.7)
    assert not switches(watch(lambda t: [middle], 2.0, 30.0))
    assert len(switches(watch(lambda t: [RIVAL] if t < 0.5 else [middle], 3.0, 30.0))) == 1


def test_single_sightings_far_apart_raise_nothing() -> None:
    assert not switches(watch(lambda t: [RIVAL] if round(t * 30) % 9 == 0 else [], 3.0, 30.0))


def test_the_strongest_rival_is_reported_and_moves_with_the_picture() -> None:
    alarm = DistractorAlarm()
    other = candidate(-3.0, 0.7, 0.9)
    assert alarm.step([TARGET, other, RIVAL], TARGET, 0.0).rival == RIVAL.box
    alarm.shift(10.0, -4.0)
    alarm.shift(math.nan, 0.0)
    moved = alarm.step([TARGET], TARGET, 0.1).rival
    assert moved is not None
    assert (moved.cx_px, moved.cy_px) == pytest.approx((RIVAL.box.cx_px + 10.0, RIVAL.box.cy_px - 4.0))


def test_without_a_chosen_one_the_alarm_fades() -> None:
    alarm = DistractorAlarm()
    for k in range(10):
        alarm.step([TARGET, RIVAL], TARGET, k / 30)
    reports = [alarm.step([TARGET, RIVAL], None, 0.3 + k / 30) for k in range(1, 20)]
    assert reports[0].reason is DistractorReason.FADING
    assert reports[-1] == DistractorReport(False, None, DistractorReason.NOT_CHOSEN)


@pytest.mark.parametrize("bad", [*BAD, 0.1])
def test_a_time_that_is_no_time_holds_the_distractor_alarm(bad: float) -> None:
    alarm = DistractorAlarm()
    for k in range(10):
        held = alarm.step([TARGET, RIVAL], TARGET, k / 30)
    if bad != math.inf:
        assert alarm.step([TARGET], TARGET, bad) == DistractorReport(True, held.rival, DistractorReason.NO_TIME)
    assert alarm.step([TARGET], TARGET, 0.35).on


Script = Callable[[float], dict[str, Any]]
GOOD: dict[str, Any] = {"exemplar": 0.9, "recent": 0.92, "ln_size": 3.5, "nis": 3.0, "speed_sizes_s": 0.5}


def follow(script: Script, until_s: float, fps: float = 30.0) -> list[tuple[float, FalseLockReport]]:
    lock = FalseLock()
    times = [k / fps for k in range(round(until_s * fps) + 1)]
    return [(t, lock.step(LockFacts(**{"t_s": t, "locked": True, **GOOD, **script(t)}))) for t in times]


def between(start_s: float, end_s: float, **changes: Any) -> Script:
    return lambda t: changes if start_s < t < end_s else {}


def reasons(played: list[tuple[float, FalseLockReport]]) -> set[FalseLockReason]:
    return {report.reason for _, report in played if report.on}


def test_a_good_lock_raises_nothing() -> None:
    assert reasons(follow(lambda t: {}, 5.0)) == set()


PARTS = [
    (between(2.01, 4.01, exemplar=0.44, recent=0.4), UNLIKE, FC.unlike_s, FC.off_s),
    (between(2.01, 4.01, nis=16.0), WRONG, 0.5 + FC.hold_s, 0.5 + FC.off_s),
    (between(2.01, 4.01, ln_size=4.3, exemplar=0.55, recent=0.55), WANDERED, FC.hold_s, 0.0),
    (between(2.01, 4.01, ln_size=4.7, exemplar=None, recent=None), WANDERED, FC.hold_s, 0.0),
]


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize(("script", "reason", "on_s", "off_s"), PARTS)
def test_each_part_comes_in_its_time_at_every_rate(
    script: Script, reason: FalseLockReason, on_s: float, off_s: float, fps: float
) -> None:
    played = follow(script, 7.0, fps)
    assert reasons(played) == {reason}
    times = switches(played)
    assert times[0] == pytest.approx(2.01 + on_s, abs=1.01 / fps)
    if off_s:
        assert times[1] == pytest.approx(4.01 + off_s, abs=1.01 / fps)
    assert not played[-1][1].on


@pytest.mark.parametrize("fps", RATES)
def test_a_moving_target_that_stops_dead_and_looks_otherwise(fps: float) -> None:
    def script(look: float) -> Script:
        return lambda t: (
            {"speed_sizes_s": 3.0} if t < 2.01 else {"speed_sizes_s": 0.1, "exemplar": look, "recent": look}
        )

    played = follow(script(0.55), 4.0, fps)
    assert reasons(played) == {STOPPED}
    assert switches(played)[0] == pytest.approx(2.01 + FC.hold_s, abs=1.01 / fps)
    assert reasons(follow(script(0.62), 4.0, fps)) == set()  # it stopped, and is the same


@pytest.mark.parametrize(
    "changes",
    [
        {"exemplar": 0.4},  # it turned: like the recent one still
        {"exemplar": 0.47, "recent": 0.4},  # doubtful
        {"exemplar": None, "recent": None},
        {"exemplar": math.nan, "recent": 0.1},
        {"ln_size": 4.3},  # grew fast, and looks the same
        {"ln_size": None},
        {"ln_size": math.inf},
        {"nis": 12.0},
        {"nis": None},
        {"nis": math.nan},
        {"speed_sizes_s": 0.0},
        {"speed_sizes_s": None},
        {"speed_sizes_s": math.nan},
        {"exemplar": None, "recent": None, "ln_size": None, "nis": None, "speed_sizes_s": None},
    ],
)
def test_what_is_no_proof_raises_nothing(changes: dict[str, Any]) -> None:
    assert reasons(follow(between(2.01, 9.0, **changes), 5.0)) == set()


def test_a_target_that_never_looked_like_itself_is_not_judged_by_its_looks() -> None:
    def script(first: float) -> Script:
        return lambda t: {"exemplar": first if t < 1.51 else 0.01, "recent": 0.0}

    assert reasons(follow(script(0.2), 5.0)) == set()
    assert reasons(follow(script(0.3), 5.0)) == {UNLIKE}


def test_slow_growth_and_short_doubt_raise_nothing() -> None:
    assert reasons(follow(lambda t: {"ln_size": 3.5 + 0.5 * t, "exemplar": 0.55, "recent": 0.55}, 5.0)) == set()
    assert reasons(follow(between(2.01, 2.6, exemplar=0.3, recent=0.3), 5.0)) == set()
    assert reasons(follow(between(2.01, 2.4, nis=18.0), 5.0)) == set()


def test_after_the_end_of_a_lock_its_evidence_is_gone_and_the_reference_stays() -> None:
    unlike = {"exemplar": 0.4, "recent": 0.4}
    alarm = FalseLock()
    for k in range(101):
        report = alarm.step(LockFacts(k / 30, True, **(GOOD | (unlike if k > 60 else {}))))
    assert report.on
    alarm.relock()
    assert not alarm.step(LockFacts(101 / 30, True, **(GOOD | unlike))).on
    assert alarm.reference == pytest.approx(0.9)
    for k in range(102, 112):
        report = alarm.step(LockFacts(k / 30, True, **(GOOD | unlike)))
    assert report.on, "the same unlike thing, found again, is given less time"


def test_a_clock_that_stands_still_does_not_fill_the_memory() -> None:
    alarm = FalseLock()
    for _ in range(2 * MAX_KEPT):
        alarm.step(LockFacts(1.0, True, **GOOD))
    assert [len(part._kept) for part in (alarm._sizes, alarm._nis, alarm._speeds)] == [MAX_KEPT] * 3


@pytest.mark.parametrize("fps", [*RATES, 5.0])
def test_the_reference_is_the_median_of_the_first_locked_second(fps: float) -> None:
    lock = FalseLock()
    ready = None
    for k in range(round(3.0 * fps) + 1):
        t_s = k / fps
        locked = not 0.41 < t_s < 0.81
        lock.step(LockFacts(t_s, locked, exemplar=0.2 if k == 1 else 0.8 if t_s < 2.0 else 0.1))
        if ready is None and lock.reference is not None:
            ready = t_s
    assert lock.reference == pytest.approx(0.8)
    assert ready == pytest.approx(1.4, abs=2.01 / fps)
    lock.reset()
    assert lock.reference is None


def test_before_the_reference_is_known_looks_prove_nothing() -> None:
    assert reasons(follow(lambda t: {"exemplar": 0.9 if t < 0.2 else 0.1, "recent": 0.1}, 0.95)) == set()


def test_an_unlike_thing_found_again_is_given_less_time() -> None:
    def script(t: float) -> dict[str, Any]:
        unlike = {"exemplar": 0.4, "recent": 0.4} if t > 2.01 else {}
        return {**unlike, "locked": not 3.01 < t < 4.01}

    played = follow(script, 6.0)
    times = switches(played)
    assert times[0] == pytest.approx(2.01 + FC.unlike_s, abs=0.04)
    assert times[2] == pytest.approx(4.01 + FC.hold_s, abs=0.04)
    off = next(t for t, report in played if t > 3.0 and not report.on)
    assert off == pytest.approx(3.01 + 0.5, abs=0.07)

    def target_again(t: float) -> dict[str, Any]:
        return {**script(t), **({"exemplar": 0.9} if 4.0 < t < 4.5 else {})}

    assert switches(follow(target_again, 6.0))[2] == pytest.approx(4.5 + FC.unlike_s, abs=0.04)


def test_the_true_target_found_again_is_not_suspected() -> None:
    def script(t: float) -> dict[str, Any]:
        return {**between(2.01, 3.01, exemplar=0.4, recent=0.4)(t), "locked": not 3.01 < t < 4.01}

    assert not any(report.on for t, report in follow(script, 6.0) if t > 3.6)


def test_what_a_lock_before_a_break_did_is_not_held_against_the_next() -> None:
    def script(t: float) -> dict[str, Any]:
        return {"locked": not 2.01 < t < 2.81, "ln_size": 3.5 if t < 2.5 else 5.0, "exemplar": 0.55, "recent": 0.5}

    assert reasons(follow(lambda t: {**script(t), **({"exemplar": 0.9} if t < 1.2 else {})}, 5.0)) == set()


def test_while_not_locked_no_evidence_counts() -> None:
    played = follow(lambda t: {"locked": False, "nis": 99.0, "exemplar": 0.0, "recent": 0.0}, 3.0)
    assert {report.reason for _, report in played} == {FalseLockReason.NOT_LOCKED}
    assert not any(report.on for _, report in played)


@pytest.mark.parametrize("bad", [*BAD, 0.1])
def test_a_time_that_is_no_time_holds_the_false_lock_alarm(bad: float) -> None:
    lock = FalseLock()
    for k in range(100):
        unlike = {} if k < 60 else {"exemplar": 0.4, "recent": 0.4}
        lock.step(LockFacts(k / 30, True, **{**GOOD, **unlike}))
    assert lock.step(LockFacts(bad, True, **GOOD)) == FalseLockReport(True, FalseLockReason.NO_TIME)


@pytest.mark.parametrize("fps", RATES)
def test_evidence_that_is_no_longer_measured_holds_for_half_a_second(fps: float) -> None:
    def script(t: float) -> dict[str, Any]:
        return {} if t < 2.01 else {"exemplar": 0.4 if t < 4.01 else None, "recent": None}

    came, went = switches(follow(script, 6.0, fps))
    assert came == pytest.approx(2.01 + FC.unlike_s, abs=1.01 / fps)
    assert went == pytest.approx(4.01 + 0.5, abs=1.01 / fps)


def test_a_second_step_of_the_same_time_is_a_step() -> None:
    alarms = Alarms()
    for _ in range(2):
        rival, false_lock = alarms.step(AlarmFacts((TARGET,), TARGET, LockFacts(1.0, True, **GOOD)))
        assert (rival.reason, false_lock.reason) == (DistractorReason.NONE_ALIKE, FalseLockReason.NONE)


def test_both_alarms_under_one_roof() -> None:
    alarms = Alarms()
    facts = [AlarmFacts((TARGET, RIVAL), TARGET, LockFacts(k / 30, True, **GOOD)) for k in range(60)]
    unlike = {"exemplar": 0.4, "recent": 0.4}
    facts += [AlarmFacts((TARGET, RIVAL), TARGET, LockFacts(k / 30, True, **{**GOOD, **unlike})) for k in range(60, 90)]
    said = [active(*alarms.step(f)) for f in facts]
    assert said[0] == ()
    assert said[30] == (TargetAlarm.DISTRACTOR,)
    assert said[-1] == (TargetAlarm.DISTRACTOR, TargetAlarm.FALSE_LOCK)
    alarms.shift(5.0, 0.0)
    rival = alarms.step(AlarmFacts((TARGET,), TARGET, LockFacts(3.0, True, **GOOD)))[0].rival
    assert rival is not None
    assert rival.cx_px == RIVAL.box.cx_px + 5.0
    alarms.reset()
    assert active(*alarms.step(AlarmFacts((TARGET,), TARGET, LockFacts(0.0, True, **GOOD)))) == ()


anything = st.floats(allow_nan=True, allow_infinity=True)
maybe = st.none() | anything


@given(st.lists(st.tuples(*[anything] * 7, *[maybe] * 5, st.booleans()), min_size=1, max_size=8))
@settings(max_examples=100, deadline=None)
def test_nothing_raises(steps: list[tuple[Any, ...]]) -> None:
    alarms = Alarms()
    for a in steps:
        other = Candidate(Box(*a[1:5]), a[5], a[5], a[5], Evidence((), a[5], a[5], a[7], a[8], a[5], a[5]))
        facts = LockFacts(a[0], a[12], *a[7:12])
        alarms.step(AlarmFacts((TARGET, other), other, facts))
        rival, _ = alarms.step(AlarmFacts((TARGET, other), TARGET, facts))
        alarms.shift(a[5], a[6])
        assert rival.rival is None or rival.rival.is_valid


dips = st.lists(st.tuples(st.floats(0.1, 3.0), st.floats(0.0, 1.0)), min_size=1, max_size=5)


@given(dips)
@settings(max_examples=25, deadline=None)
def test_every_history_of_looks_gives_the_same_alarms_at_every_rate(script: list[tuple[float, float]]) -> None:
    def look(t: float) -> dict[str, Any]:
        at_s = 1.51
        for span_s, value in script:
            span_s = 0.4 * round(span_s / 0.4) + 0.4  # well apart from the limits, which rates may split by a period
            if at_s <= t < at_s + span_s:
                return {"exemplar": value, "recent": value}
            at_s += span_s
        return {}

    came = [switches(follow(look, 12.0, fps)) for fps in RATES]
    assert len({len(times) for times in came}) == 1
    for times in zip(*came, strict=True):
        assert max(times) - min(times) <= 0.1 + 1e-6


@pytest.mark.parametrize("value", [-1.0, math.nan, 1e9])
def test_configs_name_what_is_out_of_range(value: float) -> None:
    for name in ("apart_sizes", "stay_share", "on_s"):
        with pytest.raises(ValueError, match=f"distractor alarm {name}"):
            DistractorConfig(**{name: value})
    for name in ("unlike_share", "doubt_share", "nis_share", "still_sizes_s"):
        with pytest.raises(ValueError, match=f"false lock alarm {name}"):
            FalseLockConfig(**{name: value})
