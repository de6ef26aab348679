"""Bodies of cars: a rounded lower body, a glazed cabin on top, wheels, lamps. Lorries and buses: heavy.py."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sitl.world.car_parts import (
    GLASS,
    GLASS_GLOSS,
    HEADLAMP,
    PAINT_GLOSS,
    PLATE,
    TAIL_LAMP,
    TRIM,
    add_wheel,
)
from sitl.world.heavy import HEAVY, build_heavy
from sitl.world.mesh import BACK, FRONT, LEFT, RIGHT, Colour, FloatArray, Mesh, MeshBuilder, Slice, band, on_quad
from sitl.world.spec import CarBody, CarSpec


@dataclass(frozen=True, slots=True)
class _Shape:
    """Measures of a body in metres: length, half width, height of the belt at back and front, and the cabin.

    `cabin` is (foot back, foot front, roof back, roof front) along x, `roof_m` the roof's height, `roof_half_m`
    half its width, `glass_from` where the side glass begins along the side (0 = back).
    """

    length_m: float
    half_width_m: float
    belt_back_m: float
    belt_front_m: float
    cabin: tuple[float, float, float, float]
    roof_m: float
    roof_half_m: float
    wheelbase_m: float
    glass_from: float = 0.0
    bed: tuple[float, float] | None = None


SHAPES = {
    CarBody.SEDAN: _Shape(4.5, 0.90, 0.98, 0.80, (-1.80, 0.95, -1.05, 0.22), 1.45, 0.60, 2.7),
    CarBody.HATCHBACK: _Shape(4.0, 0.87, 0.98, 0.82, (-1.93, 0.95, -1.55, 0.15), 1.50, 0.60, 2.5),
    CarBody.VAN: _Shape(5.0, 0.97, 1.10, 1.02, (-2.44, 1.75, -2.34, 0.95), 2.05, 0.80, 3.0, 0.62),
    CarBody.PICKUP: _Shape(5.2, 0.95, 1.05, 0.98, (-0.55, 1.30, -0.35, 0.55), 1.80, 0.66, 3.2, 0.0, (-2.45, -0.62)),
}


@lru_cache(maxsize=64)  # many worlds are built of few cars
def car_mesh(spec: CarSpec) -> Mesh:
    """The body of a car, its middle over the origin."""
    red, green, blue = spec.colour_rgb
    paint: Colour = (float(blue), float(green), float(red))
    builder = MeshBuilder()
    if spec.body in HEAVY:
        build_heavy(builder, HEAVY[spec.body], paint)
        return builder.build(spec.scale)
    shape = SHAPES[spec.body]
    belt = _lower_body(builder, shape, paint)
    _cabin(builder, shape, belt, paint)
    return builder.build(spec.scale)


def car_half_size_m(spec: CarSpec) -> tuple[float, float, float]:
    """Half length, half width and full height of a car."""
    if spec.body in HEAVY:
        heavy = HEAVY[spec.body]
        half_length_m, half_width_m, height_m = heavy.length_m / 2, heavy.half_width_m, heavy.height_m
    else:
        shape = SHAPES[spec.body]
        half_length_m, half_width_m, height_m = shape.length_m / 2, shape.half_width_m, shape.roof_m
    return half_length_m * spec.scale, half_width_m * spec.scale, height_m * spec.scale


def _lower_body(builder: MeshBuilder, shape: _Shape, paint: Colour) -> Slice:
    x, w = shape.length_m / 2, shape.half_width_m
    back, front = shape.belt_back_m, shape.belt_front_m
    slices = [
        Slice(-x + 0.22, x - 0.22, w - 0.10, 0.22, 0.20, 0.20),
        Slice(-x + 0.03, x - 0.02, w - 0.02, 0.34, 0.36, 0.34),
        Slice(-x, x, w, 0.38, 0.62 * back, 0.66 * front),
        Slice(-x + 0.04, x - 0.10, w - 0.02, 0.38, 0.86 * back, 0.92 * front),
        Slice(-x + 0.14, x - 0.30, w - 0.09, 0.36, back, front),
    ]
    for level, (low, high) in enumerate(itertools.pairwise(slices)):
        for quad, outward in band(low, high):
            builder.face(quad, outward, TRIM if level == 0 else paint, 0.0 if level == 0 else PAINT_GLOSS)
    quads = [quad for quad, _ in band(slices[1], slices[2])]
    uppers = [quad for quad, _ in band(slices[2], slices[3])]
    _ends(builder, quads, uppers)
    top = slices[-1].outline()
    up = np.array([0.0, 0.0, -1.0])
    builder.face(top, up, paint, PAINT_GLOSS)
    if shape.bed:
        inner = Slice(shape.bed[0], shape.bed[1], w - 0.2, 0.08, back, back - 0.02)
        builder.face(inner.outline(), up, TRIM, 0.0, decal=True)
    for side in (-1.0, 1.0):
        for axle in (-shape.wheelbase_m / 2, shape.wheelbase_m / 2):
            add_wheel(builder, axle, side * (w + 0.004), side)
    builder.end_part(0.5 * back)
    return slices[-1]


def _ends(builder: MeshBuilder, quads: list[FloatArray], uppers: list[FloatArray]) -> None:
    """Grille, plates and bumpers, and the lamps, which reach around the corners."""
    x_axis = np.array([1.0, 0.0, 0.0])
    builder.face(on_quad(quads[FRONT], (0.12, 0.88), (0.15, 0.75)), x_axis, TRIM, decal=True)
    builder.face(on_quad(quads[FRONT], (0.38, 0.62), (0.25, 0.60)), x_axis, PLATE, decal=True)
    builder.face(on_quad(quads[BACK], (0.35, 0.65), (0.35, 0.80)), -x_axis, PLATE, decal=True)
    builder.face(on_quad(quads[BACK], (0.02, 0.98), (0.02, 0.22)), -x_axis, TRIM, decal=True)
    for corner in (FRONT + 1, FRONT - 1):
        quad = uppers[corner % 12]
        builder.face(on_quad(quad, (0.05, 0.95), (0.10, 0.75)), x_axis, HEADLAMP, 0.2, decal=True)
    for corner in (BACK - 1, BACK + 1):
        quad = uppers[corner % 12]
        builder.face(on_quad(quad, (0.05, 0.95), (0.05, 0.85)), -x_axis, TAIL_LAMP, 0.1, decal=True)
    for u in ((0.0, 0.16), (0.84, 1.0)):
        builder.face(on_quad(uppers[FRONT], u, (0.10, 0.75)), x_axis, HEADLAMP, 0.2, decal=True)
        builder.face(on_quad(uppers[BACK], u, (0.05, 0.85)), -x_axis, TAIL_LAMP, 0.1, decal=True)


def _cabin(builder: MeshBuilder, shape: _Shape, belt: Slice, paint: Colour) -> None:
    foot_back, foot_front, roof_back, roof_front = shape.cabin
    rise = (belt.height_front_m - belt.height_back_m) / (belt.front_m - belt.back_m)

    def belt_height(x_m: float) -> float:
        return belt.height_back_m + rise * (x_m - belt.back_m)

    foot = Slice(foot_back, foot_front, belt.half_width_m - 0.03, 0.16, belt_height(foot_back), belt_height(foot_front))
    roof, half = shape.roof_m, shape.roof_half_m
    edge = Slice(roof_back, roof_front, half, 0.14, roof - 0.07, roof - 0.07)
    crown = Slice(roof_back + 0.14, roof_front - 0.16, half - 0.12, 0.12, roof, roof)
    for i, (quad, outward) in enumerate(band(foot, edge)):
        glazed = i in (FRONT, BACK, RIGHT, LEFT)
        panelled = shape.glass_from > 0 and i in (BACK, RIGHT, LEFT)
        if glazed and not panelled:
            builder.face(quad, outward, GLASS, GLASS_GLOSS)
        else:
            builder.face(quad, outward, paint, PAINT_GLOSS)
    _side_glass(builder, band(foot, edge), shape, paint)
    for quad, outward in band(edge, crown):
        builder.face(quad, outward, paint, PAINT_GLOSS)
    builder.face(crown.outline(), np.array([0.0, 0.0, -1.0]), paint, PAINT_GLOSS)
    builder.end_part((roof + belt.height_back_m) / 2)


def _side_glass(builder: MeshBuilder, faces: list[tuple[FloatArray, FloatArray]], shape: _Shape, paint: Colour) -> None:
    """Pillars on glazed sides; windows in the panels of a van."""
    for i in (RIGHT, LEFT):
        quad, outward = faces[i]
        forward = i == LEFT  # the outline runs back on the right side and forward on the left one
        if shape.glass_from > 0:
            u = (shape.glass_from, 0.97) if forward else (0.03, 1 - shape.glass_from)
            builder.face(on_quad(quad, u, (0.15, 0.85)), outward, GLASS, GLASS_GLOSS, decal=True)
            continue
        for at in (0.47, 0.80) if forward else (0.53, 0.20):
            builder.face(on_quad(quad, (at - 0.025, at + 0.025), (0.0, 1.0)), outward, paint, PAINT_GLOSS, decal=True)
    if shape.glass_from > 0:
        quad, outward = faces[BACK]
        builder.face(on_quad(quad, (0.12, 0.88), (0.35, 0.85)), outward, GLASS, GLASS_GLOSS, decal=True)
