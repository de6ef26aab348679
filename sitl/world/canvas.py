"""Drawing on the ground's picture in metres: the picture's columns go east, its rows north."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sitl.world.spec import PointNE

ImageU8 = npt.NDArray[np.uint8]
SHIFT = 4  # cv2 takes points in 1/16 pixel


@dataclass(frozen=True, slots=True)
class Canvas:
    """A square raster over the ground: texel (0, 0) has its outer corner at (`south_m`, `west_m`)."""

    south_m: float
    west_m: float
    texel_m: float
    side_px: int

    def blank(self) -> ImageU8:
        """A mask of zeros."""
        return np.zeros((self.side_px, self.side_px), np.uint8)

    def coarser(self, times: int) -> Canvas:
        """The same ground with texels `times` as large."""
        return Canvas(self.south_m, self.west_m, self.texel_m * times, self.side_px // times)

    def pixels(self, points: Sequence[PointNE]) -> npt.NDArray[np.int32]:
        """Points (n, 2) as cv2 takes them with `SHIFT`."""
        at = np.asarray(points, np.float64)
        xy = np.stack([at[:, 1] - self.west_m, at[:, 0] - self.south_m], axis=1) / self.texel_m - 0.5
        return np.round(xy * (1 << SHIFT)).astype(np.int32)

    def line(self, mask: ImageU8, points: Sequence[PointNE], width_m: float, value: float | Sequence[float]) -> None:
        """A line with round joints."""
        thick = max(1, round(width_m / self.texel_m))
        cv2.polylines(mask, [self.pixels(points)], False, _scalar(value), thick, cv2.LINE_AA, SHIFT)

    def fill(self, mask: ImageU8, points: Sequence[PointNE], value: float | Sequence[float]) -> None:
        """A convex polygon."""
        cv2.fillConvexPoly(mask, self.pixels(points), _scalar(value), cv2.LINE_AA, SHIFT)

    def disc(self, mask: ImageU8, at: PointNE, radius_m: float, value: float | Sequence[float]) -> None:
        """A disc."""
        x, y = (int(v) for v in self.pixels([at])[0])
        cv2.circle(
            mask, (x, y), max(1, round(radius_m / self.texel_m * (1 << SHIFT))), _scalar(value), -1, cv2.LINE_AA, SHIFT
        )


def _scalar(value: float | Sequence[float]) -> Sequence[float]:
    return (float(value),) if isinstance(value, (int, float)) else tuple(float(v) for v in value)


def rectangle(at: PointNE, yaw_rad: float, half_x_m: float, half_y_m: float) -> list[PointNE]:
    """Corners of a rectangle, x along `yaw_rad`."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    return [
        (at[0] + a * half_x_m * c - b * half_y_m * s, at[1] + a * half_x_m * s + b * half_y_m * c) for a, b in signs
    ]


def along(points: Sequence[PointNE], step_m: float, first_m: float = 0.0) -> list[tuple[PointNE, float]]:
    """Points every `step_m` along a line of straight pieces, each with the heading there."""
    found, left = [], first_m
    for a, b in itertools.pairwise(points):
        length = math.dist(a, b)
        if length < 1e-9:
            continue
        yaw = math.atan2(b[1] - a[1], b[0] - a[0])
        while left <= length:
            share = left / length
            found.append(((a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])), yaw))
            left += step_m
        left -= length
    return found


def nearest_on(points: Sequence[PointNE], at: PointNE) -> PointNE:
    """The point of a line of straight pieces that lies nearest."""
    best, where = math.inf, points[0]
    for a, b in itertools.pairwise(points):
        dn, de = b[0] - a[0], b[1] - a[1]
        square = dn * dn + de * de
        share = 0.0 if square < 1e-12 else ((at[0] - a[0]) * dn + (at[1] - a[1]) * de) / square
        share = min(1.0, max(0.0, share))
        point = (a[0] + share * dn, a[1] + share * de)
        if math.dist(point, at) < best:
            best, where = math.dist(point, at), point
    return where
