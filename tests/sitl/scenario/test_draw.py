"""What the seed draws, and encounters: judged by the geometry camera, which knows nothing of how they were reckoned."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import sitl.world.world as world_module
from sitl.render.geometry import GeometryCamera
from sitl.scenario import ScenarioError, build, drawn, load_scenario, mirrored
from sitl.scenario.encounter import EncounterError
from sitl.scenario.load import from_mapping
from sitl.scenario.schema import Scenario
from sitl.scene import CameraPose, ObjectTruth
from tests.sitl.scenario.samples import right

SUITE = ("occlusion_short", "occlusion_long", "lookalike", "leaves", "returns")
HIDDEN_S = {"occlusion_short": 1.5, "occlusion_long": 5.0, "returns": 4.0}
STEP_S = 0.05
# Each seed is another encounter. All of the suite's were looked at; three in every test run keep watch.
SEEDS = [pytest.param(s, marks=() if s in (0, 7, 13) else pytest.mark.slow) for s in range(20)]


@pytest.fixture(autouse=True)
def bare_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody looks at the ground here, and painting it takes longer than everything else."""
    monkeypatch.setattr(world_module, "build_ground", lambda *_: None)


def watched(made: Scenario, seed: int, start_s: float = 0.5) -> list[tuple[float, dict[str, ObjectTruth]]]:
    """What a camera sees that hangs still over the start and is turned to the target."""
    world = world_module.World(build.world_spec(made, seed), 1)
    camera, v = GeometryCamera(world, build.camera_model(made)), made.vehicle
    eye = (v.start_north_m, v.start_east_m, -v.takeoff_height_m)
    seen = []
    for t_s in np.arange(start_s, made.duration_s, STEP_S).tolist():
        place = world.placements(t_s)["target"]
        north, east = place.north_m - eye[0], place.east_m - eye[1]
        pitch = -math.atan2(-0.75 - eye[2], math.hypot(north, east))
        seen.append((t_s, camera.observe(t_s, CameraPose(eye, 0.0, pitch, math.atan2(east, north)))))
    return seen


def hidden_times(seen: list[tuple[float, dict[str, ObjectTruth]]]) -> list[float]:
    return [t_s for t_s, truths in seen if truths["target"].visibility == 0.0]


@pytest.mark.parametrize("name", HIDDEN_S)
@pytest.mark.parametrize("seed", SEEDS)
def test_it_is_hidden_as_long_as_it_is_to_be_and_comes_back(name: str, seed: int) -> None:
    scenario = load_scenario_once(name)
    made = drawn(scenario, seed)
    seen = watched(made, seed, 3.0)
    times = hidden_times(seen)
    assert len(times) * STEP_S == pytest.approx(HIDDEN_S[name], rel=0.1)
    assert times[-1] - times[0] == pytest.approx((len(times) - 1) * STEP_S), "in one piece"
    assert times[0] == pytest.approx(scenario.encounters[0].at_s, abs=0.15)
    assert seen[0][1]["target"].visibility > 0.5
    last = [truths["target"].visibility for t_s, truths in seen if t_s > made.duration_s - 2.0]
    assert min(last) > 0.5, "two seconds in sight at the end, for it to be found again"


@pytest.mark.parametrize("seed", SEEDS)
def test_it_leaves_for_good(seed: int) -> None:
    scenario = load_scenario_once("leaves")
    seen = watched(drawn(scenario, seed), seed, 3.0)
    times = hidden_times(seen)
    assert times[0] == pytest.approx(scenario.encounters[0].at_s, abs=0.4), "eaves are not reckoned with"
    assert times[-1] == seen[-1][0]
    assert len(times) == round((times[-1] - times[0]) / STEP_S) + 1
    assert max(truths["coming-out"].visibility for t_s, truths in seen if t_s > times[0]) > 0.9


@pytest.mark.parametrize("seed", SEEDS)
def test_look_alikes_pass_before_and_behind_it(seed: int) -> None:
    scenario = load_scenario_once("lookalike")
    made = drawn(scenario, seed)
    assert build.look_alikes(made) == {"look-alike", "oncoming"}
    seen = watched(made, seed)
    assert hidden_times(seen) == []
    for name, encounter in zip(("look-alike", "oncoming"), scenario.encounters, strict=True):
        _, truths = min(seen, key=lambda item: abs(item[0] - encounter.at_s))
        mine, its = truths["target"].amodal, truths[name].amodal
        assert mine is not None
        assert its is not None
        assert mine.iou(its) > 0.15, "the boxes overlap"
        assert abs(mine.cx_px - its.cx_px) < 0.2 * mine.w_px
        nearer = truths[name].range_m < truths["target"].range_m
        assert nearer == (name == "look-alike")
    assert 0.3 < min(truths["target"].visibility for _, truths in seen) < 0.95, "partly covered"


_LOADED: dict[str, Scenario] = {}


def load_scenario_once(name: str) -> Scenario:
    if name not in _LOADED:
        _LOADED[name] = load_scenario(name)
    return _LOADED[name]


def test_the_seed_draws_colours_places_ways_and_sides() -> None:
    made = [drawn(load_scenario_once("returns"), seed) for seed in range(6)]
    again = drawn(load_scenario_once("returns"), 3)
    assert again == made[3]
    assert all(m.variety is None and m.encounters == () for m in made)
    assert drawn(made[0], 7) is made[0], "settled once and for all"
    assert len({m.target.colour_rgb for m in made}) > 2
    assert len({m.vehicle.start_north_m for m in made}) == 6
    assert len({m.world.buildings[0].north_m for m in made}) == 6
    assert {len(m.target.path.points_ne_m) for m in made} == {2, 4}
    assert {m.vehicle.start_east_m > 0 for m in made} == {True, False}
    assert all(8.0 <= m.vehicle.takeoff_height_m <= 10.5 for m in made)
    assert {m.occluders.buildings[0].north_m for m in made} == {0.0}, "what hides it stays where it is"
    assert not any(m.mirrored for m in made), "the other side is another place, not mirrored chance"


def test_what_is_not_listed_stays_as_it_is_for_seed_0() -> None:
    data = load_scenario_once("leaves").model_dump(mode="json", by_alias=True)
    still = from_mapping({**data, "seed_policy": ["colour"]}, "file")
    a, b = drawn(still, 0), drawn(still, 4)
    assert a.vehicle == b.vehicle
    assert a.world == b.world
    assert a.target.path == b.target.path
    assert a.target.colour_rgb != b.target.colour_rgb
    assert drawn(load_scenario_once("leaves"), 4).vehicle != b.vehicle


@pytest.mark.parametrize("seed", [0, 2])
def test_the_mirrored_scenario_draws_the_mirror_image(seed: int) -> None:
    scenario = load_scenario_once("occlusion_short")
    assert drawn(mirrored(scenario), seed) == mirrored(drawn(scenario, seed))
    assert mirrored(mirrored(scenario)) == scenario


def test_the_camera_is_pointed_at_the_target_when_it_is_clicked() -> None:
    for seed in range(4):
        made = drawn(load_scenario_once("occlusion_long"), seed)
        world = world_module.World(build.world_spec(made, seed), 1)
        pose = build.start_pose(made)
        truth = GeometryCamera(world, build.camera_model(made)).observe(0.5, pose)["target"]
        assert truth.centre_px == pytest.approx((320, 240), abs=8)


def test_a_scenario_without_variety_is_left_alone() -> None:
    default = load_scenario("default")
    assert drawn(default, 5) is default
    # Seeds that are listed but have nothing to draw from change nothing either.
    plain = from_mapping(right(), "file")
    assert drawn(plain, 5) is plain


def meeting(**changes: Any) -> dict[str, Any]:
    data = right()
    data["distractors"][0]["path"] = {"points_ne_m": [[10, -20], [10, 40]], "speed_m_s": 4}
    data["world"]["buildings"] = []
    data["occluders"] = {}
    data["encounters"] = [{"mover": "twin", "at_s": 6, **changes}]
    return data


def test_in_line_sets_the_start_and_keeps_the_speed() -> None:
    made = drawn(from_mapping(meeting(), "file"), 0)
    path = made.distractors[0].path
    assert path.speed_m_s == 4
    places = world_module.World(build.world_spec(made, 0), 1).placements(6.0)
    a, b = places["target"], places["twin"]
    assert math.atan2(b.east_m, b.north_m) == pytest.approx(math.atan2(a.east_m, a.north_m), abs=1e-3)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"mover": "twinn"}, "encounters[0].mover: 'twinn' is no target or distractor; did you mean twin?"),
        ({"mover": "walker"}, "encounters[0].mover: 'walker' stands; give its path another point and a speed"),
        ({"hidden_s": 3}, "encounters: twin: it hides target for 0.0 s at most, 3 s are wanted; make its way or what"),
        ({"mover": "target"}, "encounters: target: nothing hides it whole on its way"),
        ({"mover": "target", "hidden_s": 2}, "encounters: target: nothing hides it whole on its way"),
    ],
)
def test_an_encounter_that_cannot_be_is_refused_by_name(changes: dict[str, Any], expected: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        from_mapping(meeting(**changes), "file")
    assert len(caught.value.problems) == 1
    assert caught.value.problems[0].startswith(expected)


def test_a_way_that_does_not_cross_the_line_of_sight_is_refused() -> None:
    data = meeting()
    data["distractors"][0]["path"]["points_ne_m"] = [[10, -20], [10, -5]]
    with pytest.raises(ScenarioError, match="twin: its way does not cross the line of sight to target at 6 s"):
        from_mapping(data, "file")
    data["distractors"][1]["path"] = {"points_ne_m": [[10, -20], [10, 20]], "speed_m_s": 1}
    walking = Scenario.model_validate({**data, "encounters": [{"mover": "walker", "at_s": 6}]})
    with pytest.raises(EncounterError, match="walker: is no car"):
        drawn(walking, 0)


def test_names_in_variety_are_checked() -> None:
    data = right()
    data["variety"] = {
        "paints": [{"movers": ["target", "tvin"], "colours_rgb": [[1, 2, 3]]}],
        "ways": [{"mover": "nobody", "points_ne_m": [[1, 2]]}],
    }
    with pytest.raises(ScenarioError) as caught:
        from_mapping(data, "file")
    assert caught.value.problems[0].startswith("variety.ways[0].mover: 'nobody' is no target or distractor")
    assert "variety.paints[0].movers: 'tvin' is no target or distractor; did you mean twin?" in caught.value.problems
