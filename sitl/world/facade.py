"""Pictures for walls and roofs: bricks or plaster with windows and doors, tiles, gravel, concrete."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sitl.world.noise import Grain, octaves

ImageU8 = npt.NDArray[np.uint8]
FloatImage = npt.NDArray[np.float32]

TEXEL_M = 0.04  # finer than a pixel beyond 20 m
FLOOR_M = 2.9
WALLS_BGR = (
    (176, 196, 204), (202, 210, 212), (140, 165, 182), (96, 112, 158), (120, 140, 172), (182, 186, 180),
)  # fmt: skip
ROOFS_BGR = ((66, 78, 128), (74, 76, 82), (72, 84, 104), (88, 104, 138), (96, 94, 92))


@dataclass(frozen=True, slots=True)
class Style:
    """How a house looks."""

    wall_bgr: tuple[int, int, int]
    brick: bool
    roof_bgr: tuple[int, int, int]

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Style:
        """A style drawn by `rng`."""
        wall = int(rng.integers(len(WALLS_BGR)))
        return cls(WALLS_BGR[wall], wall in (3, 4), ROOFS_BGR[int(rng.integers(len(ROOFS_BGR)))])


def _size(width_m: float, height_m: float) -> tuple[int, int]:
    return max(8, round(height_m / TEXEL_M)), max(8, round(width_m / TEXEL_M))


@dataclass(frozen=True, slots=True, eq=False)
class Painter:
    """What all pictures of one building share: random numbers and the world's grain."""

    rng: np.random.Generator
    grain: Grain

    def rough(self, size: tuple[int, int], amplitude: float) -> FloatImage:
        """Factors (rows, columns, 1) of an uneven surface."""
        return np.asarray(1 + amplitude * self.grain.piece(self.rng, size)[..., None], dtype=np.float32)


def _finish(image: FloatImage) -> ImageU8:
    return np.clip(image, 0, 255).astype(np.uint8)


def wall(painter: Painter, style: Style, width_m: float, height_m: float, door: bool) -> ImageU8:
    """A wall seen from outside; row 0 is at the eaves."""
    rng = painter.rng
    rows, columns = _size(width_m, height_m)
    image = np.empty((rows, columns, 3), np.float32)
    image[:] = style.wall_bgr
    if style.brick:
        image *= _bricks(rng, rows, columns)
    heights = (rows - np.arange(rows, dtype=np.float32))[:, None, None] * TEXEL_M
    image *= 1 - 0.22 * np.exp(-heights / 0.5)  # splashed earth at the foot
    image[: max(1, round(0.45 / TEXEL_M))] *= 0.62  # shade of the eaves
    _openings(rng, image, width_m, height_m, door)
    return _finish(image * painter.rough((rows, columns), 0.05))


def _bricks(rng: np.random.Generator, rows: int, columns: int) -> FloatImage:
    """Courses of 8 cm: a factor for each brick and light joints."""
    brick_rows, brick_columns = rows // 2 + 1, columns // 6 + 2
    tones = rng.uniform(0.82, 1.14, (brick_rows, brick_columns)).astype(np.float32)
    factor = np.repeat(np.repeat(tones, 2, axis=0), 6, axis=1)[:rows, :columns]
    return np.asarray(factor[..., None], dtype=np.float32)


def _openings(rng: np.random.Generator, image: FloatImage, width_m: float, height_m: float, door: bool) -> None:
    floors = max(1, int((height_m + 0.4) / FLOOR_M))
    bays = max(1, int(width_m / 3.1))
    pitch = width_m / bays
    frame = (228.0, 230.0, 230.0) if rng.random() < 0.7 else (70.0, 72.0, 76.0)
    wide = float(rng.uniform(1.1, 1.7))
    door_bay = int(rng.integers(bays)) if door else -1
    for floor in range(floors):
        for bay in range(bays):
            middle = (bay + 0.5) * pitch
            sill = floor * FLOOR_M + 0.9
            if floor == 0 and bay == door_bay:
                colour = tuple(float(v) for v in rng.integers(30, 130, 3))
                _rectangle(image, middle, 0.0, 1.25, 2.25, frame)
                _rectangle(image, middle, 0.0, 1.0, 2.12, colour)
                continue
            if sill + 1.4 > height_m - 0.2 or rng.random() < 0.08:
                continue
            _window(rng, image, middle, sill, min(wide, pitch * 0.7), frame)


def _window(
    rng: np.random.Generator, image: FloatImage, middle_m: float, sill_m: float, wide_m: float,
    frame: tuple[float, ...],
) -> None:  # fmt: skip
    _rectangle(image, middle_m, sill_m - 0.12, wide_m + 0.3, 0.12, (170.0, 172.0, 172.0))
    _rectangle(image, middle_m, sill_m, wide_m + 0.16, 1.4, frame)
    glass = float(rng.uniform(38, 78))
    _rectangle(image, middle_m, sill_m + 0.08, wide_m, 1.24, (glass * 1.15, glass, glass * 0.88))
    _rectangle(image, middle_m, sill_m + 0.85, wide_m, 0.47, (glass * 1.9, glass * 1.7, glass * 1.5))  # mirrored sky
    if rng.random() < 0.5:
        _rectangle(image, middle_m - wide_m * 0.36, sill_m + 0.08, wide_m * 0.24, 1.24, (168.0, 176.0, 180.0))
    _rectangle(image, middle_m, sill_m + 0.08, 0.08, 1.24, frame)


def _rectangle(
    image: FloatImage, middle_m: float, foot_m: float, wide_m: float, high_m: float, bgr: tuple[float, ...]
) -> None:
    rows, columns = image.shape[:2]
    x0, x1 = (round((middle_m + side * wide_m / 2) / TEXEL_M) for side in (-1, 1))
    y0, y1 = rows - round((foot_m + high_m) / TEXEL_M), rows - round(foot_m / TEXEL_M)
    image[max(0, y0) : max(0, y1), max(0, x0) : min(columns, max(0, x1))] = bgr


def tiles(painter: Painter, style: Style, width_m: float, height_m: float) -> ImageU8:
    """A slope of a tiled roof; row 0 is at the ridge."""
    rng = painter.rng
    rows, columns = _size(width_m, height_m)
    course, tile = 7, 6
    tones = rng.uniform(0.86, 1.12, (rows // course + 1, columns // tile + 1)).astype(np.float32)
    laid = np.repeat(np.repeat(tones, course, axis=0), tile, axis=1)[:rows, :columns]
    along = np.arange(rows, dtype=np.float32) % course / course
    factor = laid * (1.08 - 0.26 * along**3)[:, None]
    image = np.asarray(style.roof_bgr, np.float32) * factor[..., None] * painter.rough((rows, columns), 0.09)
    return _finish(np.asarray(image, dtype=np.float32))


def gravel(painter: Painter, width_m: float, height_m: float) -> ImageU8:
    """A flat roof: gravel or felt with seams, a parapet, a few boxes of ventilation."""
    rng = painter.rng
    rows, columns = _size(width_m, height_m)
    image = np.empty((rows, columns, 3), np.float32)
    image[:] = np.array([132.0, 136.0, 138.0]) * rng.uniform(0.75, 1.15)
    image *= painter.rough((rows, columns), 0.08)
    for row in range(0, rows, round(1.0 / TEXEL_M)):
        image[row : row + 1] *= 0.86
    for _ in range(max(1, int(width_m * height_m / 60))):
        w, h = (round(float(v) / TEXEL_M) for v in rng.uniform(0.7, 2.2, 2))
        x, y = int(rng.integers(10, max(11, columns - w - 10))), int(rng.integers(10, max(11, rows - h - 10)))
        image[y + 12 : y + h + 12, x + 12 : x + w + 12] *= 0.5
        image[y : y + h, x : x + w] = rng.uniform(140, 200)
        image[y : y + h : 4, x : x + w] *= 0.8
    edge = round(0.35 / TEXEL_M)
    parapet = np.array([178.0, 180.0, 180.0], np.float32)
    for part in (image[:edge], image[-edge:], image[:, :edge], image[:, -edge:]):
        part[:] = parapet
    return _finish(cv2.GaussianBlur(image, (3, 3), 0.6).astype(np.float32))


def concrete(painter: Painter, width_m: float, height_m: float) -> ImageU8:
    """Poured concrete with stains that run down."""
    rng = painter.rng
    rows, columns = _size(width_m, height_m)
    streaks = np.repeat(octaves(rng, (1, columns), (max(2, columns // 12), columns), 0.8), rows, axis=0)[..., None]
    image = np.array([150.0, 153.0, 154.0], np.float32) * (1 + 0.05 * streaks) * painter.rough((rows, columns), 0.06)
    return _finish(np.asarray(image, dtype=np.float32))


def railing(painter: Painter, width_m: float, height_m: float) -> ImageU8:
    """Metal posts and bars before dark panels."""
    rows, columns = _size(width_m, height_m)
    image = np.empty((rows, columns, 3), np.float32)
    image[:] = (112.0, 106.0, 92.0)
    image[:, ::4] = (168.0, 164.0, 152.0)
    image[:, :: round(1.6 / TEXEL_M)] = (190.0, 188.0, 182.0)
    image[: max(1, rows // 8)] = (196.0, 194.0, 190.0)
    return _finish(image * painter.rough((rows, columns), 0.04))
