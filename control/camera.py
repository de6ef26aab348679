"""Pinhole camera: pixels to rays and angles of the line of sight, and pixel velocity to angular rate."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tracker.messages import Array

# A ray whose forward share is below this meets the image plane at no useful place (89.9999 degrees off the axis).
MIN_FORWARD = 1e-6


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Focal lengths, principal point and size of the picture, all in continuous pixels (tracker/box.py).

    The lens is taken as free of distortion. Raises ValueError when a focal length or a size is not positive and finite,
    or the principal point lies outside the picture.
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: float
    height_px: float

    def __post_init__(self) -> None:
        for name in ("fx_px", "fy_px", "width_px", "height_px"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"Intrinsics.{name} = {value}: must be finite and above 0")
        for name, size in (("cx_px", self.width_px), ("cy_px", self.height_px)):
            value = getattr(self, name)
            if not 0 <= value <= size:
                raise ValueError(f"Intrinsics.{name} = {value}: must lie in [0, {size}]")

    @classmethod
    def from_hfov(cls, width_px: float, height_px: float, hfov_rad: float) -> Intrinsics:
        """Square pixels, principal point in the middle: f = W / (2 tan(HFOV / 2)).

        >>> round(Intrinsics.from_hfov(640, 360, math.radians(66)).fx_px)
        493
        """
        if not 0 < hfov_rad < math.pi:
            raise ValueError(f"hfov_rad = {hfov_rad}: must lie between 0 and pi")
        focal_px = width_px / (2 * math.tan(hfov_rad / 2))
        return cls(focal_px, focal_px, width_px / 2, height_px / 2, width_px, height_px)

    def ray(self, x_px: float, y_px: float) -> Array:
        """Unit vector (3,) through a pixel, camera axes (x right, y down, z forward)."""
        xn, yn = self._normalized(x_px, y_px)
        return np.array([xn, yn, 1.0]) / math.hypot(xn, yn, 1.0)

    def pixel(self, ray: Array) -> tuple[float, float] | None:
        """Where a vector (3,) in camera axes, of any length, meets the image plane; None beside or behind it."""
        x, y, z = (float(v) for v in ray)
        if not z > MIN_FORWARD * math.hypot(x, y, z):
            return None
        return self.cx_px + self.fx_px * x / z, self.cy_px + self.fy_px * y / z

    def sight_angles(self, x_px: float, y_px: float) -> tuple[float, float]:
        """Azimuth (right +) and elevation (up +) of a pixel's line of sight in the gimbal's axes."""
        xn, yn = self._normalized(x_px, y_px)
        return math.atan(xn), -math.atan2(yn, math.hypot(xn, 1.0))

    def ray_rate(self, x_px: float, y_px: float, vx_px_s: float, vy_px_s: float) -> Array:
        """Time derivative (3,) of `ray` for a point that moves in the picture; camera axes, per second, exact."""
        xn, yn = self._normalized(x_px, y_px)
        xn_s, yn_s = vx_px_s / self.fx_px, vy_px_s / self.fy_px
        norm = math.hypot(xn, yn, 1.0)
        along = (xn * xn_s + yn * yn_s) / norm**2
        return np.array([xn_s - xn * along, yn_s - yn * along, -along]) / norm

    def sight_rate(self, x_px: float, y_px: float, vx_px_s: float, vy_px_s: float) -> tuple[float, float]:
        """Rates (rad/s) of the two `sight_angles`: the exact Jacobian, which is px/f only at the principal point."""
        xn, yn = self._normalized(x_px, y_px)
        xn_s, yn_s = vx_px_s / self.fx_px, vy_px_s / self.fy_px
        plane_sq = 1.0 + xn * xn
        azimuth_rate = xn_s / plane_sq
        elevation_rate = -(yn_s * plane_sq - yn * xn * xn_s) / (math.sqrt(plane_sq) * (plane_sq + yn * yn))
        return azimuth_rate, elevation_rate

    def _normalized(self, x_px: float, y_px: float) -> tuple[float, float]:
        return (x_px - self.cx_px) / self.fx_px, (y_px - self.cy_px) / self.fy_px
