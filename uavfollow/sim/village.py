"""A crossing in a village drawn by chance: houses, trees, cars of many paints, a person; no two seeds alike."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sitl.world.spec import (
    BuildingSpec,
    CarBody,
    CarSpec,
    ColourRGB,
    PathSpec,
    PersonSpec,
    PointNE,
    RoadSpec,
    TreeSpec,
    WorldSpec,
)

SIZE_M = 120.0  # a larger ground takes longer to paint, and what lies beyond is tiled anyway
REACH_M = 55.0  # where ways begin and end
LANE_M = 1.9  # middle of a lane from the middle of the road
KERB_SIDE_M = 5.3  # pavement: people on one side, parked cars on the other, so that none walks through a car
TREES_FROM_M = 7.8  # beyond the pavement, so that no trunk stands in a way
HOUSES_FROM_M = 17.0  # middle of a house from the middle of a road; the larger half of it is 8 m
TREES, HOUSES = 14, 4
# Named, so that a body added to the simulator changes no village that was ever drawn.
BODIES = (CarBody.SEDAN, CarBody.HATCHBACK, CarBody.VAN, CarBody.PICKUP)
LOOK_ALIKE_SHARE = 0.5  # of the worlds in which the oncoming car looks like the first one

PAINTS: tuple[ColourRGB, ...] = (
    (176, 28, 30), (225, 225, 222), (38, 62, 120), (110, 112, 115), (30, 30, 32), (48, 84, 56), (196, 160, 60),
    (150, 152, 156), (120, 70, 40), (90, 140, 190), (210, 100, 30), (70, 30, 60),
)  # fmt: skip
_QUARTERS = ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))


@dataclass(frozen=True, slots=True)
class _Turn:
    """The village is drawn with roads along the axes and then turned as a whole."""

    yaw_rad: float

    def at(self, north_m: float, east_m: float) -> PointNE:
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return north_m * c - east_m * s, north_m * s + east_m * c

    def path(
        self, rng: np.random.Generator, speed_m_s: tuple[float, float], points: tuple[PointNE, ...], yaw_rad: float = 0
    ) -> PathSpec:
        speed = float(rng.uniform(*speed_m_s)) if len(points) > 1 else 0.0
        radius_m = float(rng.uniform(4.0, 6.0))
        return PathSpec(tuple(self.at(*p) for p in points), speed, 0.0, radius_m, yaw_rad + self.yaw_rad)


def draw_village(rng: np.random.Generator) -> WorldSpec:
    """A world with 3 moving and 2 parked cars and a person; the ways meet no obstacle, whatever is drawn."""
    turn = _Turn(float(rng.uniform(-math.pi, math.pi)))
    ends = (-REACH_M, REACH_M)
    roads = (
        RoadSpec(tuple(turn.at(n, 0.0) for n in ends), 7.5),
        RoadSpec(tuple(turn.at(0.0, e) for e in ends), 7.0),
    )
    return WorldSpec(
        SIZE_M, (0.0, 0.0), roads, _houses(rng, turn), _trees(rng, turn), (), _cars(rng, turn), _people(rng, turn)
    )


def _cars(rng: np.random.Generator, turn: _Turn) -> tuple[CarSpec, ...]:
    """The first one turns right, goes straight on or left at the crossing."""
    begin = (float(rng.uniform(-40.0, -22.0)), LANE_M)
    ways: tuple[tuple[PointNE, ...], ...] = (
        (begin, (LANE_M, LANE_M), (LANE_M, REACH_M)),
        (begin, (REACH_M, LANE_M)),
        (begin, (-LANE_M, LANE_M), (-LANE_M, -REACH_M)),
    )
    first = _car(rng, "first", turn.path(rng, (2.0, 7.0), ways[int(rng.integers(len(ways)))]))
    other_lane = ((float(rng.uniform(15.0, 50.0)), -LANE_M), (-REACH_M, -LANE_M))
    oncoming = _car(rng, "oncoming", turn.path(rng, (2.0, 8.0), other_lane))
    if rng.random() < LOOK_ALIKE_SHARE:
        oncoming = CarSpec("oncoming", first.body, first.colour_rgb, oncoming.path, first.scale)
    crossing = turn.path(rng, (3.0, 8.0), ((-LANE_M, float(rng.uniform(10, 45))), (-LANE_M, -REACH_M)))
    parked = [
        turn.path(rng, (0.0, 0.0), ((float(rng.uniform(*where)), -KERB_SIDE_M),), float(rng.integers(2)) * math.pi)
        for where in ((-30.0, -12.0), (12.0, 30.0))
    ]
    named = zip(("crossing", "parked-south", "parked-north"), (crossing, *parked), strict=True)
    return (first, oncoming, *(_car(rng, name, path) for name, path in named))


def _car(rng: np.random.Generator, name: str, path: PathSpec) -> CarSpec:
    body = BODIES[int(rng.integers(len(BODIES)))]
    return CarSpec(name, body, _paint(rng), path, float(rng.uniform(0.9, 1.2)))


def _paint(rng: np.random.Generator) -> ColourRGB:
    shade = np.asarray(PAINTS[int(rng.integers(len(PAINTS)))]) + rng.normal(0.0, 14.0, 3)
    red, green, blue = (int(v) for v in np.clip(np.round(shade), 8, 245))
    return red, green, blue


def _people(rng: np.random.Generator, turn: _Turn) -> tuple[PersonSpec, ...]:
    """One, along either road: a body in all its poses takes longer to build than five cars."""
    begin = float(rng.uniform(-30.0, -12.0))
    ways: tuple[tuple[PointNE, ...], ...] = (
        ((begin, KERB_SIDE_M), (REACH_M, KERB_SIDE_M)),
        ((KERB_SIDE_M, -begin), (KERB_SIDE_M, -REACH_M)),
    )
    way = turn.path(rng, (0.8, 1.8), ways[int(rng.integers(len(ways)))])
    return (PersonSpec("walker", _paint(rng), way, float(rng.uniform(1.55, 1.95))),)


def _trees(rng: np.random.Generator, turn: _Turn) -> tuple[TreeSpec, ...]:
    trees = []
    for i in range(TREES):
        near, far = rng.uniform(TREES_FROM_M, 12.0), rng.uniform(TREES_FROM_M, 45.0)
        sides = (near, far) if i % 2 else (far, near)  # along either road
        north, east = (float(s * v) for s, v in zip(_QUARTERS[i % 4], sides, strict=True))
        height = float(rng.uniform(4.0, 9.0))
        trees.append(TreeSpec(*turn.at(north, east), height, height * float(rng.uniform(0.5, 0.75))))
    return tuple(trees)


def _houses(rng: np.random.Generator, turn: _Turn) -> tuple[BuildingSpec, ...]:
    houses = []
    for i in range(HOUSES):
        north, east = (float(s * rng.uniform(HOUSES_FROM_M, 30.0)) for s in _QUARTERS[i])
        length, width, height = (float(rng.uniform(*span)) for span in ((9.0, 14.0), (8.0, 12.0), (4.0, 8.0)))
        yaw = turn.yaw_rad + float(rng.integers(4)) * math.pi / 2
        houses.append(BuildingSpec(*turn.at(north, east), length, width, height, yaw))
    return tuple(houses)
