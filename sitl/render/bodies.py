"""Cars and persons in the picture: their faces, one over the other."""

from __future__ import annotations

from bisect import bisect_left

import cv2
import numpy as np
import numpy.typing as npt

from sitl.render.posed import Posed
from sitl.render.projection import window
from sitl.render.shading import Lit
from sitl.render.surface import Surface, blend, covering
from sitl.world.mesh import Mesh, Part

FloatArray = npt.NDArray[np.float64]
ImageU8 = npt.NDArray[np.uint8]
IndexImage = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

FINE_BELOW_PX, MIDDLE_BELOW_PX = 110.0, 330.0  # sizes up to which a body is drawn 3 and 2 times as large and averaged
MOST_PX = 20000.0  # a corner that would be drawn farther outside is moved there


def draw_body(surface: Surface, body: Posed, lit: Lit) -> int:
    """Draw a body, put its number where it covers, and return how many pixels of the picture it covers."""
    view, mesh = surface.view, body.mesh
    in_camera = view.to_camera(body.corners)
    if float(in_camera[:, 2].min()) < view.near_m:
        return _draw_clipped(surface, body, lit)
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
    drawn = np.clip(((pixels - middle) * shrink + middle - (x0, y0)) * times - 0.5, -MOST_PX, MOST_PX)
    points = np.round(drawn).astype(np.int32)[mesh.outlines]
    patch = _blank(lit, ((y1 - y0) * times, (x1 - x0) * times))
    bounds, faces = mesh.bounds, lit.faces
    for k in _face_order(mesh, lit):
        face = faces[k]
        cv2.fillConvexPoly(patch, points[bounds[face] : bounds[face + 1]], k + 1)
    picture = _coloured(lit, patch)
    if times > 1:
        picture = np.asarray(cv2.resize(picture, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return _put(surface, body, picture, rect)


def _blank(lit: Lit, shape: tuple[int, int]) -> IndexImage:
    """A picture for numbers of faces, 1 for the first of `lit`: one channel is faster to draw in than four."""
    return np.zeros(shape, np.uint8 if len(lit.faces) < 255 else np.uint16)


def _coloured(lit: Lit, numbers: IndexImage) -> ImageU8:
    """Numbers of faces to premultiplied BGRA."""
    palette = np.zeros((len(lit.faces) + 1, 4), np.uint8)
    palette[1:] = lit.colours
    found = palette.view(np.uint32)[:, 0].take(numbers)
    return found.view(np.uint8).reshape(*numbers.shape, 4)


def _put(surface: Surface, body: Posed, patch: ImageU8, rect: tuple[int, int, int, int]) -> int:
    x0, y0, x1, y1 = rect
    blend(surface.image[y0:y1, x0:x1], patch)
    covered = covering(patch)
    cv2.copyTo(np.full_like(covered, body.number), covered, surface.ids[y0:y1, x0:x1])
    return int(cv2.countNonZero(covered))


def _draw_clipped(surface: Surface, body: Posed, lit: Lit) -> int:
    """A body that reaches behind the camera: face by face, cut at the near plane."""
    view = surface.view
    patch = _blank(lit, (view.height_px, view.width_px))
    for k in _face_order(body.mesh, lit):
        polygon = view.polygon(body.corners[body.mesh.faces[lit.faces[k]]])
        if polygon is not None:
            cv2.fillConvexPoly(patch, np.round(polygon - 0.5).astype(np.int32), k + 1)
    return _put(surface, body, _coloured(lit, patch), (0, 0, view.width_px, view.height_px))


def _face_order(mesh: Mesh, lit: Lit) -> list[int]:
    """Places in `lit.faces`, part by part: parts on top of each other from the far one on, so also those abreast.

    Parts one behind the other (a cab and its box) come last in the comparison.
    """
    ahead, right, down = lit.eye

    def nearness(part: Part) -> tuple[float, float, float]:
        aside = round(abs(part.middle[1] - right), 6)  # middles are sums: what is abreast may differ by a rounding
        return -abs(-part.layer_m - down), -aside, -abs(part.middle[0] - ahead)

    order: list[int] = []
    for part in sorted(mesh.parts, key=nearness):
        order += range(bisect_left(lit.faces, part.first), bisect_left(lit.faces, part.last))
    return order
