"""A scenario and a seed, made into the scenario of that one run: colours, places and encounters are settled."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from sitl.scenario import build, things
from sitl.scenario.encounter import EncounterError, Stage, hide_behind_mover, hide_itself, in_line
from sitl.scenario.events import ClickEvent
from sitl.scenario.schema import Scenario, Vary
from sitl.scenario.seeds import seed_for, speed_factor
from sitl.scenario.transform import mirrored
from sitl.scenario.variety import EncounterSection, PaintsSection, VarietySection
from sitl.scene import Vector
from sitl.world.motion import Path
from sitl.world.spec import CarSpec, PathSpec, PersonSpec, WorldSpec

MIDDLE_M = 0.75  # height of the target's middle that the camera is pointed at


def drawn(scenario: Scenario, seed: int) -> Scenario:
    """The scenario of a run: without `variety` and `encounters`, which have become places, colours, starts and speeds.

    One that has neither is returned as it is. Raises EncounterError (a ValueError) for an encounter that cannot be.
    """
    if scenario.variety is None and not scenario.encounters:
        return scenario
    if scenario.mirrored:  # chance is mirrored too: what is drawn is the mirror image
        return mirrored(drawn(mirrored(scenario), seed))
    variety = scenario.variety or VarietySection()
    place = np.random.default_rng(seed_for(scenario, seed, Vary.PLACE))
    flipped = bool(place.random() < 0.5)
    made = _placed(scenario, variety, place)
    made = _painted(made, variety.paints, np.random.default_rng(seed_for(scenario, seed, Vary.COLOUR)))
    made = made.model_copy(update={"variety": None, "encounters": ()})
    for encounter in scenario.encounters:
        made = _met(made, seed, encounter)
    if scenario.variety is not None:
        made = _pointed(made, seed)
    return mirrored(made).model_copy(update={"mirrored": False}) if flipped and variety.both_sides else made


def _placed(scenario: Scenario, variety: VarietySection, rng: np.random.Generator) -> Scenario:
    """Everything is drawn, whatever is used: one range must not change the chance of another."""
    turn = math.radians(rng.uniform(*variety.bearing_deg))
    share = float(rng.uniform(*variety.distance_share))
    vehicle = scenario.vehicle
    low, high = variety.height_m or (vehicle.takeoff_height_m,) * 2
    height = float(rng.uniform(low, high))
    shift = float(rng.uniform(*variety.background_m))
    ways: dict[str, list[tuple[tuple[float, float], ...]]] = {}
    for way in variety.ways:
        ways.setdefault(way.mover, []).append(way.points_ne_m)
    chosen = {name: them[int(rng.integers(len(them)))] for name, them in ways.items()}
    about = variety.about_ne_m
    north, east = vehicle.start_north_m - about[0], vehicle.start_east_m - about[1]
    c, s = share * math.cos(turn), share * math.sin(turn)
    start = {
        "start_north_m": about[0] + north * c - east * s,
        "start_east_m": about[1] + north * s + east * c,
        "takeoff_height_m": height,
    }
    along = math.radians(variety.background_deg)
    made = scenario.model_copy(
        update={
            "vehicle": vehicle.model_copy(update=start),
            "world": _moved(scenario.world, shift * math.cos(along), shift * math.sin(along)),
        }
    )
    return _changed(made, list(chosen), lambda m: _on_way(m, {"points_ne_m": chosen[m.name]}))


def _moved(world: things.WorldSection, north_m: float, east_m: float) -> things.WorldSection:
    """Houses and trees of the background, moved."""

    def moved(items: Sequence[things.BuildingSection] | Sequence[things.TreeSection]) -> tuple[object, ...]:
        return tuple(
            item.model_copy(update={"north_m": item.north_m + north_m, "east_m": item.east_m + east_m})
            for item in items
        )

    return world.model_copy(update={"buildings": moved(world.buildings), "trees": moved(world.trees)})


def _painted(scenario: Scenario, paints: Sequence[PaintsSection], rng: np.random.Generator) -> Scenario:
    for paint in paints:
        change: dict[str, object] = {"colour_rgb": paint.colours_rgb[int(rng.integers(len(paint.colours_rgb)))]}
        scenario = _changed(scenario, paint.movers, partial(_with, change))
    return scenario


def _changed(scenario: Scenario, names: Sequence[str], change: Callable[[things.Mover], things.Mover]) -> Scenario:
    """The scenario with each of the movers named changed."""
    target, others = scenario.target, scenario.distractors
    return scenario.model_copy(
        update={
            "target": change(target) if target.name in names else target,
            "distractors": tuple(change(d) if d.name in names else d for d in others),
        }
    )


def _with(changes: dict[str, object], mover: things.Mover) -> things.Mover:
    return mover.model_copy(update=changes)


def _on_way(mover: things.Mover, changes: dict[str, object]) -> things.Mover:
    return mover.model_copy(update={"path": mover.path.model_copy(update=changes)})


def _met(scenario: Scenario, seed: int, encounter: EncounterSection) -> Scenario:
    """One encounter settled: start and speed of its mover."""
    spec = build.world_spec(scenario, seed)
    target = _car(spec, scenario.target.name)
    stage = Stage(_eye(scenario), target, spec.buildings)
    at_s, hidden_s = encounter.at_s, encounter.hidden_s
    factor = 1.0
    if encounter.mover == target.name:
        path, factor = hide_itself(stage, at_s, hidden_s), speed_factor(scenario, seed)
    elif hidden_s is None:
        path = in_line(stage, _car(spec, encounter.mover), at_s)
    else:
        path = hide_behind_mover(stage, _car(spec, encounter.mover), at_s, hidden_s)
    # The target's speed is multiplied by what the seed says when the world is built.
    changes: dict[str, object] = {"speed_m_s": path.speed_m_s / factor, "start_s": path.start_s}
    return _changed(scenario, [encounter.mover], lambda m: _on_way(m, changes))


def _car(spec: WorldSpec, name: str) -> CarSpec:
    found = next((car for car in spec.cars if car.name == name), None)
    if found is None:
        raise EncounterError(f"{name}: is no car; encounters are of cars")
    return found


def _eye(scenario: Scenario) -> Vector:
    v = scenario.vehicle
    return v.start_north_m, v.start_east_m, -v.takeoff_height_m


def _pointed(scenario: Scenario, seed: int) -> Scenario:
    """Vehicle and camera look at the target when it is clicked, as an operator would have turned them."""
    click_s = next((e.at_s for e in scenario.events if isinstance(e, ClickEvent)), 0.0)
    place = Path(_path(build.world_spec(scenario, seed), scenario.target.name)).at(click_s)
    eye = _eye(scenario)
    north, east, below = place.north_m - eye[0], place.east_m - eye[1], -MIDDLE_M - eye[2]
    yaw, pitch = math.degrees(math.atan2(east, north)), -math.degrees(math.atan2(below, math.hypot(north, east)))
    return scenario.model_copy(
        update={
            "vehicle": scenario.vehicle.model_copy(update={"start_yaw_deg": yaw}),
            "gimbal": scenario.gimbal.model_copy(update={"start_pitch_deg": pitch}),
        }
    )


def _path(spec: WorldSpec, name: str) -> PathSpec:
    movers: tuple[CarSpec | PersonSpec, ...] = (*spec.cars, *spec.persons)
    return next(mover.path for mover in movers if mover.name == name)
