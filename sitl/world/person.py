"""A walking person: legs, trunk, arms and head, in a few poses of the stride."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache

import numpy as np

from sitl.world.mesh import Colour, FloatArray, Mesh, MeshBuilder
from sitl.world.spec import PersonSpec

POSES = 16  # of one stride; at walking speed each lasts about two frames
STRIDE_M = 1.5  # two steps, for a person of 1.75 m
BUILD_HEIGHT_M = 1.75
TROUSERS: Colour = (78.0, 62.0, 52.0)
SHOES: Colour = (40.0, 38.0, 40.0)
SKIN: Colour = (128.0, 152.0, 196.0)
HAIR: Colour = (36.0, 42.0, 58.0)
HIP_M, SHOULDER_M, NECK_M = 0.88, 1.44, 1.50
SWING_RAD = 0.42


@lru_cache(maxsize=32)  # many worlds are built of few persons
def person_meshes(spec: PersonSpec) -> tuple[Mesh, ...]:
    """The poses of one stride, in order; a standing person is the first."""
    return tuple(_pose(spec, 2 * math.pi * k / POSES) for k in range(POSES))


def pose_index(spec: PersonSpec, travelled_m: float) -> int:
    """Which pose a person has after a way."""
    stride = STRIDE_M * spec.height_m / BUILD_HEIGHT_M
    return math.floor(travelled_m / stride * POSES) % POSES


def _pose(spec: PersonSpec, phase_rad: float) -> Mesh:
    red, green, blue = spec.colour_rgb
    shirt: Colour = (float(blue), float(green), float(red))
    swing = SWING_RAD * math.sin(phase_rad)
    builder = MeshBuilder()
    for side in (-1.0, 1.0):
        foot_x = side * math.sin(swing) * HIP_M
        lift = 0.08 * max(0.0, side * math.cos(phase_rad)) * abs(math.cos(phase_rad))
        _limb(builder, (0.0, side * 0.10, HIP_M), (foot_x, side * 0.10, 0.06 + lift), (0.10, 0.075), TROUSERS)
        builder.end_part(HIP_M / 2)
    # The shoes are drawn with the legs of their side, below them.
    for side in (-1.0, 1.0):
        hand_x = -side * math.sin(swing) * 0.5
        _limb(builder, (0.0, side * 0.26, SHOULDER_M), (hand_x, side * 0.29, 0.86), (0.055, 0.045), shirt)
        builder.end_part(1.15)
    _limb(builder, (0.0, 0.0, HIP_M), (0.0, 0.0, SHOULDER_M + 0.04), (0.155, 0.185), shirt)
    builder.end_part(1.15)
    _limb(builder, (0.0, 0.0, NECK_M - 0.03), (0.02, 0.0, BUILD_HEIGHT_M), (0.085, 0.10), SKIN, HAIR)
    builder.end_part(1.62)
    return builder.build(spec.height_m / BUILD_HEIGHT_M)


def _limb(
    builder: MeshBuilder,
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    radii_m: tuple[float, float],
    colour: Colour,
    top: Colour | None = None,
) -> None:
    """A tapered eight-sided post between two points (x, y, height); rounded off at both ends."""
    a, b = (np.array([p[0], p[1], -p[2]]) for p in (start, end))
    angles = np.arange(8) * (math.pi / 4) + math.pi / 8
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(8)], axis=1)
    stations = [(0.0, 0.55 * radii_m[0]), (0.12, radii_m[0]), (0.85, radii_m[1]), (1.0, 0.55 * radii_m[1])]
    rings = [a + t * (b - a) + ring * r for t, r in stations]
    for i, (low, high) in enumerate(itertools.pairwise(rings)):
        middle = (low.mean(axis=0) + high.mean(axis=0)) / 2
        shade = top if top is not None and i > 0 else colour
        if top is not None and i == 1:
            _head_sides(builder, low, high, middle, colour, top)
            continue
        for k in range(8):
            j = (k + 1) % 8
            quad = np.array([low[k], low[j], high[j], high[k]])
            builder.face(quad, quad.mean(axis=0) - middle, shade)
    builder.face(rings[0], a - b, colour)
    builder.face(rings[-1], b - a, top or colour)


def _head_sides(
    builder: MeshBuilder, low: FloatArray, high: FloatArray, middle: FloatArray, face: Colour, hair: Colour
) -> None:
    """Face in front, hair at the sides and behind."""
    for k in range(8):
        j = (k + 1) % 8
        quad = np.array([low[k], low[j], high[j], high[k]])
        outward = quad.mean(axis=0) - middle
        builder.face(quad, outward, face if outward[0] > 0.03 else hair)
