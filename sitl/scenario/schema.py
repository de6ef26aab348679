"""The whole of a scenario file (docs/interfaces.md): typed, bounded, units in the keys, degrees at this edge only.

Time 0 is when take-off has ended. North, east in metres; yaw clockwise from north, pitch nose up +.
"""

from __future__ import annotations

from enum import Enum
from typing import Annotated, Literal

from pydantic import Field

from sitl.metrics.criteria import Source
from sitl.scenario.events import BUILT_KINDS, Event, FaultSection, OtherEvent
from sitl.scenario.fields import Angle, Coordinate, Milliseconds
from sitl.scenario.things import Mover, OccludersSection, WorldSection
from sitl.scenario.variety import EncounterSection, VarietySection
from tracker.config.errors import suggestion
from tracker.config.fields import Bounds, Section

BUILT_GUIDANCE = ("trail",)


class Flavour(str, Enum):
    """Whose autopilot is simulated."""

    ARDUPILOT = "ardupilot"
    PX4 = "px4"


class Vary(str, Enum):
    """What the seed of a run may change; what is not listed stays as it is for seed 0."""

    TEXTURE = "texture"
    LIGHT = "light"
    WIND = "wind"
    NOISE = "noise"
    CLICK = "click"
    SPEED = "speed"
    COLOUR = "colour"
    PLACE = "place"


class CameraSection(Section):
    """Lens, picture and transport of the video."""

    width_px: Annotated[int, Bounds(64, 3840, whole=True)] = Field(default=640, description="width of the picture")
    height_px: Annotated[int, Bounds(64, 2160, whole=True)] = Field(default=480, description="height of the picture")
    hfov_deg: Annotated[float, Bounds(5.0, 150.0)] = Field(default=66.0, description="horizontal field of view")
    exposure_ms: Annotated[float, Bounds(0.0, 40.0)] = Field(default=4.0, description="exposure time")
    latency_ms: Milliseconds = Field(default=60.0, description="from the exposure to the picture at the application")
    jitter_ms: Annotated[float, Bounds(0.0, 200.0)] = Field(default=8.0, description="sigma of that time")
    drop_share: Annotated[float, Bounds(0.0, 0.95)] = Field(default=0.0, description="share of pictures that get lost")


class VehicleSection(Section):
    """The vehicle, where it takes off and what it can do."""

    flavour: Flavour = Field(default=Flavour.ARDUPILOT, description="autopilot")
    takeoff_height_m: Annotated[float, Bounds(2.0, 120.0)] = Field(
        default=12.0, description="height of the camera when take-off has ended"
    )
    start_north_m: Coordinate = Field(default=0.0, description="where it takes off")
    start_east_m: Coordinate = Field(default=0.0, description="where it takes off")
    start_yaw_deg: Angle = Field(default=0.0, description="heading at the start")
    max_tilt_deg: Annotated[float, Bounds(5.0, 60.0)] = Field(default=40.0, description="tilt limit of the autopilot")
    max_accel_m_s2: Annotated[float, Bounds(0.5, 16.0)] = Field(default=8.0, description="horizontal acceleration")
    max_jerk_m_s3: Annotated[float, Bounds(1.0, 200.0)] = Field(default=25.0, description="change of acceleration")
    max_yaw_rate_deg_s: Annotated[float, Bounds(10.0, 360.0)] = Field(default=120.0, description="turning about down")
    delay_ms: Milliseconds = Field(default=50.0, description="from the velocity controller to the motors")


class GimbalSection(Section):
    """The gimbal under the vehicle; roll is stabilised."""

    start_pitch_deg: Annotated[float, Bounds(-90.0, 30.0)] = Field(
        default=-30.0, description="where it points until something is clicked"
    )
    delay_ms: Milliseconds = Field(default=30.0, description="from command to motor")
    lag_ms: Annotated[float, Bounds(5.0, 1000.0)] = Field(default=50.0, description="time constant of its rate loop")
    max_rate_deg_s: Annotated[float, Bounds(5.0, 720.0)] = Field(default=120.0, description="fastest turning")
    max_accel_deg_s2: Annotated[float, Bounds(20.0, 20000.0)] = Field(default=1146.0, description="change of the rate")
    stiction_deg: Annotated[float, Bounds(0.0, 2.0)] = Field(default=0.06, description="break-away error at rest")
    misalignment_pitch_deg: Annotated[float, Bounds(-10.0, 10.0)] = Field(
        default=0.0, description="camera against the joints"
    )
    misalignment_yaw_deg: Annotated[float, Bounds(-10.0, 10.0)] = Field(
        default=0.0, description="camera against the joints"
    )
    misalignment_roll_deg: Annotated[float, Bounds(-10.0, 10.0)] = Field(
        default=0.0, description="camera against the joints"
    )
    report: Literal["measured", "commanded"] = Field(
        default="measured", description="what it reports as its attitude: its encoders, or what it was told"
    )


class WindSection(Section):
    """Moving air."""

    mean_m_s: Annotated[float, Bounds(0.0, 20.0)] = Field(default=0.0, description="mean speed")
    from_deg: Angle = Field(default=0.0, description="where it comes from, clockwise from north")
    gust_sigma_m_s: Annotated[float, Bounds(0.0, 10.0)] = Field(default=0.0, description="sigma of the gusts")
    gust_time_s: Annotated[float, Bounds(0.1, 60.0)] = Field(default=2.0, description="correlation time of the gusts")


class LimitsSection(Section):
    """Tighter limits for this run; null leaves that of the application, which is also the greatest value."""

    max_horizontal_m_s: Annotated[float, Bounds(0.1, 5.0)] | None = Field(default=None, description="horizontal speed")
    max_up_m_s: Annotated[float, Bounds(0.05, 1.0)] | None = Field(default=None, description="climb")
    max_down_m_s: Annotated[float, Bounds(0.05, 1.0)] | None = Field(default=None, description="descent")
    max_yaw_rate_deg_s: Annotated[float, Bounds(1.0, 45.0)] | None = Field(default=None, description="turning")
    max_horizontal_accel_m_s2: Annotated[float, Bounds(0.1, 2.0)] | None = Field(
        default=None, description="horizontal acceleration"
    )


class GuidanceSection(Section):
    """What the application is asked to do."""

    mode: str = Field(default="trail", description="law: trail")
    # 5 m: the least that the application takes for a standoff (two arm lengths and the error of a monocular range).
    standoff_m: Annotated[float, Bounds(5.0, 500.0)] = Field(
        default=20.0, description="horizontal distance to keep from the target"
    )
    height_m: Annotated[float, Bounds(2.0, 120.0)] | None = Field(
        default=None, description="height to keep; null: the one at the start"
    )
    limits: LimitsSection = Field(default_factory=LimitsSection, description="tighter limits than the application's")


class CriterionSection(Section):
    """What a metric of the run must reach."""

    metric: str = Field(description="name of the metric")
    min: Annotated[float, Bounds(-1e9, 1e9)] | None = Field(default=None, description="least value that passes")
    max: Annotated[float, Bounds(-1e9, 1e9)] | None = Field(default=None, description="greatest value that passes")
    when: Source | None = Field(default=None, description="only for runs of this source of candidates")


class Scenario(Section):
    """A scenario, checked key by key; `sitl.scenario.check` checks whether it makes sense as a whole."""

    schema_version: Literal[1] = Field(alias="schema", description="version of this format")
    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,59}$")] = Field(description="short name, a-z 0-9 _ -")
    description: str = Field(default="", max_length=2000, description="what it tests, for people")
    duration_s: Annotated[float, Bounds(1.0, 3600.0)] = Field(description="from the end of take-off")
    fps: Annotated[float, Bounds(1.0, 120.0)] = Field(default=30.0, description="pictures a second")
    seed_policy: tuple[Vary, ...] = Field(default=tuple(Vary), description="what the seed changes")
    mirrored: bool = Field(
        default=False, strict=True, description="chance is mirrored too (east, and x in the picture): for tests"
    )
    world: WorldSection = Field(default_factory=WorldSection, description="the ground and what stands on it")
    target: Mover = Field(description="what is to be followed")
    distractors: tuple[Mover, ...] = Field(default=(), max_length=100, description="other cars and persons")
    occluders: OccludersSection = Field(
        default_factory=OccludersSection, description="what is there to hide the target"
    )
    variety: VarietySection | None = Field(default=None, description="what the seed draws of colours and places")
    encounters: tuple[EncounterSection, ...] = Field(
        default=(), max_length=100, description="who hides the target or passes it, and when"
    )
    camera: CameraSection = Field(default_factory=CameraSection, description="lens, picture and transport")
    vehicle: VehicleSection = Field(default_factory=VehicleSection, description="the vehicle and where it starts")
    gimbal: GimbalSection = Field(default_factory=GimbalSection, description="the gimbal")
    wind: WindSection = Field(default_factory=WindSection, description="moving air")
    faults: tuple[FaultSection, ...] = Field(default=(), max_length=100, description="parts that fail (none built yet)")
    events: tuple[Event, ...] = Field(default=(), max_length=100, description="what people and the camera do, and when")
    guidance: GuidanceSection = Field(default_factory=GuidanceSection, description="what the application is to do")
    criteria: tuple[CriterionSection, ...] = Field(default=(), max_length=100, description="what the run must reach")
    tracker_compute_delay_s: Annotated[float, Bounds(0.0, 5.0)] = Field(
        default=0.0, description="simulated time of one network call of the tracker; a picture may take several"
    )

    def pending_reasons(self) -> tuple[str, ...]:
        """What this scenario needs that is not built yet, a line each; empty when it can run."""
        reasons = [f"faults[{i}]: the fault {fault.kind!r} is not built yet" for i, fault in enumerate(self.faults)]
        for i, event in enumerate(self.events):
            if isinstance(event, OtherEvent):
                near = suggestion(event.kind, BUILT_KINDS)
                reasons.append(f"events[{i}]: the event {event.kind!r} is not built yet{near}")
        if self.vehicle.flavour is not Flavour.ARDUPILOT:
            reasons.append(f"vehicle.flavour: {self.vehicle.flavour.value} is not built yet")
        if self.guidance.mode not in BUILT_GUIDANCE:
            near = suggestion(self.guidance.mode, BUILT_GUIDANCE)
            reasons.append(f"guidance.mode: {self.guidance.mode!r} is not built yet{near}")
        return tuple(reasons)
