"""Telemetry at the time of an exposure."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from uavfollow.mavlink.history import KEPT_S, History


def filled(*reports: tuple[float, float], angles: tuple[int, ...] = ()) -> History:
    history = History(angles)
    for t_s, value in reports:
        assert history.add(t_s, (value,))
    return history


def test_on_the_line_between_two_reports():
    assert filled((1.0, 10.0), (1.2, 20.0)).at(1.05) == (1.05, (pytest.approx(12.5),))


def test_angles_take_the_short_way_round():
    t_s, (angle,) = filled((0.0, math.radians(170)), (0.2, math.radians(-170)), angles=(0,)).at(0.1)
    assert t_s == 0.1
    assert abs(angle) == pytest.approx(math.pi)


def test_outside_the_nearest_report_with_its_own_time():
    history = filled((1.0, 10.0), (1.2, 20.0))
    assert history.at(5.0) == (1.2, (20.0,)), "nothing is extrapolated, the age shows"
    assert history.at(0.0) == (1.0, (10.0,))
    assert History().at(0.0) is None
    assert History().last is None


def test_no_line_across_a_gap():
    history = filled((0.0, 0.0), (0.8, 80.0))
    assert history.at(0.3) == (0.0, (0.0,))
    assert history.at(0.5) == (0.8, (80.0,))


def test_what_is_not_finite_or_not_newer_is_refused():
    history = filled((1.0, 10.0))
    assert not history.add(1.0, (11.0,))
    assert not history.add(0.5, (11.0,))
    assert not history.add(math.nan, (11.0,))
    assert not history.add(2.0, (math.nan,))
    assert history.last == (1.0, (10.0,))


@given(st.lists(st.floats(0.001, 0.4), min_size=2, max_size=300), st.floats(0, 1))
def test_memory_is_bounded_and_a_ramp_comes_out_exact(steps, share):
    history, t_s = History(), 0.0
    for step in steps:
        t_s += step
        history.add(t_s, (3.0 * t_s,))
    assert len(history._times) <= KEPT_S / 0.001 + 2
    assert t_s - history._times[0] <= KEPT_S
    asked = history._times[0] + share * (t_s - history._times[0])
    found_s, (value,) = history.at(asked)
    assert found_s == pytest.approx(asked)
    assert value == pytest.approx(3.0 * found_s)
