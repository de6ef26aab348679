from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl.plant.quadrotor import GRAVITY_M_S2, Quadrotor, QuadrotorParams
from sitl.plant.shaping import VelocityShaper
from sitl.plant.wind import Wind

Vector = tuple[float, float, float]
HZ = 400
REST = (0.0, 0.0, 0.0)


def airborne(params: QuadrotorParams | None = None, wind: Wind | None = None, yaw_rad: float = 0.0) -> Quadrotor:
    quad = Quadrotor(params, wind, (0.0, 0.0, -30.0), yaw_rad)
    quad.hover()
    return quad


def fly(
    quad: Quadrotor,
    seconds: float,
    command: Callable[[float], tuple[Vector, float]] | None = None,
    start_s: float = 0.0,
    hz: int = HZ,
    watch: Callable[[Quadrotor], None] | None = None,
) -> None:
    """Raw (unshaped) commands at 50 Hz."""
    dt_s = 1.0 / hz
    for index in range(round(seconds * hz)):
        t_s = start_s + index * dt_s
        if command is not None and index % (hz // 50) == 0:
            v, yaw_rate = command(t_s)
            quad.command(v, yaw_rate, t_s)
        quad.step(t_s, dt_s)
        if watch is not None:
            watch(quad)


def manoeuvre(t_s: float) -> tuple[Vector, float]:
    if t_s < 3.0:
        return (4.0, 2.0, -1.0), 0.4
    return ((-2.0, 5.0, 0.5), -0.3) if t_s < 6.0 else (REST, 0.0)


def test_a_hovering_vehicle_stays_where_it_is() -> None:
    quad = airborne()
    fly(quad, 5.0)
    assert quad.pos_ned_m == pytest.approx((0.0, 0.0, -30.0), abs=1e-9)
    assert quad.motors_on
    assert not quad.on_ground


@pytest.mark.parametrize("heading", [0.0, 1.0, -2.5])
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (-0.6, 0.8)])
def test_it_flies_where_it_is_told_whatever_its_heading(heading: float, direction: tuple[float, float]) -> None:
    quad = airborne(yaw_rad=heading)
    fly(quad, 8.0, lambda _t: ((4.0 * direction[0], 4.0 * direction[1], 0.0), 0.0))
    assert quad.vel_ned_m_s[0] == pytest.approx(4.0 * direction[0], abs=0.05)
    assert quad.vel_ned_m_s[1] == pytest.approx(4.0 * direction[1], abs=0.05)
    assert quad.yaw_rad == pytest.approx(heading, abs=1e-9)


def test_signs_of_attitude() -> None:
    north, east = airborne(), airborne()
    fly(north, 0.5, lambda _t: ((3.0, 0.0, 0.0), 0.5))
    assert north.pitch_rad < -0.05  # nose down to go forward
    assert north.yaw_rad > 0.05  # clockwise from above
    fly(east, 0.5, lambda _t: ((0.0, 3.0, 0.0), 0.0))
    assert east.roll_rad > 0.05  # right side down to go right
    assert east.rates_rad_s[0] == pytest.approx(east.euler_rates_rad_s[0])


def test_tilt_acceleration_and_rates_keep_their_limits() -> None:
    # Without drag, which adds its own acceleration when it brakes.
    params = QuadrotorParams(
        max_tilt_rad=math.radians(20.0),
        max_yaw_rate_rad_s=1.0,
        drag_linear_n_s_m=0.0,
        drag_quadratic_n_s2_m2=0.0,
    )
    quad = airborne(params)
    accel_most = GRAVITY_M_S2 * math.tan(params.max_tilt_rad)

    def watch(q: Quadrotor) -> None:
        tilt = math.acos(math.cos(q.roll_rad) * math.cos(q.pitch_rad))
        assert tilt <= params.max_tilt_rad + math.radians(0.5)
        assert math.hypot(*q.accel_ned_m_s2[:2]) <= accel_most * 1.05
        assert all(abs(rate) <= params.max_tilt_rate_rad_s + 1e-9 for rate in q.euler_rates_rad_s[:2])
        assert abs(q.euler_rates_rad_s[2]) <= 1.0 + 1e-9

    fly(
        quad,
        4.0,
        lambda t: ((40.0, -40.0, 0.0) if t < 3.0 else (-40.0, 0.0, 0.0), 9.0 if t < 2.0 else -9.0),
        watch=watch,
    )
    assert abs(quad.euler_rates_rad_s[2]) > 0.9


def test_demanded_acceleration_and_its_change_keep_their_limits() -> None:
    params = QuadrotorParams(max_accel_m_s2=2.0, max_jerk_m_s3=8.0, drag_linear_n_s_m=0.0, drag_quadratic_n_s2_m2=0.0)
    quad = airborne(params)
    seen = [0.0]
    fly(quad, 2.0, lambda _t: ((8.0, 0.0, 0.0), 0.0), watch=lambda q: seen.append(q.accel_ned_m_s2[0]))
    assert max(seen) == pytest.approx(2.0, rel=0.02)
    window = HZ // 10
    assert max(b - a for a, b in zip(seen, seen[window:], strict=False)) <= 8.0 * 0.1 * 1.15


@pytest.mark.parametrize("by_battery", [False, True])
def test_thrust_is_limited_and_height_comes_before_speed(by_battery: bool) -> None:
    params = QuadrotorParams()
    weak_n = 1.05 * params.mass_kg * GRAVITY_M_S2

    def weak() -> Quadrotor:
        quad = airborne(params if by_battery else dataclasses.replace(params, max_thrust_n=weak_n))
        quad.thrust_factor = weak_n / params.max_thrust_n if by_battery else 1.0
        return quad

    quad = weak()
    fly(quad, 3.0, lambda _t: ((10.0, 0.0, 0.0), 0.0))
    # 5 % of thrust in hand allow 18 degrees and no more without sinking.
    assert math.acos(1.0 / 1.05) + 0.02 > -quad.pitch_rad > 0.1
    assert quad.pos_ned_m[2] == pytest.approx(-30.0, abs=0.1)
    climber = weak()
    fly(climber, 2.0, lambda _t: ((0.0, 0.0, -5.0), 0.0))
    assert -0.05 * GRAVITY_M_S2 - 1e-6 <= climber.accel_ned_m_s2[2] < 0.0


def test_anti_windup_of_the_climb() -> None:
    params = QuadrotorParams()
    quad = airborne(params)
    quad.thrust_factor = params.mass_kg * GRAVITY_M_S2 / params.max_thrust_n  # it cannot climb at all
    fly(quad, 10.0, lambda _t: ((0.0, 0.0, -2.0), 0.0))
    quad.thrust_factor = 1.0
    climbs: list[float] = []
    fly(quad, 3.0, lambda _t: (REST, 0.0), 10.0, watch=lambda q: climbs.append(-q.vel_ned_m_s[2]))
    assert max(climbs) < 2.0  # ten seconds of missing 2 m/s would throw it up at more than 8
    assert abs(climbs[-1]) < 0.3


def test_an_empty_battery_lets_it_sink() -> None:
    quad = airborne()
    params = QuadrotorParams()
    quad.thrust_factor = 0.9 * params.mass_kg * GRAVITY_M_S2 / params.max_thrust_n
    fly(quad, 3.0, lambda _t: (REST, 0.0))
    assert quad.vel_ned_m_s[2] > 1.0


@pytest.mark.parametrize("speed", [1.0, 5.0, 9.0])
def test_no_residue_after_an_unshaped_stop(speed: float) -> None:
    quad = airborne()
    fly(quad, 15.0, lambda t: ((speed, 0.0, 0.0) if t < 10.0 else REST, 0.0))
    assert math.hypot(*quad.vel_ned_m_s) < 0.03


@pytest.mark.parametrize("target", [(3.0, 0.0), (0.0, -5.0), (6.4, 4.8)])
def test_no_residue_five_seconds_after_a_shaped_stop(target: tuple[float, float]) -> None:
    quad, shaper = airborne(), VelocityShaper(2.5, 5.0, 2)
    late = []
    for index in range(22 * HZ):
        t_s = index / HZ
        north, east = shaper.step(target if t_s < 12.0 else (0.0, 0.0), 1.0 / HZ)
        quad.command((north, east, 0.0), 0.0, t_s, (*shaper.accel, 0.0))
        quad.step(t_s, 1.0 / HZ)
        if t_s > 17.0:
            late.append(math.hypot(*quad.vel_ned_m_s))
    assert max(late) < 0.03


def test_the_cap_of_the_recorded_autopilot_can_be_flown() -> None:
    quad = airborne()
    fly(quad, 12.0, lambda _t: ((10.7, 0.0, 0.0), 0.0))
    assert quad.vel_ned_m_s[0] == pytest.approx(10.7, abs=0.1)
    assert quad.pos_ned_m[2] == pytest.approx(-30.0, abs=0.1)


def test_anti_windup_against_a_wind_that_is_too_strong() -> None:
    quad = airborne(wind=Wind((-14.0, 0.0, 0.0)))
    fly(quad, 20.0, lambda _t: (REST, 0.0))
    assert quad.vel_ned_m_s[0] < -1.0  # it is blown away
    assert quad.pos_ned_m[2] == pytest.approx(-30.0, abs=0.2)
    # It is told to go with the wind: nothing that was saved up holds it back.
    fly(quad, 3.0, lambda _t: ((-8.0, 0.0, 0.0), 0.0), start_s=20.0)
    assert quad.vel_ned_m_s[0] == pytest.approx(-8.0, abs=0.8)


def test_steady_wind_is_rejected() -> None:
    quad = airborne(wind=Wind((6.0, -4.0, 0.0)))
    fly(quad, 12.0, lambda _t: (REST, 0.0))
    assert math.hypot(*quad.vel_ned_m_s) < 0.05
    # It leans against the wind, which comes from the south-east.
    assert quad.pitch_rad > 0.1
    assert quad.roll_rad > 0.05


def test_gusts_move_it_but_little() -> None:
    quad = airborne(wind=Wind((3.0, 0.0, 0.0), 1.5, 2.0, seed=5))
    speeds: list[float] = []
    fly(quad, 10.0, lambda _t: (REST, 0.0))
    fly(quad, 30.0, lambda _t: (REST, 0.0), 10.0, watch=lambda q: speeds.append(math.hypot(*q.vel_ned_m_s)))
    rms = math.sqrt(sum(v * v for v in speeds) / len(speeds))
    assert 0.02 < rms < 0.5
    assert math.hypot(*quad.pos_ned_m[:2]) < 3.0


def shaped_flight(hz: int, gusts_m_s: float) -> Quadrotor:
    """`manoeuvre` as an autopilot flies it, shaped in every step."""
    quad = airborne(wind=Wind((2.0, 1.0, 0.0), gusts_m_s, 2.0, seed=7))
    horizontal, vertical = VelocityShaper(2.5, 5.0, 2), VelocityShaper(1.0, 5.0)
    for index in range(10 * hz):
        t_s = index / hz
        (north, east, down), yaw_rate = manoeuvre(t_s)
        north, east = horizontal.step((north, east), 1.0 / hz)
        (down,) = vertical.step((down,), 1.0 / hz)
        quad.command((north, east, down), yaw_rate, t_s, (*horizontal.accel, *vertical.accel))
        quad.step(t_s, 1.0 / hz)
    return quad


def raw_flight(hz: int, gusts_m_s: float) -> Quadrotor:
    quad = airborne(wind=Wind((2.0, 1.0, 0.0), gusts_m_s, 2.0, seed=7))
    fly(quad, 10.0, manoeuvre, hz=hz)
    return quad


@pytest.mark.parametrize("gusts_m_s", [0.0, 1.5])
@pytest.mark.parametrize(("flight", "most_m"), [(shaped_flight, 0.005), (raw_flight, 0.02)])
def test_half_the_rate_gives_the_same_flight(
    flight: Callable[[int, float], Quadrotor], most_m: float, gusts_m_s: float
) -> None:
    slow, fast = flight(200, gusts_m_s), flight(400, gusts_m_s)
    assert math.dist(slow.pos_ned_m, fast.pos_ned_m) < most_m
    assert math.dist(slow.vel_ned_m_s, fast.vel_ned_m_s) < 0.002
    assert slow.yaw_rad == pytest.approx(fast.yaw_rad, abs=0.001)


def test_a_mirror_gives_the_mirrored_flight() -> None:
    straight = airborne(wind=Wind((2.0, 1.0, 0.0), 1.5, 2.0, seed=7), yaw_rad=0.5)
    mirrored = airborne(wind=Wind((2.0, 1.0, 0.0), 1.5, 2.0, seed=7, mirrored=True), yaw_rad=-0.5)

    def mirror(t_s: float) -> tuple[Vector, float]:
        (north, east, down), yaw_rate = manoeuvre(t_s)
        return (north, -east, down), -yaw_rate

    fly(straight, 10.0, manoeuvre)
    fly(mirrored, 10.0, mirror)
    sides = (1.0, -1.0, 1.0)
    assert mirrored.pos_ned_m == pytest.approx(
        [s * v for s, v in zip(sides, straight.pos_ned_m, strict=True)], abs=1e-9
    )
    assert mirrored.vel_ned_m_s == pytest.approx(
        [s * v for s, v in zip(sides, straight.vel_ned_m_s, strict=True)], abs=1e-9
    )
    assert mirrored.rates_rad_s == pytest.approx(
        [s * v for s, v in zip((-1.0, 1.0, -1.0), straight.rates_rad_s, strict=True)], abs=1e-9
    )
    assert mirrored.roll_rad == pytest.approx(-straight.roll_rad, abs=1e-9)
    assert mirrored.pitch_rad == pytest.approx(straight.pitch_rad, abs=1e-9)
    assert mirrored.yaw_rad == pytest.approx(-straight.yaw_rad, abs=1e-9)
    assert abs(straight.pos_ned_m[1]) > 1.0  # the check has something to see


@pytest.mark.parametrize("hz", [200, 400])
@pytest.mark.parametrize("delay_s", [0.0, 0.05, 0.12])
def test_the_delay_is_in_seconds(hz: int, delay_s: float) -> None:
    quad = airborne(QuadrotorParams(delay_s=delay_s))
    quad.command((2.0, 0.0, 0.0), 0.3, 0.0)
    moved_s = None
    for index in range(hz):
        quad.step(index / hz, 1.0 / hz)
        if moved_s is None and quad.euler_rates_rad_s[1] != 0.0:
            moved_s = index / hz
    assert moved_s == pytest.approx(delay_s, abs=1e-9)


@given(bad=st.sampled_from([math.nan, math.inf, -math.inf]), place=st.integers(0, 7))
def test_refuses_what_is_not_finite_and_flies_on(bad: float, place: int) -> None:
    quad = airborne()
    numbers = [1.0] * 8
    numbers[place] = bad
    with pytest.raises(ValueError, match="finite"):
        quad.command((numbers[0], numbers[1], numbers[2]), numbers[3], numbers[4], (numbers[5], numbers[6], numbers[7]))
    fly(quad, 0.2)
    assert quad.pos_ned_m == pytest.approx((0.0, 0.0, -30.0), abs=1e-9)


def test_refuses_commands_from_the_past_and_steps_too_long() -> None:
    quad = airborne()
    quad.command(REST, 0.0, 1.0)
    with pytest.raises(ValueError, match="before"):
        quad.command(REST, 0.0, 0.5)
    for dt_s in (0.0, -0.01, 0.05, math.nan):
        with pytest.raises(ValueError, match="dt_s"):
            quad.step(0.0, dt_s)


@pytest.mark.parametrize(
    "change",
    [{"mass_kg": 0.0}, {"max_tilt_rad": 1.4}, {"max_thrust_n": 10.0}, {"delay_s": math.nan}, {"thrust_lag_s": -1.0},
     {"max_accel_down_m_s2": 9.0}],
)  # fmt: skip
def test_refuses_impossible_params(change: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="QuadrotorParams"):
        dataclasses.replace(QuadrotorParams(), **change)


# --- ground --------------------------------------------------------------------------------------------------------


def test_it_stands_until_thrust_exceeds_weight() -> None:
    quad = Quadrotor(pos_ned_m=(3.0, 4.0, 0.0), wind=Wind((8.0, 0.0, 0.0), 2.0, seed=1))
    assert quad.on_ground
    fly(quad, 1.0, lambda _t: ((0.0, 0.0, -2.0), 0.0))
    assert quad.on_ground  # motors are off
    quad.spin()
    fly(quad, 1.0, start_s=1.0)
    assert quad.on_ground
    fly(quad, 1.0, lambda _t: ((2.0, 0.0, 0.5), 1.0), start_s=2.0)
    assert quad.on_ground
    assert quad.pos_ned_m == (3.0, 4.0, 0.0)
    assert quad.vel_ned_m_s == quad.accel_ned_m_s2 == REST
    fly(quad, 2.0, lambda _t: ((0.0, 0.0, -1.0), 0.0), start_s=3.0)
    assert not quad.on_ground
    assert quad.pos_ned_m[2] < -1.0


def test_a_landing_ends_at_rest_and_level() -> None:
    quad = Quadrotor(pos_ned_m=(0.0, 0.0, 2.0 - 3.0), ground_down_m=2.0)
    quad.hover()
    lowest = [-9.0]
    fly(quad, 12.0, lambda _t: ((1.0, 1.0, 0.6), 0.0), watch=lambda q: lowest.append(q.pos_ned_m[2]))
    assert quad.on_ground
    assert max(lowest) == quad.pos_ned_m[2] == 2.0
    assert quad.vel_ned_m_s == REST
    assert abs(quad.roll_rad) + abs(quad.pitch_rad) < 1e-6
    quad.idle()
    fly(quad, 1.0, start_s=12.0)
    assert quad.pos_ned_m[2] == 2.0
    assert not quad.motors_on


def test_without_motors_it_falls_and_comes_to_rest() -> None:
    quad = Quadrotor(pos_ned_m=(0.0, 0.0, -50.0))
    assert not quad.on_ground
    fly(quad, 0.5)
    assert quad.vel_ned_m_s[2] == pytest.approx(0.5 * GRAVITY_M_S2, rel=0.15)
    fly(quad, 1.5, start_s=0.5)
    assert quad.vel_ned_m_s[2] < 2.0 * GRAVITY_M_S2 * 0.9  # drag
    fly(quad, 10.0, start_s=2.0)
    assert quad.on_ground
    assert quad.pos_ned_m == (0.0, 0.0, 0.0)
    assert quad.vel_ned_m_s == quad.accel_ned_m_s2 == REST


def test_motors_off_in_flight_forgets_the_commands() -> None:
    quad = airborne()
    fly(quad, 2.0, lambda _t: ((3.0, 0.0, 0.0), 0.0))
    quad.idle()
    fly(quad, 6.0, start_s=2.0)
    assert quad.on_ground
    quad.spin()
    fly(quad, 1.0, start_s=8.0)
    assert quad.on_ground


# --- anything ------------------------------------------------------------------------------------------------------

_speed = st.floats(-30.0, 30.0)
_accel = st.floats(-20.0, 20.0)
_order = st.tuples(
    st.sampled_from(["command", "command", "command", "idle", "spin"]), st.tuples(*[_speed] * 4, *[_accel] * 3)
)


@settings(max_examples=60, deadline=None)
@given(
    orders=st.lists(_order, min_size=1, max_size=12),
    wind=st.tuples(st.floats(-15.0, 15.0), st.floats(-15.0, 15.0)),
    dt_s=st.sampled_from([0.0025, 0.005, 0.02]),
)
def test_bounded_and_finite_whatever_is_ordered(
    orders: list[tuple[str, tuple[float, ...]]], wind: tuple[float, float], dt_s: float
) -> None:
    params = QuadrotorParams()
    quad = airborne(params, Wind((wind[0], wind[1], 0.0), 2.0, 1.0, seed=3))
    t_s = 0.0
    for order, numbers in orders:
        if order == "command":
            quad.command((numbers[0], numbers[1], numbers[2]), numbers[3], t_s, (numbers[4], numbers[5], numbers[6]))
        else:
            getattr(quad, order)()
        for _ in range(round(0.4 / dt_s)):
            quad.step(t_s, dt_s)
            t_s += dt_s
        state = (*quad.pos_ned_m, *quad.vel_ned_m_s, *quad.accel_ned_m_s2, *quad.rates_rad_s)
        assert all(math.isfinite(v) for v in state)
        assert quad.pos_ned_m[2] <= 0.0
        assert math.hypot(*quad.vel_ned_m_s) < 45.0
        assert abs(quad.roll_rad) < params.max_tilt_rad + math.radians(8.0)
        assert abs(quad.pitch_rad) < params.max_tilt_rad + math.radians(8.0)
        assert -math.pi <= quad.yaw_rad < math.pi
