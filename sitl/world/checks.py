"""What cannot be: names twice, sizes that are no sizes, ways through walls and trunks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass

import numpy as np
import numpy.typing as npt

from sitl.world.cars import car_half_size_m
from sitl.world.motion import Path
from sitl.world.solid import LocalFrame
from sitl.world.spec import CarSpec, PersonSpec, WorldSpec
from sitl.world.structures import PILLAR_M, pillar_frame
from sitl.world.trees import trunk_radius_m

FloatArray = npt.NDArray[np.float64]

STEP_M = 0.25  # between the places of a way that are looked at; narrower than any trunk with a car's width around it
PERSON_HALF_M = 0.25
DISCS = 3  # in a row cover a car
MOST_SIZE_M = 2000.0  # the ground's picture would be coarser than half a metre


class WorldError(ValueError):
    """The world cannot be as it is described; one line with the object and the place."""


def check_world(spec: WorldSpec) -> None:
    """Raise `WorldError` for the first thing that cannot be."""
    _check_numbers(spec, "world")
    if not 0 < spec.size_m <= MOST_SIZE_M:
        raise WorldError(f"world: size_m {spec.size_m:g} is not in (0, {MOST_SIZE_M:g}]")
    _check_sizes(spec)
    _check_names(spec)
    movers: list[CarSpec | PersonSpec] = [*spec.cars, *spec.persons]
    for mover in movers:
        _check_path(mover)
        _check_way(spec, mover)


def _check_numbers(value: object, where: str) -> None:
    """Every number of a specification, however deep, is finite."""
    if isinstance(value, float | int) and not isinstance(value, bool):
        if not math.isfinite(value):
            raise WorldError(f"{where}: {value} is not a finite number")
    elif isinstance(value, tuple):
        for i, item in enumerate(value):
            _check_numbers(item, f"{where}[{i}]")
    elif is_dataclass(value):
        for field in fields(value):
            name = getattr(value, "name", None)
            _check_numbers(getattr(value, field.name), f"{name or where}.{field.name}")


def _check_sizes(spec: WorldSpec) -> None:
    sizes: list[tuple[str, object, tuple[str, ...]]] = []
    sizes += [(f"building {i}", b, ("length_m", "width_m", "height_m")) for i, b in enumerate(spec.buildings)]
    sizes += [(f"tree {i}", t, ("height_m", "crown_m")) for i, t in enumerate(spec.trees)]
    parts = ("length_m", "width_m", "clearance_m", "thickness_m")
    sizes += [(f"bridge {i}", b, parts) for i, b in enumerate(spec.bridges)]
    sizes += [(f"road {i}", r, ("width_m",)) for i, r in enumerate(spec.roads)]
    sizes += [(f"car {c.name!r}", c, ("scale",)) for c in spec.cars]
    sizes += [(f"person {p.name!r}", p, ("height_m",)) for p in spec.persons]
    for what, owner, names in sizes:
        for name in names:
            if getattr(owner, name) <= 0:
                raise WorldError(f"{what}: {name} is {getattr(owner, name):g}, must be above 0")
    for i, road in enumerate(spec.roads):
        if len(road.points) < 2:
            raise WorldError(f"road {i}: needs at least two points, has {len(road.points)}")


def _check_names(spec: WorldSpec) -> None:
    seen: set[str] = set()
    movers: list[CarSpec | PersonSpec] = [*spec.cars, *spec.persons]
    for mover in movers:
        if not mover.name:
            raise WorldError("a car or person has no name")
        if mover.name in seen:
            raise WorldError(f"{mover.name!r}: the name is used twice")
        seen.add(mover.name)


def _check_path(mover: CarSpec | PersonSpec) -> None:
    path = mover.path
    if not path.points:
        raise WorldError(f"{mover.name!r}: its path has no point")
    if path.speed_m_s < 0 or path.corner_radius_m < 0:
        raise WorldError(f"{mover.name!r}: speed_m_s and corner_radius_m cannot be negative")
    if Path(path).length_m > 0 and path.speed_m_s == 0:
        raise WorldError(f"{mover.name!r}: its path has {len(path.points)} points but speed_m_s is 0")


def _check_way(spec: WorldSpec, mover: CarSpec | PersonSpec) -> None:
    discs, radius = _footprint(mover)
    height = mover.height_m if isinstance(mover, PersonSpec) else car_half_size_m(mover)[2]
    for what, hit in _obstacles(spec, discs, radius, height):
        touched = np.nonzero(hit)[0]
        if touched.size:
            north, east = discs[touched[0]]
            start = "starts in" if touched[0] < DISCS else "passes through"
            raise WorldError(f"{mover.name!r}: {start} {what} (near north {north:.1f} m, east {east:.1f} m)")


def _footprint(mover: CarSpec | PersonSpec) -> tuple[FloatArray, float]:
    """The ground an object covers on its way: discs (n, 2) north, east, `DISCS` for each place, and their radius."""
    way = Path(mover.path)
    count = math.floor(way.length_m / STEP_M) + 2
    places = [way.along(min(i * STEP_M, way.length_m)) for i in range(count)]
    at = np.array([(p.north_m, p.east_m) for p in places])
    if isinstance(mover, PersonSpec):
        return np.repeat(at, DISCS, axis=0), PERSON_HALF_M
    half_length, half_width, _ = car_half_size_m(mover)
    forward = np.array([(math.cos(p.yaw_rad), math.sin(p.yaw_rad)) for p in places])
    shifts = np.linspace(-1, 1, DISCS) * (half_length - half_width)
    return (at[:, None] + shifts[None, :, None] * forward[:, None]).reshape(-1, 2), half_width


def _obstacles(
    spec: WorldSpec, discs: FloatArray, radius: float, height: float
) -> Iterator[tuple[str, npt.NDArray[np.bool_]]]:
    """Everything that may stand in the way, with the discs it touches."""
    for i, house in enumerate(spec.buildings):
        at = f"building {i} at north {house.north_m:g} m, east {house.east_m:g} m"
        frame = LocalFrame(house.north_m, house.east_m, house.yaw_rad)
        yield at, _touches(frame, house.length_m / 2, house.width_m / 2, discs, radius)
    for i, tree in enumerate(spec.trees):
        away = np.hypot(discs[:, 0] - tree.north_m, discs[:, 1] - tree.east_m)
        at = f"the trunk of tree {i} at north {tree.north_m:g} m, east {tree.east_m:g} m"
        yield at, away < radius + trunk_radius_m(tree)
    for i, bridge in enumerate(spec.bridges):
        at = f"bridge {i} at north {bridge.north_m:g} m, east {bridge.east_m:g} m"
        if height >= bridge.clearance_m:
            frame = LocalFrame(bridge.north_m, bridge.east_m, bridge.yaw_rad)
            yield at, _touches(frame, bridge.length_m / 2, bridge.width_m / 2, discs, radius)
        for sign in (-1.0, 1.0):
            yield (
                f"a pillar of {at}",
                _touches(pillar_frame(bridge, sign), PILLAR_M / 2, bridge.width_m / 2, discs, radius),
            )


def _touches(
    frame: LocalFrame, half_x: float, half_y: float, discs: FloatArray, radius: float
) -> npt.NDArray[np.bool_]:
    """Which discs touch an upright rectangle."""
    dn, de = discs[:, 0] - frame.north_m, discs[:, 1] - frame.east_m
    c, s = math.cos(frame.yaw_rad), math.sin(frame.yaw_rad)
    x, y = np.abs(dn * c + de * s) - half_x, np.abs(de * c - dn * s) - half_y
    return np.asarray(np.hypot(np.maximum(x, 0.0), np.maximum(y, 0.0)) < radius)
