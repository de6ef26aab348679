from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl.plant.shaping import VelocityShaper

DT_S = 0.0025


def test_accelerates_at_the_limits_and_arrives_without_overshoot() -> None:
    shaper = VelocityShaper(2.5, 5.0)
    velocities, accels = [0.0], [0.0]
    for _ in range(round(6.0 / DT_S)):
        velocities.append(shaper.step((5.0,), DT_S)[0])
        accels.append(shaper.accel[0])
    # By hand: 0.5 s of jerk to 2.5 m/s2 (0.625 m/s), then 2.5 m/s2 until 1.25 m/s are missing (1.75 s).
    assert velocities[round(0.5 / DT_S)] == pytest.approx(0.625, abs=0.01)
    assert velocities[round(1.75 / DT_S)] == pytest.approx(3.75, abs=0.02)
    assert max(accels) == pytest.approx(2.5)
    assert max(velocities) <= 5.0 + 1e-9
    assert velocities[-1] == pytest.approx(5.0, abs=0.01)


@settings(max_examples=30, deadline=None)
@given(
    targets=st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=8),
    dt_s=st.sampled_from([0.0025, 0.005, 0.02]),
)
def test_keeps_its_limits_whatever_is_asked(targets: list[tuple[float, float]], dt_s: float) -> None:
    shaper = VelocityShaper(2.5, 5.0, 2)
    for target in targets:
        for _ in range(round(0.6 / dt_s)):
            before, accel_before = shaper.velocity, shaper.accel
            shaper.step(target, dt_s)
            assert math.hypot(*shaper.accel) <= 2.5 + 1e-9
            assert math.dist(shaper.accel, accel_before) <= 5.0 * dt_s + 1e-9
            assert math.dist(shaper.velocity, before) <= 2.5 * dt_s + 1e-9
    for _ in range(round(30.0 / dt_s)):
        shaper.step(target, dt_s)
    assert math.dist(shaper.velocity, target) < 1e-3


def test_two_axes_are_one_vector_and_one_axis_is_a_special_case() -> None:
    line, plane = VelocityShaper(2.5, 5.0), VelocityShaper(2.5, 5.0, 2)
    for _ in range(800):
        line.step((5.0,), DT_S)
        plane.step((3.0, 4.0), DT_S)
        assert plane.velocity == pytest.approx((0.6 * line.velocity[0], 0.8 * line.velocity[0]), abs=1e-9)


def test_half_the_rate_gives_the_same_ramp() -> None:
    fast, slow = VelocityShaper(2.5, 5.0, 2), VelocityShaper(2.5, 5.0, 2)
    for index in range(1600):
        target = (5.0, -2.0) if index < 1000 else (0.0, 0.0)
        fast.step(target, 0.0025)
        if index % 2:
            slow.step(target, 0.005)
            assert math.dist(fast.velocity, slow.velocity) < 0.01


def test_reset_starts_from_a_velocity() -> None:
    shaper = VelocityShaper(1.0, 5.0)
    shaper.step((3.0,), DT_S)
    shaper.reset((2.0,))
    assert shaper.velocity == (2.0,)
    assert shaper.accel == (0.0,)
    assert shaper.step((2.0,), DT_S) == (2.0,)


def test_refuses_nonsense() -> None:
    for accel, jerk, axes in ((0.0, 5.0, 1), (1.0, math.nan, 1), (-1.0, 1.0, 1), (1.0, 1.0, 3)):
        with pytest.raises(ValueError, match="must be"):
            VelocityShaper(accel, jerk, axes)
    with pytest.raises(ValueError, match="finite"):
        VelocityShaper(1.0, 5.0).step((math.nan,), DT_S)
    with pytest.raises(ValueError, match="values to unpack"):
        VelocityShaper(1.0, 5.0, 2).step((1.0,), DT_S)
