"""The camera's flight round a mover: slow changes of side, height, distance and place in the picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sitl.scene import CameraModel, CameraPose
from sitl.world.world import World

PICTURE_PX = (640, 480)
STEP_S = 0.15  # between pictures: a target of 16 px moves by less than its size, and 24 pictures differ
HFOV_RAD = (math.radians(35.0), math.radians(85.0))  # tele to wide lens of a gimbal camera
SIZE_PX = (18.0, 150.0)  # of the target, square root of its area, in the middle of the flight; log-uniform
SWING_LOG_SIZE = (0.1, 0.45)  # amplitude of its change
DISTANCE_M = (4.5, 80.0)  # nearer the body fills the picture, farther the haze swallows it
ELEVATION_RAD = (math.radians(12.0), math.radians(75.0))
LEAST_ELEVATION_RAD = math.radians(8.0)
ROUND_RATE_RAD_S = 0.25  # at most, either way
WANDER_SHARE = 0.22  # of the picture's width and height: the target is not kept in the middle
ROLL_RAD = math.radians(6.0)
PERIOD_S = (8.0, 20.0)  # of every swing
CAR_M, PERSON_M = (2.3, 0.75), (0.95, 0.9)  # square root of the area seen, height of the middle (at most)


@dataclass(frozen=True, slots=True)
class _Swing:
    """middle + amplitude sin(2 pi t / period + phase)."""

    middle: float
    amplitude: float
    period_s: float
    phase_rad: float

    def at(self, t_s: float) -> float:
        return self.middle + self.amplitude * math.sin(2 * math.pi * t_s / self.period_s + self.phase_rad)


def _swing(rng: np.random.Generator, middle: float, amplitude: float) -> _Swing:
    return _Swing(middle, amplitude, float(rng.uniform(*PERIOD_S)), float(rng.uniform(0, 2 * math.pi)))


@dataclass(frozen=True, slots=True)
class RoundFlight:
    """Where the camera is when picture `k` is taken. The scene's time then is `begin_s + k STEP_S`."""

    target: str
    camera: CameraModel
    begin_s: float
    is_person: bool
    azimuth_rad: float
    round_rate_rad_s: float
    elevation_rad: _Swing
    log_size_px: _Swing
    right_share: _Swing
    down_share: _Swing
    roll_rad: _Swing

    @classmethod
    def draw(cls, rng: np.random.Generator, target: str, is_person: bool) -> RoundFlight:
        """A flight drawn by `rng`."""
        width, height = PICTURE_PX
        return cls(
            target=target,
            camera=CameraModel(width, height, float(rng.uniform(*HFOV_RAD))),
            begin_s=float(rng.uniform(1.0, 6.0)),
            is_person=is_person,
            azimuth_rad=float(rng.uniform(-math.pi, math.pi)),
            round_rate_rad_s=float(rng.uniform(-ROUND_RATE_RAD_S, ROUND_RATE_RAD_S)),
            elevation_rad=_swing(rng, float(rng.uniform(*ELEVATION_RAD)), math.radians(8.0)),
            log_size_px=_swing(
                rng, float(rng.uniform(math.log(SIZE_PX[0]), math.log(SIZE_PX[1]))), float(rng.uniform(*SWING_LOG_SIZE))
            ),
            right_share=_swing(rng, 0.0, float(rng.uniform(0, WANDER_SHARE))),
            down_share=_swing(rng, 0.0, float(rng.uniform(0, WANDER_SHARE))),
            roll_rad=_swing(rng, 0.0, float(rng.uniform(0, ROLL_RAD))),
        )

    def scene_s(self, k: int) -> float:
        """Time in the world at picture `k`."""
        return self.begin_s + k * STEP_S

    def pose(self, world: World, k: int) -> CameraPose:
        """Pose of the camera at picture `k`."""
        t_s = k * STEP_S
        place = world.placements(self.scene_s(k))[self.target]
        seen_m, middle_m = PERSON_M if self.is_person else CAR_M
        focal_px = self.camera.width_px / 2 / math.tan(self.camera.hfov_rad / 2)
        far_m = min(max(focal_px * seen_m / math.exp(self.log_size_px.at(t_s)), DISTANCE_M[0]), DISTANCE_M[1])
        elevation = max(self.elevation_rad.at(t_s), LEAST_ELEVATION_RAD)
        azimuth = self.azimuth_rad + self.round_rate_rad_s * t_s
        flat_m = far_m * math.cos(elevation)
        position = (
            place.north_m - flat_m * math.cos(azimuth),
            place.east_m - flat_m * math.sin(azimuth),
            -middle_m - far_m * math.sin(elevation),
        )
        yaw = azimuth - math.atan(self.right_share.at(t_s) * self.camera.width_px / focal_px)
        pitch = -elevation + math.atan(self.down_share.at(t_s) * self.camera.height_px / focal_px)
        return CameraPose(position, self.roll_rad.at(t_s), pitch, yaw)
