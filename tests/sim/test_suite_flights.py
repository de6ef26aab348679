"""The suite's scenarios flown by the geometry camera, one seed each: the encounter happens and the loop meets it."""

from __future__ import annotations

import pytest

from sitl.metrics import Verdict
from sitl.scenario import load_scenario
from tests.sim.flights import fly
from uavfollow.sim.session import SimResult
from uavfollow.sim.suite_aims import BY_NAME

HIDDEN_S = {"occlusion_short": 1.5, "occlusion_long": 5.0, "returns": 4.0}


@pytest.fixture(scope="module", params=sorted(BY_NAME))
def flight(request: pytest.FixtureRequest) -> SimResult:
    return fly(load_scenario(request.param), 0)


def test_the_encounter_and_the_aim(flight: SimResult) -> None:
    name, metrics = flight.scenario.name, flight.metrics
    assert [h.answer for h in flight.log.happenings] == ["selected"]
    if name in HIDDEN_S:
        # How long exactly is tested without a tracker (tests/sitl/scenario/test_draw.py).
        assert metrics["hidden_longest_s"] is not None
        assert metrics["hidden_longest_s"] >= 0.9 * HIDDEN_S[name]
    elif name == "leaves":
        assert metrics["visible_again_s"] is None
        assert metrics["hidden_longest_s"] is not None
        assert metrics["hidden_longest_s"] > 4.5
    else:
        assert metrics["hidden_longest_s"] is None
    assert metrics["lock_share"] is not None
    assert metrics["lock_share"] > 0.4, "what is never held is never lost"
    assert metrics["false_confirmed_share"] is not None
    assert metrics["false_confirmed_share"] <= 0.05
    judged = {c.criterion.metric: c for c in flight.criteria}
    aim = judged[BY_NAME[name].metric]
    assert aim.verdict is Verdict.PASSED, aim.reason


def test_the_vehicle_hovers_and_nothing_is_sent_to_it(flight: SimResult) -> None:
    samples = [s.sample for s in flight.log.steps]
    start = samples[0].vehicle_pos_ned_m
    assert max(abs(a - b) for s in samples for a, b in zip(s.vehicle_pos_ned_m, start, strict=True)) < 0.6
    assert flight.log.setpoints == []
