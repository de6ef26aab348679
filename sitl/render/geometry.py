"""Truth without pixels: boxes from the same bodies, visibility by rays, for runs that need no picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sitl.render.posed import Posed, pose_movers
from sitl.render.projection import View
from sitl.render.truth import Outline, outlines
from sitl.scene import CameraModel, CameraPose, ObjectTruth
from sitl.world.world import World
from tracker.box import Box

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

TRUNK_SIDES = 6
MOST_PLANES = 8  # of one solid; the rest of the table is filled with planes that cut nothing
NOTHING_M = 1e12
LEAST_BOX_PX = 1.0  # a single visible point still is a pixel


class GeometryCamera:
    """Sees what the renderer's truth says, by rays from the camera to points on each body.

    Boxes of whole bodies are exact; visibility and the box of the visible part are as fine as the points are dense.
    """

    def __init__(self, world: World, camera: CameraModel) -> None:
        self.world, self.camera = world, camera
        solids = [(s.normals, s.offsets) for s in world.solids]
        spheres = [(s.centre, float(np.linalg.norm(s.half))) for s in world.solids]
        for tree in world.trees:
            solids.append(_post(tree.base, tree.trunk_radius_m, tree.crown_bottom_m))
            middle = tree.base - np.array([0.0, 0.0, tree.crown_bottom_m / 2])
            spheres.append((middle, float(np.hypot(tree.trunk_radius_m, tree.crown_bottom_m / 2))))
        self._normals, self._offsets = _table(solids)
        self._crowns = np.array([t.crown_centre for t in world.trees]).reshape(-1, 3)
        radii = [(t.crown_radius_m, t.crown_radius_m, t.crown_half_height_m) for t in world.trees]
        self._radii = np.array(radii).reshape(-1, 3)
        # Balls around everything: solids and trunks, then crowns.
        self._middles = np.concatenate([np.array([s[0] for s in spheres]).reshape(-1, 3), self._crowns])
        self._reaches = np.concatenate([np.array([s[1] for s in spheres]), self._radii.max(axis=1, initial=0.0)])

    def observe(self, t_s: float, pose: CameraPose) -> dict[str, ObjectTruth]:
        """Truth of every car and person at a time, by name."""
        view = View(self.camera, pose, self.world.scale)
        movers = pose_movers(self.world, t_s)
        found = outlines(view, movers)
        truths = {outline.name: outline.truth(None, 0.0) for outline in found}
        looked_at = [
            (body, outline) for body, outline in zip(movers, found, strict=True) if _may_be_seen(view, outline)
        ]
        if not looked_at:
            return truths
        samples = _samples(view, [body for body, _ in looked_at])
        hidden = self._hidden(view.position, samples, [body for body, _ in looked_at], movers)
        starts = np.searchsorted(samples.owner, np.arange(len(looked_at) + 1))
        for k, (_, outline) in enumerate(looked_at):
            part = slice(int(starts[k]), int(starts[k + 1]))
            weight, pixels, clear = samples.weight[part], samples.pixels[part], ~hidden[part]
            truths[outline.name] = _truth(outline, weight, pixels, clear)
        return truths

    def _hidden(self, eye: FloatArray, samples: _Samples, bodies: list[Posed], movers: list[Posed]) -> BoolArray:
        """Which samples cannot be seen from the eye."""
        rays = samples.points - eye
        targets = np.array([body.number - 1 for body in bodies])
        others = np.array([body.middle for body in movers])
        halves = np.array([body.half for body in movers])
        sizes = np.sqrt((halves * halves).sum(axis=1))
        near = _near(
            eye, others[targets], sizes[targets],
            np.concatenate([self._middles, others]), np.concatenate([self._reaches, sizes]),
        )  # fmt: skip
        solids, fixed = self._normals.shape[1], len(self._middles)
        solid, crown, close = (np.nonzero(part)[0] for part in np.split(near, [solids, fixed]))
        hidden = np.zeros(len(rays), dtype=bool)
        if len(crown):
            hidden |= _cut_by_balls(eye, rays, self._crowns[crown], self._radii[crown])
        normals, offsets = _planes(np.array([body.turn for body in movers])[close], others[close], halves[close])
        hits = _cut_by_solids(
            eye, rays,
            np.concatenate([self._normals[:, solid], normals], axis=1),
            np.concatenate([self._offsets[:, solid], offsets], axis=1),
        )  # fmt: skip
        # No body hides itself.
        hits[len(solid) :] &= close[:, None] != targets[samples.owner]
        return np.asarray(hidden | hits.any(axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """Points on bodies that face the camera and lie in the picture: NED, pixels, share of their body's area, body."""

    points: FloatArray
    pixels: FloatArray
    weight: FloatArray
    owner: npt.NDArray[np.intp]


def _may_be_seen(view: View, outline: Outline) -> bool:
    behind = outline.amodal is None and outline.centre_px is None
    outside = outline.amodal is not None and outline.inner is None
    return view.height_m > 0 and not behind and not outside


def _samples(view: View, bodies: list[Posed]) -> _Samples:
    points = np.concatenate([body.mesh.samples @ body.turn + body.origin for body in bodies])
    normals = np.concatenate([body.mesh.sample_normals @ body.turn for body in bodies])
    areas = np.concatenate([body.mesh.sample_areas for body in bodies])
    owner = np.repeat(np.arange(len(bodies)), [len(body.mesh.samples) for body in bodies])
    towards = view.position - points
    lean = _dot(towards, normals)
    x, y, z = view.to_camera(points).T
    share = view.focal_px / np.maximum(z, view.near_m)
    x, y = share * x + view.middle_px[0], share * y + view.middle_px[1]
    kept = (lean > 0) & (z >= view.near_m) & (x >= 0) & (x < view.width_px) & (y >= 0) & (y < view.height_px)
    # What a point stands for in the picture: its area as it is turned to the eye, over depth squared.
    square = np.maximum(_dot(towards, towards), view.near_m**2)
    weight = areas * lean / np.sqrt(square) / square
    return _Samples(points[kept], np.stack([x[kept], y[kept]], axis=1), weight[kept], owner[kept])


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of rows (..., 3): (...,)."""
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _truth(outline: Outline, weight: FloatArray, pixels: FloatArray, clear: BoolArray) -> ObjectTruth:
    if not clear.any():
        return outline.truth(None, 0.0)
    if bool(clear.all()) and outline.inner is not None:
        return outline.truth(outline.inner, 1.0)
    share = min(1.0, float(weight[clear].sum() / weight.sum()))
    return outline.truth(_visible_box(outline.inner, pixels, pixels[clear]), share)


def _near(
    eye: FloatArray, targets: FloatArray, reaches: FloatArray, middles: FloatArray, sizes: FloatArray
) -> BoolArray:
    """Which balls come near any of the lines from the eye to balls of radii `reaches` about the targets."""
    ways = targets - eye
    squares = np.maximum(_dot(ways, ways), 1e-12)
    offsets = middles - eye
    along = np.minimum(np.maximum(offsets @ ways.T / squares, 0.0), 1.0)
    gaps = offsets[:, None] - along[..., None] * ways
    return np.asarray((_dot(gaps, gaps) < (sizes[:, None] + reaches) ** 2).any(axis=1))


def _planes(axes: FloatArray, middles: FloatArray, halves: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Planes of boxes (N) in the form of `_table`, from axes (N, 3, 3), middles (N, 3) and half sizes (N, 3)."""
    normals = np.zeros((MOST_PLANES, len(axes), 3))
    offsets = np.full((MOST_PLANES, len(axes)), NOTHING_M)
    normals[:3] = axes.transpose(1, 0, 2)
    normals[3:6] = -normals[:3]
    along = _dot(normals[:3], middles)
    offsets[:3], offsets[3:6] = along + halves.T, halves.T - along
    return normals, offsets


def _cut_by_solids(eye: FloatArray, rays: FloatArray, normals: FloatArray, offsets: FloatArray) -> BoolArray:
    """Which rays (n, 3), from the eye to their ends, pass through the solids (planes, k, 3): (k, n)."""
    # Planes come first: numpy is slow along short last axes. Speed: how fast a ray leaves a plane's inner side.
    speed = (normals.reshape(-1, 3) @ rays.T).reshape(*offsets.shape, len(rays))
    room = (offsets - normals @ eye)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = room / speed
    enters, leaves = speed < 0, speed > 0
    enter = np.where(enters, crossing, -np.inf).max(axis=0)
    leave = np.where(leaves, crossing, np.inf).min(axis=0)
    missed = (~(enters | leaves) & (room < 0)).any(axis=0)  # along a plane, outside
    return np.asarray((np.maximum(enter, 0.0) < np.minimum(leave, 1.0)) & ~missed)


def _cut_by_balls(eye: FloatArray, rays: FloatArray, middles: FloatArray, radii: FloatArray) -> BoolArray:
    """Which rays (n, 3) pass through one of the ellipsoids (k, 3)."""
    start = ((eye - middles) / radii)[:, None]
    way = rays / radii[:, None]
    along = np.minimum(np.maximum(-_dot(way, start) / np.maximum(_dot(way, way), 1e-12), 0.0), 1.0)
    nearest = start + along[..., None] * way
    return np.asarray((_dot(nearest, nearest) < 1.0).any(axis=0))


def _visible_box(whole: Box | None, inside: FloatArray, clear: FloatArray) -> Box:
    """Box of the clear points (n, 2); a side at which none is hidden is that of the whole body in the picture."""
    low, high = clear.min(axis=0), clear.max(axis=0)
    if whole is not None:
        x0, y0, x1, y1 = whole.to_corners()
        low = np.where(low <= inside.min(axis=0), (x0, y0), low)
        high = np.where(high >= inside.max(axis=0), (x1, y1), high)
    high = np.maximum(high, low + LEAST_BOX_PX)
    return Box.from_corners(float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def _post(base: FloatArray, radius_m: float, height_m: float) -> tuple[FloatArray, FloatArray]:
    """Planes of an upright post with `TRUNK_SIDES` sides."""
    turns = np.arange(TRUNK_SIDES) * (2 * np.pi / TRUNK_SIDES)
    sides = np.stack([np.cos(turns), np.sin(turns), np.zeros(TRUNK_SIDES)], axis=1)
    normals = np.concatenate([sides, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])
    offsets = np.concatenate([sides @ base + radius_m, [height_m, 0.0]])
    return normals, offsets


def _table(solids: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Planes of all solids in one table each: normals (MOST_PLANES, N, 3), offsets (MOST_PLANES, N)."""
    normals = np.zeros((MOST_PLANES, len(solids), 3))
    offsets = np.full((MOST_PLANES, len(solids)), NOTHING_M)
    for i, (planes, distances) in enumerate(solids):
        normals[: len(planes), i] = planes
        offsets[: len(planes), i] = distances
    return normals, offsets
