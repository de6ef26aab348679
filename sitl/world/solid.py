"""Large convex solids with textured faces (houses, bridge), and trees: what stands still and hides things."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from sitl.world.light import Light
from sitl.world.noise import pyramid

FloatArray = npt.NDArray[np.float64]
ImageU8 = npt.NDArray[np.uint8]


def mirror_signs(mirror: bool) -> FloatArray:
    """Factors of the NED axes that exchange east and west."""
    return np.array([1.0, -1.0 if mirror else 1.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class TexturedFace:
    """A flat convex polygon (n, 3) NED with a picture on it.

    The corner (0, 0) of the picture lies at `origin`; one texel of level 0 is the vector `u` along a row and `v` along
    a column. `levels` are the picture and its halvings, of four channels; the last means nothing (see Ground).
    """

    polygon: FloatArray
    normal: FloatArray
    origin: FloatArray
    u: FloatArray
    v: FloatArray
    levels: tuple[ImageU8, ...]

    def mapped(self, scale: float, mirror: bool) -> TexturedFace:
        """The face in a scaled, mirrored world."""
        m = mirror_signs(mirror)
        k = m * scale
        return replace(
            self, polygon=self.polygon * k, normal=self.normal * m, origin=self.origin * k, u=self.u * k, v=self.v * k
        )


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A convex solid: faces to draw, planes (`normals` (P, 3) . x <= `offsets` (P,)) to cast rays at, an upright box.

    The box has its middle at `centre`, half sizes `half` along its own axes and is turned by `yaw_rad`.
    """

    name: str
    faces: tuple[TexturedFace, ...]
    normals: FloatArray
    offsets: FloatArray
    centre: FloatArray
    half: FloatArray
    yaw_rad: float

    def mapped(self, scale: float, mirror: bool) -> Solid:
        """The solid in a scaled, mirrored world."""
        m = mirror_signs(mirror)
        return Solid(
            self.name,
            tuple(face.mapped(scale, mirror) for face in self.faces),
            self.normals * m,
            self.offsets * scale,
            self.centre * m * scale,
            self.half * scale,
            self.yaw_rad * float(m[1]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Tree:
    """A tree: an upright post from `base` (NED, on the ground) and an ellipsoid crown drawn as a picture.

    `sprite` (levels of premultiplied BGRA) spans the crown's outline; `flip` exchanges its left and right.
    """

    base: FloatArray
    trunk_radius_m: float
    crown_centre: FloatArray
    crown_radius_m: float
    crown_half_height_m: float
    trunk_bgr: tuple[float, float, float]
    sprite: tuple[ImageU8, ...]
    flip: bool = False

    @property
    def crown_bottom_m(self) -> float:
        """Height of the crown's lowest point."""
        return -float(self.crown_centre[2]) - self.crown_half_height_m

    def mapped(self, scale: float, mirror: bool) -> Tree:
        """The tree in a scaled, mirrored world."""
        k = mirror_signs(mirror) * scale
        return replace(
            self, base=self.base * k, trunk_radius_m=self.trunk_radius_m * scale, crown_centre=self.crown_centre * k,
            crown_radius_m=self.crown_radius_m * scale, crown_half_height_m=self.crown_half_height_m * scale,
            flip=self.flip != mirror,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """An upright frame on the ground: x along `yaw_rad`, y to its right, height up."""

    north_m: float
    east_m: float
    yaw_rad: float

    def point(self, x: float, y: float, height: float) -> FloatArray:
        """NED of a point."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return np.array([self.north_m + x * c - y * s, self.east_m + x * s + y * c, -height])

    def direction(self, x: float, y: float, height: float) -> FloatArray:
        """NED of a direction."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return np.array([x * c - y * s, x * s + y * c, -height])


def textured_face(
    corners: list[FloatArray], along: FloatArray, down: FloatArray, picture: ImageU8, texel_m: float, light: Light
) -> TexturedFace:
    """A face whose picture begins at the first corner, rows along the unit vector `along`, columns along `down`.

    The light of its direction is put into the picture here: what stands still keeps its light.
    """
    polygon = np.array(corners)
    normal = np.cross(down, along)  # seen from outside, `along` goes to the right and `down` down
    normal = normal / float(np.linalg.norm(normal))
    factor = float(light.shade(normal[None])[0]) * light.exposure_bgr
    lit = np.clip(picture.astype(np.float32) * factor.astype(np.float32), 0, 255).astype(np.uint8)
    four = np.asarray(cv2.cvtColor(lit, cv2.COLOR_BGR2BGRA), dtype=np.uint8)
    return TexturedFace(polygon, normal, polygon[0], along * texel_m, down * texel_m, pyramid(four))


def make_solid(
    name: str, faces: list[TexturedFace], frame: LocalFrame, half: tuple[float, float], heights: tuple[float, float]
) -> Solid:
    """A solid of its faces and a flat bottom; `heights` are of bottom and top, `half` sizes along x and y."""
    normals = [face.normal for face in faces] + [np.array([0.0, 0.0, 1.0])]
    points = [face.polygon[0] for face in faces] + [frame.point(0, 0, heights[0])]
    offsets = np.array([float(n @ p) for n, p in zip(normals, points, strict=True)])
    centre = frame.point(0, 0, (heights[0] + heights[1]) / 2)
    halves = np.array([half[0], half[1], (heights[1] - heights[0]) / 2])
    return Solid(name, tuple(faces), np.array(normals), offsets, centre, halves, frame.yaw_rad)
