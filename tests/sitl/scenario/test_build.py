from __future__ import annotations

import math
from dataclasses import asdict

import pytest

from sitl.metrics import Criterion, Source
from sitl.scenario import build
from sitl.scenario.events import ClickEvent
from sitl.scenario.load import from_mapping
from sitl.scenario.schema import Vary
from sitl.scenario.seeds import SPEED_SHARE, seed_for, speed_factor
from sitl.scenario.transform import mirrored
from sitl.world.spec import CarBody
from tests.sitl.scenario.samples import right, spoiled
from tracker.box import Box

SMALL = from_mapping(right(), "file")
CLICK = ClickEvent(kind="click", at_s=0.5)


def test_world() -> None:
    world = build.world_spec(from_mapping(spoiled("seed_policy", []), "file"), 7)
    assert [car.name for car in world.cars] == ["target", "twin"]
    assert world.cars[0].body is CarBody.SEDAN
    assert world.cars[0].path.speed_m_s == 3.0
    assert world.cars[0].path.points == ((20.0, 1.0), (60.0, 1.0), (60.0, 50.0))
    assert world.cars[1].path.yaw_rad == pytest.approx(math.radians(30))
    assert [person.name for person in world.persons] == ["walker"]
    assert world.buildings[0].yaw_rad == pytest.approx(math.radians(20))
    assert world.bridges[0].yaw_rad == pytest.approx(math.pi / 2)
    assert len(world.trees) == 1


def test_look_alikes_are_of_the_same_kind_body_and_colour() -> None:
    assert build.look_alikes(SMALL) == {"twin"}
    assert build.look_alikes(from_mapping(spoiled("distractors.0.body", "van"), "file")) == frozenset()


def test_camera_and_start() -> None:
    camera, pose = build.camera_model(SMALL), build.start_pose(SMALL)
    assert camera.hfov_rad == pytest.approx(math.radians(66))
    assert build.focal_px(SMALL) == pytest.approx(320 / math.tan(math.radians(33)))
    assert pose.pos_ned_m == (0.0, 0.0, -12.0)
    assert pose.pitch_rad == pytest.approx(math.radians(-30))


def test_vehicle_and_gimbal_take_what_the_scenario_says() -> None:
    data = spoiled("vehicle.max_tilt_deg", 20)
    data["vehicle"]["delay_ms"] = 80
    data["gimbal"] = {"lag_ms": 70, "max_rate_deg_s": 60, "misalignment_roll_deg": 1.5}
    scenario = from_mapping(data, "file")
    vehicle, gimbal = build.quadrotor_params(scenario), build.gimbal_params(scenario)
    assert vehicle.max_tilt_rad == pytest.approx(math.radians(20))
    assert vehicle.delay_s == pytest.approx(0.08)
    assert gimbal.lag_s == pytest.approx(0.07)
    assert gimbal.max_rate_rad_s == pytest.approx(math.radians(60))
    assert gimbal.misalignment_roll_rad == pytest.approx(math.radians(1.5))


def test_defaults_of_vehicle_and_gimbal_are_those_of_the_plant() -> None:
    from sitl.plant.gimbal_params import GimbalParams
    from sitl.plant.quadrotor_params import QuadrotorParams

    assert asdict(build.quadrotor_params(SMALL)) == pytest.approx(asdict(QuadrotorParams()), rel=0.01)
    assert asdict(build.gimbal_params(SMALL)) == pytest.approx(asdict(GimbalParams()), rel=0.06)  # degrees are rounded


def test_wind_blows_from_where_it_is_said_to_come() -> None:
    calm = from_mapping(spoiled("wind", {"mean_m_s": 2, "from_deg": 90}), "file")
    north, east, down = build.wind(calm, 0).at(1.0)
    assert (north, east, down) == (pytest.approx(0, abs=1e-12), pytest.approx(-2), 0.0)


def test_wind_of_the_mirrored_scenario_is_the_mirror_image_with_its_gusts() -> None:
    ours, theirs = build.wind(SMALL, 3), build.wind(mirrored(SMALL), 3)
    for t_s in (0.0, 0.7, 5.31):
        (n0, e0, d0), (n1, e1, d1) = ours.at(t_s), theirs.at(t_s)
        assert (n1, e1, d1) == (pytest.approx(n0, abs=1e-12), pytest.approx(-e0, abs=1e-12), pytest.approx(d0))


def test_seeds_are_independent_streams_and_fixed_when_not_listed() -> None:
    drawn = {seed_for(SMALL, seed, what) for seed in range(20) for what in Vary}
    assert len(drawn) == 20 * len(Vary)
    calm = from_mapping(spoiled("seed_policy", ["texture"]), "file")
    assert seed_for(calm, 5, Vary.WIND) == seed_for(calm, 6, Vary.WIND) == seed_for(SMALL, 0, Vary.WIND)
    assert seed_for(calm, 5, Vary.TEXTURE) != seed_for(calm, 6, Vary.TEXTURE)
    with pytest.raises(ValueError, match="seed = -1"):
        seed_for(SMALL, -1, Vary.WIND)


def test_the_seed_changes_the_targets_speed_only_within_its_share() -> None:
    factors = [speed_factor(SMALL, seed) for seed in range(200)]
    assert 1 - SPEED_SHARE <= min(factors) < 1 - 0.8 * SPEED_SHARE
    assert 1 + 0.8 * SPEED_SHARE < max(factors) <= 1 + SPEED_SHARE
    assert speed_factor(from_mapping(spoiled("seed_policy", []), "file"), 5) == 1.0
    world = build.world_spec(SMALL, 5)
    assert world.cars[0].path.speed_m_s == pytest.approx(3 * factors[5])


def test_a_click_errs_by_its_share_of_the_size() -> None:
    truth = Box(300, 200, 40, 20)
    clicks = [build.clicked_box(SMALL, seed, CLICK, truth) for seed in range(400)]
    right = [(b.cx_px - truth.cx_px) / truth.w_px for b in clicks]
    below = [(b.cy_px - truth.cy_px) / truth.h_px for b in clicks]
    for errors in (right, below):
        assert sum(errors) / len(errors) == pytest.approx(0, abs=0.012)
        assert math.sqrt(sum(e * e for e in errors) / len(errors)) == pytest.approx(0.05, rel=0.2)
    assert clicks[3] == build.clicked_box(SMALL, 3, CLICK, truth)
    exact = ClickEvent(kind="click", at_s=0.5, error_sigma_share=0, size_sigma_share=0)
    assert build.clicked_box(SMALL, 3, exact, truth) == truth


def test_the_mirrored_click_errs_to_the_other_side() -> None:
    truth, image = Box(300, 200, 40, 20), Box(340, 200, 40, 20)
    ours, theirs = build.clicked_box(SMALL, 4, CLICK, truth), build.clicked_box(mirrored(SMALL), 4, CLICK, image)
    assert theirs.cx_px == pytest.approx(640 - ours.cx_px)
    assert (theirs.cy_px, theirs.w_px, theirs.h_px) == (ours.cy_px, ours.w_px, ours.h_px)


def test_criteria_and_what_is_wanted() -> None:
    data = spoiled("criteria", [{"metric": "iou_mean", "max": 0.9, "when": "geometry"}])
    data["guidance"] = {"standoff_m": 12, "limits": {"max_horizontal_m_s": 3, "max_yaw_rate_deg_s": 20}}
    scenario = from_mapping(data, "file")
    assert build.criteria(scenario) == (Criterion("iou_mean", None, 0.9, Source.GEOMETRY),)
    wanted = build.wanted(scenario)
    assert wanted.standoff_m == 12.0
    assert wanted.limits.max_horizontal_m_s == 3.0
    assert wanted.limits.max_yaw_rate_rad_s == pytest.approx(math.radians(20))
    assert wanted.limits.max_up_m_s == 1.0
