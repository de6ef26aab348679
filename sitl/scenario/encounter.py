"""Who hides the target when: the start and the speed of a mover that make an encounter last as long as it is to.

Seen from a fixed eye, the vehicle's start. A car is hidden when the rays to all points on its surface that face the
eye are cut, as the geometry camera has it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from sitl.scene import Vector
from sitl.world.cars import car_half_size_m, car_mesh
from sitl.world.motion import Path, Placement
from sitl.world.spec import BuildingSpec, CarSpec, PathSpec

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

STEP_S = 0.005  # to which the ends of a hidden time are found
SCAN_S = 0.2  # between the times, at 1 m/s, at which a hidden place is looked for; shorter ones are not found
MOST_M_S, LEAST_M_S = 20.0, 0.3  # speeds that are tried: a fast car in a town, a crawl
SPEED_RATIO = 0.85  # between speeds that are tried until the hidden time is long enough
HALVINGS = 12
WINDOW_S = 3.0  # beyond the hidden time, on either side of its middle, that is looked at
WAY_STEP_M = 0.25  # between the places of a way at which the line of sight is looked for


class EncounterError(ValueError):
    """No start or speed gives what is asked for; one line."""


@dataclass(frozen=True, slots=True)
class Stage:
    """What an encounter is reckoned with: the eye (NED), the target, and the houses that may hide it."""

    eye: Vector
    target: CarSpec
    houses: tuple[BuildingSpec, ...]


def hide_behind_mover(stage: Stage, mover: CarSpec, at_s: float, hidden_s: float) -> PathSpec:
    """The mover's way with the speed that hides the target for `hidden_s`, from `at_s` on. Raises EncounterError."""
    middle_s = at_s + hidden_s / 2
    along_m = _crossing_m(stage, mover, middle_s)

    def duration_s(speed_m_s: float) -> float:
        path = _arriving(mover.path, speed_m_s, along_m, middle_s)
        span = _span(stage, stage.target.path, [replace(mover, path=path)], middle_s, hidden_s + WINDOW_S)
        return span[1] - span[0]

    speed = _speed_for(duration_s, hidden_s, f"{mover.name}: it hides {stage.target.name}")
    return _arriving(mover.path, speed, along_m, middle_s)


def in_line(stage: Stage, mover: CarSpec, at_s: float) -> PathSpec:
    """The mover's way with the start that brings its middle into the line from the eye to the target at `at_s`.

    Raises EncounterError when its way does not cross that line.
    """
    return _arriving(mover.path, mover.path.speed_m_s, _crossing_m(stage, mover, at_s), at_s)


def _crossing_m(stage: Stage, mover: CarSpec, at_s: float) -> float:
    """How far along its way the mover crosses the line from the eye to the target of `at_s`."""
    place = Path(stage.target.path).at(at_s)
    sight = (place.north_m - stage.eye[0], place.east_m - stage.eye[1])
    way = Path(mover.path)
    count = math.floor(way.length_m / WAY_STEP_M) + 1
    sides = [_side(stage.eye, sight, way.along(i * WAY_STEP_M)) for i in range(count)]
    for i, (a, b) in enumerate(itertools.pairwise(sides)):
        ahead = way.along(i * WAY_STEP_M)
        towards = (ahead.north_m - stage.eye[0]) * sight[0] + (ahead.east_m - stage.eye[1]) * sight[1]
        if a * b <= 0 and a != b and towards > 0:
            return (i + a / (a - b)) * WAY_STEP_M
    raise EncounterError(f"{mover.name}: its way does not cross the line of sight to {stage.target.name} at {at_s:g} s")


def _arriving(path: PathSpec, speed_m_s: float, along_m: float, at_s: float) -> PathSpec:
    """The way with a speed, and the start by which it has come so far at `at_s`."""
    way = Path(replace(path, speed_m_s=speed_m_s, start_s=0.0))
    return replace(way.spec, start_s=at_s - _time_to(way, along_m))


def _time_to(way: Path, along_m: float) -> float:
    """How long a mover takes to come so far."""
    low, high = 0.0, way.end_s
    while high - low > STEP_S / 10:
        middle = (low + high) / 2
        low, high = (middle, high) if way.at(middle).travelled_m < along_m else (low, middle)
    return high


def hide_itself(stage: Stage, at_s: float, hidden_s: float | None) -> PathSpec:
    """The target's way with the start by which it is hidden whole from `at_s` on, and the speed that makes it last.

    `hidden_s` None: its speed stays as it is. Raises EncounterError.
    """
    path = stage.target.path
    first_m, last_m = _hidden_way(stage)
    if hidden_s is not None:

        def duration_s(speed_m_s: float) -> float:
            way = Path(replace(path, speed_m_s=speed_m_s, start_s=0.0))
            return math.inf if math.isinf(last_m) else _time_to(way, last_m) - _time_to(way, first_m)

        path = replace(path, speed_m_s=_speed_for(duration_s, hidden_s, f"{stage.target.name}: it is hidden"))
    return _arriving(path, path.speed_m_s, first_m, at_s)


def _hidden_way(stage: Stage) -> tuple[float, float]:
    """Where on its way (m) the target is first hidden whole, and where no more; infinite when it stays so.

    Raises EncounterError when nothing hides it.
    """
    # At 1 m/s times are metres but for the start, and what stands hides the same places at every speed.
    path = replace(stage.target.path, speed_m_s=1.0, start_s=0.0)
    way = Path(path)
    times = np.arange(0.0, way.end_s + SCAN_S, SCAN_S)
    hidden = _hidden(stage, path, times, [])
    if not hidden.any():
        raise EncounterError(f"{stage.target.name}: nothing hides it whole on its way")
    first = int(np.argmax(hidden))
    seen = np.nonzero(~hidden[first:])[0]
    begin_s, _ = _span(stage, path, [], float(times[first]), SCAN_S)
    if not seen.size:
        return way.at(begin_s).travelled_m, math.inf
    _, end_s = _span(stage, path, [], float(times[first + int(seen[0]) - 1]), SCAN_S)
    return way.at(begin_s).travelled_m, way.at(end_s).travelled_m


def _span(
    stage: Stage, path: PathSpec, movers: Sequence[CarSpec], inside_s: float, reach_s: float
) -> tuple[float, float]:
    """The time around `inside_s` in which the target is hidden whole, up to `reach_s` on either side."""

    def is_hidden(t_s: float) -> bool:
        return bool(_hidden(stage, path, np.array([t_s]), movers)[0])

    if not is_hidden(inside_s):
        return inside_s, inside_s
    ends = []
    for seen_s in (inside_s - reach_s, inside_s + reach_s):
        inner, outer = inside_s, seen_s
        while abs(outer - inner) > STEP_S:
            middle = (inner + outer) / 2
            inner, outer = (middle, outer) if is_hidden(middle) else (inner, middle)
        ends.append((inner + outer) / 2)
    return ends[0], ends[1]


def _speed_for(duration_s: Callable[[float], float], hidden_s: float, what: str) -> float:
    """The speed at which a hidden time, which falls with speed, is `hidden_s`."""
    high, longest = MOST_M_S, 0.0
    low = high * SPEED_RATIO
    while (found_s := duration_s(low)) < hidden_s:
        longest = max(longest, found_s)
        high, low = low, low * SPEED_RATIO
        if low < LEAST_M_S:
            raise EncounterError(
                f"{what} for {longest:.1f} s at most, {hidden_s:g} s are wanted; make its way or what hides it longer"
            )
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if duration_s(middle) >= hidden_s else (low, middle)
    return low


def _side(eye: Vector, sight: tuple[float, float], place: Placement) -> float:
    """On which side of the line of sight a place is, as a signed area."""
    return sight[0] * (place.east_m - eye[1]) - sight[1] * (place.north_m - eye[0])


def _hidden(stage: Stage, path: PathSpec, times: FloatArray, movers: Sequence[CarSpec]) -> BoolArray:
    """At which times (T,) the target on `path` is hidden whole by the movers, or by the houses where there are none."""
    mesh = car_mesh(stage.target)
    own = _poses(path, times)
    points, normals = _turned(mesh.samples, own), _turned(mesh.sample_normals, own)
    points[..., :2] += own[:, None, :2]
    eye = np.asarray(stage.eye)
    away = ((eye - points) * normals).sum(axis=-1) <= 0  # points that face away are hidden by the body itself
    cut = away.copy()
    for house in () if movers else stage.houses:
        pose = np.broadcast_to([house.north_m, house.east_m, house.yaw_rad], own.shape)
        cut |= _cut(eye, points, pose, (house.length_m / 2, house.width_m / 2, house.height_m))
    for mover in movers:
        cut |= _cut(eye, points, _poses(mover.path, times), car_half_size_m(mover))
    return np.asarray(cut.all(axis=1))


def _poses(path: PathSpec, times: FloatArray) -> FloatArray:
    """North, east, yaw (T, 3)."""
    way = Path(path)
    places = [way.at(float(t)) for t in times]
    return np.array([(p.north_m, p.east_m, p.yaw_rad) for p in places])


def _turned(vectors: FloatArray, poses: FloatArray) -> FloatArray:
    """Body vectors (S, 3) in NED directions at each pose: (T, S, 3)."""
    c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    x, y, z = vectors.T
    return np.stack([x * c - y * s, x * s + y * c, np.broadcast_to(z, (len(poses), len(z)))], axis=-1)


def _cut(eye: FloatArray, points: FloatArray, poses: FloatArray, size: tuple[float, float, float]) -> BoolArray:
    """Which rays from the eye to points (T, S, 3) pass through an upright box of half length, half width, height."""
    c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])

    def local(places: FloatArray) -> FloatArray:
        north, east = places[..., 0] - poses[:, :1], places[..., 1] - poses[:, 1:2]
        down = np.broadcast_to(places[..., 2], north.shape)
        return np.stack([north * c + east * s, east * c - north * s, down + size[2] / 2])

    start, end = local(eye[None, None]), local(points)
    half = np.array([size[0], size[1], size[2] / 2])[:, None, None]
    way = np.where(np.abs(end - start) < 1e-9, 1e-9, end - start)
    one, two = (-half - start) / way, (half - start) / way
    enter, leave = np.minimum(one, two).max(axis=0), np.maximum(one, two).min(axis=0)
    return np.asarray(np.maximum(enter, 0.0) < np.minimum(leave, 1.0))
