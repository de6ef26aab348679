"""Shadows that stand still: of houses, bridge and trees on the ground, as factors of the ground's picture."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from sitl.world.canvas import Canvas
from sitl.world.light import Light
from sitl.world.noise import octaves
from sitl.world.solid import FloatArray, ImageU8, Solid, Tree

SKY_BLUE_BGR = (0.90, 0.97, 1.0)  # how much of the missing sun is missed in each channel: shade is bluish
CONTACT_SHARE = 0.30  # light that the foot of a wall takes from the ground beside it
CONTACT_M = 0.7


def shadow_factor(
    canvas: Canvas, light: Light, rng: np.random.Generator, solids: list[Solid], trees: list[Tree]
) -> tuple[npt.NDArray[np.float32], ImageU8]:
    """Factor (rows, columns, 3) of the ground's light, and the share of the sun (255 = all) that reaches it."""
    shade, contact = canvas.blank(), canvas.blank()
    for solid in solids:
        canvas.fill(shade, _hull(solid_shadow(solid, light)), 255)
        if float(solid.centre[2] + solid.half[2]) > -0.01:  # stands on the ground
            canvas.fill(contact, _hull(solid.faces[0].polygon[:, :2], *(f.polygon[:, :2] for f in solid.faces)), 255)
    crowns = canvas.blank()
    for tree in trees:
        _tree_shadow(canvas, light, tree, crowns, shade)
    leaves = octaves(rng, crowns.shape[:2], _leaf_cells(canvas), 0.9)
    soft = cv2.GaussianBlur(crowns, (0, 0), max(0.6, 0.30 / canvas.texel_m)).astype(np.float32) / 255
    dapple = np.clip((soft - 0.45 + 0.2 * np.clip(leaves, -1, 1)) * 4, 0, 0.92)
    walls = cv2.GaussianBlur(shade, (3, 3), 0.6).astype(np.float32) / 255
    missing = np.maximum(dapple, walls)
    near = cv2.GaussianBlur(contact, (0, 0), CONTACT_M / canvas.texel_m).astype(np.float32) / 255
    factor = 1 - light.sun_share * missing[..., None] * np.array(SKY_BLUE_BGR, np.float32)
    factor *= (1 - CONTACT_SHARE * near)[..., None]
    sunlit = cv2.GaussianBlur(1 - missing, (0, 0), max(0.5, 0.5 / canvas.texel_m))
    return factor.astype(np.float32), np.clip(sunlit * 255, 0, 255).astype(np.uint8)


def _leaf_cells(canvas: Canvas) -> tuple[int, ...]:
    side_m = canvas.side_px * canvas.texel_m
    return tuple(min(canvas.side_px, max(2, round(side_m / w))) for w in (2.0, 0.9, 0.45))


def solid_shadow(solid: Solid, light: Light) -> FloatArray:
    """Where the corners' shadows fall: (n, 2) north, east."""
    corners = np.concatenate([face.polygon for face in solid.faces])
    return np.asarray(corners[:, :2] - corners[:, 2:] * np.asarray(light.shadow_per_height))


def _hull(*points: FloatArray) -> list[tuple[float, float]]:
    hull = cv2.convexHull(np.concatenate(points).astype(np.float32))[:, 0]
    return [(float(n), float(e)) for n, e in hull]


def _tree_shadow(canvas: Canvas, light: Light, tree: Tree, crowns: ImageU8, shade: ImageU8) -> None:
    per_height = np.asarray(light.shadow_per_height)
    reach = float(np.linalg.norm(per_height))
    height = -float(tree.crown_centre[2])
    middle = tree.base[:2] + per_height * height
    along = float(np.hypot(tree.crown_radius_m, tree.crown_half_height_m * reach))
    direction = per_height / max(reach, 1e-9)
    across = np.array([-direction[1], direction[0]])
    turns = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ellipse = (
        middle + np.outer(np.cos(turns) * along, direction) + np.outer(np.sin(turns) * tree.crown_radius_m, across)
    )
    canvas.fill(crowns, [(float(n), float(e)) for n, e in ellipse], 255)
    foot = (float(tree.base[0]), float(tree.base[1]))
    canvas.line(shade, (foot, (float(middle[0]), float(middle[1]))), 2 * tree.trunk_radius_m, 255)
