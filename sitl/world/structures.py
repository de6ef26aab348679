"""Houses and bridges as solids."""

from __future__ import annotations

import math

import numpy as np

from sitl.world import facade
from sitl.world.facade import Painter
from sitl.world.light import Light
from sitl.world.solid import FloatArray, ImageU8, LocalFrame, Solid, TexturedFace, make_solid, textured_face
from sitl.world.spec import BridgeSpec, BuildingSpec

OVERHANG_M = 0.35
ROOF_PITCH = 0.62  # rise over run, about 32 degrees
HIGHEST_ROOF_SHARE = 0.42  # of the whole height
TILED_BELOW_M = 14.5  # wider houses have flat roofs
DECK_M = 0.45  # the slab; the rest of the bridge's thickness is railing
RAIL_M = 0.12
PILLAR_M = 1.2


def building_solids(spec: BuildingSpec, name: str, light: Light, painter: Painter) -> list[Solid]:
    """Walls and, on a house of usual width, a hipped roof. Nothing but the eaves lies outside of the cuboid."""
    frame = LocalFrame(spec.north_m, spec.east_m, spec.yaw_rad)
    style = facade.Style.draw(painter.rng)
    short = min(spec.length_m, spec.width_m)
    rise = min(ROOF_PITCH * short / 2, HIGHEST_ROOF_SHARE * spec.height_m) if short <= TILED_BELOW_M else 0.0
    eaves = spec.height_m - rise
    half = (spec.length_m / 2, spec.width_m / 2)
    pictures = [
        facade.wall(painter, style, spec.width_m, eaves, True),
        facade.wall(painter, style, spec.length_m, eaves, True),
        facade.wall(painter, style, spec.width_m, eaves, False),
        facade.wall(painter, style, spec.length_m, eaves, False),
    ]
    faces = _walls(frame, half, (0.0, eaves), pictures, light)
    top = facade.gravel(painter, spec.length_m, spec.width_m) if rise == 0 else facade.concrete(painter, 1.0, 1.0)
    faces.append(_lid(frame, half, eaves, top, light))
    solids = [make_solid(name, faces, frame, half, (0.0, eaves))]
    if rise > 0:
        solids.append(_hipped_roof(frame, half, (eaves, spec.height_m), style, light, painter, name))
    return solids


def bridge_solids(spec: BridgeSpec, name: str, light: Light, painter: Painter) -> list[Solid]:
    """Deck, two railings, and a pillar (as wide as the deck) at each end."""
    frame = LocalFrame(spec.north_m, spec.east_m, spec.yaw_rad)
    deck_m = min(DECK_M, spec.thickness_m * 0.6)
    low, mid, high = spec.clearance_m, spec.clearance_m + deck_m, spec.clearance_m + spec.thickness_m
    half = (spec.length_m / 2, spec.width_m / 2)
    side, end = facade.concrete(painter, spec.length_m, deck_m), facade.concrete(painter, spec.width_m, deck_m)
    top, bottom = (facade.concrete(painter, spec.length_m, spec.width_m) for _ in range(2))
    solids = [_box(name, frame, half, (low, mid), (end, side, top), light, bottom)]
    rail, tip = facade.railing(painter, spec.length_m, high - mid), facade.concrete(painter, RAIL_M, high - mid)
    lid = facade.concrete(painter, spec.length_m, RAIL_M)
    for sign in (-1.0, 1.0):
        centre = frame.point(0.0, sign * (half[1] - RAIL_M / 2), 0.0)
        own = LocalFrame(float(centre[0]), float(centre[1]), spec.yaw_rad)
        solids.append(_box(name, own, (half[0], RAIL_M / 2), (mid, high), (tip, rail, lid), light))
    wide, thin = facade.concrete(painter, spec.width_m, low), facade.concrete(painter, PILLAR_M, low)
    for sign in (-1.0, 1.0):
        own = pillar_frame(spec, sign)
        solids.append(_box(name, own, (PILLAR_M / 2, half[1]), (0.0, low), (wide, thin, thin), light))
    return solids


def pillar_frame(spec: BridgeSpec, sign: float) -> LocalFrame:
    """Where the pillar at the far (+1) or near (-1) end stands."""
    frame = LocalFrame(spec.north_m, spec.east_m, spec.yaw_rad)
    foot = frame.point(sign * (spec.length_m / 2 - PILLAR_M / 2), 0.0, 0.0)
    return LocalFrame(float(foot[0]), float(foot[1]), spec.yaw_rad)


def _box(
    name: str, frame: LocalFrame, half: tuple[float, float], heights: tuple[float, float],
    pictures: tuple[ImageU8, ImageU8, ImageU8], light: Light, bottom: ImageU8 | None = None,
) -> Solid:  # fmt: skip
    """A cuboid with pictures of (ends, sides, top)."""
    ends, sides, top = pictures
    faces = [
        *_walls(frame, half, heights, [ends, sides, ends, sides], light),
        _lid(frame, half, heights[1], top, light),
    ]
    if bottom is not None:
        x, y = half
        corners = [frame.point(a, b, heights[0]) for a, b in ((-x, y), (x, y), (x, -y), (-x, -y))]
        faces.append(
            textured_face(corners, frame.direction(1, 0, 0), frame.direction(0, -1, 0), bottom, facade.TEXEL_M, light)
        )
    return make_solid(name, faces, frame, half, heights)


def _walls(
    frame: LocalFrame, half: tuple[float, float], heights: tuple[float, float], pictures: list[ImageU8], light: Light
) -> list[TexturedFace]:
    """Front (+x), right (+y), back and left, each seen from outside."""
    x, y = half
    plan = [(x, y), (-x, y), (-x, -y), (x, -y)]  # counter-clockwise from outside: the wall goes to the right
    low, high = heights
    down = frame.direction(0, 0, -1)
    faces = []
    for (start, end), picture in zip(
        ((plan[3], plan[0]), (plan[0], plan[1]), (plan[1], plan[2]), (plan[2], plan[3])), pictures, strict=True
    ):
        # Seen from outside the wall runs from its right end (in plan order) to its left one.
        a, b = end, start
        length = math.dist(a, b)
        along = frame.direction((b[0] - a[0]) / length, (b[1] - a[1]) / length, 0)
        corners = [frame.point(*a, high), frame.point(*b, high), frame.point(*b, low), frame.point(*a, low)]
        faces.append(textured_face(corners, along, down, picture, facade.TEXEL_M, light))
    return faces


def _lid(frame: LocalFrame, half: tuple[float, float], height: float, picture: ImageU8, light: Light) -> TexturedFace:
    x, y = half
    corners = [frame.point(a, b, height) for a, b in ((-x, -y), (x, -y), (x, y), (-x, y))]
    return textured_face(corners, frame.direction(1, 0, 0), frame.direction(0, 1, 0), picture, facade.TEXEL_M, light)


def _hipped_roof(
    frame: LocalFrame, half: tuple[float, float], heights: tuple[float, float], style: facade.Style, light: Light,
    painter: Painter, name: str,
) -> Solid:  # fmt: skip
    x, y = half[0] + OVERHANG_M, half[1] + OVERHANG_M
    low, high = heights
    run = min(x, y)
    ridge_x, ridge_y = max(0.0, x - run), max(0.0, y - run)
    slope = math.hypot(run, high - low)
    faces = []
    for turn in range(4):
        # Quarter turns of the roof: `a` half the eaves' length, `b` the way out to them, `r` half the ridge's part.
        a, b, r = (y, x, ridge_y) if turn % 2 == 0 else (x, y, ridge_x)
        out = ridge_x if turn % 2 == 0 else ridge_y
        own = LocalFrame(frame.north_m, frame.east_m, frame.yaw_rad + turn * math.pi / 2)
        down = own.direction(b - out, 0, low - high) / slope
        along = own.direction(0, -1, 0)
        corner = own.point(b, a, low) - down * slope
        polygon: list[FloatArray] = [own.point(out, r, high)]
        if r > 0:
            polygon.append(own.point(out, -r, high))
        polygon += [own.point(b, -a, low), own.point(b, a, low)]
        picture = facade.tiles(painter, style, 2 * a, slope)
        face = textured_face([corner, *polygon], along, down, picture, facade.TEXEL_M, light)
        faces.append(TexturedFace(np.array(polygon), face.normal, face.origin, face.u, face.v, face.levels))
    return make_solid(name, faces, frame, (x, y), heights)
