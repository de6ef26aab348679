"""Trees: where trunk and crown are, and pictures of crowns."""

from __future__ import annotations

import math

import cv2
import numpy as np

from sitl.world.light import Light
from sitl.world.noise import octaves, pyramid
from sitl.world.solid import ImageU8, Tree
from sitl.world.spec import TreeSpec

SPRITE_PX = 192
VARIANTS = 6
CLUMPS = 420  # tufts of leaves of one crown
LEAVES_BGR = ((40, 92, 70), (46, 104, 84), (38, 78, 56), (54, 110, 100), (44, 84, 78))
TRUNK_BGR = (62.0, 78.0, 92.0)
TRUNK_SHARE = 0.032  # radius over height
LEAST_STEM_M = 1.6  # free trunk below the crown


def trunk_radius_m(spec: TreeSpec) -> float:
    """Radius of the trunk at the foot."""
    return TRUNK_SHARE * spec.height_m


def make_tree(spec: TreeSpec, sprite: tuple[ImageU8, ...], flip: bool) -> Tree:
    """A tree of a specification with one of the crowns' pictures."""
    half = min(0.48 * spec.crown_m, max(0.25 * spec.height_m, (spec.height_m - LEAST_STEM_M) / 2))
    centre = np.array([spec.north_m, spec.east_m, -(spec.height_m - half)])
    base = np.array([spec.north_m, spec.east_m, 0.0])
    return Tree(base, trunk_radius_m(spec), centre, spec.crown_m / 2, half, TRUNK_BGR, sprite, flip)


def crown_sprites(light: Light, rng: np.random.Generator) -> list[tuple[ImageU8, ...]]:
    """Levels of premultiplied BGRA pictures, one list entry for each variant."""
    return [pyramid(_crown(light, rng, LEAVES_BGR[i % len(LEAVES_BGR)])) for i in range(VARIANTS)]


def _crown(light: Light, rng: np.random.Generator, leaf_bgr: tuple[int, int, int]) -> ImageU8:
    size = SPRITE_PX
    image = np.zeros((size, size, 4), np.uint8)
    base = np.asarray(leaf_bgr, np.float64) * rng.uniform(0.9, 1.12, 3) * light.exposure_bgr
    centre = (size // 2, size // 2)
    core = tuple(float(v) for v in base * 0.34)
    cv2.circle(image, centre, round(0.40 * size), (*core, 255.0), -1)
    for x, y, depth, radius, tone in _clumps(rng):
        colour = tuple(float(v) for v in np.clip(base * tone, 0, 255))
        at = (round(size * (0.5 + 0.5 * x)), round(size * (0.5 + 0.5 * y)))
        cv2.circle(image, at, max(1, round(size * radius * (0.9 + 0.1 * depth))), (*colour, 255.0), -1)
    coarse = octaves(rng, (size, size), (24, 48, 96, 192), 0.95)[..., None]
    fine = 1 + 0.24 * coarse
    image[..., :3] = np.clip(image[..., :3] * fine, 0, 255)
    ragged = (octaves(rng, (size, size), (40, 80, 160), 0.9) > -1.15).astype(np.uint8) * 255
    rim = cv2.circle(np.zeros((size, size), np.uint8), centre, round(0.37 * size), 255, -1)
    holes = cv2.bitwise_not(cv2.bitwise_or(ragged, rim))
    image[holes > 0] = 0
    return np.asarray(cv2.GaussianBlur(image, (3, 3), 0.5), dtype=np.uint8)


def _clumps(rng: np.random.Generator) -> list[tuple[float, float, float, float, float]]:
    """Tufts back to front as (x, y, depth, radius, tone), seen from the side and above; the light comes from above."""
    directions = rng.standard_normal((CLUMPS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lumps = rng.standard_normal((7, 3))
    lumps /= np.linalg.norm(lumps, axis=1, keepdims=True)
    # Boughs stand out of the round: the nearer to one, the farther from the middle.
    bough = np.max(directions @ lumps.T, axis=1)
    reach = (0.70 + 0.18 * np.clip(bough, 0, 1) ** 2) * rng.uniform(0.9, 1.04, CLUMPS)
    points = directions * reach[:, None]
    tilt = math.radians(35)
    up = points[:, 2] * math.cos(tilt) - points[:, 1] * math.sin(tilt)
    depth = points[:, 1] * math.cos(tilt) + points[:, 2] * math.sin(tilt)
    light = 0.5 + 0.5 * directions[:, 2]
    tone = (0.42 + 0.85 * light**1.4) * (0.78 + 0.3 * np.clip(bough, 0, 1)) * rng.uniform(0.82, 1.18, CLUMPS)
    radius = rng.uniform(0.028, 0.062, CLUMPS)
    order = np.argsort(depth)
    return [(float(points[i, 0]), float(-up[i]), float(depth[i]), float(radius[i]), float(tone[i])) for i in order]
