from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl.plant.gimbal import GimbalParams, GimbalPlant

HZ = 400
SMOOTH = GimbalParams(stiction_rad=0.0, encoder_step_rad=0.0)


def run(
    gimbal: GimbalPlant,
    seconds: float,
    start_s: float = 0.0,
    hz: int = HZ,
    watch: Callable[[float], None] | None = None,
) -> None:
    for index in range(round(seconds * hz)):
        t_s = start_s + index / hz
        gimbal.step(t_s, 1.0 / hz)
        if watch is not None:
            watch(t_s + 1.0 / hz)


def test_signs_and_arrival_of_angles() -> None:
    gimbal = GimbalPlant(SMOOTH)
    gimbal.command_angle(-0.6, 0.4, 0.0)
    run(gimbal, 0.3)
    assert gimbal.pitch_rate_rad_s < 0.0 < gimbal.yaw_rate_rad_s
    run(gimbal, 2.0, 0.3)
    assert gimbal.pitch_rad == pytest.approx(-0.6, abs=1e-3)
    assert gimbal.yaw_rad == pytest.approx(0.4, abs=1e-3)


def test_angles_are_reached_without_overshoot() -> None:
    gimbal = GimbalPlant(SMOOTH)
    gimbal.command_angle(-1.2, 2.0, 0.0)
    seen: list[tuple[float, float]] = []
    run(gimbal, 4.0, watch=lambda _t: seen.append((gimbal.pitch_rad, gimbal.yaw_rad)))
    assert min(p for p, _ in seen) > -1.2 - 0.005
    assert max(y for _, y in seen) < 2.0 + 0.005


def test_a_rate_keeps_on_until_the_next_command_or_the_stop() -> None:
    gimbal = GimbalPlant(SMOOTH)
    gimbal.command_rate(0.0, 0.2, 0.0)
    run(gimbal, 5.0)
    # The delay is lost; the lag is lost too, for the joint follows the reference behind it.
    assert gimbal.yaw_rad == pytest.approx(0.2 * (5.0 - SMOOTH.delay_s - SMOOTH.lag_s), abs=0.005)
    gimbal.command_rate(0.0, 0.0, 5.0)
    run(gimbal, 0.5, 5.0)
    stopped = gimbal.yaw_rad
    run(gimbal, 5.0, 5.5)
    assert gimbal.yaw_rad == pytest.approx(stopped, abs=1e-3)
    gimbal.command_rate(-0.5, 0.5, 10.5)
    run(gimbal, 10.0, 10.5)
    assert gimbal.pitch_rad == pytest.approx(SMOOTH.min_pitch_rad, abs=1e-3)
    assert gimbal.yaw_rad == pytest.approx(SMOOTH.max_yaw_rad, abs=1e-3)
    assert abs(gimbal.yaw_rate_rad_s) < 1e-3
    # And back off the stop at once.
    gimbal.command_rate(0.5, -0.5, 20.5)
    run(gimbal, 1.0, 20.5)
    assert gimbal.yaw_rad < SMOOTH.max_yaw_rad - 0.3
    assert gimbal.pitch_rad > SMOOTH.min_pitch_rad + 0.3


def test_angles_beyond_the_stops_go_to_the_stops() -> None:
    gimbal = GimbalPlant(SMOOTH)
    gimbal.command_angle(1.5, -9.0, 0.0)
    run(gimbal, 6.0)
    assert gimbal.pitch_rad == pytest.approx(math.radians(30.0), abs=1e-3)
    assert gimbal.yaw_rad == pytest.approx(math.radians(-170.0), abs=1e-3)


@pytest.mark.parametrize("hz", [200, 400])
@pytest.mark.parametrize("delay_s", [0.0, 0.03, 0.1])
def test_the_delay_is_in_seconds(hz: int, delay_s: float) -> None:
    gimbal = GimbalPlant(dataclasses.replace(SMOOTH, delay_s=delay_s))
    gimbal.command_rate(0.5, 0.5, 0.0)
    starts: list[float] = []

    def watch(t_s: float) -> None:
        if gimbal.yaw_rate_rad_s != 0.0:
            starts.append(t_s - 1.0 / hz)

    run(gimbal, 0.3, hz=hz, watch=watch)
    assert starts[0] == pytest.approx(delay_s, abs=1e-9)


@pytest.mark.parametrize("lag_s", [0.03, 0.08])
def test_the_lag_is_that_of_the_params(lag_s: float) -> None:
    gimbal = GimbalPlant(dataclasses.replace(SMOOTH, lag_s=lag_s, delay_s=0.0))
    gimbal.command_rate(0.0, 0.1, 0.0)
    run(gimbal, lag_s)
    assert gimbal.yaw_rate_rad_s == pytest.approx(0.1 * (1.0 - math.exp(-1.0)), rel=0.05)


def test_rate_and_acceleration_are_limited() -> None:
    params = dataclasses.replace(SMOOTH, max_rate_rad_s=1.5, max_accel_rad_s2=6.0)
    gimbal = GimbalPlant(params)
    gimbal.command_rate(-9.0, 9.0, 0.0)
    rates = [(0.0, 0.0)]
    run(gimbal, 0.9, watch=lambda _t: rates.append((gimbal.pitch_rate_rad_s, gimbal.yaw_rate_rad_s)))
    assert rates[-1] == pytest.approx((-1.5, 1.5), rel=0.02)
    changes = [abs(b[1] - a[1]) * HZ for a, b in pairwise(rates)]
    assert max(changes) == pytest.approx(6.0, rel=0.02)
    assert all(abs(r) <= 1.5 + 1e-9 for pair in rates for r in pair)


def test_a_rate_beyond_the_limit_leaves_nothing_to_catch_up() -> None:
    gimbal = GimbalPlant(SMOOTH)
    gimbal.command_rate(0.0, 6.0, 0.0)
    run(gimbal, 0.8)
    gimbal.command_rate(0.0, 0.0, 0.8)
    before = gimbal.yaw_rad
    run(gimbal, 1.5, 0.8)
    # Delay, lag and braking at the limits, no more.
    rate, brake = SMOOTH.max_rate_rad_s, SMOOTH.max_rate_rad_s / SMOOTH.max_accel_rad_s2
    assert gimbal.yaw_rad - before < rate * (SMOOTH.delay_s + 2.0 * SMOOTH.lag_s + brake)


def test_stops_are_met_softly() -> None:
    gimbal = GimbalPlant(SMOOTH)
    gimbal.command_rate(0.0, 2.0, 0.0)
    rates = [0.0]
    run(gimbal, 4.0, watch=lambda _t: rates.append(gimbal.yaw_rate_rad_s))
    assert max(abs(b - a) * HZ for a, b in pairwise(rates)) <= SMOOTH.max_accel_rad_s2 * 1.01


def test_a_standing_joint_sticks_until_it_breaks_away() -> None:
    sticky = GimbalPlant(dataclasses.replace(SMOOTH, stiction_rad=0.01))
    sticky.command_angle(-0.008, 0.0, 0.0)
    run(sticky, 2.0)
    assert sticky.pitch_rad == 0.0
    sticky.command_rate(-0.02, 0.0, 2.0)
    moved: list[float] = []
    run(sticky, 3.0, 2.0, watch=lambda t: moved.append(t) if sticky.pitch_rate_rad_s != 0.0 else None)
    # 2 mrad are missing for the break-away: 0.1 s at this rate, after the delay.
    assert moved[0] == pytest.approx(2.0 + SMOOTH.delay_s + 0.1, abs=0.06)
    # Once it moves it catches up and loses nothing.
    assert sticky.pitch_rad == pytest.approx(-0.008 - 0.02 * (3.0 - SMOOTH.delay_s - SMOOTH.lag_s), abs=0.002)


def test_it_sticks_again_where_it_turns_back() -> None:
    gimbal = GimbalPlant(dataclasses.replace(SMOOTH, stiction_rad=0.01))
    gimbal.command_rate(0.0, 0.1, 0.0)
    run(gimbal, 1.0)
    gimbal.command_rate(0.0, -0.1, 1.0)
    still: list[float] = []
    run(gimbal, 1.0, 1.0, watch=lambda t: still.append(t) if gimbal.yaw_rate_rad_s == 0.0 else None)
    assert len(still) / HZ == pytest.approx(0.1, abs=0.05)
    run(gimbal, 1.0, 2.0)
    assert gimbal.yaw_rate_rad_s == pytest.approx(-0.1, rel=0.02)


def test_the_encoder_is_quantised_and_knows_no_misalignment() -> None:
    params = dataclasses.replace(SMOOTH, encoder_step_rad=0.01, misalignment_pitch_rad=0.05, misalignment_yaw_rad=0.05)
    gimbal = GimbalPlant(params)
    gimbal.command_angle(-0.3037, 0.2061, 0.0)
    run(gimbal, 3.0)
    assert gimbal.pitch_rad == pytest.approx(-0.3037, abs=5e-4)
    assert gimbal.measured_pitch_rad == pytest.approx(-0.30, abs=1e-12)
    assert gimbal.measured_yaw_rad == pytest.approx(0.21, abs=1e-12)
    assert GimbalPlant(SMOOTH, -0.3037, 0.2).measured_pitch_rad == -0.3037


def test_only_fast_tilt_leaks_and_only_the_stated_share() -> None:
    gimbal = GimbalPlant(dataclasses.replace(SMOOTH, stabilisation_residue=0.1))
    gimbal.step(0.0, 1.0 / HZ, 0.2, -0.1)
    assert gimbal.leak_rad == pytest.approx((0.02, -0.01), rel=0.02)
    for index in range(1, 4 * HZ):
        gimbal.step(index / HZ, 1.0 / HZ, 0.2, -0.1)
    assert gimbal.leak_rad == pytest.approx((0.0, 0.0), abs=1e-4)


def test_half_the_rate_gives_the_same_motion() -> None:
    ends = []
    for hz in (200, 400):
        gimbal = GimbalPlant()
        gimbal.command_rate(-0.3, 0.8, 0.0)
        run(gimbal, 1.5, hz=hz)
        gimbal.command_angle(-0.9, -0.5, 1.5)
        run(gimbal, 0.7, 1.5, hz=hz)
        ends.append((gimbal.pitch_rad, gimbal.yaw_rad))
    assert ends[0] == pytest.approx(ends[1], abs=0.01)


def test_a_mirror_gives_the_mirrored_motion() -> None:
    params = GimbalParams(min_yaw_rad=-1.0, max_yaw_rad=2.0, misalignment_yaw_rad=0.02, misalignment_roll_rad=0.03)
    straight, mirrored = GimbalPlant(params), GimbalPlant(params.mirrored())
    for index in range(5 * HZ):
        t_s = index / HZ
        if index % 200 == 0:
            rate = 0.9 if t_s < 3.0 else -1.3
            straight.command_rate(-0.1, rate, t_s)
            mirrored.command_rate(-0.1, -rate, t_s)
        straight.step(t_s, 1.0 / HZ, 0.1 * math.sin(5.0 * t_s), 0.1)
        mirrored.step(t_s, 1.0 / HZ, -0.1 * math.sin(5.0 * t_s), 0.1)
        assert mirrored.pitch_rad == straight.pitch_rad
        assert mirrored.yaw_rad == -straight.yaw_rad
        assert mirrored.measured_yaw_rad == -straight.measured_yaw_rad
        assert mirrored.leak_rad == pytest.approx((-straight.leak_rad[0], straight.leak_rad[1]), abs=1e-15)
    assert params.mirrored().mirrored() == params


@given(bad=st.sampled_from([math.nan, math.inf, -math.inf]), place=st.integers(0, 2), angles=st.booleans())
def test_refuses_what_is_not_finite_and_stays(bad: float, place: int, angles: bool) -> None:
    gimbal = GimbalPlant()
    numbers = [0.5, 0.5, 0.0]
    numbers[place] = bad
    with pytest.raises(ValueError, match="finite"):
        (gimbal.command_angle if angles else gimbal.command_rate)(*numbers)
    run(gimbal, 0.2)
    assert (gimbal.pitch_rad, gimbal.yaw_rad) == (0.0, 0.0)


def test_refuses_commands_from_the_past_and_bad_steps() -> None:
    gimbal = GimbalPlant()
    gimbal.command_rate(0.0, 0.0, 1.0)
    with pytest.raises(ValueError, match="before"):
        gimbal.command_rate(0.0, 0.0, 0.5)
    for dt_s in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="dt_s"):
            gimbal.step(0.0, dt_s)


@pytest.mark.parametrize(
    "change",
    [
        {"lag_s": 0.0},
        {"delay_s": -0.1},
        {"max_rate_rad_s": math.nan},
        {"min_pitch_rad": 1.0},
        {"stabilisation_residue": 2.0},
    ],
)
def test_refuses_impossible_params(change: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="GimbalParams"):
        dataclasses.replace(GimbalParams(), **change)


_order = st.tuples(st.booleans(), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))


@settings(max_examples=60, deadline=None)
@given(orders=st.lists(_order, min_size=1, max_size=12), dt_s=st.sampled_from([0.0025, 0.005, 0.02]))
def test_bounded_whatever_is_ordered(orders: list[tuple[bool, float, float]], dt_s: float) -> None:
    params = GimbalParams()
    gimbal = GimbalPlant(params)
    t_s = 0.0
    for angles, pitch, yaw in orders:
        (gimbal.command_angle if angles else gimbal.command_rate)(pitch, yaw, t_s)
        for _ in range(round(0.4 / dt_s)):
            gimbal.step(t_s, dt_s)
            t_s += dt_s
            assert params.min_pitch_rad <= gimbal.pitch_rad <= params.max_pitch_rad
            assert params.min_yaw_rad <= gimbal.yaw_rad <= params.max_yaw_rad
            assert abs(gimbal.pitch_rate_rad_s) <= params.max_rate_rad_s
            assert abs(gimbal.yaw_rate_rad_s) <= params.max_rate_rad_s
