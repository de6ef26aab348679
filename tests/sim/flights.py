"""Short flights of the default scenario for tests."""

from __future__ import annotations

from typing import Any

from sitl.scenario import Scenario, load_scenario
from sitl.scenario.events import ClickEvent, FollowEvent, ModeEvent, PictureEvent, StopEvent
from uavfollow.sim.session import SimOptions, SimResult, run_sim

EVENTS = {"click": ClickEvent, "follow": FollowEvent, "stop": StopEvent, "mode": ModeEvent, "black": PictureEvent,
          "freeze": PictureEvent}  # fmt: skip
CLICK = {"kind": "click", "at_s": 0.5}
FOLLOW = {"kind": "follow", "at_s": 2.0}


def event(values: dict[str, Any]) -> Any:
    return EVENTS[values["kind"]](**values)


def scenario(*more: dict[str, Any], base: str = "default", **changes: Any) -> Scenario:
    """The default scenario with events after the click and the start of following, and other changes."""
    events = tuple(event(e) for e in (CLICK, FOLLOW, *more))
    return load_scenario(base).model_copy(update={"events": events, **changes})


def fly(flown: Scenario, seed: int = 0, **options: Any) -> SimResult:
    """Without files, by the geometry camera unless a model is given."""
    values = {
        "seed": seed, "model": None, "precision": "fp32", "device": "cpu", "threads": 1, "out": None, "video": False,
        "realtime": False,
    }  # fmt: skip
    return run_sim(flown, SimOptions(**(values | options)))


def wire(result: SimResult) -> list[tuple]:
    """Everything the application sent that moves something, as it was on the wire, from the scenario's time 0."""
    begin = result.log.begin_s
    setpoints = [(round(s.t_s - begin, 6), "v", *s.v_ned_m_s, s.yaw_rate_rad_s) for s in result.log.setpoints]
    gimbal = [(round(g.t_s - begin, 6), "g", *g.q_wxyz) for g in result.log.gimbal]
    return setpoints + gimbal


def statuses(result: SimResult, start_s: float, end_s: float = 1e9) -> list[str]:
    """Status of each step exposed in a span of the scenario's time."""
    begin = result.log.begin_s
    return [s.sample.status for s in result.log.steps if start_s <= s.sample.t_s - begin < end_s]
