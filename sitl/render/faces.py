"""Textured faces of the solids, projected all at once."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sitl.render.projection import GUARD_PX, View, windows
from sitl.render.surface import POINT_SHIFT, Rect, Surface
from sitl.world.solid import Solid

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]
ImageU8 = npt.NDArray[np.uint8]

FLAT_BELOW_PX = 5  # a face that small gets its mean colour
SHARPNESS = 0.1  # levels finer than the mean of a pixel's two footprints
LEAST_DETERMINANT = 1e-12  # a face seen edge-on has no inverse


@dataclass(frozen=True, slots=True, eq=False)
class FaceJob:
    """One face ready to be drawn: window, corners relative to it (eighths of a pixel), texel of each of its pixels."""

    rect: Rect
    points: npt.NDArray[np.int32]
    matrix: FloatArray
    picture: ImageU8
    mean_bgr: FloatArray


class Faces:
    """The faces of all solids of a world; `prepare` projects those that are seen."""

    def __init__(self, solids: tuple[Solid, ...]) -> None:
        faces = [face for solid in solids for face in solid.faces]
        self._solids = solids
        self._levels = [face.levels for face in faces]
        self._means = [face.levels[-1].reshape(-1, 3).mean(axis=0) for face in faces]
        self._counts = np.array([len(levels) for levels in self._levels], dtype=int)
        self._owner = np.array([i for i, solid in enumerate(solids) for _ in solid.faces], dtype=int)
        # Triangles repeat their last corner.
        self._polygons = np.array([face.polygon[[0, 1, 2, min(3, len(face.polygon) - 1)]] for face in faces])
        self._normals = np.array([face.normal for face in faces])
        self._frames = np.array([np.stack([face.u, face.v, face.origin], axis=1) for face in faces])
        self._texels = np.array([float(np.linalg.norm(face.u)) for face in faces])

    def prepare(self, view: View, shown: npt.NDArray[np.bool_]) -> dict[int, list[FaceJob]]:
        """Jobs of the faces that look at the camera, by solid; `shown` (solids,) tells which may be in the picture."""
        jobs: dict[int, list[FaceJob]] = {}
        index = self._facing(view, shown)
        if not len(index):
            return jobs
        polygons = self._polygons[index]
        corners = view.to_camera(polygons)
        depth = corners[..., 2]
        near = depth.min(axis=1) < view.near_m
        pixels = view.focal_px * corners[..., :2] / np.maximum(depth, view.near_m)[..., None] + view.middle_px
        clipped = near | (np.abs(pixels).max(axis=(1, 2)) > GUARD_PX)
        matrices, levels, usable = self._textures(view, index, polygons)
        low, high = pixels.min(axis=1), pixels.max(axis=1)
        for k in np.nonzero(clipped)[0].tolist():
            outline = view.polygon(polygons[k])
            usable[k] &= outline is not None
            if outline is not None:
                low[k], high[k] = outline.min(axis=0), outline.max(axis=0)
        rects = windows(view, low, high)
        corner = np.array(rects, dtype=np.float64)[:, None, :2] + 0.5
        points = np.round((np.clip(pixels, -GUARD_PX, GUARD_PX) - corner) * (1 << POINT_SHIFT)).astype(np.int32)
        matrices[:, :, 2] += (matrices[:, :, :2] * corner).sum(axis=2)
        matrices[:, :2] -= 0.5 * matrices[:, 2:]
        for k in np.nonzero(usable)[0].tolist():
            x0, y0, x1, y1 = rects[k]
            if x1 <= x0 or y1 <= y0:
                continue
            face, outline_k = int(index[k]), points[k]
            if clipped[k]:
                cut = view.polygon(polygons[k])
                assert cut is not None  # else it would not be usable
                outline_k = np.round((cut - corner[k]) * (1 << POINT_SHIFT)).astype(np.int32)
            picture = self._levels[face][levels[k]]
            job = FaceJob(rects[k], outline_k, matrices[k], picture, self._means[face])
            jobs.setdefault(self._owner[face], []).append(job)
        return jobs

    def _facing(self, view: View, shown: npt.NDArray[np.bool_]) -> IndexArray:
        """Faces of shown solids that look at the camera; of a solid around the camera, the others."""
        if not len(self._owner):
            return np.zeros(0, dtype=np.intp)
        sides = ((view.position - self._polygons[:, 0]) * self._normals).sum(axis=1) > 0
        for i in np.nonzero(shown)[0]:
            solid = self._solids[i]
            if bool((solid.normals @ view.position <= solid.offsets).all()):
                sides[self._owner == i] = True
        return np.nonzero(sides & shown[self._owner])[0]

    def _textures(
        self, view: View, index: IndexArray, polygons: FloatArray
    ) -> tuple[FloatArray, npt.NDArray[np.int_], npt.NDArray[np.bool_]]:
        """Homographies from pixels to texels of the level that fits, the levels, and whether there is a homography."""
        frames = self._frames[index].copy()
        frames[:, :, 2] -= view.position
        to_pixels = view.matrix @ view.axes @ frames
        usable = np.abs(np.linalg.det(to_pixels)) > LEAST_DETERMINANT * self._texels[index] ** 3
        to_pixels[~usable] = np.eye(3)
        matrices = np.linalg.inv(to_pixels)
        middles = polygons.mean(axis=1) - view.position
        distance = np.maximum(np.linalg.norm(middles, axis=1), view.near_m)
        lean = np.maximum(np.abs((self._normals[index] * middles).sum(axis=1)) / distance, 0.05)
        footprint = distance / view.focal_px / np.sqrt(lean)
        wanted = np.floor(np.log2(footprint / self._texels[index]) + 0.5 - SHARPNESS).astype(int)
        levels = np.clip(wanted, 0, self._counts[index] - 1)
        matrices[:, :2] *= (0.5**levels)[:, None, None]
        return matrices, levels, usable


def draw_faces(surface: Surface, jobs: list[FaceJob], haze: float) -> None:
    """Draw the faces of one solid, which do not hide each other."""
    for job in jobs:
        x0, y0, x1, y1 = job.rect
        size = (x1 - x0, y1 - y0)
        mask = np.zeros((size[1], size[0]), np.uint8)
        cv2.fillConvexPoly(mask, job.points, 255.0, cv2.LINE_8, POINT_SHIFT)
        part = surface.image[y0:y1, x0:x1]
        if min(size) < FLAT_BELOW_PX:
            picture: ImageU8 = np.empty((size[1], size[0], 3), np.uint8)
            picture[:] = job.mean_bgr
        else:
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            picture = np.asarray(
                cv2.warpPerspective(job.picture, job.matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE),
                dtype=np.uint8,
            )
        if haze > 0:
            picture = np.asarray(
                cv2.convertScaleAbs(picture, alpha=1 - haze, beta=haze * float(surface.haze_bgr.mean())), dtype=np.uint8
            )
        cv2.copyTo(picture, mask, part)
        if surface.matters(job.rect):
            cv2.copyTo(np.zeros_like(mask), mask, surface.ids[y0:y1, x0:x1])
