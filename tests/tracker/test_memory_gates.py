"""Gates of the memory on scripted facts: what is written when, and why not."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker.box import Box
from tracker.memory_gates import (
    MAX_KEPT,
    MemoryDecision,
    MemoryFacts,
    MemoryGates,
    MemoryGatesConfig,
    MemoryReason,
)
from tracker.messages import MemorySlot, TargetAlarm

BOX = Box(300.0, 200.0, 30.0, 60.0)
IMAGE = (640.0, 360.0)
CONFIG = MemoryGatesConfig()
RATES = (10.0, 20.0, 30.0)
RECENT, ANCHOR = MemorySlot.RECENT, MemorySlot.ANCHOR
DISTRACTOR, FALSE_LOCK = (TargetAlarm.DISTRACTOR,), (TargetAlarm.FALSE_LOCK,)

Change = Callable[[float], dict[str, Any]]


def sure(t_s: float, box: Box = BOX, **changes: Any) -> MemoryFacts:
    ln_size = math.log(math.sqrt(box.w_px * box.h_px)) if box.is_valid else 0.0
    return replace(MemoryFacts(t_s, True, 0.95, False, 0.9, box, IMAGE, ln_size), **changes)


def larger(factor: float) -> dict[str, Any]:
    """A box of so many times the area, with its ln(size)."""
    box = Box(BOX.cx_px, BOX.cy_px, BOX.w_px * math.sqrt(factor), BOX.h_px * math.sqrt(factor))
    return {"box": box, "ln_size": math.log(math.sqrt(box.w_px * box.h_px))}


def play(change: Change, until_s: float, fps: float = 30.0) -> list[tuple[float, MemoryDecision]]:
    gates = MemoryGates()
    gates.reset(0.0)
    times = [k / fps for k in range(round(until_s * fps) + 1)]
    return [(t, gates.step(sure(**{"t_s": t, **change(t)}))) for t in times]


def writes(played: list[tuple[float, MemoryDecision]]) -> list[tuple[float, MemorySlot]]:
    return [(t, d.slot) for t, d in played if d.slot is not None]


def last(change: dict[str, Any]) -> MemoryDecision:
    """After three sure seconds, what comes of one step with a change."""
    return play(lambda t: change if t > 2.99 else {}, 3.0)[-1][1]


def nothing(t_s: float) -> dict[str, Any]:
    return {}


@pytest.mark.parametrize("fps", RATES)
def test_recent_is_written_every_half_second_once_the_lock_is_old_enough(fps: float) -> None:
    times = [t for t, slot in writes(play(nothing, 5.0, fps)) if slot is RECENT]
    assert times[0] == pytest.approx(CONFIG.young_s, abs=1.01 / fps)
    assert len(times) == 7
    assert all(b - a == pytest.approx(CONFIG.recent_s, abs=1e-6) for a, b in pairwise(times))


@pytest.mark.parametrize("fps", RATES)
def test_no_anchor_without_a_distractor_and_spaced_ones_with_it(fps: float) -> None:
    assert all(slot is RECENT for _, slot in writes(play(nothing, 5.0, fps)))
    near = writes(play(lambda t: {"alarms": DISTRACTOR, "ambiguous": True} if t > 2.55 else {}, 5.6, fps))
    anchors = [t for t, slot in near if slot is ANCHOR]
    assert anchors[0] == pytest.approx(2.55, abs=1.01 / fps)
    assert all(b - a >= CONFIG.anchor_s - 1e-6 for a, b in pairwise(anchors))
    assert len(anchors) == 4
    assert not [t for t, slot in near if slot is RECENT and t > 2.56]  # ambiguous


def test_a_distractor_counts_for_a_second() -> None:
    def seen_until(t_end: float) -> list[MemorySlot]:
        return [s for t, s in writes(play(lambda t: {"ambiguous": t <= t_end}, 2.05)) if s is ANCHOR]

    assert seen_until(1.2) == [ANCHOR]
    assert seen_until(0.9) == []


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"locked": False}, MemoryReason.NOT_LOCKED),
        ({"alarms": FALSE_LOCK}, MemoryReason.FALSE_LOCK),
        ({"confidence": 0.79}, MemoryReason.UNCERTAIN),
        ({"exemplar": 0.29}, MemoryReason.UNLIKE_EXEMPLAR),
        ({"exemplar": math.nan}, MemoryReason.UNLIKE_EXEMPLAR),
        ({"alike": False}, MemoryReason.UNLIKE_EXEMPLAR),  # of other colours
        ({"alike": False, "exemplar": None}, MemoryReason.UNLIKE_EXEMPLAR),
        ({"ambiguous": True, "confidence": 0.85}, MemoryReason.AMBIGUOUS),
        ({"box": Box(14.0, 200.0, 30.0, 60.0)}, MemoryReason.AT_EDGE),
        ({"box": Box(16.0, 200.0, 30.0, 60.0)}, MemoryReason.AT_EDGE),
        ({"box": Box(300.0, 330.0, 30.0, 60.0)}, MemoryReason.AT_EDGE),
        ({"box": Box(625.0, 200.0, 30.0, 60.0)}, MemoryReason.AT_EDGE),
        ({"box": Box(300.0, 29.0, 30.0, 60.0)}, MemoryReason.AT_EDGE),
        (larger(1.45), MemoryReason.SIZE_JUMP),
        (larger(1.0 / 1.45), MemoryReason.SIZE_JUMP),
        (larger(0.6), MemoryReason.OCCLUDED),
        ({"ln_size": math.nan}, MemoryReason.NOT_FINITE),
        ({"ln_size": 1e9}, MemoryReason.NOT_FINITE),
        ({"box": Box(math.nan, 1.0, 1.0, 1.0)}, MemoryReason.NOT_FINITE),
        ({"confidence": math.nan}, MemoryReason.NOT_FINITE),
        ({"image_size_px": (0.0, 360.0)}, MemoryReason.NOT_FINITE),
        ({"t_s": math.inf}, MemoryReason.NOT_FINITE),
        ({"t_s": 1.0}, MemoryReason.TIME_WENT_BACK),
    ],
)
def test_every_refusal_has_its_reason(change: dict[str, Any], reason: MemoryReason) -> None:
    assert last({}) == MemoryDecision(RECENT, MemoryReason.WRITE_RECENT)  # the same step without the change
    assert last(change) == MemoryDecision(None, reason)


def test_a_clock_that_stands_still_does_not_fill_the_memory() -> None:
    gates = MemoryGates()
    gates.reset(0.0)
    for _ in range(2 * MAX_KEPT):
        gates.step(sure(1.0))
    assert len(gates._sizes) == MAX_KEPT


def test_what_is_not_known_does_not_refuse() -> None:
    assert last({"exemplar": None}).slot is RECENT
    assert last({"exemplar": 0.31}).slot is RECENT
    assert last(larger(1.35)).slot is RECENT


def test_an_anchor_asks_for_more_than_a_recent() -> None:
    assert last({"alarms": DISTRACTOR}).slot is ANCHOR
    assert last({"alarms": DISTRACTOR, "confidence": 0.85}).slot is RECENT
    assert last({"alarms": DISTRACTOR, **larger(1.25)}).slot is RECENT
    assert last({"alarms": DISTRACTOR, **larger(1.15)}).slot is ANCHOR
    assert last({"alarms": DISTRACTOR + FALSE_LOCK}).reason is MemoryReason.FALSE_LOCK


@pytest.mark.parametrize("fps", RATES)
def test_nothing_is_written_in_the_first_seconds_of_a_reacquisition(fps: float) -> None:
    def gone(t: float) -> dict[str, Any]:
        return {"locked": not 3.01 < t < 4.01}

    after = [t for t, _ in writes(play(gone, 8.0, fps)) if t > 3.01]
    assert after[0] == pytest.approx(4.01 + CONFIG.young_s, abs=2.01 / fps)
    reasons = {d.reason for t, d in play(gone, 8.0, fps) if 4.2 < t < 5.9}
    assert reasons == {MemoryReason.SETTLING}


def test_a_short_break_settles_sooner_but_not_sooner_than_the_long_one_before() -> None:
    short = [t for t, _ in writes(play(lambda t: {"locked": not 3.01 < t < 3.2}, 5.0)) if t > 3.01]
    assert short[0] == pytest.approx(3.2 + CONFIG.settle_s, abs=0.07)
    both = writes(play(lambda t: {"locked": not (3.01 < t < 4.01 or 4.5 < t < 4.6)}, 8.0))
    assert min(t for t, _ in both if t > 3.01) == pytest.approx(4.01 + CONFIG.young_s, abs=0.07)


@pytest.mark.parametrize("fps", RATES)
def test_doubt_freezes_for_its_time_after_it_is_over(fps: float) -> None:
    def doubtful(t: float) -> dict[str, Any]:
        return {"confidence": 0.3 if 3.01 < t < 3.51 else 0.95}

    played = play(doubtful, 6.0, fps)
    after = [t for t, _ in writes(played) if t > 3.01]
    assert after[0] == pytest.approx(3.51 + CONFIG.freeze_s, abs=1.01 / fps)
    assert {d.reason for t, d in played if 3.6 < t < 4.4} == {MemoryReason.FROZEN}
    warned = play(lambda t: {"alarms": FALSE_LOCK if 3.01 < t < 3.51 else ()}, 6.0, fps)
    assert next(t for t, _ in writes(warned) if t > 3.01) == pytest.approx(3.51 + CONFIG.freeze_s, abs=1.01 / fps)


@pytest.mark.parametrize("fps", RATES)
def test_confidence_must_last(fps: float) -> None:
    played = play(lambda t: {"confidence": 0.7 if 3.01 < t < 3.51 else 0.95}, 6.0, fps)
    assert next(t for t, _ in writes(played) if t > 3.01) == pytest.approx(3.51 + CONFIG.steady_s, abs=1.01 / fps)


def test_slow_growth_is_no_jump_and_slow_shrinking_no_occlusion() -> None:
    for rate in (0.2, -0.2):
        slow = [t for t, _ in writes(play(lambda t, r=rate: larger(math.exp(2.0 * r * t)), 4.0))]  # type: ignore[misc]
        assert len(slow) == 5


def test_low_rates_have_a_history_too() -> None:
    assert writes(play(nothing, 5.0, 4.0))


def test_a_reset_begins_anew() -> None:
    gates = MemoryGates()
    for k in range(91):
        gates.step(sure(k / 30))
    gates.reset(3.1)
    assert gates.step(sure(3.2)).reason is MemoryReason.SETTLING
    gates.reset(math.nan)
    assert gates.step(sure(0.5)).reason is MemoryReason.SETTLING


anything = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(st.tuples(*[anything] * 10, st.booleans(), st.booleans()), min_size=1, max_size=6))
@settings(max_examples=100, deadline=None)
def test_nothing_raises_and_a_write_is_always_inside_the_picture(steps: list[tuple[Any, ...]]) -> None:
    gates = MemoryGates()
    for a in steps:
        gates.step(MemoryFacts(a[0], a[10], a[1], a[11], a[2], Box(*a[3:7]), (a[7], a[8]), a[9]))
    assert gates.step(sure(math.nan)).slot is None


flags = st.lists(st.tuples(st.booleans(), st.floats(0.0, 1.0), st.booleans()), min_size=1, max_size=200)


@given(flags)
@settings(max_examples=60, deadline=None)
def test_spacing_and_lock_hold_for_every_history(script: list[tuple[bool, float, bool]]) -> None:
    gates = MemoryGates()
    gates.reset(0.0)
    written: dict[MemorySlot, float] = {}
    locked_s = None
    for k in range(10 * len(script)):
        locked, confidence, ambiguous = script[k // 10]
        t_s = k / 30
        locked_s = None if not locked else t_s if locked_s is None else locked_s
        decision = gates.step(sure(t_s, locked=locked, confidence=confidence, ambiguous=ambiguous))
        if decision.slot is None:
            continue
        assert locked_s is not None
        assert t_s - locked_s >= CONFIG.settle_s - 1e-6
        assert confidence >= (CONFIG.anchor_confidence if decision.slot is ANCHOR else CONFIG.recent_confidence)
        spacing = CONFIG.anchor_s if decision.slot is ANCHOR else CONFIG.recent_s
        assert t_s - written.get(decision.slot, -math.inf) >= spacing - 1e-6
        written[decision.slot] = t_s


@pytest.mark.parametrize("name", ["recent_s", "anchor_confidence", "recent_area", "edge_sizes", "young_s", "freeze_s"])
@pytest.mark.parametrize("value", [-2.0, math.nan, 1e9])
def test_config_names_what_is_out_of_range(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"memory gates {name}"):
        MemoryGatesConfig(**{name: value})
