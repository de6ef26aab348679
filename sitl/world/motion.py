"""Where a moving object is at a time: straight lines, rounded corners, a gentle start and stop."""

from __future__ import annotations

import itertools
import math
from bisect import bisect_right
from dataclasses import dataclass, replace

from sitl.world.spec import PathSpec, PointNE

ACCEL_M_S2 = 2.5  # a brisk car; a person reaches walking speed in half a second
SHORTEST_M = 1e-6  # points closer than this are one point
LEAST_RADIUS_M = 1e-3  # tighter corners are turned on the spot


@dataclass(frozen=True, slots=True)
class Placement:
    """Where an object is: its middle on the ground, heading (clockwise from north, not wrapped), speed, way so far."""

    north_m: float
    east_m: float
    yaw_rad: float
    speed_m_s: float = 0.0
    yaw_rate_rad_s: float = 0.0
    travelled_m: float = 0.0

    def mapped(self, scale: float, mirror: bool) -> Placement:
        """The same in a world `scale` times as large, with east and west exchanged when `mirror`."""
        side = -1.0 if mirror else 1.0
        return replace(
            self,
            north_m=self.north_m * scale,
            east_m=self.east_m * scale * side,
            yaw_rad=self.yaw_rad * side,
            speed_m_s=self.speed_m_s * scale,
            yaw_rate_rad_s=self.yaw_rate_rad_s * side,
            travelled_m=self.travelled_m * scale,
        )


@dataclass(frozen=True, slots=True)
class _Piece:
    """A line (curvature 0) or an arc, from `start_m` along the way on."""

    start_m: float
    length_m: float
    north_m: float
    east_m: float
    yaw_rad: float
    curvature_1_m: float = 0.0

    def at(self, along_m: float) -> tuple[float, float, float]:
        s, k = along_m - self.start_m, self.curvature_1_m
        if k == 0.0:
            return self.north_m + s * math.cos(self.yaw_rad), self.east_m + s * math.sin(self.yaw_rad), self.yaw_rad
        yaw = self.yaw_rad + k * s
        north = self.north_m + (math.sin(yaw) - math.sin(self.yaw_rad)) / k
        return north, self.east_m - (math.cos(yaw) - math.cos(self.yaw_rad)) / k, yaw


class Path:
    """A way in time. Speed is constant but for the start and the stop, which take `ACCEL_M_S2`."""

    def __init__(self, spec: PathSpec) -> None:
        self.spec = spec
        self._pieces = _pieces(spec)
        self._starts = [piece.start_m for piece in self._pieces]
        last = self._pieces[-1] if self._pieces else None
        self.length_m = last.start_m + last.length_m if last else 0.0
        # A short way has no room for the full speed.
        self.peak_m_s = min(spec.speed_m_s, math.sqrt(ACCEL_M_S2 * self.length_m))

    @property
    def end_s(self) -> float:
        """When the object arrives at its last point (start_s for one that never moves)."""
        if self.peak_m_s <= 0:
            return self.spec.start_s
        ramp_s = self.peak_m_s / ACCEL_M_S2
        return self.spec.start_s + 2 * ramp_s + (self.length_m - self.peak_m_s * ramp_s) / self.peak_m_s

    def at(self, t_s: float) -> Placement:
        """Placement at a time; before `start_s` at the first point, after the end at the last one."""
        along, speed = self._progress(t_s)
        return self.along(along, speed)

    def along(self, along_m: float, speed_m_s: float = 0.0) -> Placement:
        """Placement at a way from the first point, whatever the time."""
        if not self._pieces:
            north, east = self.spec.points[0]
            return Placement(north, east, self.spec.yaw_rad)
        piece = self._pieces[max(0, bisect_right(self._starts, along_m) - 1)]
        north, east, yaw = piece.at(along_m)
        return Placement(north, east, yaw, speed_m_s, speed_m_s * piece.curvature_1_m, along_m)

    def _progress(self, t_s: float) -> tuple[float, float]:
        since, left, peak = t_s - self.spec.start_s, self.end_s - t_s, self.peak_m_s
        if since <= 0 or peak <= 0:
            return 0.0, 0.0
        if left <= 0:
            return self.length_m, 0.0
        ramp_s = peak / ACCEL_M_S2
        if min(since, left) >= ramp_s:
            return peak * (since - ramp_s / 2), peak
        if since < left:
            return ACCEL_M_S2 * since**2 / 2, ACCEL_M_S2 * since
        return self.length_m - ACCEL_M_S2 * left**2 / 2, ACCEL_M_S2 * left


def _distinct(points: tuple[PointNE, ...]) -> list[PointNE]:
    kept = [points[0]]
    for point in points[1:]:
        if math.dist(point, kept[-1]) > SHORTEST_M:
            kept.append(point)
    return kept


def _pieces(spec: PathSpec) -> list[_Piece]:
    points = _distinct(spec.points)
    headings = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in itertools.pairwise(points)]
    lengths = [math.dist(a, b) for a, b in itertools.pairwise(points)]
    pieces: list[_Piece] = []
    along, cut, yaw = 0.0, 0.0, headings[0] if headings else 0.0
    for i, (heading, length) in enumerate(zip(headings, lengths, strict=True)):
        turn, tangent = 0.0, 0.0
        if i + 1 < len(lengths):
            turn = math.remainder(headings[i + 1] - heading, 2 * math.pi)
            room = min(length, lengths[i + 1]) / 2
            tangent = min(spec.corner_radius_m * abs(math.tan(turn / 2)), room)
        north = points[i][0] + cut * math.cos(heading)
        east = points[i][1] + cut * math.sin(heading)
        line = _Piece(along, length - cut - tangent, north, east, yaw)
        pieces.append(line)
        along += line.length_m
        radius = tangent / abs(math.tan(turn / 2)) if tangent > 0 else 0.0
        if radius > LEAST_RADIUS_M:
            north, east, _ = line.at(along)
            pieces.append(_Piece(along, radius * abs(turn), north, east, yaw, math.copysign(1 / radius, turn)))
            along += pieces[-1].length_m
            cut = tangent
        else:
            # Turned on the spot: the line still has to reach the corner itself.
            pieces[-1] = replace(line, length_m=line.length_m + tangent)
            along += tangent
            cut = 0.0
        yaw += turn
    return pieces
