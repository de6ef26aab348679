"""Good inputs for the laws, from which a test changes the one thing it is about, and plants to close a loop over."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from control.camera import Intrinsics
from control.frames import GIMBAL_FROM_CAMERA, direction_from_angles, gimbal_rotation, ned_from_gimbal
from control.gimbal import GimbalLaw
from control.messages import GimbalCommand, GimbalFrame, GimbalState, VehicleState
from tracker.box import Box
from tracker.messages import TargetReason, TargetState, TargetStatus

CAMERA = Intrinsics.from_hfov(640, 360, math.radians(66))
CENTRE = (CAMERA.cx_px, CAMERA.cy_px)
NOW_S = 100.0


def target(x_px: float = CENTRE[0], y_px: float = CENTRE[1], **changes) -> TargetState:
    values = {
        "t_s": NOW_S,
        "status": TargetStatus.LOCKED,
        "reason": TargetReason.SEEN,
        "box": Box(x_px, y_px, 40.0, 40.0),
        "vel_px_s": (0.0, 0.0),
        "growth_per_s": 0.0,
        "cov": np.diag([1.0, 1.0, 1e-4, 1e-4]),
        "confidence": 0.9,
    }
    return TargetState(**(values | changes))


def gimbal(pitch_rad: float = 0.0, yaw_rad: float = 0.0, **changes) -> GimbalState:
    values = {"t_s": NOW_S, "frame": GimbalFrame.VEHICLE, "valid": True, "source": "test"}
    return GimbalState(pitch_rad=pitch_rad, yaw_rad=yaw_rad, **(values | changes))


def vehicle(yaw_rad: float = 0.0, **changes) -> VehicleState:
    values = {
        "t_s": NOW_S,
        "roll_rad": 0.0,
        "pitch_rad": 0.0,
        "pos_ned_m": (0.0, 0.0, -10.0),
        "vel_ned_m_s": (0.0, 0.0, 0.0),
        "attitude_valid": True,
        "position_valid": True,
        "source": "test",
    }
    return VehicleState(yaw_rad=yaw_rad, **(values | changes))


def pixel_of(azimuth_rad: float, elevation_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float] | None:
    """Where a direction of the base appears in a camera that points to pitch and yaw."""
    in_gimbal = gimbal_rotation(pitch_rad, yaw_rad).T @ direction_from_angles(azimuth_rad, elevation_rad)
    return CAMERA.pixel(GIMBAL_FROM_CAMERA.T @ in_gimbal)


def pixel_of_ned(offset_ned_m, state: GimbalState, vehicle_yaw_rad: float) -> tuple[float, float] | None:
    """Where a point of the world, relative to the camera, appears."""
    to_ned = ned_from_gimbal(state.pitch_rad, state.yaw_rad, state.frame, vehicle_yaw_rad)
    return CAMERA.pixel((to_ned @ GIMBAL_FROM_CAMERA).T @ np.asarray(offset_ned_m, dtype=float))


@dataclass
class GimbalLoop:
    """The law around an integrator with a pure delay, stepped at 1 kHz; the camera sees at `rate_hz`, without noise.

    The target is at `azimuth_of(t)`, `elevation_of(t)` in the base. With `give_camera_rate` the law is told how fast
    the camera turns, and the true pixel velocity; else it must find the rate itself and the pixel velocity is nonsense.
    """

    law: GimbalLaw
    delay_s: float = 0.15
    rate_hz: int = 20
    give_camera_rate: bool = False
    report_hz: int | None = None  # None: a report with every frame
    state: GimbalState | None = None
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    drive_by_angle: bool = False
    azimuth_of: callable = lambda t: 0.0
    elevation_of: callable = lambda t: 0.0
    times_s: list = field(default_factory=list)
    error_px: list = field(default_factory=list)
    yaws_rad: list = field(default_factory=list)
    commands: list = field(default_factory=list)

    def run(self, duration_s: float, step_s: float = 0.001) -> None:
        ticks, per_frame = round(duration_s / step_s), round(1 / (self.rate_hz * step_s))
        pipe: deque[GimbalCommand | None] = deque([None] * round(self.delay_s / step_s))
        command, moving = None, None
        for tick in range(ticks):
            t_s = tick * step_s
            pixel = self._pixel(t_s)
            self.times_s.append(t_s)
            self.error_px.append(math.hypot(pixel[0] - CENTRE[0], pixel[1] - CENTRE[1]))
            self.yaws_rad.append(self.yaw_rad)
            if tick % per_frame == 0:
                command = self._decide(pixel, moving, t_s)
                self.commands.append(command)
            pipe.append(command)
            moving = pipe.popleft()
            self._move(moving, step_s)

    def _decide(self, pixel: tuple[float, float], moving: GimbalCommand | None, t_s: float) -> GimbalCommand:
        if self.state is None or self.report_hz is None or t_s - self.state.t_s > 1 / self.report_hz - 1e-6:
            self.state = gimbal(self.pitch_rad, self.yaw_rad, t_s=t_s)
        state = self.state
        if not self.give_camera_rate:
            return self.law.step(target(*pixel, vel_px_s=(777.0, -777.0), t_s=t_s), state, CAMERA, t_s)
        rate = (moving.pitch_rate_rad_s, moving.yaw_rate_rad_s) if moving else (0.0, 0.0)
        h = 1e-4
        pitch_rad, yaw_rad = self.pitch_rad + rate[0] * h, self.yaw_rad + rate[1] * h
        soon = pixel_of(self.azimuth_of(t_s + h), self.elevation_of(t_s + h), pitch_rad, yaw_rad)
        velocity = ((soon[0] - pixel[0]) / h, (soon[1] - pixel[1]) / h)
        return self.law.step(target(*pixel, vel_px_s=velocity, t_s=t_s), state, CAMERA, t_s, rate)

    def _pixel(self, t_s: float) -> tuple[float, float]:
        pixel = pixel_of(self.azimuth_of(t_s), self.elevation_of(t_s), self.pitch_rad, self.yaw_rad)
        return pixel if pixel is not None else (1e4, CENTRE[1])

    def _move(self, command: GimbalCommand | None, step_s: float) -> None:
        if command is None:
            return
        if self.drive_by_angle:  # a servo of 0.1 s towards the commanded angle
            self.pitch_rad += (command.pitch_rad - self.pitch_rad) * step_s / 0.1
            self.yaw_rad += math.remainder(command.yaw_rad - self.yaw_rad, math.tau) * step_s / 0.1
        else:
            self.pitch_rad += command.pitch_rate_rad_s * step_s
            self.yaw_rad += command.yaw_rate_rad_s * step_s
