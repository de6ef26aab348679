"""Scripted candidates and a simulated clock for the target tracker: a script gives what is found at a time."""

import copy
import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

from tracker.box import Box
from tracker.messages import Candidate, Evidence, TargetReason, TargetState, TargetStatus
from tracker.target import TargetTracker

BOX = Box(300.0, 200.0, 30.0, 60.0)
SIZE_PX = math.sqrt(30.0 * 60.0)
IMAGE = (640.0, 360.0)
RATES = (10.0, 20.0, 30.0)
BAD = (math.nan, math.inf, -math.inf)
EPS = 1e-5

Script = Callable[[float], Sequence[Candidate]]


def evidence(exemplar: float | None = 0.9, **changes: Any) -> Evidence:
    """Of a clear sighting, unless changed."""
    values: dict[str, Any] = {
        "heads": (0.9, 0.9, 0.9),
        "second": 0.3,
        "sharpness": 9.0,
        "exemplar": exemplar,
        "recent": exemplar,
        "ln_scale": 0.0,
        "ln_aspect": 0.0,
    }
    return Evidence(**(values | changes))


def seen(
    score: float = 0.8, dx: float = 0.0, dy: float = 0.0, *, zoom: float = 1.0, of: Evidence | None = None
) -> Candidate:
    """A candidate moved by (dx, dy) px from where the target was selected."""
    box = Box(BOX.cx_px + dx, BOX.cy_px + dy, BOX.w_px * zoom, BOX.h_px * zoom)
    return Candidate(box, score, score, score, of)


def step_all(script: Script, times: Sequence[float], tracker: TargetTracker) -> list[TargetState]:
    """Step the script at these times."""
    return [tracker.step(script(t), t, IMAGE) for t in times]


def play(script: Script, until_s: float, fps: float = 30.0, tracker: TargetTracker | None = None) -> list[TargetState]:
    """Start at 0 and step a script; the first state is that of the start."""
    tracker = tracker or TargetTracker()
    return [tracker.start(BOX, 0.0), *step_all(script, [k / fps for k in range(1, round(until_s * fps) + 1)], tracker)]


def locked(tracker: TargetTracker | None = None, velocity_px_s: float = 0.0, fps: float = 30.0) -> TargetTracker:
    """A tracker that has been locked until 1 s on a target that moves right."""
    tracker = tracker or TargetTracker()
    assert play(lambda t: [seen(dx=velocity_px_s * t)], 1.0, fps, tracker)[-1].status is TargetStatus.LOCKED
    return tracker


def until(t_s: float, before: Sequence[Candidate], after: Sequence[Candidate]) -> Script:
    """One answer up to a time, another after it."""
    return lambda t: before if t <= t_s + EPS else after


def changes(states: Sequence[TargetState]) -> list[tuple[float, TargetStatus]]:
    """Time and status at every change of the status."""
    return [(b.t_s, b.status) for a, b in pairwise(states) if a.status is not b.status]


def reasons(states: Sequence[TargetState]) -> set[TargetReason]:
    return {s.reason for s in states}


def told(state: TargetState) -> tuple[Any, ...]:
    """A state as a tuple that compares by value."""
    cov = None if state.cov is None else state.cov.tobytes()
    return (
        *(state.t_s, state.status, state.reason, state.box, state.vel_px_s, state.growth_per_s),
        *(cov, state.confidence, state.alarms, state.chosen, state.memory),
    )


def future(tracker: TargetTracker, from_s: float) -> list[tuple[Any, ...]]:
    """What a copy of the tracker would say of the next seconds: equal for two that know the same."""
    twin = copy.deepcopy(tracker)
    states = [twin.step([seen(0.9, 5.0)], from_s + k / 10, IMAGE) for k in range(1, 4)]
    states += [twin.step([seen(0.9, 8 * SIZE_PX)], from_s + 0.3 + k / 10, IMAGE) for k in range(1, 4)]
    states += [twin.step([], from_s + 0.6 + k / 2, IMAGE) for k in range(1, 6)]
    return [told(s) for s in states]
