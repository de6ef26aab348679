"""What all road vehicles are made of: colours, gloss, wheels."""

from __future__ import annotations

import math

import numpy as np

from sitl.world.mesh import Colour, MeshBuilder

GLASS: Colour = (62.0, 52.0, 44.0)
TRIM: Colour = (42.0, 42.0, 42.0)
TYRE: Colour = (34.0, 33.0, 32.0)
HUB: Colour = (150.0, 150.0, 150.0)
HEADLAMP: Colour = (235.0, 235.0, 228.0)
TAIL_LAMP: Colour = (36.0, 28.0, 176.0)
PLATE: Colour = (215.0, 222.0, 222.0)
PAINT_GLOSS, GLASS_GLOSS = 0.16, 0.32
WHEEL_RADIUS_M = 0.32
WHEEL_CORNERS = 10
ARCH_M = 0.06  # dark gap around a tyre
HUB_SHARE = 0.59375  # of the wheel's radius: 19 cm on a car


def add_wheel(builder: MeshBuilder, x_m: float, y_m: float, side: float, radius_m: float = WHEEL_RADIUS_M) -> None:
    """A wheel as discs on the body's side (`side` +1 right, -1 left), standing on the ground."""
    angles = np.arange(WHEEL_CORNERS) * (2 * math.pi / WHEEL_CORNERS)
    ring = np.stack([np.cos(angles), np.zeros_like(angles), np.sin(angles)], axis=1)
    outward = np.array([0.0, side, 0.0])
    middle = np.array([x_m, y_m, -radius_m])
    # Dark arch behind the tyre, moved up: below the hub the tyre stands free.
    arch = middle + ring * (radius_m + ARCH_M)
    arch[:, 2] = np.minimum(arch[:, 2], -0.2)
    builder.face(arch, outward, TRIM, decal=True)
    builder.face(middle + ring * radius_m, outward, TYRE, decal=True)
    builder.face(middle + ring * (HUB_SHARE * radius_m), outward, HUB, 0.1, decal=True)
