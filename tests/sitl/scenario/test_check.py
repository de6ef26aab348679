from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.scenario.build import camera_model, start_pose
from sitl.scenario.check import check_scenario, first_view
from sitl.scenario.errors import ScenarioError
from sitl.scenario.load import from_mapping
from sitl.scenario.schema import Scenario
from tests.sitl.scenario.samples import right, spoiled

HOUSE = {"north_m": 40, "east_m": 0, "length_m": 10, "width_m": 10, "height_m": 6}


def problem(path: str, value: object) -> str:
    with pytest.raises(ScenarioError) as caught:
        from_mapping(spoiled(path, value), "file")
    return caught.value.problems[0]


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("distractors.0.name", "target", "distractors[0].name: 'target' is the name of target too"),
        ("distractors.1.name", "twin", "distractors[1].name: 'twin' is the name of distractors[0] too"),
        ("world.buildings.0", HOUSE, "world: 'target': passes through building 0 at north 40 m, east 0 m"),
        ("world.buildings.0", {**HOUSE, "north_m": 20}, "world: 'target': starts in building 0 at north 20 m"),
        ("occluders.buildings", [{**HOUSE, "yaw_deg": 45}], "world: 'target': passes through building 1"),
        ("world.trees.0", {"north_m": 20, "east_m": 1}, "world: 'target': starts in the trunk of tree 0"),
        ("occluders.trees", [{"north_m": 60, "east_m": 30}], "world: 'target': passes through the trunk of tree 1"),
        ("distractors.1.path.points_ne_m", [[30, 20]], "world: 'walker': starts in building 0"),
        ("occluders.bridges.0.length_m", 2, "world: 'target': passes through a pillar of bridge 0"),
        ("occluders.bridges.0.clearance_m", 1.2, "world: 'target': passes through bridge 0"),
        ("world.buildings.0", {**HOUSE, "north_m": -3, "height_m": 15}, "vehicle: the start at 12 m is inside"),
        ("vehicle.start_yaw_deg", 180, "target.path.points_ne_m[0]: not in the first picture (behind the camera)"),
        ("vehicle.start_yaw_deg", 50, "not in the first picture (at -"),
        ("gimbal.start_pitch_deg", 20, "not in the first picture"),
        ("target.path.speed_m_s", 0, "target.path.speed_m_s: 0 with several points"),
        ("target.path.start_s", 25, "target.path.start_s: 25 is not before the end (duration_s: 20)"),
        ("events.1.at_s", 20, "events[1].at_s: 20 is not before the end (duration_s: 20)"),
        ("events.0.at_s", 19.5, "duration_s: 20 is too short for the click at 19.5 s; give at least 20.5"),
        ("criteria.0.metric", "lock_shar", "criteria[0].metric: 'lock_shar' is no metric; did you mean lock_share?"),
        ("criteria.0.metric", "q", "is no metric; known are final_locked_on_target"),
        ("criteria.0.metric", "realtime_factor", "it cannot be a criterion"),
        ("criteria.0", {"metric": "iou_mean"}, "criteria[0]: neither min nor max"),
        ("criteria.0", {"metric": "iou_mean", "min": 2, "max": 1}, "criteria[0]: min 2 is above max 1"),
    ],
)
def test_what_makes_no_sense_is_refused(path: str, value: object, expected: str) -> None:
    assert expected in problem(path, value)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("world.trees.0", {"north_m": 20, "east_m": 3, "crown_m": 6}),  # a crown over the road is no trunk in the way
        ("world.buildings.0", {**HOUSE, "east_m": 8}),
        ("world.buildings.0", {**HOUSE, "north_m": 0, "east_m": 0}),  # a start above a low roof
        ("vehicle.start_yaw_deg", 20),
        ("events", []),
    ],
)
def test_what_is_possible_is_not(path: str, value: object) -> None:
    from_mapping(spoiled(path, value), "file")


def test_check_can_be_called_again_on_a_loaded_scenario() -> None:
    check_scenario(from_mapping(right(), "file"), "file")


@given(st.floats(-40, 40), st.floats(-80, 30), st.floats(5, 60), st.floats(-20, 20))
def test_the_first_view_agrees_with_a_projection_by_matrices(
    yaw: float, pitch: float, north: float, east: float
) -> None:
    np = pytest.importorskip("numpy")
    scenario = Scenario.model_validate(
        {**right(), "vehicle": {"start_yaw_deg": yaw}, "gimbal": {"start_pitch_deg": pitch}}
    )
    pose, camera = start_pose(scenario), camera_model(scenario)
    cy, sy, cp, sp = np.cos(pose.yaw_rad), np.sin(pose.yaw_rad), np.cos(pose.pitch_rad), np.sin(pose.pitch_rad)
    ned_from_camera = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]) @ np.array(
        [[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]]
    )
    place = np.array([north, east, -1.0])
    x, y, z = ned_from_camera.T @ (place - np.array(pose.pos_ned_m))
    seen = first_view(scenario, (north, east, -1.0))
    if x <= 0.1:
        assert seen is None
        return
    focal = camera.width_px / 2 / np.tan(camera.hfov_rad / 2)
    assert seen is not None
    assert seen[0] * camera.width_px == pytest.approx(
        camera.width_px / 2 + focal * y / x, abs=1e-6 * (1 + abs(focal * y / x))
    )
    assert seen[1] * camera.height_px == pytest.approx(
        camera.height_px / 2 + focal * z / x, abs=1e-6 * (1 + abs(focal * z / x))
    )
