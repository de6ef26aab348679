"""Small solid bodies of flat faces: cars and persons. Body axes: x forward, y right, z down, the ground at z = 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]
Colour = tuple[float, float, float]  # BGR albedo, 0 to 255

SAMPLES = 64  # points on the surface that the ray caster looks at; about half of them face a camera


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A convex piece of a mesh: its faces `first` to `last` (exclusive) and its middle, by which pieces are sorted."""

    first: int
    last: int
    middle: tuple[float, float, float]
    layer_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Faces over `vertices` (V, 3). A face faces away from the body along `normals` (F, 3) at distance `offsets` (F,).

    `colours` (F, 3) are BGR albedos, `gloss` (F,) is the share of mirrored sky. Faces of one part are drawn in their
    order. `samples` (S, 3) with normals and areas are spread over the surface; `low` and `high` bound the body, `foot`
    (K, 3) are the corners of its outline from above, put on the ground.
    """

    vertices: FloatArray
    faces: tuple[IndexArray, ...]
    normals: FloatArray
    offsets: FloatArray
    colours: FloatArray
    gloss: FloatArray
    parts: tuple[Part, ...]
    samples: FloatArray
    sample_normals: FloatArray
    sample_areas: FloatArray
    low: FloatArray
    high: FloatArray
    foot: FloatArray
    # What follows from the above and is needed for every picture: middle and half sizes of the bounds, the faces'
    # corners one face after the other, where in them each face begins (F + 1), and normal, colour and gloss (F, 7).
    middle: FloatArray = field(init=False)
    half: FloatArray = field(init=False)
    outlines: IndexArray = field(init=False)
    bounds: list[int] = field(init=False)
    look: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "middle", (self.low + self.high) / 2)
        object.__setattr__(self, "half", (self.high - self.low) / 2)
        object.__setattr__(self, "outlines", np.concatenate(self.faces))
        object.__setattr__(self, "bounds", np.cumsum([0, *(len(face) for face in self.faces)]).tolist())
        object.__setattr__(self, "look", np.column_stack([self.normals, self.colours, self.gloss]))

    def mapped(self, scale: float, mirror: bool) -> Mesh:
        """The body in a world `scale` times as large, left and right exchanged when `mirror`."""
        side = np.array([1.0, -1.0 if mirror else 1.0, 1.0])
        corners = np.sort(np.stack([self.low * side, self.high * side]), axis=0) * scale
        parts = tuple(
            Part(
                p.first,
                p.last,
                (p.middle[0] * scale, p.middle[1] * scale * side[1], p.middle[2] * scale),
                p.layer_m * scale,
            )
            for p in self.parts
        )
        return Mesh(
            self.vertices * side * scale,
            self.faces,
            self.normals * side,
            self.offsets * scale,
            self.colours,
            self.gloss,
            parts,
            self.samples * side * scale,
            self.sample_normals * side,
            self.sample_areas * scale**2,
            corners[0],
            corners[1],
            self.foot * side * scale,
        )


class MeshBuilder:
    """Collects faces part by part; `build` makes the mesh."""

    def __init__(self) -> None:
        self._points: list[FloatArray] = []
        self._faces: list[IndexArray] = []
        self._normals: list[FloatArray] = []
        self._colours: list[Colour] = []
        self._gloss: list[float] = []
        self._decal: list[bool] = []
        self._parts: list[tuple[int, int, float]] = []
        self._count = 0

    def face(
        self, points: FloatArray, outward: FloatArray, colour: Colour, gloss: float = 0.0, decal: bool = False
    ) -> None:
        """Add a flat face; `outward` tells which of its two sides is the outer one. A decal lies on another face."""
        a = points - points[0]
        b = np.concatenate([a[1:], a[:1]])
        # Newell: right for warped quads as well.
        normal = np.array(
            [
                (a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]).sum(),
                (a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]).sum(),
                (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(),
            ]
        )
        length = float(np.linalg.norm(normal))
        if length < 1e-12:
            return
        normal = normal / length
        self._normals.append(normal if float(normal @ outward) >= 0 else -normal)
        self._faces.append(np.arange(self._count, self._count + len(points)))
        self._points.append(points)
        self._colours.append(colour)
        self._gloss.append(gloss)
        self._decal.append(decal)
        self._count += len(points)

    def end_part(self, layer_m: float) -> None:
        """Close a convex part; `layer_m` (height of its middle) sorts parts that stand on each other."""
        first = self._parts[-1][1] if self._parts else 0
        self._parts.append((first, len(self._faces), layer_m))

    def build(self, scale: float = 1.0) -> Mesh:
        """The mesh, `scale` times as large as it was drawn."""
        stacked = np.concatenate(self._points) * scale
        vertices, index = np.unique(np.round(stacked, 9), axis=0, return_inverse=True)
        index = index.reshape(-1)
        normals = np.array(self._normals)
        middles = np.array([stacked[face].mean(axis=0) for face in self._faces])
        parts = []
        for first, last, layer in self._parts:
            middle = middles[first:last].mean(axis=0)
            parts.append(Part(first, last, (float(middle[0]), float(middle[1]), float(middle[2])), layer * scale))
        solid = [stacked[f] for f, d in zip(self._faces, self._decal, strict=True) if not d]
        mirrors = _is_symmetric(vertices)
        samples = _samples(solid, normals[~np.array(self._decal)], SAMPLES // 2 if mirrors else SAMPLES)
        if mirrors:
            samples = _with_mirror_images(*samples)
        return Mesh(
            vertices,
            tuple(index[face] for face in self._faces),
            normals,
            (normals * middles).sum(axis=1),
            np.array(self._colours, dtype=np.float64),
            np.array(self._gloss),
            tuple(parts),
            *samples,
            vertices.min(axis=0),
            vertices.max(axis=0),
            vertices[cv2.convexHull(vertices[:, :2].astype(np.float32), returnPoints=False)[:, 0]] * [1.0, 1.0, 0.0],
        )


def _is_symmetric(vertices: FloatArray) -> bool:
    """Whether the left half of a body is the mirror image of the right one."""
    mirrored = np.unique(np.round(vertices * [1.0, -1.0, 1.0], 9) + 0.0, axis=0)
    return mirrored.shape == vertices.shape and bool(np.allclose(mirrored, np.unique(vertices + 0.0, axis=0)))


def _with_mirror_images(
    points: FloatArray, normals: FloatArray, areas: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Each sample and its mirror image, so that a mirrored scene has mirrored samples and the same visibility."""
    side = np.array([1.0, -1.0, 1.0])
    return np.concatenate([points, points * side]), np.concatenate([normals, normals * side]), np.tile(areas / 2, 2)


def _samples(faces: Sequence[FloatArray], normals: FloatArray, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """`count` points spread over the faces: points (S, 3), normals (S, 3), areas (S,)."""
    triangles, owners = [], []
    for i, face in enumerate(faces):
        for k in range(1, len(face) - 1):
            triangles.append(np.stack([face[0], face[k], face[k + 1]]))
            owners.append(i)
    corners = np.array(triangles)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    # Low-discrepancy points: the picks follow the area, the place within a triangle the golden ratios.
    picks = np.searchsorted(np.cumsum(areas), (np.arange(count) + 0.5) / count * areas.sum())
    a = np.mod(0.5 + np.arange(count) * 0.7548776662466927, 1.0)
    b = np.mod(0.5 + np.arange(count) * 0.5698402909980532, 1.0)
    flip = a + b > 1
    a, b = np.where(flip, 1 - a, a), np.where(flip, 1 - b, b)
    chosen = corners[picks]
    points = chosen[:, 0] + a[:, None] * (chosen[:, 1] - chosen[:, 0]) + b[:, None] * (chosen[:, 2] - chosen[:, 0])
    weights = np.full(count, areas.sum() / count)
    return points, normals[np.array(owners)[picks]], weights


@dataclass(frozen=True, slots=True)
class Slice:
    """A level outline of a body: a rectangle with cut corners; the height may differ between front and back."""

    back_m: float
    front_m: float
    half_width_m: float
    corner_m: float
    height_back_m: float
    height_front_m: float

    def outline(self) -> FloatArray:
        """Twelve points (12, 3): three at each corner; front right, back right, back left, front left."""
        c = self.corner_m
        k = 0.29 * c  # the middle point of a quarter circle
        x0, x1, w = self.back_m, self.front_m, self.half_width_m
        plan = [
            (x1, w - c), (x1 - k, w - k), (x1 - c, w),
            (x0 + c, w), (x0 + k, w - k), (x0, w - c),
            (x0, c - w), (x0 + k, k - w), (x0 + c, -w),
            (x1 - c, -w), (x1 - k, k - w), (x1, c - w),
        ]  # fmt: skip
        span = max(x1 - x0, 1e-9)
        rise = (self.height_front_m - self.height_back_m) / span
        return np.array([(x, y, -(self.height_back_m + rise * (x - x0))) for x, y in plan])


BACK, FRONT, RIGHT, LEFT = 5, 11, 2, 8  # index of the outline's edge on that side


def band(low: Slice, high: Slice) -> list[tuple[FloatArray, FloatArray]]:
    """The twelve faces between two slices, each with a direction that points outward."""
    a, b = low.outline(), high.outline()
    inside = (a.mean(axis=0) + b.mean(axis=0)) / 2
    faces = []
    for i in range(12):
        j = (i + 1) % 12
        quad = np.array([a[i], a[j], b[j], b[i]])
        faces.append((quad, quad.mean(axis=0) - inside))
    return faces


def on_quad(quad: FloatArray, u: tuple[float, float], v: tuple[float, float]) -> FloatArray:
    """A rectangle in the quad's own coordinates, u along its foot and v up, both 0 to 1: points (4, 3)."""
    a, b, c, d = quad
    points = []
    for s, t in ((u[0], v[0]), (u[1], v[0]), (u[1], v[1]), (u[0], v[1])):
        points.append((1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * d + s * c))
    return np.array(points)
