"""The sections about what the seed of a run may draw (colours, places), and about who meets whom when."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from sitl.scenario.fields import Angle, Colour, Point, Seconds
from sitl.scenario.things import Name
from tracker.config.fields import Bounds, Section

Metres = Annotated[float, Bounds(-500.0, 500.0)]
Factor = Annotated[float, Bounds(0.2, 5.0)]
Height = Annotated[float, Bounds(2.0, 120.0)]


class PaintsSection(Section):
    """Colours to draw from. The movers named get the same one."""

    movers: tuple[Name, ...] = Field(min_length=1, max_length=100, description="names of the target or of distractors")
    colours_rgb: tuple[Colour, ...] = Field(min_length=1, max_length=100, description="one of these is drawn")


class WaySection(Section):
    """Another way for a mover: of all that are given for it, one is drawn."""

    mover: Name = Field(description="name of the target or of a distractor")
    points_ne_m: tuple[Point, ...] = Field(min_length=1, max_length=200, description="[north, east] of each corner")


class VarietySection(Section):
    """What `colour` and `place` of the seed policy draw; a range is [from, to]. Without it they do nothing."""

    about_ne_m: Point = Field(default=(0.0, 0.0), description="[north, east] about which the vehicle's start is turned")
    bearing_deg: tuple[Angle, Angle] = Field(default=(0.0, 0.0), description="by how much it is turned about it")
    distance_share: tuple[Factor, Factor] = Field(
        default=(1.0, 1.0), description="what the start's distance from there is multiplied by"
    )
    height_m: tuple[Height, Height] | None = Field(default=None, description="height of the take-off; null: as given")
    background_m: tuple[Metres, Metres] = Field(
        default=(0.0, 0.0), description="how far the world's houses and trees are moved; roads and occluders stay"
    )
    background_deg: Angle = Field(default=0.0, description="which way they are moved, clockwise from north")
    both_sides: bool = Field(default=False, strict=True, description="half of the seeds get the mirror image (east)")
    paints: tuple[PaintsSection, ...] = Field(default=(), max_length=100, description="colours to draw from")
    ways: tuple[WaySection, ...] = Field(default=(), max_length=100, description="ways to draw from")


class EncounterSection(Section):
    """When somebody hides the target or passes it, seen from the vehicle's start: sets a mover's start (and speed).

    The mover is another car: it is between camera and target. Or it is the target itself: it goes behind what stands
    there. Times are what they are said to be whatever the seed draws.
    """

    mover: Name = Field(description="whose start is set (and speed, with hidden_s): a distractor or the target")
    at_s: Seconds = Field(
        description="when the target is hidden whole; of a distractor without hidden_s: when it is in line with it"
    )
    hidden_s: Annotated[float, Bounds(0.2, 60.0)] | None = Field(
        default=None, description="how long the target is hidden whole; null: the speed stays as it is"
    )
