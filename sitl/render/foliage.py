"""Trees: trunks and crowns, projected all at once."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sitl.render.projection import View, windows
from sitl.render.surface import POINT_SHIFT, Rect, Surface, blend, covering
from sitl.world.solid import Tree

FloatArray = npt.NDArray[np.float64]
ImageU8 = npt.NDArray[np.uint8]

SPRITE_FILL = 0.90  # of the crown's picture is filled: its rim is ragged
TAPER = 0.6  # width of the trunk in the crown, over that at the foot
MOST_PX = 4000.0  # a trunk that would be drawn farther outside is left out


@dataclass(frozen=True, slots=True, eq=False)
class Projected:
    """All trees (N) in one picture.

    Crowns: windows, the pictures' levels, affine maps (N, 2, 3) from pixels of the windows to texels, whether the
    camera is `within`. Trunks: `quads` (N, 2, 4, 2) in eighths of a pixel and `tones` (N, 2, 3), left and right half,
    and windows. `haze` of each; `crown_seen` and `trunk_seen` tell what lies before the camera and in the picture.
    """

    crown_rects: list[Rect]
    levels: list[int]
    maps: FloatArray
    crown_seen: list[bool]
    within: list[bool]
    quads: npt.NDArray[np.int32]
    tones: list[list[list[float]]]
    trunk_rects: list[Rect]
    trunk_seen: list[bool]
    haze: list[float]


class Foliage:
    """The trees of a world."""

    def __init__(self, trees: tuple[Tree, ...]) -> None:
        self._trees = trees
        self._bases = np.array([tree.base for tree in trees]).reshape(-1, 3)
        self._crowns = np.array([tree.crown_centre for tree in trees]).reshape(-1, 3)
        tops = self._bases.copy()
        tops[:, 2] = self._crowns[:, 2]
        self._points = np.stack([self._bases, tops, self._crowns])
        self._radii = np.array([tree.crown_radius_m for tree in trees])
        self._halves = np.array([tree.crown_half_height_m for tree in trees])
        self._trunks = np.array([tree.trunk_radius_m for tree in trees])
        self._bark = np.array([tree.trunk_bgr for tree in trees]).reshape(-1, 3)
        self._flips = np.array([-1.0 if tree.flip else 1.0 for tree in trees])
        # Every crown's picture has the same size; sizes of its levels.
        self._sizes = np.array([level.shape[0] for level in trees[0].sprite]) if trees else np.ones(1, dtype=int)

    def prepare(self, surface: Surface) -> Projected:
        """Where the trees are in the picture. Values of what is not before the camera mean nothing."""
        view = surface.view
        points = view.to_camera(self._points)
        before = points[..., 2] >= view.near_m
        depth = np.maximum(points[..., 2], view.near_m)
        pixels = view.focal_px * points[..., :2] / depth[..., None] + view.middle_px
        offset = view.position - self._crowns
        distance = np.maximum(np.sqrt((offset * offset).sum(axis=1)), view.near_m)
        reach = self._reach(view, offset[:, 2] / distance, depth[2])
        c, s = abs(math.cos(view.tilt_rad)), abs(math.sin(view.tilt_rad))
        extent = reach @ np.array([[c, s], [s, c]])  # half sizes of a rectangle around the turned picture
        crown_rects = windows(view, pixels[2] - extent, pixels[2] + extent)
        levels, maps = self._textures(view, pixels[2], reach, crown_rects)
        flat = np.hypot(offset[:, 0], offset[:, 1]) / self._radii
        within = np.hypot(flat, offset[:, 2] / self._halves) <= 1.0
        crown_seen = before[2] & np.array([x1 > x0 and y1 > y0 for x0, y0, x1, y1 in crown_rects], dtype=bool)
        quads, trunk_rects, sane = self._posts(view, pixels[:2], depth[:2])
        haze = np.array([surface.haze(value) for value in distance.tolist()])
        sides = 0.62 + 0.28 * np.array([-1.0, 1.0]) * surface.sun_right
        lit = self._bark[:, None] * surface.exposure_bgr * sides[:, None]
        tones = lit + haze[:, None, None] * (surface.haze_bgr - lit)
        return Projected(
            crown_rects, levels.tolist(), maps, crown_seen.tolist(), within.tolist(), quads, tones.tolist(),
            trunk_rects, (before[0] & before[1] & sane).tolist(), haze.tolist(),
        )  # fmt: skip

    def _reach(self, view: View, lift: FloatArray, depth: FloatArray) -> FloatArray:
        """Half sizes (N, 2) of the crowns' pictures; `lift` is the down component of the direction to the camera."""
        apparent = np.sqrt(self._halves**2 * (1 - lift**2) + self._radii**2 * lift**2)
        # A ball's outline is the tangent cone, which is wider than its middle section.
        tangent = np.sqrt(np.maximum(depth**2 - 0.5 * self._radii**2, (0.3 * depth) ** 2))
        return np.stack([self._radii, apparent], axis=1) * (view.focal_px / SPRITE_FILL / tangent)[:, None]

    def _textures(
        self, view: View, at: FloatArray, reach: FloatArray, rects: list[Rect]
    ) -> tuple[npt.NDArray[np.intp], FloatArray]:
        """Level of each crown's picture and the map from the window's pixels to its texels."""
        least = 1.6 * reach.max(axis=1, initial=0.0)
        levels = np.maximum((self._sizes[1:, None] >= least).sum(axis=0), 0)
        half = self._sizes[levels] / 2
        c, s = math.cos(view.tilt_rad), math.sin(view.tilt_rad)
        maps = np.empty((len(at), 2, 3))
        maps[:, 0, :2] = (self._flips * half / reach[:, 0])[:, None] * np.array([c, -s])
        maps[:, 1, :2] = (half / reach[:, 1])[:, None] * np.array([s, c])
        corner = np.array([rect[:2] for rect in rects], dtype=np.float64).reshape(-1, 2) + 0.5 - at
        maps[:, :, 2] = (half - 0.5)[:, None] + (maps[:, :, :2] * corner[:, None]).sum(axis=2)
        return levels, maps

    def _posts(
        self, view: View, ends: FloatArray, depth: FloatArray
    ) -> tuple[npt.NDArray[np.int32], list[Rect], npt.NDArray[np.bool_]]:
        """Quads and windows of the trunks from the pixels of foot and top (2, N, 2), and which can be drawn."""
        across = np.array([math.cos(view.tilt_rad), -math.sin(view.tilt_rad)])
        widths = self._trunks * np.array([[1.0], [TAPER]]) * view.focal_px / depth
        steps = np.array([-1.0, 0.0, 1.0])[:, None, None, None] * widths[..., None] * across
        edges = ends + steps  # left, middle, right; foot, top
        low, high = edges.min(axis=(0, 1)), edges.max(axis=(0, 1))
        rects = windows(view, low - 1, high + 1)
        sane = np.maximum(-low, high).max(axis=1, initial=0.0) < MOST_PX
        eighths = np.round((np.clip(edges, -MOST_PX, MOST_PX) - 0.5) * (1 << POINT_SHIFT)).astype(np.int32)
        left, right = eighths[[0, 1, 1, 0], [0, 0, 1, 1]], eighths[[1, 2, 2, 1], [0, 0, 1, 1]]
        return np.ascontiguousarray(np.stack([left, right]).transpose(2, 0, 1, 3)), rects, sane

    def draw_trunk(self, surface: Surface, seen: Projected, index: int) -> None:
        """The post up to the middle of the crown: its lit half and its dark half."""
        if not seen.trunk_seen[index]:
            return
        for quad, tone in zip(seen.quads[index], seen.tones[index], strict=True):
            cv2.fillConvexPoly(surface.image, quad, tone, cv2.LINE_AA, POINT_SHIFT)
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
        rect = x0, y0, x1, y1 = seen.crown_rects[index]
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        source = tree.sprite[seen.levels[index]]
        sprite: ImageU8 = np.asarray(
            cv2.warpAffine(source, seen.maps[index], (x1 - x0, y1 - y0), flags=flags), dtype=np.uint8
        )
        if seen.haze[index] > 0:
            sprite = _fogged(surface, sprite, seen.haze[index])
        blend(surface.image[y0:y1, x0:x1], sprite)
        if surface.matters(rect):
            part = surface.ids[y0:y1, x0:x1]
            cv2.bitwise_and(part, cv2.bitwise_not(covering(sprite)), part)


def _fogged(surface: Surface, sprite: ImageU8, haze: float) -> ImageU8:
    """Towards the colour of the haze; the alpha stays."""
    tone = (surface.haze_bgr * haze / 255).tolist()
    mixing = np.diag([1 - haze, 1 - haze, 1 - haze, 1.0])
    mixing[:3, 3] = tone
    return np.asarray(cv2.transform(sprite, mixing), dtype=np.uint8)


def _fill_with_leaves(surface: Surface, tree: Tree) -> None:
    """A camera inside a crown sees leaves only."""
    size = tree.sprite[0].shape[0]
    middle = tree.sprite[0][size // 3 : 2 * size // 3, size // 3 : 2 * size // 3]
    view = surface.view
    surface.image[:] = cv2.resize(middle, (view.width_px, view.height_px), interpolation=cv2.INTER_LINEAR)
    surface.ids[:] = 0
