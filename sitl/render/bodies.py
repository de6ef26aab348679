"""Cars and persons in the picture: their shadows on the ground, their faces in the light."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sitl.render.projection import window
from sitl.render.surface import COVERED, Surface, blend
from sitl.world.ground import Ground
from sitl.world.mesh import Mesh, Part
from sitl.world.motion import Placement
from sitl.world.world import World

FloatArray = npt.NDArray[np.float64]
ImageU8 = npt.NDArray[np.uint8]

FINE_BELOW_PX, MIDDLE_BELOW_PX = 110.0, 330.0  # sizes up to which a body is drawn 3 and 2 times as large and averaged
CONTACT_SHARE = 0.52  # light that is missing under a car besides the sun
SKY_BGR = np.array([216.0, 196.0, 176.0])  # what glass and paint mirror


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """A mover at one time: body, place, and its corners in NED (V, 3)."""

    name: str
    number: int
    placement: Placement
    mesh: Mesh
    corners: FloatArray
    origin: FloatArray  # NED (3,)
    middle: FloatArray  # of the upright box, NED (3,)
    half: FloatArray  # its half sizes, along its own axes
    turn: FloatArray  # (3, 3): body coordinates @ turn = NED directions

    @property
    def box(self) -> tuple[FloatArray, FloatArray, float]:
        """Middle (NED), half sizes and yaw of its upright box."""
        return self.middle, self.half, self.placement.yaw_rad

    def to_ned(self, points: FloatArray) -> FloatArray:
        """Body coordinates (n, 3) to NED."""
        return points @ self.turn + self.origin

    def to_body(self, points: FloatArray) -> FloatArray:
        """NED (3,) or (n, 3) to body coordinates."""
        return np.asarray((points - self.origin) @ self.turn.T)


def pose_movers(world: World, t_s: float) -> list[Posed]:
    """All cars and persons at a time, numbered from 1."""
    placements = world.placements(t_s)
    posed = []
    for number, mover in enumerate(world.movers, start=1):
        placement = placements[mover.name]
        mesh = mover.mesh_at(placement, world.scale)
        c, s = math.cos(placement.yaw_rad), math.sin(placement.yaw_rad)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        origin = np.array([placement.north_m, placement.east_m, 0.0])
        middle = (mesh.low + mesh.high) / 2 @ turn + origin
        half = (mesh.high - mesh.low) / 2
        corners = mesh.vertices @ turn + origin
        posed.append(Posed(mover.name, number, placement, mesh, corners, origin, middle, half, turn))
    return posed


def draw_shadow(surface: Surface, body: Posed, ground: Ground) -> None:
    """Darken the ground under a body and where its shadow falls; a body in the shade throws none."""
    view = surface.view
    sunlit = ground.sunlit_at(body.placement.north_m, body.placement.east_m)
    flat = body.corners.copy()
    flat[:, :2] -= body.corners[:, 2:] * np.asarray(surface.light.shadow_per_height)
    flat[:, 2] = 0.0
    foot = body.corners.copy()
    foot[:, 2] = 0.0
    both = view.to_camera(np.stack([flat, foot]))
    if float(both[..., 2].min()) < view.near_m:
        return
    pixels = view.pixels(both)
    if float(np.abs(pixels).max()) > 4 * view.width_px:
        return
    soft = max(1.0, 0.05 * surface.scale * view.focal_px / float(both[..., 2].mean()))
    rect = window(view, pixels.min(axis=(0, 1)) - 3 * soft, pixels.max(axis=(0, 1)) + 3 * soft)
    if rect is None:
        return
    x0, y0, x1, y1 = rect
    mask = np.full((y1 - y0, x1 - x0), 255, np.uint8)
    shade = 1 - surface.light.sun_share * sunlit
    for outline, value in ((pixels[0], shade), (pixels[1], shade * (1 - CONTACT_SHARE))):
        hull = cv2.convexHull((outline - (x0 + 0.5, y0 + 0.5)).astype(np.float32))
        points = np.round(hull * 8).astype(np.int32)
        cv2.fillConvexPoly(mask, points, 255.0 * value, cv2.LINE_8, 3)
    size = 2 * round(1.5 * soft) + 1
    mask = np.asarray(cv2.GaussianBlur(mask, (size, size), soft), dtype=np.uint8)
    part = surface.image[y0:y1, x0:x1]
    cv2.multiply(part, cv2.cvtColor(mask, cv2.COLOR_GRAY2BGR), part, 1 / 255)


def draw_body(surface: Surface, body: Posed, ground: Ground) -> int:
    """Draw a body, put its number where it covers, and return how many pixels of the picture it covers."""
    view = surface.view
    in_camera = view.to_camera(body.corners)
    near = float(in_camera[:, 2].min())
    eye = body.to_body(view.position)
    visible = body.mesh.normals @ eye > body.mesh.offsets
    colours = _colours(surface, body, eye, ground)
    if near < view.near_m:
        return _draw_clipped(surface, body, visible, eye, colours)
    pixels = view.pixels(in_camera)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    rect = window(view, low, high)
    if rect is None:
        return 0
    x0, y0, x1, y1 = rect
    size = float((high - low).max())
    times = 3 if size < FINE_BELOW_PX else 2 if size < MIDDLE_BELOW_PX else 1
    # cv2 fills the border as well, half a pixel too much: the body is drawn that much smaller.
    shrink = 1 - 1 / np.maximum((high - low) * times, 2.0)
    middle = (low + high) / 2
    drawn = np.clip(((pixels - middle) * shrink + middle - (x0, y0)) * times - 0.5, -20000, 20000)
    points = np.round(drawn).astype(np.int32)
    patch = np.zeros(((y1 - y0) * times, (x1 - x0) * times, 4), np.uint8)
    faces = body.mesh.faces
    for index in _face_order(body.mesh, eye, visible):
        cv2.fillConvexPoly(patch, points[faces[index]], colours[index])
    if times > 1:
        patch = np.asarray(cv2.resize(patch, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return _put(surface, body, patch, rect)


def _put(surface: Surface, body: Posed, patch: ImageU8, rect: tuple[int, int, int, int]) -> int:
    x0, y0, x1, y1 = rect
    blend(surface.image[y0:y1, x0:x1], patch)
    covered = patch[..., 3] >= COVERED
    surface.ids[y0:y1, x0:x1][covered] = body.number
    return int(np.count_nonzero(covered))


def _draw_clipped(
    surface: Surface, body: Posed, visible: npt.NDArray[np.bool_], eye: FloatArray, colours: list[tuple[float, ...]]
) -> int:
    """A body that reaches behind the camera: face by face, cut at the near plane."""
    view = surface.view
    patch = np.zeros((view.height_px, view.width_px, 4), np.uint8)
    for index in _face_order(body.mesh, eye, visible):
        polygon = view.polygon(body.corners[body.mesh.faces[index]])
        if polygon is not None:
            cv2.fillConvexPoly(patch, np.round(polygon - 0.5).astype(np.int32), colours[index])
    return _put(surface, body, patch, (0, 0, view.width_px, view.height_px))


def _face_order(mesh: Mesh, eye: FloatArray, visible: npt.NDArray[np.bool_]) -> list[int]:
    """Visible faces, part by part: parts that stand on each other from the far one on, so also those side by side."""

    def nearness(part: Part) -> tuple[float, float]:
        return -abs(-part.layer_m - float(eye[2])), -abs(part.middle[1] - float(eye[1]))

    shown = visible.tolist()
    order: list[int] = []
    for part in sorted(mesh.parts, key=nearness):
        order += [i for i in range(part.first, part.last) if shown[i]]
    return order


def _colours(surface: Surface, body: Posed, eye: FloatArray, ground: Ground) -> list[tuple[float, ...]]:
    """Colour (B, G, R, 255) of each face: sun, sky, a mirrored sky on paint and glass, haze."""
    mesh, light = body.mesh, surface.light
    sunlit = ground.sunlit_at(body.placement.north_m, body.placement.east_m)
    normals = mesh.normals @ body.turn
    tone = light.shade(normals, sunlit)[:, None] * mesh.colours
    view_direction = eye / max(float(np.linalg.norm(eye)), 1e-9)
    facing = np.clip(mesh.normals @ view_direction, 0, 1)
    # Mirrored ray: what points up shows the sky, what points down the ground.
    mirrored_up = np.clip(-(2 * facing * mesh.normals[:, 2] - view_direction[2]), -1, 1)
    sky = np.clip(0.45 + 0.6 * mirrored_up, 0.12, 1.0)
    mirror = mesh.gloss * (0.7 + 1.6 * (1 - facing) ** 3)
    mirror = np.minimum(mirror, 0.8)[:, None] * (0.55 + 0.45 * sunlit)
    tone = tone * (1 - mirror) + mirror * sky[:, None] * SKY_BGR
    tone = tone * surface.exposure_bgr
    haze = surface.haze(float(np.linalg.norm(eye)))
    if haze > 0:
        tone = tone * (1 - haze) + haze * surface.haze_bgr
    rows = np.clip(tone, 0, 255).tolist()
    return [(row[0], row[1], row[2], 255.0) for row in rows]
