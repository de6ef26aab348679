import math
from dataclasses import fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.limits import BRAKES, COAST_DECAY_S, HOLDS, VelocityLimiter, VelocityLimits
from control.messages import CommandReason, VelocityCommand

speeds = st.floats(-30, 30)
commands = st.lists(
    st.tuples(speeds, speeds, speeds, st.floats(-5, 5), st.sampled_from(list(CommandReason)), st.floats(0.0, 1.5)),
    min_size=1,
    max_size=25,
)


def command(north=0.0, east=0.0, down=0.0, yaw_rate=0.0, reason=CommandReason.TRACKING, t_s=0.0):
    return VelocityCommand((north, east, down), yaw_rate, t_s, reason)


def step(limiter, wanted, now_s):
    """One step with a command that was made just now."""
    return limiter.step(replace(wanted, t_s=now_s), now_s)


def run(limiter, wanted, seconds, hz=20, start_s=0.0):
    out = None
    for i in range(round(seconds * hz)):
        out = step(limiter, wanted, start_s + i / hz)
    return out


def test_smoke_a_small_command_arrives_unchanged():
    out = run(VelocityLimiter(VelocityLimits()), command(1.0, -1.0, 0.3, 0.2), 2.0)
    assert out.v_ned_m_s == pytest.approx((1.0, -1.0, 0.3))
    assert out.yaw_rate_rad_s == pytest.approx(0.2)
    assert out.reason is CommandReason.TRACKING


def test_saturation_keeps_the_direction():
    out = run(VelocityLimiter(VelocityLimits()), command(30.0, 40.0, -9.0, -9.0), 6.0)
    assert out.v_ned_m_s == pytest.approx((3.0, 4.0, -1.0))
    assert out.yaw_rate_rad_s == pytest.approx(-math.radians(45))
    assert out.reason is CommandReason.LIMITED


def test_up_and_down_have_their_own_limit():
    limits = VelocityLimits(max_up_m_s=0.5, max_down_m_s=0.8)
    assert run(VelocityLimiter(limits), command(down=-3.0), 3.0).v_ned_m_s[2] == pytest.approx(-0.5)
    assert run(VelocityLimiter(limits), command(down=3.0), 3.0).v_ned_m_s[2] == pytest.approx(0.8)


@pytest.mark.parametrize("hz", [10, 20, 50])
def test_slew_is_per_second_at_every_rate(hz):
    limiter = VelocityLimiter(VelocityLimits())
    step(limiter, command(), 0.0)
    for i in range(1, hz + 1):
        out = step(limiter, command(north=5.0, down=1.0, yaw_rate=9.0), i / hz)
    assert out.v_ned_m_s == pytest.approx((2.0, 0.0, 1.0))
    assert out.yaw_rate_rad_s == pytest.approx(math.radians(45))
    assert out.reason is CommandReason.LIMITED


@pytest.mark.parametrize("reason", sorted(HOLDS))
def test_a_hold_is_zero_at_once_whatever_it_asks_for(reason):
    limiter = VelocityLimiter(VelocityLimits())
    run(limiter, command(north=5.0, down=0.9, yaw_rate=0.6), 3.0)
    out = step(limiter, command(north=5.0, down=1.0, yaw_rate=1.0, reason=reason), 3.0)
    assert (out.v_ned_m_s, out.yaw_rate_rad_s, out.reason) == ((0.0, 0.0, 0.0), 0.0, reason)
    # and motion begins again from standstill
    assert step(limiter, command(north=5.0), 3.05).v_ned_m_s[0] == pytest.approx(0.1)


@pytest.mark.parametrize("reason", sorted(BRAKES))
def test_braking_is_harder_and_keeps_its_reason(reason):
    limiter = VelocityLimiter(VelocityLimits())
    run(limiter, command(north=5.0), 3.0)
    out = run(limiter, command(reason=reason), 0.5, start_s=3.0)
    assert out.v_ned_m_s[0] == pytest.approx(2.5)
    assert out.reason is reason
    assert run(limiter, command(reason=reason), 0.55, start_s=3.5).v_ned_m_s == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("reason", sorted(BRAKES))
def test_only_the_braking_is_harder_and_not_the_retreat(reason):
    limiter = VelocityLimiter(VelocityLimits())
    out = run(limiter, command(north=-5.0, down=-1.0, yaw_rate=1.0, reason=reason), 0.5)
    assert out.v_ned_m_s[0] == pytest.approx(-2.0 * 0.5)
    assert out.v_ned_m_s[2] == pytest.approx(-1.0 * 0.5)
    assert out.yaw_rate_rad_s == pytest.approx(math.radians(90) * 0.5)


def test_a_brake_limit_below_the_ordinary_one_does_not_soften_the_braking():
    limiter = VelocityLimiter(VelocityLimits(brake_horizontal_accel_m_s2=0.5))
    run(limiter, command(north=2.0), 3.0)
    out = run(limiter, command(reason=CommandReason.TOO_CLOSE), 0.5, start_s=3.0)
    assert out.v_ned_m_s[0] == pytest.approx(1.0)


@given(st.floats(-6, 6), st.floats(-6, 6), st.lists(st.tuples(speeds, speeds), min_size=1, max_size=20))
def test_a_coast_never_gains_horizontal_speed(north, east, wishes):
    limiter = VelocityLimiter(VelocityLimits())
    speed = math.hypot(*run(limiter, command(north, east), 1.0).v_ned_m_s[:2])
    for i, wish in enumerate(wishes):
        out = step(limiter, command(*wish, reason=CommandReason.COASTING), 1.0 + 0.05 * i)
        assert math.hypot(*out.v_ned_m_s[:2]) <= speed + 1e-9
        assert out.reason is CommandReason.COASTING
        speed = math.hypot(*out.v_ned_m_s[:2])


@pytest.mark.parametrize("hz", [10, 30])
def test_a_coast_slows_down_whatever_it_asks_for_and_may_turn(hz):
    limiter = VelocityLimiter(VelocityLimits())
    assert run(limiter, command(north=3.0, reason=CommandReason.COASTING), 1.0).v_ned_m_s == (0.0, 0.0, 0.0)
    run(limiter, command(north=1.5), 3.0, start_s=1.0)
    for i in range(1, 2 * hz + 1):
        out = step(limiter, command(north=5.0, reason=CommandReason.COASTING), 3.95 + i / hz)
    assert out.v_ned_m_s[0] == pytest.approx(1.5 * math.exp(-2.0 / COAST_DECAY_S))
    out = run(limiter, command(east=1.0, reason=CommandReason.COASTING), 1.0, start_s=6.0)
    assert out.v_ned_m_s[0] == pytest.approx(0.0, abs=1e-6)
    assert 0 < out.v_ned_m_s[1] < 0.2


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize("entry", range(6))
def test_not_finite_anywhere_is_zero_at_once(entry, bad):
    limiter = VelocityLimiter(VelocityLimits())
    run(limiter, command(north=2.0, yaw_rate=0.5), 3.0)
    values = [2.0, 0.0, 0.0, 0.5, 3.0, 3.0]
    values[entry] = bad
    out = limiter.step(VelocityCommand(tuple(values[:3]), values[3], values[4], CommandReason.TRACKING), values[5])
    assert (out.v_ned_m_s, out.yaw_rate_rad_s) == ((0.0, 0.0, 0.0), 0.0)
    assert out.reason is CommandReason.HOLD_NOT_FINITE
    # and it starts again from standstill
    assert step(limiter, command(north=2.0), 3.1).v_ned_m_s[0] <= 2.0 * 0.1 + 1e-9


@pytest.mark.parametrize("age_s", [0.31, 1000.0, -0.1])
def test_a_command_that_was_not_made_just_now_is_not_sent(age_s):
    limiter = VelocityLimiter(VelocityLimits())
    run(limiter, command(north=2.0, yaw_rate=0.5), 3.0)
    out = limiter.step(command(north=2.0, yaw_rate=0.5, t_s=3.0 - age_s), 3.0)
    assert (out.v_ned_m_s, out.yaw_rate_rad_s) == ((0.0, 0.0, 0.0), 0.0)
    assert out.reason is CommandReason.HOLD_STALE_COMMAND
    assert limiter.step(command(reason=CommandReason.HOLD_NO_TARGET), 3.05).reason is CommandReason.HOLD_NO_TARGET


@pytest.mark.parametrize("back_s", [0.2, 0.9])
def test_time_that_goes_back_and_forth_is_no_time(back_s):
    limiter = VelocityLimiter(VelocityLimits())
    step(limiter, command(), 100.0)
    for _ in range(20):
        step(limiter, command(north=5.0), 100.0 - back_s)
        out = step(limiter, command(north=5.0), 100.0)
    assert out.v_ned_m_s == (0.0, 0.0, 0.0)
    assert step(limiter, command(north=5.0), 100.05).v_ned_m_s[0] == pytest.approx(0.1)


@pytest.mark.parametrize("step_s", [0.0, -5.0])
def test_time_that_does_not_go_on_changes_nothing_but_a_hold_still_stops(step_s):
    limiter = VelocityLimiter(VelocityLimits())
    before = run(limiter, command(north=2.0), 2.0)
    assert step(limiter, command(north=5.0), 1.95 + step_s).v_ned_m_s == before.v_ned_m_s
    out = step(limiter, command(reason=CommandReason.HOLD_STALE_TARGET), 1.95 + 2 * step_s)
    assert out.v_ned_m_s == (0.0, 0.0, 0.0)


def test_a_pause_is_not_one_large_step():
    limiter = VelocityLimiter(VelocityLimits())
    step(limiter, command(), 0.0)
    assert step(limiter, command(north=5.0), 0.9).v_ned_m_s[0] == pytest.approx(0.5)
    run(limiter, command(north=5.0), 3.0, start_s=1.0)
    assert step(limiter, command(north=5.0), 10.0).v_ned_m_s[0] == pytest.approx(0.1)  # the autopilot has stopped


@given(commands)
def test_never_more_than_asked_or_had_and_never_over_a_limit(sequence):
    limits, now_s = VelocityLimits(), 0.0
    limiter, before = VelocityLimiter(limits), (0.0, 0.0, 0.0, 0.0)
    for north, east, down, yaw_rate, reason, dt_s in sequence:
        now_s += dt_s
        out = step(limiter, command(north, east, down, yaw_rate, reason), now_s)
        given_now = (*out.v_ned_m_s, out.yaw_rate_rad_s)
        for asked, had, got in zip((north, east, down, yaw_rate), before, given_now, strict=True):
            assert min(0.0, asked, had) - 1e-9 <= got <= max(0.0, asked, had) + 1e-9
        assert math.hypot(*out.v_ned_m_s[:2]) <= limits.max_horizontal_m_s + 1e-9
        assert -limits.max_up_m_s - 1e-9 <= out.v_ned_m_s[2] <= limits.max_down_m_s + 1e-9
        assert abs(out.yaw_rate_rad_s) <= limits.max_yaw_rate_rad_s + 1e-9
        if reason is not CommandReason.TRACKING:
            assert out.reason is reason
        before = given_now


@given(speeds, speeds, speeds, st.floats(-5, 5))
def test_mirrored_command_gives_mirrored_output(north, east, down, yaw_rate):
    a = run(VelocityLimiter(VelocityLimits()), command(north, east, down, yaw_rate), 0.5)
    b = run(VelocityLimiter(VelocityLimits()), command(north, -east, down, -yaw_rate), 0.5)
    assert b.v_ned_m_s == pytest.approx((a.v_ned_m_s[0], -a.v_ned_m_s[1], a.v_ned_m_s[2]))
    assert b.yaw_rate_rad_s == pytest.approx(-a.yaw_rate_rad_s)


@pytest.mark.parametrize("name", [f.name for f in fields(VelocityLimits)])
def test_tighten_takes_away_and_never_adds(name):
    base = VelocityLimits()
    value = getattr(base, name)
    assert getattr(base.tighten(replace(base, **{name: value / 2})), name) == value / 2
    assert base.tighten(replace(base, **{name: value * 2})) == base


@pytest.mark.parametrize("name", [f.name for f in fields(VelocityLimits)])
@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_bad_limits_name_the_field(name, bad):
    with pytest.raises(ValueError, match=name):
        VelocityLimits(**{name: bad})


def test_holds_are_all_the_hold_reasons():
    assert {r.name for r in HOLDS} == {r.name for r in CommandReason if r.name.startswith("HOLD_")}
    assert CommandReason.COASTING not in HOLDS
