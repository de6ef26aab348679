"""The day's light: where the sun is, how strong, of which colour; drawn once for a world."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

SUN_ELEVATION_RAD = (0.65, 1.05)  # 37 to 60 degrees: long enough shadows to be seen, short enough not to rule
SUN_SHARE = (0.5, 0.62)  # of the light on flat ground; the rest is sky
GAIN = (1.18, 1.38)  # exposure of the camera: albedos are taken as measured, and cameras expose brightly
TINT = 0.03  # white balance error of each channel


@dataclass(frozen=True, slots=True)
class Light:
    """`to_sun` is the unit vector towards the sun (NED); flat ground in the open gets light 1 from sun and sky."""

    to_sun: tuple[float, float, float]
    sun_share: float
    gain: float
    tint_bgr: tuple[float, float, float]
    haze_bgr: tuple[float, float, float]
    zenith_bgr: tuple[float, float, float]

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Light:
        """A fair day drawn by `rng`."""
        elevation, azimuth = rng.uniform(*SUN_ELEVATION_RAD), rng.uniform(0, 2 * math.pi)
        flat = math.cos(elevation)
        gain = float(rng.uniform(*GAIN))
        tint = tuple(float(v) for v in 1 + rng.uniform(-TINT, TINT, 3))
        return cls(
            (flat * math.cos(azimuth), flat * math.sin(azimuth), -math.sin(elevation)),
            float(rng.uniform(*SUN_SHARE)),
            gain,
            (tint[0], tint[1], tint[2]),
            (206.0, 201.0, 194.0),
            (196.0, 152.0, 104.0),
        )

    def mapped(self, mirror: bool) -> Light:
        """The light of the mirrored world."""
        n, e, d = self.to_sun
        return replace(self, to_sun=(n, -e, d)) if mirror else self

    @property
    def shadow_per_height(self) -> tuple[float, float]:
        """Where the shadow of a point one metre high falls: (north, east) metres from its foot."""
        n, e, d = self.to_sun
        return n / d, e / d

    @property
    def exposure_bgr(self) -> FloatArray:
        """Factor from albedo in light 1 to the picture's numbers, by channel."""
        return self.gain * np.asarray(self.tint_bgr)

    def shade(self, normals: FloatArray, sunlit: float | FloatArray = 1.0) -> FloatArray:
        """Light (N,) on faces with outward normals (N, 3) NED.

        `sunlit` (one for all, or (N,)) is the share of the sun that is not shaded.
        """
        up = -normals[:, 2]
        sky = (1 - self.sun_share) * (0.72 + 0.28 * up)  # a wall sees half of the sky and some light off the ground
        sun = self.sun_share / -self.to_sun[2] * np.maximum(normals @ np.asarray(self.to_sun), 0.0)
        return np.asarray(sky + sunlit * sun)
