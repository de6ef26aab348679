"""The renderer: a picture of the world from a camera pose, and the truth of everything that moves in it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from sitl.render.backdrop import draw_backdrop
from sitl.render.bodies import draw_body
from sitl.render.faces import Faces, draw_faces
from sitl.render.foliage import Foliage
from sitl.render.order import Boxes, paint_order
from sitl.render.posed import Posed, pose_movers
from sitl.render.post import Post
from sitl.render.projection import View
from sitl.render.shading import Lit, draw_shadows, light_bodies
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
        self._corners = self._boxes.corners()

    def render(self, t_s: float, pose: CameraPose, frame_index: int) -> Picture:
        """Picture and truth at a time; `frame_index` chooses the noise."""
        view = View(self.camera, pose, self.world.scale)
        shape = (self.camera.height_px, self.camera.width_px)
        image, ids = np.zeros((*shape, 4), np.uint8), np.zeros(shape, np.uint8)
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
        view, solids, trees = surface.view, len(self.world.solids), len(self.world.trees)
        first_mover = solids + 2 * trees
        moving = Boxes.stack([body.box for body in movers])
        shown, low, high = _in_picture(np.concatenate([self._corners, moving.corners()], axis=1), view)
        boxes = self._boxes.joined(moving).chosen(shown)
        tracked = np.concatenate([low, high], axis=1)[shown >= first_mover]
        surface = replace(surface, tracked=tuple(tuple(row) for row in tracked.tolist()))
        wanted = np.zeros(solids, dtype=bool)
        wanted[shown[shown < solids]] = True
        faces, seen = self._faces.prepare(view, wanted), self._foliage.prepare(surface)
        lights = self._light(surface, [movers[i] for i in (shown[shown >= first_mover] - first_mover).tolist()])
        covered: dict[int, int] = {}
        numbers = shown.tolist()
        for rank in paint_order(boxes, low, high, view.position):
            index = numbers[rank]
            if index < solids:
                draw_faces(surface, faces.get(index, []), surface.haze(math.dist(boxes.centre[rank], view.position)))
            elif index < solids + trees:
                self._foliage.draw_trunk(surface, seen, index - solids)
            elif index < first_mover:
                self._foliage.draw_crown(surface, seen, index - solids - trees)
            else:
                body = movers[index - first_mover]
                covered[body.number] = draw_body(surface, body, lights[body.number])
        return covered

    def _light(self, surface: Surface, bodies: list[Posed]) -> dict[int, Lit]:
        """Draw the shadows of bodies; light on them by their numbers."""
        lights = light_bodies(surface, bodies, self.world.ground)
        draw_shadows(surface, bodies, lights)
        return {body.number: light for body, light in zip(bodies, lights, strict=True)}


def _tree_boxes(tree: Tree) -> list[tuple[FloatArray, FloatArray, float]]:
    """Boxes of trunk and crown; the trunk's ends where the crown begins."""
    bottom, radius = tree.crown_bottom_m, tree.trunk_radius_m
    trunk = (tree.base - np.array([0, 0, bottom / 2]), np.array([radius, radius, bottom / 2]), 0.0)
    crown = np.array([tree.crown_radius_m, tree.crown_radius_m, tree.crown_half_height_m])
    return [trunk, (tree.crown_centre, crown, 0.0)]


def _in_picture(corners: FloatArray, view: View) -> tuple[npt.NDArray[np.intp], FloatArray, FloatArray]:
    """Indices of the boxes (8, N, 3) that may be seen, with the corners of their pictures (n, 2)."""
    in_camera = view.to_camera(corners)
    x, y, depth = in_camera.transpose(2, 0, 1)
    nearest = depth.min(axis=0)
    share = view.focal_px / np.maximum(depth, view.near_m)
    x, y = share * x + view.middle_px[0], share * y + view.middle_px[1]
    # What reaches behind the camera may be anywhere in the picture.
    partly = nearest < view.near_m
    left, right = np.where(partly, 0.0, x.min(axis=0)), np.where(partly, view.width_px, x.max(axis=0))
    top, bottom = np.where(partly, 0.0, y.min(axis=0)), np.where(partly, view.height_px, y.max(axis=0))
    seen = (depth.max(axis=0) >= view.near_m) & (left < view.width_px) & (top < view.height_px)
    seen &= (right > 0) & (bottom > 0) & (np.maximum(right - left, bottom - top) >= LEAST_PX)
    seen &= view.may_see(in_camera)
    shown = np.nonzero(seen)[0]
    return shown, np.stack([left, top], axis=1)[shown], np.stack([right, bottom], axis=1)[shown]


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
