"""What a scenario says of the world: plain numbers, no pictures. NED metres, radians, ground at down = 0."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

PointNE = tuple[float, float]
ColourRGB = tuple[int, int, int]


class CarBody(str, Enum):
    """Outline of a car."""

    SEDAN = "sedan"
    HATCHBACK = "hatchback"
    VAN = "van"
    PICKUP = "pickup"
    LORRY = "lorry"
    BUS = "bus"
    BENDY_BUS = "bendy_bus"


@dataclass(frozen=True, slots=True)
class PathSpec:
    """A way along straight lines with rounded corners.

    `points` (at least one; one point = parked) are (north_m, east_m); `speed_m_s` holds along the whole way;
    `start_s` is when the object leaves the first point, where it waits before; at the last point it stands. `yaw_rad`
    is the heading of an object that never moves.
    """

    points: tuple[PointNE, ...]
    speed_m_s: float = 0.0
    start_s: float = 0.0
    corner_radius_m: float = 5.0
    yaw_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class CarSpec:
    """A car; `scale` multiplies its length, width and height."""

    name: str
    body: CarBody
    colour_rgb: ColourRGB
    path: PathSpec
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class PersonSpec:
    """A walking person."""

    name: str
    colour_rgb: ColourRGB
    path: PathSpec
    height_m: float = 1.75


@dataclass(frozen=True, slots=True)
class TreeSpec:
    """A tree: trunk and crown; `crown_m` is the crown's diameter."""

    north_m: float
    east_m: float
    height_m: float = 7.0
    crown_m: float = 4.5


@dataclass(frozen=True, slots=True)
class BuildingSpec:
    """A cuboid house with a textured front; `length_m` along its own x axis, turned by `yaw_rad`."""

    north_m: float
    east_m: float
    length_m: float
    width_m: float
    height_m: float
    yaw_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class BridgeSpec:
    """A deck over a road with a pillar at each end; `length_m` across the road, along its own x axis.

    `clearance_m` is the height of the deck's underside, `thickness_m` deck and railing together.
    """

    north_m: float
    east_m: float
    length_m: float
    width_m: float
    clearance_m: float = 4.6
    thickness_m: float = 1.4
    yaw_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class RoadSpec:
    """A paved road along `points`."""

    points: tuple[PointNE, ...]
    width_m: float = 7.0


@dataclass(frozen=True, slots=True)
class WorldSpec:
    """The whole world. `size_m`: side of the square of ground about `centre`; beyond it the ground goes on (tiled)."""

    size_m: float = 240.0
    centre: PointNE = (0.0, 0.0)
    roads: tuple[RoadSpec, ...] = ()
    buildings: tuple[BuildingSpec, ...] = ()
    trees: tuple[TreeSpec, ...] = ()
    bridges: tuple[BridgeSpec, ...] = ()
    cars: tuple[CarSpec, ...] = ()
    persons: tuple[PersonSpec, ...] = ()
