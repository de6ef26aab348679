"""Truth without pixels: boxes from the same bodies, visibility by rays, for runs that need no picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sitl.render.bodies import Posed, pose_movers
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
        self._middles = np.array([s[0] for s in spheres]).reshape(-1, 3)
        self._reaches = np.array([s[1] for s in spheres])
        self._crowns = np.array([t.crown_centre for t in world.trees]).reshape(-1, 3)
        radii = [(t.crown_radius_m, t.crown_radius_m, t.crown_half_height_m) for t in world.trees]
        self._radii = np.array(radii).reshape(-1, 3)

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
        middles = np.array([body.middle for body in bodies])
        reaches = np.array([float(np.linalg.norm(body.half)) for body in bodies])
        near = _near(eye, middles, reaches, self._middles, self._reaches)
        hidden = _cut_by_solids(eye, rays, self._normals[near], self._offsets[near]).any(axis=0)
        near = _near(eye, middles, reaches, self._crowns, self._radii.max(axis=1, initial=0.0))
        hidden |= _cut_by_balls(eye, rays, self._crowns[near], self._radii[near])
        others = np.array([body.middle for body in movers])
        sizes = np.array([float(np.linalg.norm(body.half)) for body in movers])
        close = np.nonzero(_near(eye, middles, reaches, others, sizes))[0]
        axes = np.array([movers[k].turn for k in close])
        offsets = (axes @ others[close][..., None])[..., 0]
        half = np.array([movers[k].half for k in close])
        hits = _cut_by_solids(
            eye, rays, np.concatenate([axes, -axes], axis=1), np.concatenate([offsets + half, half - offsets], axis=1)
        )
        numbers = np.array([movers[k].number for k in close])
        own = np.array([body.number for body in bodies])[samples.owner]
        return np.asarray(hidden | (hits & (numbers[:, None] != own)).any(axis=0))


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
    points = np.concatenate([body.to_ned(body.mesh.samples) for body in bodies])
    normals = np.concatenate([body.mesh.sample_normals @ body.turn for body in bodies])
    areas = np.concatenate([body.mesh.sample_areas for body in bodies])
    owner = np.repeat(np.arange(len(bodies)), [len(body.mesh.samples) for body in bodies])
    towards = view.position - points
    lean = (towards * normals).sum(axis=1)
    in_camera = view.to_camera(points)
    depth = np.maximum(in_camera[:, 2], view.near_m)
    pixels = view.focal_px * in_camera[:, :2] / depth[:, None] + view.middle_px
    size = (view.width_px, view.height_px)
    kept = (lean > 0) & (in_camera[:, 2] >= view.near_m) & ((pixels >= 0) & (pixels < size)).all(axis=1)
    # What a point stands for in the picture: its area as it is turned to the eye, over depth squared.
    square = np.maximum((towards**2).sum(axis=1), view.near_m**2)
    weight = areas * lean / np.sqrt(square) / square
    return _Samples(points[kept], pixels[kept], weight[kept], owner[kept])


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
    squares = np.maximum((ways**2).sum(axis=1), 1e-12)
    offsets = middles - eye
    along = np.clip(offsets @ ways.T / squares, 0.0, 1.0)
    gaps = offsets[:, None] - along[..., None] * ways
    return np.asarray(((gaps**2).sum(axis=2) < (sizes[:, None] + reaches) ** 2).any(axis=1))


def _cut_by_solids(eye: FloatArray, rays: FloatArray, normals: FloatArray, offsets: FloatArray) -> BoolArray:
    """Which rays (n, 3), from the eye to their ends, pass through the solids (k, planes, 3): (k, n)."""
    speed = rays @ normals.transpose(0, 2, 1)  # (k, n, planes): how fast the ray leaves the plane's inner side
    room = (offsets - normals @ eye)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = room / speed
    enter = np.where(speed < 0, crossing, np.where((speed == 0) & (room < 0), np.inf, -np.inf)).max(axis=2)
    leave = np.where(speed > 0, crossing, np.inf).min(axis=2)
    return np.asarray(np.maximum(enter, 0.0) < np.minimum(leave, 1.0))


def _cut_by_balls(eye: FloatArray, rays: FloatArray, middles: FloatArray, radii: FloatArray) -> BoolArray:
    """Which rays (n, 3) pass through one of the ellipsoids (k, 3)."""
    start = (eye - middles) / radii
    way = rays[None] / radii[:, None]
    square = (way**2).sum(axis=2)
    along = np.clip(-(way @ start[..., None])[..., 0] / np.maximum(square, 1e-12), 0.0, 1.0)
    nearest = start[:, None] + along[..., None] * way
    return np.asarray(((nearest**2).sum(axis=2) < 1.0).any(axis=0))


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
    """Planes of all solids in one table each: normals (N, MOST_PLANES, 3), offsets (N, MOST_PLANES)."""
    normals = np.zeros((len(solids), MOST_PLANES, 3))
    offsets = np.full((len(solids), MOST_PLANES), NOTHING_M)
    for i, (planes, distances) in enumerate(solids):
        normals[i, : len(planes)] = planes
        offsets[i, : len(planes)] = distances
    return normals, offsets
