"""Settings by kind of target: how it moves, and for how long what it did last still says where it is.

Not fitted: chosen by reasoning from how fast each kind changes its way, in its own sizes (sqrt(w h) in the picture), so
that distance and resolution do not matter. `FilterConfig()` itself was chosen by replay and stays the default.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from tracker.filter import FilterConfig
from tracker.status import StatusConfig
from tracker.target_config import TargetConfig


class TargetKind(str, Enum):
    """What is followed."""

    PERSON = "person"
    VEHICLE = "vehicle"
    BOAT = "boat"
    STATIC = "static"


@dataclass(frozen=True, slots=True)
class Preset:
    """Filter noise and coasting, with the reason for them.

    `coast_s`: how long a moving target that is not seen is taken to go on as before; `coast_still_s`: how long one that
    stood still is taken to stand there.
    """

    filter: FilterConfig
    coast_s: float
    coast_still_s: float
    reason: str

    @property
    def target(self) -> TargetConfig:
        """The settings of `tracker.target.TargetTracker` that go with it."""
        return TargetConfig(status=StatusConfig(coast_s=self.coast_s, coast_still_s=self.coast_still_s))


PRESETS: dict[TargetKind, Preset] = {
    TargetKind.PERSON: Preset(
        # 1.4 m/s of a size of about 1 m; stops or turns within half a second: 1.4 sizes/s in 0.5 s is 2 sizes/s^2 for a
        # short time. Limbs change the box's width with every step.
        FilterConfig(accel_sizes_s1_5=0.9, ln_size_sigma_best=0.13, coast_tau_s=0.6),
        coast_s=1.0,
        coast_still_s=0.8,
        reason="walks or runs, turns at any moment; its outline changes with every step",
    ),
    TargetKind.VEHICLE: Preset(
        # 3 m/s^2 of a size of 2.5 m is 1.2 sizes/s^2, held for seconds: hidden, it mostly goes on as it went.
        FilterConfig(accel_sizes_s1_5=0.7, coast_tau_s=1.5),
        coast_s=2.0,
        coast_still_s=1.0,
        reason="keeps its way and speed for seconds; brakes and turns within a second or two",
    ),
    TargetKind.BOAT: Preset(
        # A fraction of a size/s^2; waves and wake shake box and size more than the boat's own motion does.
        FilterConfig(accel_sizes_s1_5=0.3, growth_accel_s1_5=0.2, ln_size_sigma_best=0.13, coast_tau_s=3.0),
        coast_s=3.0,
        coast_still_s=2.0,
        reason="changes its way slowly; waves and wake disturb its outline",
    ),
    TargetKind.STATIC: Preset(
        # It moves in the picture only as the camera does; without rates of the camera what it did last soon says
        # nothing, and drifting away would be worse than staying.
        FilterConfig(accel_sizes_s1_5=0.4, growth_accel_s1_5=0.2, coast_tau_s=0.3),
        coast_s=3.0,
        coast_still_s=3.0,
        reason="does not move; what moves is the camera",
    ),
}
