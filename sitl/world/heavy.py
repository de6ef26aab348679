"""Bodies of lorries and buses: high boxes with a skirt near the ground, so that a car behind one is hidden whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sitl.world.car_parts import GLASS, GLASS_GLOSS, HEADLAMP, PAINT_GLOSS, PLATE, TAIL_LAMP, TRIM, add_wheel
from sitl.world.mesh import BACK, FRONT, LEFT, RIGHT, Colour, FloatArray, MeshBuilder, Slice, band, on_quad
from sitl.world.spec import CarBody

SKIRT_M = 0.38  # underside of the skirt or the side guard above the ground
ROOF_EDGE_M = 0.14  # rounded edge of the roof
WHEEL_M = 0.5  # radius
CAB_GAP_M = 0.12  # between a lorry's cab and its box
PALE: Colour = (206.0, 210.0, 212.0)  # a lorry's box, whatever the colour of the cab
BELLOWS: Colour = (58.0, 58.0, 60.0)


@dataclass(frozen=True, slots=True)
class Heavy:
    """Measures in metres. `axles`: places along x. `cab_m`: length of a cab apart from the box (0: a bus).

    `bellows`: places along x of the joints of a bus, which is drawn stretched: for straight roads.
    """

    length_m: float
    half_width_m: float
    height_m: float
    axles: tuple[float, ...]
    cab_m: float = 0.0
    cab_height_m: float = 0.0
    windows: int = 0
    bellows: tuple[float, ...] = ()


HEAVY = {
    CarBody.LORRY: Heavy(10.0, 1.25, 3.6, (-2.9, -1.6, 3.7), cab_m=2.2, cab_height_m=2.9),
    CarBody.BUS: Heavy(12.0, 1.27, 3.1, (-2.9, 3.2), windows=8),
    CarBody.BENDY_BUS: Heavy(18.0, 1.27, 3.1, (-5.4, 0.8, 6.2), windows=12, bellows=(-1.6,)),
}


def build_heavy(builder: MeshBuilder, shape: Heavy, paint: Colour) -> None:
    """Add the body to a builder, its middle over the origin."""
    front, back = shape.length_m / 2, -shape.length_m / 2
    if shape.cab_m > 0:
        split = front - shape.cab_m
        _skirt(builder, shape, TRIM)
        layer_m = (shape.height_m + SKIRT_M) / 2
        sides = _box(builder, (back, split - CAB_GAP_M), shape.half_width_m, (0.95, shape.height_m), PALE)
        _stripes(builder, sides, paint)
        builder.end_part(layer_m)
        # Of the box's layer: the two stand one behind the other, not on each other.
        cab = _box(builder, (split, front), shape.half_width_m - 0.03, (0.7, shape.cab_height_m), paint)
        _windscreen(builder, cab[FRONT], (0.45, 0.88))
        for i, u in ((RIGHT, (0.08, 0.62)), (LEFT, (0.38, 0.92))):
            builder.face(on_quad(cab[i], u, (0.45, 0.85)), _across(i), GLASS, GLASS_GLOSS, decal=True)
        builder.end_part(layer_m)
        return
    quads = _box(builder, (back, front), shape.half_width_m, (SKIRT_M, shape.height_m), paint)
    _windscreen(builder, quads[FRONT], (0.35, 0.85))
    builder.face(on_quad(quads[BACK], (0.12, 0.88), (0.5, 0.85)), -_AHEAD, GLASS, GLASS_GLOSS, decal=True)
    _lamps(builder, quads)
    _bus_sides(builder, shape, quads)
    _wheels(builder, shape)
    builder.end_part(shape.height_m / 2)


_AHEAD = np.array([1.0, 0.0, 0.0])
_UP = np.array([0.0, 0.0, -1.0])


def _across(side: int) -> FloatArray:
    return np.array([0.0, 1.0 if side == RIGHT else -1.0, 0.0])


def _box(
    builder: MeshBuilder, ends: tuple[float, float], half_width_m: float, heights: tuple[float, float], paint: Colour
) -> list[FloatArray]:
    """A box with rounded edges; returns the twelve faces of its walls."""
    (back, front), (low, high) = ends, heights
    corner, edge = 0.12, high - ROOF_EDGE_M
    foot = Slice(back, front, half_width_m, corner, low, low)
    top = Slice(back, front, half_width_m, corner, edge, edge)
    roof = Slice(back + 0.1, front - 0.1, half_width_m - 0.1, corner, high, high)
    walls = band(foot, top)
    for quad, outward in (*walls, *band(top, roof)):
        builder.face(quad, outward, paint, PAINT_GLOSS)
    builder.face(roof.outline(), _UP, paint, PAINT_GLOSS)
    return [quad for quad, _ in walls]


def _skirt(builder: MeshBuilder, shape: Heavy, paint: Colour) -> None:
    """Frame, tanks and side guards of a lorry: one low box under cab and box."""
    front, back = shape.length_m / 2, -shape.length_m / 2
    foot = Slice(back, front, shape.half_width_m - 0.02, 0.12, SKIRT_M, SKIRT_M)
    top = Slice(back, front, shape.half_width_m, 0.12, 0.95, 0.95)
    walls = band(foot, top)
    for quad, outward in walls:
        builder.face(quad, outward, paint)
    _lamps(builder, [quad for quad, _ in walls])
    _wheels(builder, shape)
    builder.end_part(SKIRT_M / 2)


def _wheels(builder: MeshBuilder, shape: Heavy) -> None:
    for side in (-1.0, 1.0):
        for x_m in shape.axles:
            add_wheel(builder, x_m, side * (shape.half_width_m + 0.004), side, WHEEL_M)


def _windscreen(builder: MeshBuilder, quad: FloatArray, v: tuple[float, float]) -> None:
    builder.face(on_quad(quad, (0.04, 0.96), v), _AHEAD, GLASS, GLASS_GLOSS, decal=True)


def _lamps(builder: MeshBuilder, quads: Sequence[FloatArray]) -> None:
    for u in ((0.03, 0.16), (0.84, 0.97)):
        builder.face(on_quad(quads[FRONT], u, (0.08, 0.2)), _AHEAD, HEADLAMP, 0.2, decal=True)
        builder.face(on_quad(quads[BACK], u, (0.08, 0.24)), -_AHEAD, TAIL_LAMP, 0.1, decal=True)
    builder.face(on_quad(quads[FRONT], (0.38, 0.62), (0.02, 0.07)), _AHEAD, PLATE, decal=True)
    builder.face(on_quad(quads[BACK], (0.38, 0.62), (0.04, 0.1)), -_AHEAD, PLATE, decal=True)


def _stripes(builder: MeshBuilder, quads: Sequence[FloatArray], paint: Colour) -> None:
    """A firm's colour on the box and the joints of its panels."""
    for i in (RIGHT, LEFT):
        builder.face(on_quad(quads[i], (0.0, 1.0), (0.0, 0.22)), _across(i), paint, PAINT_GLOSS, decal=True)
        builder.face(on_quad(quads[i], (0.12, 0.88), (0.45, 0.75)), _across(i), paint, PAINT_GLOSS, decal=True)
        for u in (0.25, 0.5, 0.75):
            builder.face(on_quad(quads[i], (u - 0.004, u + 0.004), (0.0, 1.0)), _across(i), TRIM, decal=True)
    builder.face(on_quad(quads[BACK], (0.49, 0.51), (0.0, 1.0)), -_AHEAD, TRIM, decal=True)


def _bus_sides(builder: MeshBuilder, shape: Heavy, quads: Sequence[FloatArray]) -> None:
    """A row of windows on either side, doors on the right one, bellows around the joints."""
    for i in (RIGHT, LEFT):
        for k in range(shape.windows):
            u = ((k + 0.06) / shape.windows, (k + 0.94) / shape.windows)
            is_door = i == RIGHT and k % 4 == 1
            builder.face(
                on_quad(quads[i], u, (0.04 if is_door else 0.4, 0.86)), _across(i), GLASS, GLASS_GLOSS, decal=True
            )
        for x_m in shape.bellows:
            at = (shape.length_m / 2 - x_m) / shape.length_m
            at = at if i == RIGHT else 1 - at  # the outline runs back on the right side and forward on the left one
            builder.face(on_quad(quads[i], (at - 0.035, at + 0.035), (0.0, 1.0)), _across(i), BELLOWS, decal=True)
