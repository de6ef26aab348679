"""The ground's picture: meadow, lots, pavements, roads with markings and wear; light and shadows come last."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from sitl.world.canvas import Canvas, along, nearest_on, rectangle
from sitl.world.facade import Painter
from sitl.world.light import Light
from sitl.world.noise import Grain, octaves, pyramid, to_factor_u8
from sitl.world.shadows import shadow_factor
from sitl.world.solid import FloatArray, ImageU8, Solid, Tree, mirror_signs
from sitl.world.spec import PointNE, RoadSpec, WorldSpec

TEXEL_M = 0.06  # a pixel at 30 m; nearer ground gets the detail tile as well
MOST_PX = 4096  # memory of the picture: 90 MB with its halvings
COARSE = 4  # texels of light and shadow are that much larger
FIELD = 8  # and those of the broad colours
DETAIL_TEXEL_M = 0.02
DETAIL_PX = 1024  # one period of the detail tile, 20 m
PAVEMENT_M, KERB_M, SLAB_M = 1.9, 0.18, 1.2
GRASS, LUSH, DRY, SOIL = (62, 108, 96), (52, 104, 80), (98, 142, 150), (92, 116, 138)
JOINT = (112, 116, 118)
ASPHALT, PAVING, KERB, DRIVE, PAINT = (104, 103, 101), (148, 153, 156), (176, 178, 178), (134, 140, 144), 218.0


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Picture of the ground: `levels[0]` has its corner at `origin` (NED), columns along `u`, rows along `v` (a texel).
    The levels have four channels, of which the last means nothing: cv2 warps four in less than half the time of three.

    `detail` is a finer grain (128 = as it is) whose texels are `detail_texel_m`, twice its period in both directions.
    `sunlit` (rows as above, `COARSE` times coarser) is the share of sun that reaches the ground, 255 = all.
    """

    levels: tuple[ImageU8, ...]
    origin: FloatArray
    u: FloatArray
    v: FloatArray
    detail: ImageU8
    detail_texel_m: float
    sunlit: ImageU8

    @property
    def texel_m(self) -> float:
        """Side of a texel of level 0."""
        return math.hypot(*self.u.tolist())

    def mapped(self, scale: float, mirror: bool) -> Ground:
        """The ground of a scaled, mirrored world."""
        k = mirror_signs(mirror) * scale
        return replace(
            self, origin=self.origin * k, u=self.u * k, v=self.v * k, detail_texel_m=self.detail_texel_m * scale
        )

    def sunlit_at(self, north_m: float, east_m: float) -> float:
        """Share of the sun that reaches a place, 0 to 1; 1 outside of the picture."""
        offset = np.array([north_m, east_m, 0.0]) - self.origin
        step = self.texel_m**2 * COARSE
        column, row = int(float(offset @ self.u) / step), int(float(offset @ self.v) / step)
        rows, columns = self.sunlit.shape
        return float(self.sunlit[row, column]) / 255 if 0 <= row < rows and 0 <= column < columns else 1.0


def build_ground(spec: WorldSpec, light: Light, painter: Painter, solids: list[Solid], trees: list[Tree]) -> Ground:
    """Paint the ground of a world under its light, with the shadows of what stands on it."""
    side = min(MOST_PX, max(64, math.ceil(spec.size_m / TEXEL_M / 32) * 32))
    half = spec.size_m / 2
    canvas = Canvas(spec.centre[0] - half, spec.centre[1] - half, spec.size_m / side, side)
    rng = painter.rng
    picture = _meadow(spec, canvas, rng)
    _grain(picture, painter.grain, 0.21)
    _lots(spec, canvas, picture, rng)
    paved = _roads(spec, canvas, picture, rng)
    _markings(spec, canvas, picture, paved, rng)
    _wear(spec, canvas, picture, rng)
    _grain(picture, painter.grain, 0.11, paved)
    factor, sunlit = shadow_factor(canvas.coarser(COARSE), light, rng, solids, trees)
    _tracks(spec, canvas.coarser(COARSE), factor)
    scaled = np.clip(factor * light.exposure_bgr.astype(np.float32) * 128, 0, 255).astype(np.uint8)
    wide = cv2.resize(scaled, (side, side), interpolation=cv2.INTER_LINEAR)
    cv2.multiply(picture, wide, picture, 1 / 128)
    texel = canvas.texel_m
    return Ground(
        pyramid(np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2BGRA), dtype=np.uint8)),
        np.array([canvas.south_m, canvas.west_m, 0.0]),
        np.array([0.0, texel, 0.0]),
        np.array([texel, 0.0, 0.0]),
        _detail(rng),
        DETAIL_TEXEL_M,
        sunlit,
    )


def _colour(bgr: tuple[int, int, int]) -> npt.NDArray[np.float32]:
    return np.array(bgr, np.float32)


def _meadow(spec: WorldSpec, canvas: Canvas, rng: np.random.Generator) -> ImageU8:
    """Grass between lush and dry, bare earth in places."""
    side = canvas.side_px // FIELD
    widths_m = (80.0, 35.0, 14.0, 6.0, 2.5, 1.2)
    cells = tuple(min(side, max(2, round(spec.size_m / w))) for w in widths_m)
    dry = np.clip(0.22 + 0.26 * octaves(rng, (side, side), cells, 0.8), 0, 1)[..., None]
    lush = np.clip(0.4 + 0.4 * octaves(rng, (side, side), cells[:4], 0.8), 0, 1)[..., None]
    bare = np.clip(2.2 * octaves(rng, (side, side), cells[1:], 0.85) - 3.6, 0, 1)[..., None]
    grass = _colour(GRASS) + lush * (_colour(LUSH) - _colour(GRASS))
    field = grass + dry * (_colour(DRY) - grass)
    field = field + bare * (_colour(SOIL) - field)
    field *= 1 + 0.09 * octaves(rng, (side, side), cells, 0.95)[..., None]
    small = np.clip(field, 0, 255).astype(np.uint8)
    return np.asarray(cv2.resize(small, (canvas.side_px,) * 2, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def _grain(picture: ImageU8, grain: Grain, amplitude: float, mask: ImageU8 | None = None) -> None:
    """Multiply a repeating grain into the picture, only where `mask` is set."""
    tile = cv2.cvtColor(to_factor_u8(grain.tile, amplitude), cv2.COLOR_GRAY2BGR)
    for block, where in _blocks(picture, mask):
        part = tile[: block.shape[0], : block.shape[1]]
        if where is None:
            cv2.multiply(block, part, block, 1 / 128)
        else:
            cv2.copyTo(cv2.multiply(block, part, scale=1 / 128), where, block)


def _blocks(picture: ImageU8, mask: ImageU8 | None) -> Iterator[tuple[ImageU8, ImageU8 | None]]:
    """Pieces of the picture as large as a tile, with the mask there; those with an empty mask are left out."""
    side, step = picture.shape[0], Grain.SIDE_PX
    for y in range(0, side, step):
        for x in range(0, side, step):
            where = None if mask is None else mask[y : y + step, x : x + step]
            if where is None or cv2.countNonZero(where):
                yield picture[y : y + step, x : x + step], where


def _pave(picture: ImageU8, mask: ImageU8, tile: ImageU8) -> None:
    """Lay a tile wherever the mask is set."""
    for block, where in _blocks(picture, mask):
        assert where is not None  # a mask was given
        cv2.copyTo(np.ascontiguousarray(tile[: block.shape[0], : block.shape[1]]), where, block)


def _detail(rng: np.random.Generator) -> ImageU8:
    noise = octaves(rng, (DETAIL_PX, DETAIL_PX), (512, 1024), 1.0)
    return np.tile(to_factor_u8(noise, 0.075), (2, 2))


def _lots(spec: WorldSpec, canvas: Canvas, picture: ImageU8, rng: np.random.Generator) -> None:
    """Lawns, beds, drives and terraces around the houses; earth under the trees."""
    for house in spec.buildings:
        at, yaw = (house.north_m, house.east_m), house.yaw_rad
        reach = 1.6 + 0.8 * float(rng.random())
        bed = rectangle(at, yaw, house.length_m / 2 + reach, house.width_m / 2 + reach)
        canvas.fill(picture, bed, _tone(rng, SOIL if rng.random() < 0.4 else LUSH, 0.1))
        canvas.fill(picture, rectangle(at, yaw, house.length_m / 2 + 0.8, house.width_m / 2 + 0.8), PAVING)
        roads = [nearest_on(road.points, at) for road in spec.roads]
        if roads:
            foot = min(roads, key=lambda p: math.dist(p, at))
            canvas.line(picture, (at, foot), 3.0, _tone(rng, DRIVE, 0.08))
        for corner in bed:  # shrubs, seen as dark tufts
            for _ in range(5):
                spot = (corner[0] + float(rng.normal(0, 0.9)), corner[1] + float(rng.normal(0, 0.9)))
                canvas.disc(picture, spot, float(rng.uniform(0.2, 0.55)), _tone(rng, (36, 74, 56), 0.25))
    for tree in spec.trees:
        spot = (tree.north_m, tree.east_m)
        canvas.disc(picture, spot, 0.22 * tree.crown_m, _tone(rng, SOIL, 0.15))


def _tone(rng: np.random.Generator, bgr: tuple[int, int, int], spread: float) -> tuple[float, ...]:
    factor = float(rng.uniform(1 - spread, 1 + spread))
    return tuple(min(255.0, v * factor) for v in bgr)


def _roads(spec: WorldSpec, canvas: Canvas, picture: ImageU8, rng: np.random.Generator) -> ImageU8:
    """Pavements, kerbs and asphalt; returns the mask of the asphalt."""
    walk, paved = canvas.blank(), canvas.blank()
    for road in spec.roads:
        canvas.line(walk, road.points, road.width_m + 2 * (PAVEMENT_M + KERB_M), 255)
        canvas.line(paved, road.points, road.width_m, 255)
    if not spec.roads:
        return paved
    slabs = np.empty((Grain.SIDE_PX, Grain.SIDE_PX, 3), np.uint8)
    slabs[:] = PAVING
    step = max(2, round(SLAB_M / canvas.texel_m))
    slabs[::step] = JOINT
    slabs[:, ::step] = JOINT
    _pave(picture, walk, slabs)
    for road in spec.roads:
        canvas.line(picture, road.points, road.width_m + 2 * KERB_M, KERB)
    slabs[:] = ASPHALT
    _pave(picture, paved, slabs)
    _patches(spec, canvas, picture, rng)
    return paved


def _patches(spec: WorldSpec, canvas: Canvas, picture: ImageU8, rng: np.random.Generator) -> None:
    """Mended places, manholes and oil spots."""
    for road in spec.roads:
        for at, yaw in along(road.points, 9.0, 4.0):
            side = float(rng.uniform(-0.32, 0.32)) * road.width_m
            spot = (at[0] - side * math.sin(yaw), at[1] + side * math.cos(yaw))
            kind = rng.random()
            if kind < 0.35:
                box = rectangle(spot, yaw, float(rng.uniform(0.6, 2.6)), float(rng.uniform(0.4, 1.1)))
                tone = float(rng.choice([0.76, 0.84, 1.1]))
                canvas.fill(picture, box, [v * tone for v in ASPHALT])
            elif kind < 0.5:
                canvas.disc(picture, spot, 0.36, (84, 84, 84))
                canvas.disc(picture, spot, 0.28, (66, 68, 70))
            elif kind < 0.75:
                canvas.disc(picture, spot, float(rng.uniform(0.1, 0.35)), (80, 79, 78))


def _markings(spec: WorldSpec, canvas: Canvas, picture: ImageU8, paved: ImageU8, rng: np.random.Generator) -> None:
    """Edge lines, a dashed centre line, zebra crossings where a road meets another; worn in places."""
    total = canvas.blank()
    for road in spec.roads:
        paint = canvas.blank()
        if road.width_m >= 6:
            canvas.line(paint, road.points, road.width_m - 0.40, 255)
            canvas.line(paint, road.points, road.width_m - 0.68, 0)
        for at, yaw in along(road.points, 6.0, 2.0):
            canvas.fill(paint, rectangle(at, yaw, 1.5, 0.075), 255)
        for other in spec.roads:
            if other is not road:
                canvas.line(paint, other.points, other.width_m + 1.0, 0)
        for other in spec.roads:
            if other is not road:
                _zebra(canvas, paint, road, other)
        total = np.maximum(total, paint)
    rows, columns = np.nonzero(cv2.bitwise_and(total, paved))
    if rows.size:
        wear = octaves(rng, (512, 512), (8, 32, 128, 512), 0.95)[rows % 512, columns % 512]
        cover = np.clip(0.86 - 0.2 * wear, 0.15, 1.0) * total[rows, columns] / 255
        under = picture[rows, columns].astype(np.float32)
        picture[rows, columns] = (under + cover[:, None] * (PAINT - under)).astype(np.uint8)


def _zebra(canvas: Canvas, paint: ImageU8, road: RoadSpec, other: RoadSpec) -> None:
    for end, inner in ((road.points[0], road.points[1]), (road.points[-1], road.points[-2])):
        foot = nearest_on(other.points, end)
        if math.dist(foot, end) > 1.0:
            continue
        yaw = math.atan2(inner[1] - end[1], inner[0] - end[0])
        away = other.width_m / 2 + 4.0
        middle = (end[0] + away * math.cos(yaw), end[1] + away * math.sin(yaw))
        canvas.fill(paint, rectangle(middle, yaw, 2.6, road.width_m / 2), 0)
        side = -road.width_m / 2 + 0.75
        while side < road.width_m / 2 - 0.4:
            bar = (middle[0] - side * math.sin(yaw), middle[1] + side * math.cos(yaw))
            canvas.fill(paint, rectangle(bar, yaw, 1.4, 0.25), 255)
            side += 1.0


def _wear(spec: WorldSpec, canvas: Canvas, picture: ImageU8, rng: np.random.Generator) -> None:
    """Cracks."""
    for road in spec.roads:
        for at, yaw in along(road.points, 11.0, 3.0):
            heading = yaw + float(rng.normal(0, 0.9))
            points: list[PointNE] = [(at[0] + float(rng.normal(0, 1.2)), at[1] + float(rng.normal(0, 1.2)))]
            for _ in range(int(rng.integers(5, 16))):
                heading += float(rng.normal(0, 0.45))
                last = points[-1]
                points.append((last[0] + 0.45 * math.cos(heading), last[1] + 0.45 * math.sin(heading)))
            canvas.line(picture, points, canvas.texel_m, (78, 78, 78))


def _tracks(spec: WorldSpec, canvas: Canvas, factor: npt.NDArray[np.float32]) -> None:
    """Lanes darkened by tyres, dust at the edges, broad stains; on the coarse raster of the light."""
    mask = canvas.blank()
    for road in spec.roads:
        for outer, inner, value in ((0.74, 0.30, 60), (0.62, 0.42, 20)):
            canvas.line(mask, road.points, road.width_m * outer, value)
            canvas.line(mask, road.points, road.width_m * inner, 0 if value == 60 else 60)
    if spec.roads:
        soft = cv2.GaussianBlur(mask, (0, 0), 0.35 / canvas.texel_m).astype(np.float32)
        factor *= (1 - 0.13 * soft / 60)[..., None]
