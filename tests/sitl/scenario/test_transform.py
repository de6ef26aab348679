from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.scenario import transform
from sitl.scenario.build import world_spec
from sitl.scenario.check import check_scenario, first_view
from sitl.scenario.load import from_mapping, load_scenario
from tests.sitl.scenario.samples import right, spoiled
from tests.sitl.scenario.test_schema import every_section

SMALL = from_mapping(right(), "file")


def test_mirrored_turns_east_and_every_side() -> None:
    data = right()
    data["vehicle"] = {"start_east_m": 1, "start_yaw_deg": 10}
    data["gimbal"] = {"misalignment_yaw_deg": 2, "misalignment_roll_deg": 1, "misalignment_pitch_deg": 0.5}
    image = transform.mirrored(from_mapping(data, "file"))
    assert image.mirrored
    assert image.target.path.points_ne_m == ((20, -1), (60, -1), (60, -50))
    assert image.distractors[0].path.yaw_deg == -30
    assert image.world.buildings[0].east_m == -20
    assert image.world.buildings[0].yaw_deg == -20
    assert image.world.buildings[0].north_m == 30
    assert image.wind.from_deg == -90
    assert (image.vehicle.start_east_m, image.vehicle.start_yaw_deg) == (-1, -10)
    gimbal = image.gimbal
    assert (gimbal.misalignment_yaw_deg, gimbal.misalignment_roll_deg, gimbal.misalignment_pitch_deg) == (-2, -1, 0.5)
    assert image.target.colour_rgb == (180, 20, 20)  # type: ignore[union-attr]


@pytest.mark.parametrize("name", ["small", "default"])
def test_a_mirror_image_of_a_mirror_image_is_the_original(name: str) -> None:
    scenario = SMALL if name == "small" else load_scenario(name)
    image = transform.mirrored(scenario)
    check_scenario(image, "image")
    assert image != scenario
    assert transform.mirrored(image) == scenario
    assert world_spec(transform.mirrored(image), 3) == world_spec(scenario, 3)
    assert world_spec(image, 3).cars[0].path.speed_m_s == world_spec(scenario, 3).cars[0].path.speed_m_s


@given(st.floats(-20, 20), st.floats(5, 60))
def test_the_mirrored_camera_sees_the_mirror_image(east: float, north: float) -> None:
    ours = first_view(SMALL, (north, east, -1.0))
    theirs = first_view(transform.mirrored(SMALL), (north, -east, -1.0))
    if ours is None or theirs is None:
        assert ours is theirs
        return
    assert theirs[0] == pytest.approx(1 - ours[0])
    assert theirs[1] == pytest.approx(ours[1])


def test_scaled_multiplies_places_sizes_and_speeds() -> None:
    twice = transform.scaled(SMALL, 2)
    assert twice.target.path.points_ne_m == ((40, 2), (120, 2), (120, 100))
    assert twice.target.path.speed_m_s == 6
    assert twice.target.path.start_s == 3
    assert twice.target.scale == 2  # type: ignore[union-attr]
    assert twice.distractors[1].height_m == 3.5  # type: ignore[union-attr]
    assert twice.vehicle.takeoff_height_m == 24
    assert twice.guidance.standoff_m == 40
    assert twice.occluders.bridges[0].clearance_m == pytest.approx(9.2)
    assert twice.world.trees[0].crown_m == 9
    assert twice.vehicle.max_tilt_deg == SMALL.vehicle.max_tilt_deg
    assert twice.camera == SMALL.camera
    assert transform.scaled(twice, 0.5) == SMALL


@given(st.sampled_from([0.5, 2.0, 3.0]), st.floats(5, 60), st.floats(-10, 10), st.floats(0, 3))
def test_the_scaled_world_gives_the_same_pictures(factor: float, north: float, east: float, height: float) -> None:
    ours = first_view(SMALL, (north, east, -height))
    theirs = first_view(transform.scaled(SMALL, factor), (factor * north, factor * east, -factor * height))
    assert ours is not None
    assert theirs == pytest.approx(ours)


def test_scaled_beyond_a_range_is_refused() -> None:
    with pytest.raises(ValueError, match="takeoff_height_m"):
        transform.scaled(from_mapping(spoiled("vehicle.takeoff_height_m", 12), "file"), 100)


def test_every_key_with_a_side_or_a_length_is_known() -> None:
    """A new key in metres or degrees must be given its place in the transforms, or here."""
    neither = {
        # what vehicle, gimbal and camera can do, and angles that have no side
        "hfov_deg", "start_pitch_deg", "misalignment_pitch_deg", "max_tilt_deg", "stiction_deg",
        "mean_m_s", "gust_sigma_m_s", "max_horizontal_m_s", "max_up_m_s", "max_down_m_s",
    }  # fmt: skip
    known = transform._EAST_KEYS | transform._SIDE_KEYS | transform._POINT_KEYS | transform._WORLD_LENGTHS | neither
    for section in every_section():
        for name in section.model_fields:
            if name.endswith(("_m", "_deg", "_m_s", "_ne_m")):
                assert name in known, f"{section.__name__}.{name}"
