"""Whether a scenario makes sense as a whole: names, times, metrics, geometry."""

from __future__ import annotations

import math
from collections.abc import Iterator

from sitl.metrics.names import METRIC_NAMES, NEVER_GATED
from sitl.scenario.build import world_spec
from sitl.scenario.draw import drawn
from sitl.scenario.encounter import EncounterError
from sitl.scenario.errors import ScenarioError
from sitl.scenario.events import ClickEvent
from sitl.scenario.schema import Scenario
from sitl.scenario.things import BuildingSection, CarSection, Mover
from sitl.scene import Vector
from sitl.world.checks import WorldError, check_world
from tracker.config.errors import suggestion

# Beside a wall or above a roof a vehicle needs this much air.
VEHICLE_M = 1.0
# Nearer to the border of the first picture than this share of it, a person would not choose to click.
VIEW_MARGIN = 0.03
# Middle of a target above the ground, in heights of a car and of a person.
_CAR_MIDDLE_M = 0.75
# A run shorter than this has no final half second after a click and a lock.
MIN_AFTER_CLICK_S = 1.0


def check_scenario(scenario: Scenario, where: str) -> None:
    """Raises ScenarioError with every finding; `where` names the scenario in it. Whatever is pending is no finding."""
    problems = [*_names(scenario), *_known(scenario), *_times(scenario), *_criteria(scenario)]
    # What follows is reckoned with places, starts and speeds. An encounter of wrong ones says nothing.
    problems += list(_as_drawn(scenario)) if not problems or not scenario.encounters else []
    if problems:
        raise ScenarioError(where, problems)


def _as_drawn(scenario: Scenario) -> Iterator[str]:
    """Places, as they are for seed 0."""
    try:
        made = drawn(scenario, 0)
    except EncounterError as error:
        yield f"encounters: {error}"
        return
    found = [*_start(made), *_view(made)]
    # The world's own check says again what is wrong with names and speeds, without their keys.
    yield from found or _world(made)


def _movers(scenario: Scenario) -> Iterator[tuple[str, Mover]]:
    yield "target", scenario.target
    for index, mover in enumerate(scenario.distractors):
        yield f"distractors[{index}]", mover


def _names(scenario: Scenario) -> Iterator[str]:
    taken: dict[str, str] = {}
    for key, mover in _movers(scenario):
        if mover.name in taken:
            yield f"{key}.name: {mover.name!r} is the name of {taken[mover.name]} too; give each object its own"
        taken.setdefault(mover.name, key)


def _known(scenario: Scenario) -> Iterator[str]:
    """Names in `variety` and `encounters` are those of movers that can do what is asked."""
    movers = {mover.name: mover for _, mover in _movers(scenario)}
    variety = scenario.variety
    named = [(f"encounters[{i}].mover", e.mover) for i, e in enumerate(scenario.encounters)]
    if variety is not None:
        named += [(f"variety.ways[{i}].mover", way.mover) for i, way in enumerate(variety.ways)]
        named += [(f"variety.paints[{i}].movers", n) for i, paint in enumerate(variety.paints) for n in paint.movers]
    for key, name in named:
        if name not in movers:
            near = suggestion(name, tuple(movers)) or f"; known are {', '.join(movers)}"
            yield f"{key}: {name!r} is no target or distractor{near}"
        elif key.startswith("encounters") and len(movers[name].path.points_ne_m) < 2:
            yield f"{key}: {name!r} stands; give its path another point and a speed"


def _times(scenario: Scenario) -> Iterator[str]:
    end_s = scenario.duration_s
    for index, event in enumerate(scenario.events):
        if event.at_s >= end_s:
            yield f"events[{index}].at_s: {event.at_s:g} is not before the end (duration_s: {end_s:g})"
        elif isinstance(event, ClickEvent) and event.at_s > end_s - MIN_AFTER_CLICK_S:
            yield (
                f"duration_s: {end_s:g} is too short for the click at {event.at_s:g} s; "
                f"give at least {event.at_s + MIN_AFTER_CLICK_S:g}"
            )
    for key, mover in _movers(scenario):
        path = mover.path
        if len(path.points_ne_m) > 1 and path.speed_m_s == 0:
            yield f"{key}.path.speed_m_s: 0 with several points; give a speed, or one point for what stands"
        if key == "target" and len(path.points_ne_m) > 1 and path.start_s >= end_s:
            yield f"{key}.path.start_s: {path.start_s:g} is not before the end (duration_s: {end_s:g})"


def _criteria(scenario: Scenario) -> Iterator[str]:
    for index, criterion in enumerate(scenario.criteria):
        key = f"criteria[{index}]"
        if criterion.metric not in METRIC_NAMES:
            near = suggestion(criterion.metric, METRIC_NAMES) or f"; known are {', '.join(METRIC_NAMES)}"
            yield f"{key}.metric: {criterion.metric!r} is no metric{near}"
        elif criterion.metric in NEVER_GATED:
            yield f"{key}.metric: {criterion.metric} says how fast the computer was; it cannot be a criterion"
        if criterion.min is None and criterion.max is None:
            yield f"{key}: neither min nor max is given, so nothing could fail"
        elif criterion.min is not None and criterion.max is not None and criterion.min > criterion.max:
            yield f"{key}: min {criterion.min:g} is above max {criterion.max:g}, so nothing could pass"


def _buildings(scenario: Scenario) -> Iterator[tuple[str, BuildingSection]]:
    for section in ("world", "occluders"):
        for index, building in enumerate(getattr(scenario, section).buildings):
            yield f"{section}.buildings[{index}]", building


def _start(scenario: Scenario) -> Iterator[str]:
    """The vehicle does not begin the scenario inside a house."""
    v = scenario.vehicle
    for name, house in _buildings(scenario):
        yaw = math.radians(house.yaw_deg)
        north, east = v.start_north_m - house.north_m, v.start_east_m - house.east_m
        along = abs(north * math.cos(yaw) + east * math.sin(yaw)) - house.length_m / 2.0
        across = abs(east * math.cos(yaw) - north * math.sin(yaw)) - house.width_m / 2.0
        if max(along, across) < VEHICLE_M and v.takeoff_height_m < house.height_m + VEHICLE_M:
            yield f"vehicle: the start at {v.takeoff_height_m:g} m is inside {name}"


def _world(scenario: Scenario) -> Iterator[str]:
    """Every way is free of houses, trunks and pillars. The speed, which the seed may change, does not matter to it."""
    try:
        check_world(world_spec(scenario, 0))
    except WorldError as error:
        yield f"world: {error}"


def _view(scenario: Scenario) -> Iterator[str]:
    """The target is in the picture when a person is to click it; it cannot be before take-off has ended."""
    clicks = [event for event in scenario.events if isinstance(event, ClickEvent)]
    path = scenario.target.path
    if not clicks or (len(path.points_ne_m) > 1 and clicks[0].at_s > path.start_s):
        return  # nobody clicks, or it has left by then: the run itself shows whether it is in sight
    north, east = path.points_ne_m[0]
    share = first_view(scenario, (north, east, -_middle_m(scenario.target)))
    if share is None or not all(VIEW_MARGIN <= s <= 1.0 - VIEW_MARGIN for s in share):
        seen = "behind the camera" if share is None else f"at {share[0]:.2f}, {share[1]:.2f} of width and height"
        yield (
            f"target.path.points_ne_m[0]: not in the first picture ({seen}); "
            "move it, or change vehicle.start_yaw_deg or gimbal.start_pitch_deg"
        )


def _middle_m(mover: Mover) -> float:
    return _CAR_MIDDLE_M * mover.scale if isinstance(mover, CarSection) else mover.height_m / 2.0


def first_view(scenario: Scenario, place_ned_m: Vector) -> tuple[float, float] | None:
    """Where the camera sees a place when take-off has ended, as shares of width and height; None when behind it."""
    v, c = scenario.vehicle, scenario.camera
    yaw, pitch = math.radians(v.start_yaw_deg), math.radians(scenario.gimbal.start_pitch_deg)
    north, east = place_ned_m[0] - v.start_north_m, place_ned_m[1] - v.start_east_m
    down = place_ned_m[2] + v.takeoff_height_m
    ahead = north * math.cos(yaw) + east * math.sin(yaw)
    right = east * math.cos(yaw) - north * math.sin(yaw)
    depth = ahead * math.cos(pitch) - down * math.sin(pitch)
    below = down * math.cos(pitch) + ahead * math.sin(pitch)
    if depth <= 0.1:
        return None
    half = math.tan(math.radians(c.hfov_deg) / 2.0)
    aspect = c.width_px / c.height_px
    return 0.5 + right / depth / half / 2.0, 0.5 + below / depth / half / 2.0 * aspect
