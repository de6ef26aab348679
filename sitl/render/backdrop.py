"""What lies behind everything: ground, haze and sky."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from sitl.render.projection import View
from sitl.render.surface import HAZE_LENGTH_M, Rect, shifted
from sitl.world.ground import DETAIL_PX, Ground
from sitl.world.light import Light

FloatArray = npt.NDArray[np.float64]
ImageU8 = npt.NDArray[np.uint8]

TILE_W_PX, TILE_H_PX = 160, 16  # pieces of the picture that choose their own level of the ground's pyramid
SHARPNESS = 0.4  # levels finer than the middle of a pixel's two footprints: a little aliasing rather than blur
DETAIL_BELOW_M = 0.035  # footprint under which the fine grain is put in
HAZE_FROM_M = 70.0  # nearer ground is left alone: less than 5 %
COARSE = 4  # haze and sky are computed on a grid that many times coarser
SOIL_BGRA = (36, 46, 58, 255)  # what a camera below the ground sees
CONTINUES_M = 0.02  # lowest height above the ground for which the ground is drawn


def ray_downs(view: View, x_px: FloatArray, y_px: FloatArray) -> FloatArray:
    """NED down component of the rays (depth 1) through pixels."""
    right, down, forward = view.axes[:, 2]
    focal = view.focal_px
    return np.asarray(forward + right * (x_px - view.middle_px[0]) / focal + down * (y_px - view.middle_px[1]) / focal)


def draw_backdrop(image: ImageU8, view: View, ground: Ground, light: Light, scale: float) -> None:
    """Fill the picture (H, W, 4) with ground, haze and sky; below the ground it is dark everywhere."""
    if view.height_m <= 0:
        image[:] = SOIL_BGRA
        return
    height = max(view.height_m, CONTINUES_M * scale)
    columns = max(1, math.ceil(view.width_px / TILE_W_PX))
    rows = max(1, math.ceil(view.height_px / TILE_H_PX))
    x: FloatArray = (np.arange(columns, dtype=np.float64) + 0.5)[None] * TILE_W_PX
    y: FloatArray = (np.arange(rows, dtype=np.float64) + 0.5)[:, None] * TILE_H_PX
    downs = ray_downs(view, x, y)
    tilt = np.abs(view.axes[:2, 2]) * np.array([TILE_W_PX, TILE_H_PX]) / 2 / view.focal_px
    seen = downs + tilt.sum() > 0
    depth = height / np.maximum(downs, 1e-5)
    footprint = depth / view.focal_px / np.sqrt(np.clip(downs, 1e-4, 1.0))
    levels = np.floor(np.log2(np.maximum(footprint / ground.texel_m, 1e-9)) + 0.5 - SHARPNESS).astype(int)
    levels = np.where(seen, np.clip(levels, 0, len(ground.levels) - 1), -1)
    # The ground is lowered where the camera lies upon it: a plane through the lens has no picture.
    origin = ground.origin + np.array([0.0, 0.0, height - view.height_m])
    to_texels = np.asarray(np.linalg.inv(view.plane_to_pixels(origin, ground.u, ground.v)), dtype=np.float64)
    for level, rect in _merged(levels, view):
        if level >= 0:
            _warp_ground(image, ground, to_texels, level, rect)
    near = np.where(seen & (footprint < DETAIL_BELOW_M * scale), 0, -1)
    for level, rect in _merged(near, view):
        if level >= 0:
            _warp_detail(image, ground, to_texels, rect)
    _haze_and_sky(image, view, light, height, scale)


def _merged(levels: npt.NDArray[np.int_], view: View) -> list[tuple[int, Rect]]:
    """Rectangles of one level each: runs along the rows, rows of one pattern together."""
    found = []
    lines = levels.tolist()
    top = 0
    for row in range(1, len(lines) + 1):
        if row < len(lines) and lines[row] == lines[top]:
            continue
        y0, y1 = top * TILE_H_PX, min(row * TILE_H_PX, view.height_px)
        start, line = 0, lines[top]
        for column in range(1, len(line) + 1):
            if column == len(line) or line[column] != line[start]:
                found.append((line[start], (start * TILE_W_PX, y0, min(column * TILE_W_PX, view.width_px), y1)))
                start = column
        top = row
    return found


def _warp_ground(image: ImageU8, ground: Ground, to_texels: FloatArray, level: int, rect: Rect) -> None:
    x0, y0, x1, y1 = rect
    matrix = to_texels.copy()
    matrix[:2] *= 0.5**level
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size, part = (x1 - x0, y1 - y0), image[y0:y1, x0:x1]
    texels = shifted(matrix, x0, y0)
    cv2.warpPerspective(ground.levels[level], texels, size, dst=part, flags=flags, borderMode=cv2.BORDER_WRAP)


def _warp_detail(image: ImageU8, ground: Ground, to_texels: FloatArray, rect: Rect) -> None:
    x0, y0, x1, y1 = rect
    matrix = to_texels.copy()
    matrix[:2] *= ground.texel_m / ground.detail_texel_m
    # Whole periods are taken off so that the window falls into the tile: cv2 is slow where it has to wrap.
    corners = matrix @ np.array([[x0, x1, x0, x1], [y0, y0, y1, y1], [1, 1, 1, 1]], dtype=np.float64)
    if float((corners[2] * corners[2, 0]).min()) <= 0:
        return
    least = np.floor((corners[:2] / corners[2]).min(axis=1) / DETAIL_PX) * DETAIL_PX
    matrix[:2] -= least[:, None] * matrix[2]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    grain = cv2.warpPerspective(
        ground.detail, shifted(matrix, x0, y0), (x1 - x0, y1 - y0), flags=flags, borderMode=cv2.BORDER_WRAP
    )
    part = image[y0:y1, x0:x1]
    cv2.multiply(part, cv2.cvtColor(grain, cv2.COLOR_GRAY2BGRA), part, 1 / 128)


def _haze_and_sky(image: ImageU8, view: View, light: Light, height_m: float, scale: float) -> None:
    """Blend the far ground into the haze, and draw the sky above the horizon."""
    limit = height_m / (HAZE_FROM_M * scale)  # rays less steep than that go into the haze
    x = np.array([0.0, view.width_px])
    edges = ray_downs(view, x[None], np.arange(0.0, view.height_px + COARSE, COARSE)[:, None])
    hazy = np.nonzero((edges < limit).any(axis=1))[0]
    if not hazy.size:
        return
    y0, y1 = int(hazy[0]) * COARSE, min(view.height_px, (int(hazy[-1]) + 1) * COARSE)
    rows, columns = max(1, (y1 - y0) // COARSE), max(1, view.width_px // COARSE)
    size = (view.width_px, y1 - y0)
    step_y, step_x = (y1 - y0) / rows, view.width_px / columns
    gx: FloatArray = (np.arange(columns, dtype=np.float64) + 0.5)[None] * step_x
    gy: FloatArray = y0 + (np.arange(rows, dtype=np.float64) + 0.5)[:, None] * step_y
    downs = ray_downs(view, gx, gy)
    depth = height_m / np.maximum(downs, 1e-6)
    share = 1 - np.exp(-np.maximum(depth / scale - HAZE_FROM_M * 0.5, 0) / HAZE_LENGTH_M)
    share = np.where(downs <= 0, 1.0, share)
    rest = cv2.cvtColor(np.round(255 * (1 - share)).astype(np.uint8), cv2.COLOR_GRAY2BGRA)
    part = image[y0:y1]
    cv2.multiply(part, cv2.resize(rest, size, interpolation=cv2.INTER_LINEAR), part, 1 / 255)
    sky = np.round(_sky(light, downs) * share[..., None]).astype(np.uint8)
    cv2.add(part, cv2.resize(sky, size, interpolation=cv2.INTER_LINEAR), part)


def _sky(light: Light, downs: FloatArray) -> FloatArray:
    """Colours (..., 4) of the sky; below the horizon that of the haze."""
    haze, zenith = np.asarray(light.haze_bgr), np.asarray(light.zenith_bgr)
    share = (np.minimum(np.maximum(-downs, 0.0), 0.7) / 0.7) ** 0.7
    found = np.zeros((*downs.shape, 4))
    for i, (low, high) in enumerate(zip(haze * light.exposure_bgr, zenith * light.exposure_bgr, strict=True)):
        found[..., i] = np.minimum(low + share * (high - low), 255.0)
    return found
