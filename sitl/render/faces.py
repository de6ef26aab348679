"""Textured faces of the solids, projected all at once."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sitl.render.projection import GUARD_PX, View, windows
from sitl.render.surface import POINT_SHIFT, Rect, Surface
from sitl.world.solid import Solid, TexturedFace

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]
ImageU8 = npt.NDArray[np.uint8]

FLAT_BELOW_PX = 5  # a face that small gets its mean colour
SHARPNESS = 0.1  # levels finer than the mean of a pixel's two footprints
TOUCHING = 1e-6  # of the size of a solid: what is nearer counts as on its surface
LEAST_DETERMINANT = 1e-12  # a face seen edge-on has no inverse


@dataclass(frozen=True, slots=True, eq=False)
class FaceJob:
    """One face ready to be drawn: window, corners relative to it (eighths of a pixel), texel of each of its pixels."""

    rect: Rect
    points: npt.NDArray[np.int32]
    matrix: FloatArray
    picture: ImageU8
    mean: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Outlines:
    """Projected faces (N): corners `pixels` (4, N, 2), their bounds (N, 2), and the outlines of those that were cut."""

    pixels: FloatArray
    low: FloatArray
    high: FloatArray
    cut: dict[int, FloatArray | None]


class Faces:
    """The faces of all solids of a world; `prepare` projects those that are seen."""

    def __init__(self, solids: tuple[Solid, ...]) -> None:
        faces = [face for solid in solids for face in solid.faces]
        self._solids = solids
        self._levels = [face.levels for face in faces]
        self._means = [tuple(face.levels[-1].reshape(-1, 4).mean(axis=0).tolist()) for face in faces]
        self._counts = np.array([len(levels) for levels in self._levels], dtype=int)
        self._owner = np.array([i for i, solid in enumerate(solids) for _ in solid.faces], dtype=int)
        # Triangles repeat their last corner. Corners come first: numpy is slow along short last axes.
        polygons = np.array([face.polygon[[0, 1, 2, min(3, len(face.polygon) - 1)]] for face in faces])
        self._polygons = np.ascontiguousarray(polygons.reshape(-1, 4, 3).transpose(1, 0, 2))
        self._middles = self._polygons.mean(axis=0)
        self._normals = np.array([face.normal for face in faces]).reshape(-1, 3)
        self._offsets = (self._polygons[0] * self._normals).sum(axis=1)
        self._frames = np.array([np.stack([face.u, face.v, face.origin], axis=1) for face in faces])
        self._texels = np.array([float(np.linalg.norm(face.u)) for face in faces])
        self._within = np.array(_around(faces, solids), dtype=int)

    def prepare(self, view: View, shown: BoolArray) -> dict[int, list[FaceJob]]:
        """Jobs of the faces that look at the camera, by solid; `shown` (solids,) tells which may be in the picture."""
        jobs: dict[int, list[FaceJob]] = {}
        index = self._facing(view, shown)
        in_camera = view.to_camera(self._polygons[:, index])
        kept = view.may_see(in_camera)
        index, in_camera = index[kept], in_camera[:, kept]
        if not len(index):
            return jobs
        outlines = self._project(view, index, in_camera)
        rects = windows(view, outlines.low, outlines.high)
        inside = np.array([k for k, (x0, y0, x1, y1) in enumerate(rects) if x1 > x0 and y1 > y0], dtype=np.intp)
        if not len(inside):
            return jobs
        corner = np.array(rects, dtype=np.float64)[:, :2] + 0.5
        matrices, levels, usable = self._textures(view, index[inside], corner[inside])
        clipped = np.clip(outlines.pixels, -GUARD_PX, GUARD_PX) - corner
        points = np.round(clipped.transpose(1, 0, 2) * (1 << POINT_SHIFT)).astype(np.int32, order="C")
        owners = self._owner[index].tolist()
        for n, k in enumerate(inside.tolist()):
            outline = points[k]
            if k in outlines.cut:
                cut = outlines.cut[k]
                if cut is None:
                    continue
                outline = np.round((cut - corner[k]) * (1 << POINT_SHIFT)).astype(np.int32, order="C")
            if usable[n]:
                face = int(index[k])
                job = FaceJob(rects[k], outline, matrices[n], self._levels[face][levels[n]], self._means[face])
                jobs.setdefault(owners[k], []).append(job)
        return jobs

    def _project(self, view: View, index: IndexArray, corners: FloatArray) -> _Outlines:
        """Pixels of faces, of which the corners (4, N, 3) are given in camera coordinates."""
        depth = corners[..., 2]
        near = depth.min(axis=0) < view.near_m
        pixels = view.focal_px * corners[..., :2] / np.maximum(depth, view.near_m)[..., None] + view.middle_px
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        far = near | (low < -GUARD_PX).any(axis=1) | (high > GUARD_PX).any(axis=1)
        cut: dict[int, FloatArray | None] = {}
        for k in np.nonzero(far)[0].tolist():
            outline = view.polygon(self._polygons[:, index[k]])
            cut[k] = outline
            if outline is not None:
                low[k], high[k] = outline.min(axis=0), outline.max(axis=0)
        return _Outlines(pixels, low, high, cut)

    def _facing(self, view: View, shown: BoolArray) -> IndexArray:
        """Faces of shown solids that look at the camera; of a solid around the camera, the others."""
        if not len(self._owner):
            return np.zeros(0, dtype=np.intp)
        facing = self._normals @ view.position > self._offsets
        sides = facing & (self._within < 0)
        for i in np.nonzero(shown)[0].tolist():
            solid = self._solids[i]
            if bool((solid.normals @ view.position <= solid.offsets).all()):
                sides |= facing & (self._within == i)
                sides[self._owner == i] = True
        return np.nonzero(sides & shown[self._owner])[0]

    def _textures(
        self, view: View, index: IndexArray, corner: FloatArray
    ) -> tuple[FloatArray, list[int], npt.NDArray[np.bool_]]:
        """Homographies to texels of the level that fits, the levels, and whether there is a homography.

        They start from the pixels of windows whose first pixels have their middles at `corner`.
        """
        frames = self._frames[index]
        frames[:, :, 2] -= view.position
        to_pixels = (view.matrix @ view.axes) @ frames
        usable = np.abs(np.linalg.det(to_pixels)) > LEAST_DETERMINANT * self._texels[index] ** 3
        to_pixels[~usable] = np.eye(3)
        matrices = np.linalg.inv(to_pixels)
        middles = self._middles[index] - view.position
        distance = np.maximum(np.sqrt((middles * middles).sum(axis=1)), view.near_m)
        lean = np.maximum(np.abs((self._normals[index] * middles).sum(axis=1)) / distance, 0.05)
        footprint = distance / view.focal_px / np.sqrt(lean)
        wanted = np.floor(np.log2(footprint / self._texels[index]) + 0.5 - SHARPNESS).astype(int)
        levels = np.clip(wanted, 0, self._counts[index] - 1)
        matrices[:, :2] *= (0.5**levels)[:, None, None]
        matrices[:, :, 2] += matrices[:, :, 0] * corner[:, :1] + matrices[:, :, 1] * corner[:, 1:]
        matrices[:, :2] -= 0.5 * matrices[:, 2:]
        return matrices, levels.tolist(), usable


def _around(faces: list[TexturedFace], solids: tuple[Solid, ...]) -> list[int]:
    """For each face the solid that hides it from everywhere outside of that solid (a ceiling's roof), -1 for none."""
    centres = np.array([solid.centre for solid in solids]).reshape(-1, 3)
    sizes = np.array([float(np.linalg.norm(solid.half)) for solid in solids])
    found = []
    for face in faces:
        gaps = np.linalg.norm(centres - face.polygon.mean(axis=0), axis=1)
        near = np.nonzero(gaps <= sizes)[0].tolist()
        found.append(next((i for i in near if _hides(solids[i], face, TOUCHING * float(sizes[i]))), -1))
    return found


def _hides(solid: Solid, face: TexturedFace, slack_m: float) -> bool:
    """Whether a face lies in a solid that is not its own and has a part before it."""
    if any(face is own for own in solid.faces) or (face.polygon @ solid.normals.T > solid.offsets + slack_m).any():
        return False
    before = max(float((own.polygon @ face.normal).max()) for own in solid.faces)
    return before > float(face.normal @ face.polygon[0]) + slack_m


def draw_faces(surface: Surface, jobs: list[FaceJob], haze: float) -> None:
    """Draw the faces of one solid, which do not hide each other."""
    for job in jobs:
        x0, y0, x1, y1 = job.rect
        size = (x1 - x0, y1 - y0)
        part = surface.image[y0:y1, x0:x1]
        if min(size) < FLAT_BELOW_PX:
            tone = job.mean
            if haze > 0:
                tone = tuple((1 - haze) * value + haze * float(surface.haze_bgr.mean()) for value in tone)
            cv2.fillConvexPoly(part, job.points, tone, cv2.LINE_8, POINT_SHIFT)
        else:
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            picture = cv2.warpPerspective(job.picture, job.matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
            if haze > 0:
                fog = haze * float(surface.haze_bgr.mean())
                picture = cv2.convertScaleAbs(picture, alpha=1 - haze, beta=fog)
            mask = np.zeros((size[1], size[0]), np.uint8)
            cv2.fillConvexPoly(mask, job.points, 255.0, cv2.LINE_8, POINT_SHIFT)
            cv2.copyTo(picture, mask, part)
        if surface.matters(job.rect):
            cv2.fillConvexPoly(surface.ids[y0:y1, x0:x1], job.points, 0.0, cv2.LINE_8, POINT_SHIFT)
