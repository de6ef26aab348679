"""The sections about what happens at a given time: a person's acts, and faults of the camera."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag

from sitl.scenario.fields import Seconds
from sitl.scenario.things import kind_tag
from tracker.config.fields import Bounds, Section

BUILT_KINDS = ("click", "follow", "stop", "mode", "black", "freeze")


class ClickEvent(Section):
    """A person draws a box about the target in the picture that he sees."""

    kind: Literal["click"] = Field(description="what happens")
    at_s: Seconds = Field(description="when, after take-off has ended")
    error_sigma_share: Annotated[float, Bounds(0.0, 1.0)] = Field(
        default=0.05, description="sigma of his error in the place of the box, as a share of its size"
    )
    size_sigma_share: Annotated[float, Bounds(0.0, 0.5)] = Field(
        default=0.05, description="sigma of his error in width and height, as a share of them"
    )


class FollowEvent(Section):
    """The operator starts following."""

    kind: Literal["follow"] = Field(description="what happens")
    at_s: Seconds = Field(description="when, after take-off has ended")


class StopEvent(Section):
    """The operator stops following."""

    kind: Literal["stop"] = Field(description="what happens")
    at_s: Seconds = Field(description="when, after take-off has ended")


class ModeEvent(Section):
    """Someone else changes the flight mode: a pilot's switch, a ground station, a failsafe."""

    kind: Literal["mode"] = Field(description="what happens")
    at_s: Seconds = Field(description="when, after take-off has ended")
    mode: Literal["BRAKE", "LOITER", "RTL", "LAND", "ALT_HOLD", "STABILIZE", "GUIDED"] = Field(
        description="name of the mode, as the autopilot writes it"
    )


class PictureEvent(Section):
    """The camera gives black pictures, or the same picture again and again."""

    kind: Literal["black", "freeze"] = Field(description="what happens")
    at_s: Seconds = Field(description="when, after take-off has ended")
    duration_s: Annotated[float, Bounds(0.01, 3600.0)] = Field(description="how long it lasts")


class OtherEvent(Section):
    """An event of a kind that is not built: the scenario waits for it."""

    model_config = ConfigDict(extra="allow", frozen=True)
    kind: str = Field(description="what happens")
    at_s: Seconds = Field(default=0.0, description="when, after take-off has ended")


class FaultSection(Section):
    """A fault of a part; none is built yet, so a scenario with one waits."""

    model_config = ConfigDict(extra="allow", frozen=True)
    kind: str = Field(description="what fails")
    at_s: Seconds = Field(default=0.0, description="when, after take-off has ended")


def _event_tag(value: Any) -> str:
    tag = kind_tag(value, BUILT_KINDS, "")
    return "@picture" if tag in ("@black", "@freeze") else tag


Event = Annotated[
    Annotated[ClickEvent, Tag("@click")]
    | Annotated[FollowEvent, Tag("@follow")]
    | Annotated[StopEvent, Tag("@stop")]
    | Annotated[ModeEvent, Tag("@mode")]
    | Annotated[PictureEvent, Tag("@picture")]
    | Annotated[OtherEvent, Tag("@other")],
    Discriminator(_event_tag),
]
