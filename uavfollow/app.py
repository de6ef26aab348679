"""The whole loop in one place: frame or candidates and telemetry in, one StepRecord out.

`App.step` holds no thread, socket or sleep; live threads, the lockstep simulation and replay only call it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from control.camera import Intrinsics
from control.ego_motion import CameraMotion
from control.frames import GIMBAL_FROM_CAMERA, ned_from_gimbal
from control.gate import has_jumped, telemetry_hold
from control.gimbal import GimbalLaw
from control.guidance.trail import TrailGuidance
from control.limits import VelocityLimiter
from control.messages import CommandReason, GimbalCommand, GimbalState, VehicleState, VelocityCommand
from control.range import NO_RANGE, RangeEstimate, SizeRange, ground_range_m
from tracker.box import Box
from tracker.filter import usable_box
from tracker.loop import remember
from tracker.messages import Candidate, Frame, SearchHint, TargetReason, TargetState, TargetStatus, Tracker
from uavfollow.stopwatch import Stopwatch

log = logging.getLogger(__name__)

MAX_NUDGE_S = 1.0  # a hand on a picture that is older moves another one


class Target(Protocol):
    """What makes candidates into a target state: `tracker.target.TargetTracker` or `tracker.raw.RawTarget`."""

    def start(self, box: Box, t_s: float) -> TargetState:
        """Take a new target."""

    def step(self, candidates: Sequence[Candidate], t_s: float, image_size_px: tuple[float, float]) -> TargetState:
        """Take what was found in one picture."""

    def hint(self, t_s: float | None = None) -> SearchHint | None:
        """Where to search next."""

    def shift(self, dx_px: float, dy_px: float) -> bool:
        """Move the estimate with the picture; whether it was moved."""

    def nudge(self, box: Box, t_s: float) -> TargetState:
        """The operator moves or resizes the box of the live track."""


@dataclass(frozen=True, slots=True)
class Telemetry:
    """What is known of vehicle and gimbal at the time of the frame."""

    vehicle: VehicleState
    gimbal: GimbalState


@dataclass(frozen=True, slots=True, eq=False)
class StepRecord:
    """Everything of one cycle: enough to explain it. `fault` is what went wrong and was survived, None when nothing."""

    seq: int
    t_s: float
    candidates: tuple[Candidate, ...]
    target: TargetState
    telemetry: Telemetry
    range_estimate: RangeEstimate
    gimbal_command: GimbalCommand
    velocity_command: VelocityCommand
    fault: str | None


class App:
    """Tracker, target estimate, gimbal law, guidance and limits, wired in the order of the data.

    `reference_range_m` is what the operator says of the range at a selection, for where the ground does not tell it;
    None: then there is no range, and the vehicle only turns.
    """

    def __init__(
        self,
        tracker: Tracker | None,
        target: Target,
        gimbal_law: GimbalLaw,
        guidance: TrailGuidance,
        limiter: VelocityLimiter,
        intrinsics: Intrinsics,
        reference_range_m: float | None,
        stopwatch: Stopwatch | None = None,
    ) -> None:
        self._tracker = tracker
        self._target = target
        self._gimbal_law = gimbal_law
        self._guidance = guidance
        self._limiter = limiter
        self._intrinsics = intrinsics
        if reference_range_m is not None:
            SizeRange(reference_range_m, 1.0)  # raises ValueError now and not in flight
        self._reference_range_m = reference_range_m
        self._range: SizeRange | None = None
        self._camera_motion = CameraMotion()
        self._vehicle: VehicleState | None = None
        self._last: tuple[TargetState, RangeEstimate] | None = None
        self._stopwatch = stopwatch or Stopwatch()
        self._seq = 0
        self._latency_s = 0.0

    def start(
        self, frame: Frame | None, box: Box, telemetry: Telemetry, now_s: float, t_capture_s: float | None = None
    ) -> StepRecord:
        """Select `box` in `frame` (None when candidates come from elsewhere, exposed at `t_capture_s`).

        The range is then that of flat ground under the box, where attitude, height and gimbal are known and the line is
        steep enough, else the reference range, if there is one. Raises ValueError when it cannot be; what was followed
        before is then followed on.
        """
        t_s = frame.t_capture_s if frame is not None else now_s if t_capture_s is None else t_capture_s
        if not (math.isfinite(t_s) and math.isfinite(now_s) and box.is_valid):
            raise ValueError(f"box {box} at {t_s} s cannot be selected: a number that is not finite, or no size")
        range_m = self._range_on_ground(box, telemetry, now_s) or self._reference_range_m
        size_range = SizeRange(range_m, (box.w_px * box.h_px) ** 0.5) if range_m is not None else None
        if self._tracker is not None and frame is not None:
            with self._stopwatch.section("track"):
                self._tracker.init(frame, box)
        with self._stopwatch.section("filter"):
            target = self._target.start(box, t_s)
            self._range, self._latency_s = size_range, now_s - t_s
            self._reset_laws()
            self._camera_motion.reset()
            self._last = None
            self._follow_camera(telemetry, t_s)
            return self._conclude((), target, telemetry, now_s, [])

    def step(
        self,
        seen: Frame | Sequence[Candidate] | None,
        telemetry: Telemetry,
        now_s: float,
        t_capture_s: float | None = None,
    ) -> StepRecord:
        """One cycle: a frame to search, candidates found elsewhere, or None for a picture that could not be read.

        The target is that of the exposure: `Frame.t_capture_s`; for candidates `t_capture_s`, by default `now_s`; for
        None as long ago as the picture before. So a picture that is old, or the same again, becomes a stale target.

        Never raises for what was seen or measured: an error of the tracker is a step without candidates; one of the
        estimate or of a law is a HOLD of gimbal and vehicle. `fault` says what it was, and the next step goes on.
        """
        faults: list[str] = []
        t_s = self._exposure_s(seen, now_s, t_capture_s)
        self._follow_camera(telemetry, t_s)
        candidates = self._search(seen, t_s, faults)
        with self._stopwatch.section("filter"):
            try:
                size = (float(self._intrinsics.width_px), float(self._intrinsics.height_px))
                target = self._target.step(candidates, t_s, size)
            except Exception as error:  # nothing is known of the target in this step
                faults.append(self._survived("the target estimate", error))
                target = TargetState(t_s, TargetStatus.SEARCHING, TargetReason.FAULT, None, (0.0, 0.0), 0.0, None, 0.0)
            record = self._conclude(candidates, target, telemetry, now_s, faults)
        if isinstance(seen, Frame):
            self._remember(seen, target)
        return record

    def nudge(
        self, frame: Frame | None, move_px: tuple[float, float], resize: tuple[float, float], t_s: float
    ) -> TargetState:
        """The operator moves the box by so many px and resizes it by factors, in the newest picture; the track goes on.

        What is in the new box of `frame` becomes the exemplar (None: candidates come from elsewhere). Raises ValueError
        when there is no track, a number cannot be, or the tracker cannot take the box; all is then as it was.
        """
        if self._last is None or self._last[0].box is None:
            raise ValueError("there is no track to nudge: select a target first")
        if not 0.0 <= t_s - self._last[0].t_s <= MAX_NUDGE_S:
            raise ValueError(f"nudge at {t_s} s: the time must be that of the last picture or soon after")
        if frame is not None and frame.t_capture_s != self._last[0].t_s:
            raise ValueError("nudge: the frame is not the one that the box is of")
        if not (all(math.isfinite(v) for v in move_px) and all(0.1 <= v <= 10.0 for v in resize)):
            raise ValueError(f"nudge by {move_px} px and factors {resize}: must be finite, factors in 0.1..10")
        old = self._last[0].box
        box = Box(old.cx_px + move_px[0], old.cy_px + move_px[1], old.w_px * resize[0], old.h_px * resize[1])
        if not usable_box(box):
            raise ValueError(f"nudge to box {box}: of a size or place that no picture holds")
        if self._tracker is not None and frame is not None:
            self._tracker.init(frame, box)
        state = self._target.nudge(box, t_s)
        if self._range is not None:
            self._range = self._range.resized((resize[0] * resize[1]) ** 0.5)
        self._last = (state, self._last[1])
        return state

    def _remember(self, frame: Frame, target: TargetState) -> None:
        """What the estimate wants kept of this picture, after the command: a failure costs only the memory."""
        try:
            if self._tracker is not None:
                with self._stopwatch.section("track"):
                    remember(self._tracker, frame, target)
        except Exception as error:
            self._survived("the tracker's memory", error)

    def searches(self, t_s: float) -> int:
        """How many windows will be searched in a picture exposed at `t_s`; 1 while nothing is followed."""
        hint = self._target.hint(t_s)
        return 1 if hint is None else min(1 + len(hint.tiles), max(hint.max_calls, 1))

    def searched_px(self, t_s: float) -> tuple[tuple[float, float], ...]:
        """Centres of the windows searched in a picture exposed at `t_s`; empty while nothing is followed."""
        hint = self._target.hint(t_s)
        if hint is None:
            return ()
        return (hint.center_px, *(tile.center_px for tile in hint.tiles[: max(hint.max_calls, 1) - 1]))

    def reset_flight(self) -> None:
        """Limits start from standstill again: the vehicle has not been flying what was decided so far."""
        self._limiter.reset()

    def _follow_camera(self, telemetry: Telemetry, t_s: float) -> None:
        """Move the estimate as far as the camera's own motion since the last exposure moved the picture."""
        before, self._vehicle = self._vehicle, telemetry.vehicle
        if before is not None and has_jumped(before, telemetry.vehicle):
            log.warning("step %d: the vehicle's position or heading jumped; its motion starts anew", self._seq)
            self._camera_motion.reset()
            self._guidance.reset()
        box = self._last[0].box if self._last is not None else None
        range_estimate = self._last[1] if self._last is not None else NO_RANGE
        pixel = (box.cx_px, box.cy_px) if box is not None else None
        try:
            shift = self._camera_motion.step(
                telemetry.vehicle, telemetry.gimbal, t_s, pixel, range_estimate, self._intrinsics
            )
            if shift != (0.0, 0.0):
                self._target.shift(*shift)
        except Exception as error:  # without it the estimate only knows less
            self._survived("ego-motion", error)

    def _range_on_ground(self, box: Box, telemetry: Telemetry, now_s: float) -> float | None:
        vehicle, gimbal = telemetry.vehicle, telemetry.gimbal
        if telemetry_hold(vehicle, gimbal, now_s) is not None:
            return None
        to_ned = ned_from_gimbal(gimbal.pitch_rad, gimbal.yaw_rad, gimbal.frame, vehicle.yaw_rad)
        sight = to_ned @ GIMBAL_FROM_CAMERA @ self._intrinsics.ray(box.cx_px, box.cy_px)
        half_height_rad = box.h_px / 2 / self._intrinsics.fy_px
        return ground_range_m(sight, -vehicle.pos_ned_m[2], half_height_rad)

    def _exposure_s(self, seen: Frame | Sequence[Candidate] | None, now_s: float, t_capture_s: float | None) -> float:
        if seen is None:
            return now_s - self._latency_s if t_capture_s is None else t_capture_s
        if isinstance(seen, Frame):
            t_capture_s = seen.t_capture_s
        elif t_capture_s is None:
            t_capture_s = now_s
        if math.isfinite(now_s - t_capture_s):
            self._latency_s = now_s - t_capture_s
        return t_capture_s

    def _search(self, seen: Frame | Sequence[Candidate] | None, t_s: float, faults: list[str]) -> tuple[Candidate, ...]:
        if seen is None:
            faults.append("the picture could not be read")
            return ()
        try:
            if not isinstance(seen, Frame):
                return tuple(seen)
            with self._stopwatch.section("track"):
                return self._track(seen, t_s, faults)
        except Exception as error:  # one bad frame must not end a flight; the reason is kept and logged
            faults.append(self._survived("the tracker", error))
            return ()

    def _track(self, frame: Frame, t_s: float, faults: list[str]) -> tuple[Candidate, ...]:
        height_px, width_px = frame.image_bgr_u8.shape[:2]
        camera = self._intrinsics
        if self._tracker is None:
            faults.append("a picture came, but there is no tracker to search it")
        elif (width_px, height_px) != (camera.width_px, camera.height_px):
            faults.append(
                f"the picture is {width_px}x{height_px}, the camera was said to give "
                f"{camera.width_px}x{camera.height_px}: its pixels are no angles"
            )
        else:
            return tuple(self._tracker.update(frame, self._target.hint(t_s)))
        return ()

    def _survived(self, what: str, error: Exception) -> str:
        log.warning("step %d: %s failed: %r", self._seq, what, error)
        return f"{what} failed: {error!r}"

    def _reset_laws(self) -> None:
        for law in (self._gimbal_law, self._guidance, self._limiter):
            law.reset()

    def _conclude(
        self,
        candidates: tuple[Candidate, ...],
        target: TargetState,
        telemetry: Telemetry,
        now_s: float,
        faults: list[str],
    ) -> StepRecord:
        try:
            range_estimate, gimbal, velocity = self._decide(target, telemetry, now_s)
        except Exception as error:  # a law that fails commands nothing
            faults.append(self._survived("a control law", error))
            self._reset_laws()
            range_estimate, hold = NO_RANGE, CommandReason.HOLD_FAULT
            gimbal = GimbalCommand(0.0, 0.0, None, None, telemetry.gimbal.frame, now_s, hold)
            velocity = VelocityCommand((0.0, 0.0, 0.0), 0.0, now_s, hold)
        self._last = (target, range_estimate)
        record = StepRecord(
            seq=self._seq,
            t_s=now_s,
            candidates=candidates,
            target=target,
            telemetry=telemetry,
            range_estimate=range_estimate,
            gimbal_command=gimbal,
            velocity_command=velocity,
            fault="; ".join(faults) or None,
        )
        self._seq += 1
        return record

    def _decide(
        self, target: TargetState, telemetry: Telemetry, now_s: float
    ) -> tuple[RangeEstimate, GimbalCommand, VelocityCommand]:
        """Range, gimbal command, and velocity command after the limits."""
        range_estimate = self._range.estimate(target) if self._range is not None else NO_RANGE
        gimbal = self._gimbal_law.step(target, telemetry.gimbal, self._intrinsics, now_s)
        wish = self._guidance.step(target, telemetry.gimbal, self._intrinsics, telemetry.vehicle, range_estimate, now_s)
        return range_estimate, gimbal, self._limiter.step(wish, now_s)
