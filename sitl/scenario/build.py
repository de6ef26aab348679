"""A scenario and a seed, made into the parameters of the simulator's parts: radians, seconds, NED."""

from __future__ import annotations

import math

import numpy as np

from sitl.metrics import Criterion, FlightLimits, Wanted
from sitl.plant.gimbal_params import GimbalParams
from sitl.plant.quadrotor_params import QuadrotorParams
from sitl.plant.wind import Wind
from sitl.scenario import things
from sitl.scenario.events import ClickEvent
from sitl.scenario.schema import Scenario, Vary
from sitl.scenario.seeds import seed_for, speed_factor
from sitl.scene import CameraModel, CameraPose
from sitl.world.spec import (
    BridgeSpec,
    BuildingSpec,
    CarSpec,
    PathSpec,
    PersonSpec,
    RoadSpec,
    TreeSpec,
    WorldSpec,
)
from tracker.box import Box

_MS = 1e-3


def world_spec(scenario: Scenario, seed: int) -> WorldSpec:
    """The world of a run; the seed changes nothing but the target's speed (`speed` in `seed_policy`)."""
    w, o = scenario.world, scenario.occluders
    factor = speed_factor(scenario, seed)
    movers = [(scenario.target, factor), *((d, 1.0) for d in scenario.distractors)]
    return WorldSpec(
        size_m=w.size_m,
        centre=w.centre_ne_m,
        roads=tuple(RoadSpec(r.points_ne_m, r.width_m) for r in w.roads),
        buildings=tuple(_building(b) for b in (*w.buildings, *o.buildings)),
        trees=tuple(TreeSpec(t.north_m, t.east_m, t.height_m, t.crown_m) for t in (*w.trees, *o.trees)),
        bridges=tuple(_bridge(b) for b in o.bridges),
        cars=tuple(_car(m, f) for m, f in movers if isinstance(m, things.CarSection)),
        persons=tuple(_person(m, f) for m, f in movers if isinstance(m, things.PersonSection)),
    )


def look_alikes(scenario: Scenario) -> frozenset[str]:
    """Names of the distractors that look like the target: same kind, body and colour."""
    return frozenset(d.name for d in scenario.distractors if _looks(d) == _looks(scenario.target))


def camera_model(scenario: Scenario) -> CameraModel:
    """Lens and picture."""
    c = scenario.camera
    return CameraModel(c.width_px, c.height_px, math.radians(c.hfov_deg), c.exposure_ms * _MS)


def focal_px(scenario: Scenario) -> float:
    """Focal length in pixels, of both axes."""
    return scenario.camera.width_px / 2.0 / math.tan(math.radians(scenario.camera.hfov_deg) / 2.0)


def start_pose(scenario: Scenario) -> CameraPose:
    """The camera when take-off has ended, the vehicle at rest over its start, the gimbal at its start pitch."""
    v = scenario.vehicle
    place = (v.start_north_m, v.start_east_m, -v.takeoff_height_m)
    return CameraPose(place, 0.0, math.radians(scenario.gimbal.start_pitch_deg), math.radians(v.start_yaw_deg))


def quadrotor_params(scenario: Scenario) -> QuadrotorParams:
    """What the vehicle can do."""
    v = scenario.vehicle
    return QuadrotorParams(
        max_tilt_rad=math.radians(v.max_tilt_deg),
        max_accel_m_s2=v.max_accel_m_s2,
        max_jerk_m_s3=v.max_jerk_m_s3,
        max_yaw_rate_rad_s=math.radians(v.max_yaw_rate_deg_s),
        delay_s=v.delay_ms * _MS,
    )


def gimbal_params(scenario: Scenario) -> GimbalParams:
    """What the gimbal can do, and its faults."""
    g = scenario.gimbal
    return GimbalParams(
        delay_s=g.delay_ms * _MS,
        lag_s=g.lag_ms * _MS,
        max_rate_rad_s=math.radians(g.max_rate_deg_s),
        max_accel_rad_s2=math.radians(g.max_accel_deg_s2),
        stiction_rad=math.radians(g.stiction_deg),
        misalignment_pitch_rad=math.radians(g.misalignment_pitch_deg),
        misalignment_yaw_rad=math.radians(g.misalignment_yaw_deg),
        misalignment_roll_rad=math.radians(g.misalignment_roll_deg),
    )


def wind(scenario: Scenario, seed: int) -> Wind:
    """The air over time; in a mirrored scenario mean and gusts are those of the other one, mirrored."""
    w = scenario.wind
    # Wind turns its whole output round when mirrored, while `from_deg` of a mirrored scenario is mirrored already.
    towards = math.radians(-w.from_deg if scenario.mirrored else w.from_deg) + math.pi
    mean = (w.mean_m_s * math.cos(towards), w.mean_m_s * math.sin(towards), 0.0)
    return Wind(mean, w.gust_sigma_m_s, w.gust_time_s, seed_for(scenario, seed, Vary.WIND), scenario.mirrored)


def clicked_box(scenario: Scenario, seed: int, event: ClickEvent, truth: Box) -> Box:
    """What a person draws who means `truth`, with his error of place and size; seed and time of the click decide it."""
    rng = np.random.default_rng((seed_for(scenario, seed, Vary.CLICK), round(event.at_s * 1e3)))
    right, below, wider, higher = (float(v) for v in rng.standard_normal(4))
    side = -1.0 if scenario.mirrored else 1.0
    return Box(
        truth.cx_px + side * right * event.error_sigma_share * truth.w_px,
        truth.cy_px + below * event.error_sigma_share * truth.h_px,
        truth.w_px * math.exp(wider * event.size_sigma_share),
        truth.h_px * math.exp(higher * event.size_sigma_share),
    )


def criteria(scenario: Scenario) -> tuple[Criterion, ...]:
    """What the run must reach."""
    return tuple(Criterion(c.metric, c.min, c.max, c.when) for c in scenario.criteria)


def wanted(scenario: Scenario) -> Wanted:
    """What the metrics compare with."""
    g, default = scenario.guidance, FlightLimits()
    tight = g.limits
    yaw_rate = None if tight.max_yaw_rate_deg_s is None else math.radians(tight.max_yaw_rate_deg_s)
    limits = FlightLimits(
        max_horizontal_m_s=_or(tight.max_horizontal_m_s, default.max_horizontal_m_s),
        max_up_m_s=_or(tight.max_up_m_s, default.max_up_m_s),
        max_down_m_s=_or(tight.max_down_m_s, default.max_down_m_s),
        max_yaw_rate_rad_s=_or(yaw_rate, default.max_yaw_rate_rad_s),
    )
    return Wanted(g.standoff_m, focal_px(scenario), g.height_m, None, limits)


def _or(value: float | None, default: float) -> float:
    return default if value is None else value


def _path(p: things.PathSection, factor: float) -> PathSpec:
    return PathSpec(p.points_ne_m, p.speed_m_s * factor, p.start_s, p.corner_radius_m, math.radians(p.yaw_deg))


def _car(c: things.CarSection, factor: float) -> CarSpec:
    return CarSpec(c.name, c.body, c.colour_rgb, _path(c.path, factor), c.scale)


def _person(p: things.PersonSection, factor: float) -> PersonSpec:
    return PersonSpec(p.name, p.colour_rgb, _path(p.path, factor), p.height_m)


def _building(b: things.BuildingSection) -> BuildingSpec:
    return BuildingSpec(b.north_m, b.east_m, b.length_m, b.width_m, b.height_m, math.radians(b.yaw_deg))


def _bridge(b: things.BridgeSection) -> BridgeSpec:
    return BridgeSpec(b.north_m, b.east_m, b.length_m, b.width_m, b.clearance_m, b.thickness_m, math.radians(b.yaw_deg))


def _looks(m: things.Mover) -> tuple[object, ...]:
    return (m.kind, m.colour_rgb, m.body if isinstance(m, things.CarSection) else None)
