"""Where a thing that stands still goes in the picture when the camera moves: turns of the gimbal, way of the vehicle.

The estimate of a target is moved by this between two exposures. What is left to its velocity is then the target's own
motion, which goes on behind an occluder, and not the camera's, which may stop there.
"""

from __future__ import annotations

import math

import numpy as np

from control.camera import Intrinsics
from control.frames import GIMBAL_FROM_CAMERA, ned_from_gimbal
from control.gate import all_finite
from control.messages import GimbalState, VehicleState
from control.range import RangeEstimate

# Reports further from the exposure than this say where the camera pointed at another time (mavlink.md, 5).
MAX_MISMATCH_S = 0.15
# Exposures further apart than this are no pair: too much may have happened in between.
MAX_PAIR_S = 1.0
# No gimbal follows a target faster than this (100 deg/s); a greater shift means that one of the two attitudes is wrong.
MAX_TURN_RAD_S = 1.75


class CameraMotion:
    """Holds where the camera was at the last exposure. No state of the target."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the last exposure."""
        self._last: tuple[float, VehicleState, GimbalState] | None = None

    def step(
        self,
        vehicle: VehicleState,
        gimbal: GimbalState,
        t_s: float,
        pixel: tuple[float, float] | None,
        range_estimate: RangeEstimate,
        intrinsics: Intrinsics,
    ) -> tuple[float, float]:
        """Shift in pixels (right, down) of a still thing at `pixel` of the last exposure to the one at `t_s`.

        `range_estimate` is that of the thing; without one only the turn counts. (0, 0) without a pixel, or when the
        telemetry of either exposure is not valid, not finite or not of its time.
        """
        if self._last is not None and t_s <= self._last[0]:  # the motion since then was told already
            return 0.0, 0.0
        last, self._last = self._last, self._usable(vehicle, gimbal, t_s)
        if last is None or self._last is None or pixel is None or not 0 < t_s - last[0] <= MAX_PAIR_S:
            return 0.0, 0.0
        ray = _ned_from_camera(last[1], last[2]) @ intrinsics.ray(*pixel)
        way = np.array(vehicle.pos_ned_m) - np.array(last[1].pos_ned_m)
        if range_estimate.valid and last[1].position_valid and vehicle.position_valid and all_finite(*way):
            ray = ray * range_estimate.range_m - way
        moved = intrinsics.pixel(_ned_from_camera(vehicle, gimbal).T @ ray)
        if moved is None:
            return 0.0, 0.0
        shift = (moved[0] - pixel[0], moved[1] - pixel[1])
        # Off the axis a turn moves the picture by up to twice as much (at 45 degrees).
        limit_px = 2.0 * MAX_TURN_RAD_S * (t_s - last[0]) * intrinsics.fx_px
        return shift if math.hypot(*shift) <= limit_px else (0.0, 0.0)

    @staticmethod
    def _usable(
        vehicle: VehicleState, gimbal: GimbalState, t_s: float
    ) -> tuple[float, VehicleState, GimbalState] | None:
        if not (vehicle.attitude_valid and gimbal.valid):
            return None
        values = (t_s, vehicle.t_s, gimbal.t_s, vehicle.yaw_rad, gimbal.pitch_rad, gimbal.yaw_rad)
        if not all_finite(*values) or max(abs(vehicle.t_s - t_s), abs(gimbal.t_s - t_s)) > MAX_MISMATCH_S:
            return None
        return t_s, vehicle, gimbal


def _ned_from_camera(vehicle: VehicleState, gimbal: GimbalState) -> np.ndarray:
    return ned_from_gimbal(gimbal.pitch_rad, gimbal.yaw_rad, gimbal.frame, vehicle.yaw_rad) @ GIMBAL_FROM_CAMERA
