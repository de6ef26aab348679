"""Trees: trunks and crowns, projected all at once."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sitl.render.projection import View, windows
from sitl.render.surface import COVERED, POINT_SHIFT, Rect, Surface, blend
from sitl.world.solid import Tree

FloatArray = npt.NDArray[np.float64]
ImageU8 = npt.NDArray[np.uint8]

SPRITE_FILL = 0.90  # of the crown's picture is filled: its rim is ragged
TAPER = 0.6  # width of the trunk in the crown, over that at the foot
MOST_PX = 4000.0  # a trunk that would be drawn farther outside is left out


@dataclass(frozen=True, slots=True, eq=False)
class Projected:
    """All trees (N) in one picture.

    Crowns: middles `at` (N, 2), half sizes `reach` (N, 2), windows, whether the camera is `within`. Trunks: `quads`
    (N, 2, 4, 2) in eighths of a pixel, left and right half, and windows. `distance` of the crowns; `crown_seen` and
    `trunk_seen` tell what lies before the camera and in the picture.
    """

    at: FloatArray
    reach: FloatArray
    crown_rects: list[Rect]
    crown_seen: list[bool]
    within: list[bool]
    quads: npt.NDArray[np.int32]
    trunk_rects: list[Rect]
    trunk_seen: list[bool]
    distance: list[float]


class Foliage:
    """The trees of a world."""

    def __init__(self, trees: tuple[Tree, ...]) -> None:
        self._trees = trees
        self._bases = np.array([tree.base for tree in trees]).reshape(-1, 3)
        self._crowns = np.array([tree.crown_centre for tree in trees]).reshape(-1, 3)
        self._radii = np.array([tree.crown_radius_m for tree in trees])
        self._halves = np.array([tree.crown_half_height_m for tree in trees])
        self._trunks = np.array([tree.trunk_radius_m for tree in trees])

    def prepare(self, view: View) -> Projected:
        """Where the trees are in the picture. Values of what is not before the camera mean nothing."""
        tops = self._bases.copy()
        tops[:, 2] = self._crowns[:, 2]
        points = view.to_camera(np.stack([self._bases, tops, self._crowns], axis=1))
        depth = np.maximum(points[..., 2], view.near_m)
        pixels = view.focal_px * points[..., :2] / depth[..., None] + view.middle_px
        across = np.array([math.cos(view.tilt_rad), -math.sin(view.tilt_rad)])
        widths = self._trunks[:, None] * np.array([1.0, TAPER]) * view.focal_px / depth[:, :2]
        steps = np.array([-1.0, 0.0, 1.0])[None, :, None, None] * widths[:, None, :, None] * across
        offset = view.position - self._crowns
        distance = np.maximum(np.linalg.norm(offset, axis=1), view.near_m)
        lift = offset[:, 2] / distance
        apparent = np.sqrt(self._halves**2 * (1 - lift**2) + self._radii**2 * lift**2)
        # A ball's outline is the tangent cone, which is wider than its middle section.
        tangent = np.sqrt(np.maximum(depth[:, 2] ** 2 - 0.5 * self._radii**2, (0.3 * depth[:, 2]) ** 2))
        reach = np.stack([self._radii, apparent], axis=1) * (view.focal_px / SPRITE_FILL / tangent)[:, None]
        flat = np.hypot(offset[:, 0], offset[:, 1]) / self._radii
        within = np.hypot(flat, offset[:, 2] / self._halves) <= 1.0
        edges = pixels[:, None, :2] + steps
        largest = reach.max(axis=1, initial=0.0)[:, None]
        crown_rects = windows(view, pixels[:, 2] - largest, pixels[:, 2] + largest)
        trunk_rects = windows(view, edges.min(axis=(1, 2)) - 1, edges.max(axis=(1, 2)) + 1)
        before = points[..., 2] >= view.near_m
        sane = np.abs(edges).max(axis=(1, 2, 3), initial=0.0) < MOST_PX
        eighths = np.round((np.clip(edges, -MOST_PX, MOST_PX) - 0.5) * (1 << POINT_SHIFT)).astype(np.int32)
        quads = np.ascontiguousarray(np.stack([eighths[:, [k, k + 1, k + 1, k], [0, 0, 1, 1]] for k in (0, 1)], axis=1))
        crown_seen = before[:, 2] & np.array([x1 > x0 and y1 > y0 for x0, y0, x1, y1 in crown_rects], dtype=bool)
        trunk_seen = before[:, :2].all(axis=1) & sane
        return Projected(
            pixels[:, 2], reach, crown_rects, crown_seen.tolist(), within.tolist(), quads, trunk_rects,
            trunk_seen.tolist(), distance.tolist(),
        )  # fmt: skip

    def draw_trunk(self, surface: Surface, seen: Projected, index: int) -> None:
        """The post up to the middle of the crown: its lit half and its dark half."""
        if not seen.trunk_seen[index]:
            return
        haze = surface.haze(seen.distance[index])
        bark, sun_right = self._trees[index].trunk_bgr, surface.sun_right
        for half, side in ((0, -1.0), (1, 1.0)):
            tone = (0.62 + 0.28 * side * sun_right) * (1 - haze)
            colour = [
                float(b * e * tone + f * haze)
                for b, e, f in zip(bark, surface.exposure_bgr, surface.haze_bgr, strict=True)
            ]
            cv2.fillConvexPoly(surface.image, seen.quads[index, half], colour, cv2.LINE_AA, POINT_SHIFT)
        if surface.matters(seen.trunk_rects[index]):
            for quad in seen.quads[index]:
                cv2.fillConvexPoly(surface.ids, quad, 0.0, cv2.LINE_8, POINT_SHIFT)

    def draw_crown(self, surface: Surface, seen: Projected, index: int) -> None:
        """The crown: a picture that always faces the camera, as large as the ellipsoid's outline."""
        tree = self._trees[index]
        if seen.within[index]:
            _fill_with_leaves(surface, tree)
            return
        if not seen.crown_seen[index]:
            return
        rect = seen.crown_rects[index]
        sprite = _sprite(surface.view, tree, seen.at[index], seen.reach[index], rect)
        haze = surface.haze(seen.distance[index])
        if haze > 0:
            sprite = _fogged(surface, sprite, haze)
        x0, y0, x1, y1 = rect
        blend(surface.image[y0:y1, x0:x1], sprite)
        if surface.matters(rect):
            surface.ids[y0:y1, x0:x1][sprite[..., 3] >= COVERED] = 0


def _sprite(view: View, tree: Tree, at: FloatArray, reach: FloatArray, rect: Rect) -> ImageU8:
    level = 0
    while level + 1 < len(tree.sprite) and tree.sprite[level + 1].shape[0] >= 1.6 * float(reach.max()):
        level += 1
    source = tree.sprite[level]
    half = source.shape[0] / 2
    c, s = math.cos(view.tilt_rad), math.sin(view.tilt_rad)
    turn = np.array([[c, -s], [s, c]]) * half / reach[:, None]
    if tree.flip:
        turn[0] *= -1
    x0, y0, x1, y1 = rect
    shift = half - 0.5 + turn @ (np.array([x0 + 0.5, y0 + 0.5]) - at)
    matrix = np.hstack([turn, shift[:, None]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(source, matrix, (x1 - x0, y1 - y0), flags=flags), dtype=np.uint8)


def _fogged(surface: Surface, sprite: ImageU8, haze: float) -> ImageU8:
    """Towards the colour of the haze; the alpha stays."""
    tone = (surface.haze_bgr * haze / 255).tolist()
    mixing = np.diag([1 - haze, 1 - haze, 1 - haze, 1.0])
    mixing[:3, 3] = tone
    return np.asarray(cv2.transform(sprite, mixing), dtype=np.uint8)


def _fill_with_leaves(surface: Surface, tree: Tree) -> None:
    """A camera inside a crown sees leaves only."""
    size = tree.sprite[0].shape[0]
    middle = tree.sprite[0][size // 3 : 2 * size // 3, size // 3 : 2 * size // 3, :3]
    view = surface.view
    surface.image[:] = cv2.resize(middle, (view.width_px, view.height_px), interpolation=cv2.INTER_LINEAR)
    surface.ids[:] = 0
