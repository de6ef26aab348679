"""The renderer: a picture of the world from a camera pose, and the truth of everything that moves in it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from sitl.render.backdrop import draw_backdrop
from sitl.render.bodies import Posed, draw_body, draw_shadow, pose_movers
from sitl.render.faces import Faces, draw_faces
from sitl.render.foliage import Foliage
from sitl.render.order import Boxes, paint_order
from sitl.render.post import Post
from sitl.render.projection import View
from sitl.render.surface import Surface
from sitl.render.truth import Outline, outlines
from sitl.scene import CameraModel, CameraPose, ObjectTruth
from sitl.world.solid import Tree
from sitl.world.world import World
from tracker.box import Box

FloatArray = npt.NDArray[np.float64]
ImageU8 = npt.NDArray[np.uint8]

LEAST_PX = 0.7  # smaller things are not drawn


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A picture (H, W, 3) BGR and the truth of every car and person of the world, by name."""

    image_bgr_u8: ImageU8
    truths: dict[str, ObjectTruth]


class Renderer:
    """Draws a world for one camera. The same arguments give the same bytes, whatever was drawn before.

    Works for every finite pose: under the ground the picture is dark and nothing is seen, inside of a house its walls
    are.
    """

    def __init__(self, world: World, camera: CameraModel, seed: int) -> None:
        self.world, self.camera = world, camera
        self._post = Post(camera, seed, world.is_mirrored, world.scale)
        self._faces, self._foliage = Faces(world.solids), Foliage(world.trees)
        # Order of the things: solids, trunks, crowns, movers.
        boxes = [(s.centre, s.half, s.yaw_rad) for s in world.solids]
        pairs = [_tree_boxes(tree) for tree in world.trees]
        self._boxes = Boxes.stack([*boxes, *(p[0] for p in pairs), *(p[1] for p in pairs)])

    def render(self, t_s: float, pose: CameraPose, frame_index: int) -> Picture:
        """Picture and truth at a time; `frame_index` chooses the noise."""
        view = View(self.camera, pose, self.world.scale)
        shape = (self.camera.height_px, self.camera.width_px)
        image, ids = np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.uint8)
        movers = pose_movers(self.world, t_s)
        draw_backdrop(image, view, self.world.ground, self.world.light, self.world.scale)
        surface = Surface.new(image, ids, view, self.world.light, self.world.scale)
        covered = self.draw_things(surface, movers) if view.height_m > 0 else {}
        truths = {
            body.name: _truth(surface, body, outline, covered.get(body.number, 0))
            for body, outline in zip(movers, outlines(view, movers), strict=True)
        }
        return Picture(self._post.apply(image, view, pose, frame_index), truths)

    def draw_things(self, surface: Surface, movers: list[Posed]) -> dict[int, int]:
        """Draw everything that stands on the ground, far things first; pixels that each mover covers."""
        view, ground = surface.view, self.world.ground
        boxes = self._boxes.joined(Boxes.stack([body.box for body in movers]))
        shown, low, high = _in_picture(boxes, view)
        solids, trees = len(self.world.solids), len(self.world.trees)
        first_mover = solids + 2 * trees
        tracked = np.concatenate([low, high], axis=1)[shown >= first_mover]
        surface = replace(surface, tracked=tuple(tuple(row) for row in tracked.tolist()))
        wanted = np.zeros(solids, dtype=bool)
        wanted[shown[shown < solids]] = True
        faces, seen = self._faces.prepare(view, wanted), self._foliage.prepare(view)
        for index in shown[shown >= first_mover]:
            draw_shadow(surface, movers[index - first_mover], ground)
        covered: dict[int, int] = {}
        kept = Boxes(boxes.centre[shown], boxes.half[shown], boxes.yaw[shown])
        for rank in paint_order(kept, low, high, view.position):
            index = int(shown[rank])
            if index < solids:
                distance = float(np.linalg.norm(boxes.centre[index] - view.position))
                draw_faces(surface, faces.get(index, []), surface.haze(distance))
            elif index < solids + trees:
                self._foliage.draw_trunk(surface, seen, index - solids)
            elif index < first_mover:
                self._foliage.draw_crown(surface, seen, index - solids - trees)
            else:
                body = movers[index - first_mover]
                covered[body.number] = draw_body(surface, body, ground)
        return covered


def _tree_boxes(tree: Tree) -> list[tuple[FloatArray, FloatArray, float]]:
    """Boxes of trunk and crown; the trunk's ends where the crown begins."""
    bottom, radius = tree.crown_bottom_m, tree.trunk_radius_m
    trunk = (tree.base - np.array([0, 0, bottom / 2]), np.array([radius, radius, bottom / 2]), 0.0)
    crown = np.array([tree.crown_radius_m, tree.crown_radius_m, tree.crown_half_height_m])
    return [trunk, (tree.crown_centre, crown, 0.0)]


def _in_picture(boxes: Boxes, view: View) -> tuple[npt.NDArray[np.intp], FloatArray, FloatArray]:
    """Indices of the boxes that may be seen, with the corners of their pictures (n, 2)."""
    corners = view.to_camera(boxes.corners())
    depth = corners[..., 2]
    near = depth < view.near_m
    size = np.array([view.width_px, view.height_px])
    pixels = view.focal_px * corners[..., :2] / np.maximum(depth, view.near_m)[..., None] + view.middle_px
    low, high = pixels.min(axis=1), pixels.max(axis=1)
    # What reaches behind the camera may be anywhere in the picture.
    partly = near.any(axis=1)
    low[partly], high[partly] = 0.0, size
    seen = ~near.all(axis=1) & (low < size).all(axis=1) & (high > 0).all(axis=1)
    seen &= (high - low).max(axis=1) >= LEAST_PX
    shown = np.nonzero(seen)[0]
    return shown, low[shown], high[shown]


def _truth(surface: Surface, body: Posed, outline: Outline, covered: int) -> ObjectTruth:
    if not covered:
        return outline.truth(None, 0.0)
    view = surface.view
    x0, y0, x1, y1 = 0, 0, view.width_px, view.height_px
    if outline.inner is not None:  # look only where it can be
        left, top, right, bottom = outline.inner.to_corners()
        x0, y0 = max(0, math.floor(left) - 1), max(0, math.floor(top) - 1)
        x1, y1 = math.ceil(right) + 1, math.ceil(bottom) + 1
    mask = cv2.inRange(surface.ids[y0:y1, x0:x1], np.array(body.number), np.array(body.number))
    seen = cv2.countNonZero(mask)
    if not seen:
        return outline.truth(None, 0.0)
    x, y, width, height = cv2.boundingRect(mask)
    visible = Box.from_xywh(float(x0 + x), float(y0 + y), float(width), float(height))
    return outline.truth(visible, min(1.0, seen / covered))
