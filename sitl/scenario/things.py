"""The sections about what stands and moves in the world. Places are [north_m, east_m]; ground is at height 0."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from sitl.scenario.fields import Angle, Colour, Coordinate, Extent, Point
from sitl.world.spec import CarBody
from tracker.config.fields import Bounds, Section

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,39}$")]


def kind_tag(value: Any, known: tuple[str, ...], default: str) -> str:
    """`@kind` of a mapping or a section; the @ keeps tags apart from keys in the paths of errors."""
    kind = value.get("kind", default) if isinstance(value, dict) else getattr(value, "kind", default)
    return f"@{kind}" if kind in known else "@other"


class PathSection(Section):
    """The way of a moving object along straight lines with rounded corners."""

    points_ne_m: tuple[Point, ...] = Field(
        min_length=1, max_length=200, description="[north, east] of each corner; one point: it stands there"
    )
    speed_m_s: Annotated[float, Bounds(0.0, 30.0)] = Field(default=0.0, description="along the whole way")
    start_s: Annotated[float, Bounds(-3600.0, 3600.0)] = Field(
        default=0.0, description="when it leaves the first point, after take-off has ended; below 0: it is under way"
    )
    corner_radius_m: Annotated[float, Bounds(0.5, 100.0)] = Field(default=5.0, description="of the rounded corners")
    yaw_deg: Angle = Field(default=0.0, description="heading of an object with one point, clockwise from north")


class CarSection(Section):
    """A car."""

    kind: Literal["car"] = Field(default="car", description="what it is")
    name: Name = Field(description="name in reports; each object has its own")
    body: CarBody = Field(default=CarBody.SEDAN, description="outline")
    colour_rgb: Colour = Field(description="paint, red green blue from 0 to 255")
    scale: Annotated[float, Bounds(0.3, 5.0)] = Field(default=1.0, description="multiplies length, width and height")
    path: PathSection = Field(description="where it is and goes")


class PersonSection(Section):
    """A walking person."""

    kind: Literal["person"] = Field(description="what it is")
    name: Name = Field(description="name in reports; each object has its own")
    colour_rgb: Colour = Field(description="clothes, red green blue from 0 to 255")
    height_m: Annotated[float, Bounds(0.5, 10.0)] = Field(default=1.75, description="of the person")
    path: PathSection = Field(description="where it is and goes")


def _mover_tag(value: Any) -> str:
    return kind_tag(value, ("car", "person"), "car")


Mover = Annotated[
    Annotated[CarSection, Tag("@car")] | Annotated[PersonSection, Tag("@person")],
    Discriminator(
        _mover_tag, custom_error_type="unknown_kind", custom_error_message="kind: must be one of car, person"
    ),
]


class RoadSection(Section):
    """A paved road."""

    points_ne_m: tuple[Point, ...] = Field(min_length=2, max_length=200, description="[north, east] along its middle")
    width_m: Annotated[float, Bounds(1.0, 60.0)] = Field(default=7.0, description="of the pavement")


class BuildingSection(Section):
    """A house: a cuboid."""

    north_m: Coordinate = Field(description="of the middle")
    east_m: Coordinate = Field(description="of the middle")
    length_m: Extent = Field(description="along its own x axis")
    width_m: Extent = Field(description="across its own x axis")
    height_m: Extent = Field(description="of the roof")
    yaw_deg: Angle = Field(default=0.0, description="of its x axis, clockwise from north")


class TreeSection(Section):
    """A tree: trunk and crown."""

    north_m: Coordinate = Field(description="of the trunk")
    east_m: Coordinate = Field(description="of the trunk")
    height_m: Annotated[float, Bounds(1.0, 60.0)] = Field(default=7.0, description="of the top")
    crown_m: Annotated[float, Bounds(0.5, 40.0)] = Field(default=4.5, description="diameter of the crown")


class BridgeSection(Section):
    """A deck over a road, with a pillar at each end."""

    north_m: Coordinate = Field(description="of the middle")
    east_m: Coordinate = Field(description="of the middle")
    length_m: Extent = Field(description="from pillar to pillar, along its own x axis")
    width_m: Extent = Field(description="of the deck, across its own x axis")
    clearance_m: Annotated[float, Bounds(1.0, 100.0)] = Field(default=4.6, description="underside above ground")
    thickness_m: Annotated[float, Bounds(0.1, 20.0)] = Field(default=1.4, description="deck and railing together")
    yaw_deg: Angle = Field(default=0.0, description="of its x axis, clockwise from north")


class WorldSection(Section):
    """The ground and what stands on it."""

    size_m: Annotated[float, Bounds(20.0, 2000.0)] = Field(default=240.0, description="side of the square of ground")
    centre_ne_m: Point = Field(default=(0.0, 0.0), description="[north, east] of its middle")
    roads: tuple[RoadSection, ...] = Field(default=(), max_length=200, description="paved ways")
    buildings: tuple[BuildingSection, ...] = Field(default=(), max_length=500, description="houses")
    trees: tuple[TreeSection, ...] = Field(default=(), max_length=2000, description="trees beside the target's way")


class OccludersSection(Section):
    """What is there to hide the target."""

    trees: tuple[TreeSection, ...] = Field(default=(), max_length=500, description="trees between camera and target")
    bridges: tuple[BridgeSection, ...] = Field(default=(), max_length=50, description="bridges over the target's way")
    buildings: tuple[BuildingSection, ...] = Field(default=(), max_length=50, description="houses in the line of sight")
