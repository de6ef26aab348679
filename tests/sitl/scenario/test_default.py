"""The default scenario is a real test: hidden three times but never for long, and a look-alike comes close."""

from __future__ import annotations

import pytest

from sitl.scenario import load_scenario
from sitl.scenario.build import look_alikes
from tests.sitl.scenario.follower import Moment, fly, hidden_times, meeting

DEFAULT = load_scenario("default")


@pytest.fixture(scope="module", params=[(0, False), (1, True)], ids=["range-known", "range-by-size"])
def moments(request: pytest.FixtureRequest) -> list[Moment]:
    seed, by_size = request.param
    return fly(DEFAULT, seed, by_size)


def test_the_bridge_and_the_trees_hide_it_for_about_a_second(moments: list[Moment]) -> None:
    hidden = hidden_times(moments, "target")
    assert len(hidden) == 3
    bridge, tree, pair = (duration for _, duration in hidden)
    assert 0.5 <= bridge <= 1.4
    assert 0.4 <= tree <= 1.0
    assert 0.6 <= pair <= 1.4
    starts = [start for start, _ in hidden]
    assert starts[0] > 5.0  # there is time for the click, the lock and the start of following
    assert starts[1] - starts[0] > 4.0
    assert starts[2] + pair < DEFAULT.duration_s - 4.0


def test_it_is_in_full_sight_most_of_the_time_and_at_both_ends(moments: list[Moment]) -> None:
    seen = [m.truths["target"].visibility > 0.7 for m in moments]
    assert 0.7 < sum(seen) / len(seen) < 0.85
    assert all(seen[:100])
    assert all(seen[-60:])


def test_the_look_alike_comes_nearer_than_the_size_of_the_box_while_both_are_seen(moments: list[Moment]) -> None:
    assert look_alikes(DEFAULT) == {"look-alike"}
    t_s, distance_px, seen = meeting(moments, "target", "look-alike")
    at = min(moments, key=lambda m: abs(m.t_s - t_s)).truths["target"]
    assert at.amodal is not None
    assert distance_px < at.amodal.w_px
    assert seen > 0.5
    assert at.visibility > 0.7


def test_the_target_keeps_a_size_that_a_tracker_can_use(moments: list[Moment]) -> None:
    for m in moments:
        box = m.truths["target"].amodal
        assert box is not None
        assert min(box.w_px, box.h_px) >= 20
        assert m.truths["target"].truncation < 1e-9


def test_it_turns_right_by_a_quarter() -> None:
    (north0, _), (corner_north, corner_east), (north1, east1) = DEFAULT.target.path.points_ne_m
    assert corner_north > north0
    assert north1 == corner_north
    assert east1 > corner_east
