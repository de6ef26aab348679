from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.world.motion import ACCEL_M_S2, Path
from sitl.world.spec import PathSpec

COORD = st.floats(-200, 200)
POINTS = st.lists(st.tuples(COORD, COORD), min_size=2, max_size=6).map(tuple)
SPEED = st.floats(0.5, 25.0)


@given(POINTS, SPEED, st.floats(0.0, 10.0), st.floats(0.0, 1.0))
def test_speed_is_that_of_the_specification_and_position_is_continuous(
    points: tuple[tuple[float, float], ...], speed: float, radius: float, share: float
) -> None:
    path = Path(PathSpec(points, speed, 2.0, radius))
    t, dt = 2.0 + share * max(path.end_s - 2.0, 0.0), 0.01
    a, b = path.at(t), path.at(t + dt)
    step = math.hypot(b.north_m - a.north_m, b.east_m - a.east_m)
    assert step <= speed * dt + 1e-9
    assert 0 <= a.speed_m_s <= speed + 1e-9
    assert abs(b.speed_m_s - a.speed_m_s) <= ACCEL_M_S2 * dt + 1e-9
    assert b.travelled_m - a.travelled_m == pytest.approx((a.speed_m_s + b.speed_m_s) / 2 * dt, abs=1e-3)


@given(POINTS, SPEED)
def test_it_starts_at_the_first_point_and_ends_at_the_last(points: tuple[tuple[float, float], ...], v: float) -> None:
    path = Path(PathSpec(points, v, 1.0))
    start, end = path.at(0.5), path.at(path.end_s + 1.0)
    assert (start.north_m, start.east_m) == pytest.approx(points[0], abs=1e-5)
    assert (end.north_m, end.east_m) == pytest.approx(points[-1], abs=1e-4)
    assert start.speed_m_s == end.speed_m_s == 0.0


def test_a_right_turn_is_an_arc_of_the_asked_radius() -> None:
    path = Path(PathSpec(((0.0, 0.0), (50.0, 0.0), (50.0, 50.0)), 8.0, 0.0, 6.0))
    places = [path.at(i * 0.02) for i in range(round(path.end_s / 0.02))]
    turning = [p for p in places if p.yaw_rate_rad_s != 0 and p.speed_m_s == 8.0]
    assert turning
    for place in turning:
        assert place.yaw_rate_rad_s == pytest.approx(8.0 / 6.0)
        assert math.hypot(place.north_m - 44.0, place.east_m - 6.0) == pytest.approx(6.0)
    steps = [b.yaw_rad - a.yaw_rad for a, b in pairwise(places)]
    assert max(steps) <= 8.0 / 6.0 * 0.02 + 1e-9
    assert min(steps) >= 0.0
    assert places[-1].yaw_rad == pytest.approx(math.pi / 2)


def test_heading_is_the_direction_of_motion() -> None:
    path = Path(PathSpec(((0.0, 0.0), (30.0, 10.0), (10.0, 60.0), (-20.0, 0.0)), 7.0))
    for i in range(1, 250):
        t = path.end_s * i / 250
        a, b, place = path.at(t - 1e-4), path.at(t + 1e-4), path.at(t)
        way = (b.north_m - a.north_m, b.east_m - a.east_m)
        assert way[0] * math.sin(place.yaw_rad) - way[1] * math.cos(place.yaw_rad) == pytest.approx(0, abs=1e-6)
        assert way[0] * math.cos(place.yaw_rad) + way[1] * math.sin(place.yaw_rad) >= 0


def test_one_point_is_parked_with_its_heading() -> None:
    place = Path(PathSpec(((3.0, 4.0),), yaw_rad=1.2)).at(17.0)
    assert (place.north_m, place.east_m, place.yaw_rad, place.speed_m_s) == (3.0, 4.0, 1.2, 0.0)


def test_turning_back_happens_on_the_spot() -> None:
    path = Path(PathSpec(((0.0, 0.0), (20.0, 0.0), (0.0, 0.0)), 5.0))
    assert path.length_m == pytest.approx(40.0)
    assert max(path.at(i * 0.05).north_m for i in range(400)) == pytest.approx(20.0, abs=0.2)
