"""Light on cars and persons: the colours of their faces, and their shadows on the ground."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sitl.render.posed import Posed
from sitl.render.projection import windows
from sitl.render.surface import POINT_SHIFT, Rect, Surface
from sitl.world.ground import Ground

FloatArray = npt.NDArray[np.float64]
ImageU8 = npt.NDArray[np.uint8]

CONTACT_SHARE = 0.52  # light that is missing under a car besides the sun
SOFT_M = 0.05  # half-shade around a shadow
SKY_BGR = np.array([216.0, 196.0, 176.0])  # what glass and paint mirror


@dataclass(frozen=True, slots=True, eq=False)
class Lit:
    """A body's faces as they are seen: the eye in body axes, and which faces look at it, in rising order.

    `colours` (n, 4) are those of these faces, the fourth channel is 255. `sunlit` is the share of the sun that reaches
    the body.
    """

    eye: tuple[float, float, float]
    faces: list[int]
    colours: ImageU8
    sunlit: float


def light_bodies(surface: Surface, bodies: list[Posed], ground: Ground) -> list[Lit]:
    """Sun, sky, a mirrored sky on paint and glass, and haze, for all bodies at once."""
    if not bodies:
        return []
    meshes = [body.mesh for body in bodies]
    counts = [len(mesh.offsets) for mesh in meshes]
    turns = np.array([body.turn for body in bodies])
    eyes = (turns @ (surface.view.position - np.array([body.origin for body in bodies]))[..., None])[..., 0]
    distances = np.sqrt((eyes * eyes).sum(axis=1))
    sunlit = np.array([ground.sunlit_at(body.placement.north_m, body.placement.east_m) for body in bodies])
    towards = np.concatenate([mesh.normals @ eye for mesh, eye in zip(meshes, eyes, strict=True)])
    faces = np.nonzero(towards > np.concatenate([mesh.offsets for mesh in meshes]))[0]
    owner = np.repeat(np.arange(len(bodies)), counts)[faces]
    look = np.concatenate([mesh.look for mesh in meshes])[faces]  # normal, colour, gloss
    normals, colours, gloss = look[:, :3], look[:, 3:6], look[:, 6]
    distance = np.maximum(distances, 1e-9)
    strength, sky = _mirrored(normals, towards[faces] / distance[owner], (eyes[:, 2] / distance)[owner])
    share = np.minimum(gloss * strength, 0.8) * (0.55 + 0.45 * sunlit)[owner]
    tone = surface.light.shade(_turned(normals, turns[owner]), sunlit[owner])[:, None] * colours
    tone = tone * (1 - share)[:, None] + (share * sky)[:, None] * SKY_BGR
    haze = np.array([surface.haze(value) for value in distances.tolist()])[owner, None]
    rows = np.full((len(tone), 4), 255.0)
    rows[:, :3] = tone * surface.exposure_bgr * (1 - haze) + haze * surface.haze_bgr
    shades = np.rint(np.minimum(np.maximum(rows, 0.0), 255.0)).astype(np.uint8)
    firsts = np.cumsum([0, *counts])
    ends = np.searchsorted(faces, firsts).tolist()
    numbers = (faces - firsts[owner]).tolist()
    return [
        Lit((x, y, z), numbers[a:b], shades[a:b], sun)
        for (x, y, z), (a, b), sun in zip(eyes.tolist(), itertools.pairwise(ends), sunlit.tolist(), strict=True)
    ]


def _mirrored(normals: FloatArray, facing: FloatArray, down: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Strength of the mirrored light for gloss 1, and its brightness: what points up shows the sky, else the ground.

    `facing` is the cosine between normal and the direction to the eye, `down` that direction's down component.
    """
    facing = np.minimum(np.maximum(facing, 0.0), 1.0)
    up = down - 2 * facing * normals[:, 2]
    miss = 1 - facing
    return 0.7 + 1.6 * miss * miss * miss, np.minimum(np.maximum(0.45 + 0.6 * up, 0.12), 1.0)


def _turned(normals: FloatArray, turns: FloatArray) -> FloatArray:
    """Directions (n, 3) in body axes to NED; turns (n, 3, 3) are those of their bodies."""
    c, s = turns[:, 0, 0], turns[:, 0, 1]
    x, y, z = normals.T
    return np.stack([x * c - y * s, x * s + y * c, z], axis=1)


def draw_shadows(surface: Surface, bodies: list[Posed], lit: list[Lit]) -> None:
    """Darken the ground under bodies and where their shadows fall; a body in the shade throws none."""
    if not bodies:
        return
    view = surface.view
    falls = np.array([*surface.light.shadow_per_height, 1.0])
    counts = [len(points) for body in bodies for points in (body.corners, body.mesh.foot)]
    points = [part for body in bodies for part in (body.corners, body.mesh.foot @ body.turn + body.origin)]
    flat = np.concatenate(points)
    flat -= flat[:, 2:] * falls
    in_camera = view.to_camera(flat)
    starts = np.cumsum([0, *counts])
    depth = in_camera[:, 2]
    nearest = np.minimum.reduceat(depth, starts[:-1:2])
    middle = np.add.reduceat(depth, starts[:-1:2]) / np.add.reduceat(counts, np.arange(0, len(counts), 2))
    in_camera[:, 2] = np.maximum(depth, view.near_m)
    pixels = view.pixels(in_camera)
    low, high = np.minimum.reduceat(pixels, starts[:-1:2]), np.maximum.reduceat(pixels, starts[:-1:2])
    seen = (nearest >= view.near_m) & (np.maximum(-low, high).max(axis=1) <= 4 * view.width_px)
    soft = np.maximum(1.0, SOFT_M * surface.scale * view.focal_px / np.maximum(middle, view.near_m))
    rects = windows(view, low - 3 * soft[:, None], high + 3 * soft[:, None])
    for k in np.nonzero(seen)[0].tolist():
        shade = 1 - surface.light.sun_share * lit[k].sunlit
        a, b, c = starts[2 * k : 2 * k + 3].tolist()
        _darken(surface, rects[k], float(soft[k]), ((pixels[a:b], shade), (pixels[b:c], shade * (1 - CONTACT_SHARE))))


def _darken(surface: Surface, rect: Rect, soft: float, outlines: Sequence[tuple[FloatArray, float]]) -> None:
    """Multiply the picture with values inside of the hulls of points, the later ones over the former, softened."""
    x0, y0, x1, y1 = rect
    if x1 <= x0 or y1 <= y0:
        return
    mask = np.full((y1 - y0, x1 - x0), 255, np.uint8)
    for outline, value in outlines:
        hull = cv2.convexHull((outline - (x0 + 0.5, y0 + 0.5)).astype(np.float32))
        points = np.round(hull * (1 << POINT_SHIFT)).astype(np.int32)
        cv2.fillConvexPoly(mask, points, 255.0 * value, cv2.LINE_8, POINT_SHIFT)
    size = 2 * round(1.5 * soft) + 1
    mask = np.asarray(cv2.GaussianBlur(mask, (size, size), soft), dtype=np.uint8)
    part = surface.image[y0:y1, x0:x1]
    cv2.multiply(part, cv2.cvtColor(mask, cv2.COLOR_GRAY2BGRA), part, 1 / 255)
