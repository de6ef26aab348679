"""What a run notes of each processed picture, with the truth beside it: the only input of the metrics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sitl.scene import ObjectTruth, Vector
from tracker.box import Box

LOCKED = "LOCKED"
IDLE = "IDLE"
HALF = 0.5


@dataclass(frozen=True, slots=True)
class Sample:
    """One processed picture. Times in seconds of the run, NED metres, radians; pixels as in tracker/box.py.

    `t_s` is the exposure and `now_s` when the commands were made. `status`, `reason`, `box` are the application's word
    on the target at the exposure; `truth` is that of the target in the same picture (None: no picture, as while it is
    black, when the target counts as hidden). `aim_px` is where the target is to be held in the picture.

    `command_*` is the velocity command of the step, `command_sent` whether it went to the wire as a setpoint,
    `following` whether following was engaged. `gimbal_*_rate_rad_s` is the commanded rate. Places and velocities are
    true ones, at the exposure.
    """

    t_s: float
    now_s: float
    status: str
    reason: str
    box: Box | None
    truth: ObjectTruth | None
    aim_px: tuple[float, float]
    following: bool
    command_v_ned_m_s: Vector
    command_yaw_rate_rad_s: float
    command_reason: str
    command_sent: bool
    gimbal_pitch_rate_rad_s: float
    gimbal_yaw_rate_rad_s: float
    gimbal_reason: str
    vehicle_pos_ned_m: Vector
    vehicle_vel_ned_m_s: Vector
    vehicle_yaw_rad: float
    target_pos_ned_m: Vector
    target_vel_ned_m_s: Vector

    @property
    def visibility(self) -> float:
        """Visible share of the target, 0 without a picture."""
        return 0.0 if self.truth is None else self.truth.visibility

    @property
    def in_picture(self) -> bool:
        """Whether half of the target's box or more lies inside the picture, covered or not; False without a picture."""
        truth = self.truth
        return truth is not None and truth.amodal is not None and truth.truncation < HALF

    @property
    def iou(self) -> float:
        """Overlap of the reported box with the whole silhouette; 0 when either is missing."""
        if self.box is None or self.truth is None or self.truth.amodal is None:
            return 0.0
        return self.box.iou(self.truth.amodal)


@dataclass(frozen=True, slots=True)
class Setpoint:
    """A velocity setpoint as it was on the wire, `t_s` when the autopilot read it."""

    t_s: float
    v_ned_m_s: Vector
    yaw_rate_rad_s: float


def since_selection(samples: Sequence[Sample]) -> Sequence[Sample]:
    """From the first sample on whose status is not IDLE."""
    for index, sample in enumerate(samples):
        if sample.status != IDLE:
            return samples[index:]
    return ()


def since_lock(samples: Sequence[Sample]) -> Sequence[Sample]:
    """From the first LOCKED sample on."""
    for index, sample in enumerate(samples):
        if sample.status == LOCKED:
            return samples[index:]
    return ()
