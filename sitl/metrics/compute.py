"""All metrics of one run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from sitl.metrics import flight, picture
from sitl.metrics.encounter import encounter_metrics
from sitl.metrics.flight import FlightLimits
from sitl.metrics.names import METRIC_NAMES
from sitl.metrics.occlusions import occlusion_metrics
from sitl.metrics.sample import Sample, Setpoint


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the run was asked to keep. `height_m` None: the height at which following began; `bearing_rad` None: any."""

    standoff_m: float
    focal_px: float
    height_m: float | None = None
    bearing_rad: float | None = None
    limits: FlightLimits = field(default_factory=FlightLimits)


def compute(
    samples: Sequence[Sample],
    wanted: Wanted,
    setpoints: Sequence[Setpoint],
    override_s: float | None = None,
    resumed_s: float | None = None,
    realtime_factor: float | None = None,
) -> dict[str, float | None]:
    """Every name of `METRIC_NAMES`, in that order; None where it is undefined in this run.

    `samples` in the order of `t_s`; `setpoints`: every velocity setpoint (motion or zero) on the wire; `override_s`:
    when the application was told that someone else took over, None when nobody did; `resumed_s`: when the operator
    started again after that. All on one clock. Raises ValueError when the samples are not in order.
    """
    if any(later.t_s < earlier.t_s for earlier, later in pairwise(samples)):
        raise ValueError("compute: samples must be in the order of t_s")
    times_s = [s.t_s for s in setpoints]
    values: dict[str, float | None] = {
        "final_locked_on_target": picture.final_locked_on_target(samples),
        "lock_share": picture.lock_share(samples),
        "in_picture_share": picture.in_picture_share(samples),
        "honest_lock_share": picture.honest_lock_share(samples),
        "false_confirmed_share": picture.false_confirmed_share(samples),
        "iou_mean": picture.iou_mean(samples),
        **picture.centre_metrics(samples, wanted.focal_px),
        "standoff_err_rms_m": flight.standoff_err_rms_m(samples, wanted.standoff_m),
        "height_err_rms_m": flight.height_err_rms_m(samples, wanted.height_m),
        "bearing_err_rms_deg": flight.bearing_err_rms_deg(samples, wanted.bearing_rad),
        **occlusion_metrics(samples),
        **encounter_metrics(samples),
        "gimbal_cmd_rms_deg_s": flight.gimbal_cmd_rms_deg_s(samples),
        **flight.setpoint_metrics(samples, times_s),
        "commands_after_override": flight.commands_after_override(times_s, override_s, resumed_s),
        "limit_violations": flight.limit_violations(setpoints, wanted.limits),
        "realtime_factor": realtime_factor,
    }
    # The rest (geolocation, delay estimate) needs parts that do not exist yet.
    return {name: _finite(values.get(name)) for name in METRIC_NAMES}


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None
