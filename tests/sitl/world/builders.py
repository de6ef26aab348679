"""Small worlds for tests: little ground, so that they are built fast."""

from __future__ import annotations

from sitl.world.spec import CarBody, CarSpec, PathSpec, PersonSpec, PointNE, RoadSpec, WorldSpec


def parked(name: str = "car", at: PointNE = (0.0, 0.0), yaw_rad: float = 0.0, body: CarBody = CarBody.SEDAN) -> CarSpec:
    return CarSpec(name, body, (170, 30, 30), PathSpec((at,), yaw_rad=yaw_rad))


def walker(name: str = "walker", points: tuple[PointNE, ...] = ((0.0, 4.0), (30.0, 4.0))) -> PersonSpec:
    return PersonSpec(name, (40, 90, 160), PathSpec(points, 1.4))


def small_world(**parts: object) -> WorldSpec:
    road = RoadSpec(((-30.0, 0.0), (30.0, 0.0)), 7.0)
    return WorldSpec(**{"size_m": 60.0, "roads": (road,), "cars": (parked(),), **parts})  # type: ignore[arg-type]
