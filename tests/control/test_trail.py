import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.guidance.trail import TrailConfig, TrailGuidance
from control.limits import VelocityLimiter, VelocityLimits
from control.messages import CommandReason, GimbalFrame
from control.range import RangeEstimate
from tests.control.builders import CAMERA, CENTRE, NOW_S, gimbal, pixel_of_ned, target, vehicle
from tracker.box import Box
from tracker.messages import TargetStatus


def distance(range_m: float, sigma_m: float = 0.1) -> RangeEstimate:
    return RangeEstimate(range_m, sigma_m, True)


def look(range_m=30.0, x_px=CENTRE[0], y_px=CENTRE[1], config=None, state=None, craft=None, **changes):
    """One command for a target straight ahead of a level camera, unless told otherwise."""
    seen = target(x_px, y_px, **changes)
    return TrailGuidance(config or TrailConfig()).step(
        seen, state or gimbal(), CAMERA, craft or vehicle(), distance(range_m), NOW_S
    )


def test_smoke_too_far_flies_forward_and_too_near_flies_back():
    ahead = look(30.0)
    assert ahead.v_ned_m_s == pytest.approx((5.0, 0.0, 0.0))  # 15 m too far, 3 s
    assert ahead.reason is CommandReason.TRACKING
    assert look(9.0).v_ned_m_s == pytest.approx((-2.0, 0.0, 0.0))
    assert look(15.0).v_ned_m_s == pytest.approx((0.0, 0.0, 0.0))


def test_signs_a_target_to_the_right_turns_and_draws_to_the_right():
    out = look(30.0, x_px=CENTRE[0] + 100)
    assert out.yaw_rate_rad_s > 0
    assert out.v_ned_m_s[1] > 0
    assert out.v_ned_m_s[2] == 0.0


@pytest.mark.parametrize("frame", list(GimbalFrame))
def test_heading_and_gimbal_yaw_give_the_direction(frame):
    # nose west, camera to the right of it: looks north
    yaw = math.pi / 2 if frame is GimbalFrame.VEHICLE else 0.0
    out = look(30.0, state=gimbal(0.0, yaw, frame=frame), craft=vehicle(-math.pi / 2))
    assert out.v_ned_m_s == pytest.approx((5.0, 0.0, 0.0), abs=1e-9)
    assert out.yaw_rate_rad_s == pytest.approx(math.pi / 2 / 0.7)


def test_the_standoff_is_horizontal():
    pitch = math.radians(-60)
    assert look(30.0, state=gimbal(pitch)).v_ned_m_s == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


@given(st.floats(0, 640), st.floats(0, 360), st.floats(-1.2, 0.2), st.floats(-2.5, 2.5), st.floats(5, 60))
def test_mirrored_picture_gives_mirrored_command(x, y, pitch, yaw, range_m):
    a = look(range_m, x, y, state=gimbal(pitch, yaw))
    b = look(range_m, 640 - x, y, state=gimbal(pitch, -yaw))
    assert b.v_ned_m_s == pytest.approx((a.v_ned_m_s[0], -a.v_ned_m_s[1], a.v_ned_m_s[2]), abs=1e-6)
    assert b.yaw_rate_rad_s == pytest.approx(-a.yaw_rate_rad_s, abs=1e-9)


@given(st.floats(0, 640), st.floats(0, 360), st.floats(-1.57, 0.2), st.floats(-3.1, 3.1), st.floats(0.1, 4.9))
def test_below_the_least_standoff_nothing_points_to_the_target(x, y, pitch, yaw, range_m):
    law = TrailGuidance(TrailConfig(bearing_rad=2.0))
    for i in range(4):  # the target runs away, which must not draw the vehicle in
        now_s, run_m = NOW_S + 0.05 * i, 0.1 * i * range_m
        out = law.step(
            target(x, y, t_s=now_s),
            gimbal(pitch, yaw, t_s=now_s),
            CAMERA,
            vehicle(t_s=now_s, pos_ned_m=(run_m, 0.0, -10.0)),
            distance(range_m),
            now_s,
        )
    ray = CAMERA.ray(x, y)
    forward = math.cos(pitch) * ray[2] + math.sin(pitch) * ray[1]
    ahead = np.array(
        [forward * math.cos(yaw) - ray[0] * math.sin(yaw), forward * math.sin(yaw) + ray[0] * math.cos(yaw)]
    )
    if np.linalg.norm(ahead) * range_m > 0.5:
        assert float(np.dot(out.v_ned_m_s[:2], ahead)) <= 1e-9
    assert out.reason is CommandReason.TOO_CLOSE


@pytest.mark.parametrize(("pitch_deg", "height_m", "down_m_s"), [(-90, 2.0, 0.0), (-90, 14.0, -2.0), (30, 14.0, 0.0)])
def test_too_close_it_neither_descends_on_the_target_nor_climbs_into_it(pitch_deg, height_m, down_m_s):
    out = look(4.0, config=TrailConfig(height_m=height_m), state=gimbal(math.radians(pitch_deg)))
    assert out.reason is CommandReason.TOO_CLOSE
    assert out.v_ned_m_s[2] == pytest.approx(down_m_s)


def test_too_close_on_a_prediction_is_a_coast_that_leads_nowhere_near():
    out = look(3.0, status=TargetStatus.COASTING)
    assert out.reason is CommandReason.COASTING  # so the limiter lets it gain no speed
    assert out.v_ned_m_s[0] <= 0.0


@pytest.mark.parametrize("interruption", ["hold", "no_range"])
def test_the_speed_of_the_target_is_not_fed_forward_across_an_interruption(interruption):
    law = TrailGuidance(TrailConfig())
    for i in range(60):
        now_s = NOW_S + i / 20
        moved = vehicle(t_s=now_s, pos_ned_m=(2.0 * i / 20, 0.0, -10.0))
        out = law.step(target(t_s=now_s), gimbal(t_s=now_s), CAMERA, moved, distance(15.0), now_s)
    assert out.v_ned_m_s[0] > 1.5
    later = NOW_S + 3.0
    status = TargetStatus.SEARCHING if interruption == "hold" else TargetStatus.LOCKED
    far = distance(15.0) if interruption == "hold" else RangeEstimate(math.nan, math.nan, False)
    law.step(target(t_s=later, status=status), gimbal(t_s=later), CAMERA, vehicle(t_s=later), far, later)
    later += 0.05
    out = law.step(target(t_s=later), gimbal(t_s=later), CAMERA, vehicle(t_s=later), distance(15.0), later)
    assert out.v_ned_m_s == pytest.approx((0.0, 0.0, 0.0))


def test_the_way_round_the_target_has_a_greatest_speed():
    out = look(60.0, config=TrailConfig(standoff_m=60.0, bearing_rad=0.0))
    assert math.hypot(*out.v_ned_m_s[:2]) == pytest.approx(3.0)


def test_straight_above_the_target_the_way_out_is_backwards():
    out = look(10.0, state=gimbal(-math.pi / 2), craft=vehicle(math.pi / 2))
    assert out.v_ned_m_s == pytest.approx((0.0, -5.0, 0.0), abs=1e-9)
    assert out.yaw_rate_rad_s == pytest.approx(0.0, abs=1e-9)
    assert out.reason is CommandReason.TOO_CLOSE


def test_a_target_almost_straight_below_hardly_turns_the_vehicle_and_gives_no_direction():
    off_px = 20.0  # to the right, 0.41 m beside the point straight below
    out = look(10.0, x_px=CENTRE[0] + off_px, state=gimbal(-math.pi / 2))
    assert out.v_ned_m_s == pytest.approx((-5.0, 0.0, 0.0), abs=0.2)
    weight = math.sin(math.atan(off_px / CAMERA.fx_px)) / math.cos(math.radians(80))
    assert out.yaw_rate_rad_s == pytest.approx(math.pi / 2 * weight / 0.7)


@pytest.mark.parametrize(("height_m", "down_m_s"), [(None, 0.0), (10.0, 0.0), (14.0, -2.0), (4.0, 3.0)])
def test_height(height_m, down_m_s):
    assert look(config=TrailConfig(height_m=height_m)).v_ned_m_s[2] == pytest.approx(down_m_s)


@pytest.mark.parametrize(("bearing_deg", "east_sign"), [(180, 0), (170, 1), (-170, -1)])
def test_a_fixed_bearing_draws_round_the_target(bearing_deg, east_sign):
    # target 15 m north, so the vehicle is at bearing 180; at bearing 170 it would be further east
    out = look(15.0, config=TrailConfig(bearing_rad=math.radians(bearing_deg)))
    assert out.v_ned_m_s[0] == pytest.approx(0.0, abs=1e-9)
    assert out.v_ned_m_s[1] == pytest.approx(east_sign * 15 * math.radians(10) / 4, abs=1e-6)


@pytest.mark.parametrize("hz", [10, 20, 30])
def test_the_speed_of_the_target_is_fed_forward(hz):
    law = TrailGuidance(TrailConfig())
    for i in range(8 * hz):  # vehicle and target move together, north east
        now_s = NOW_S + i / hz
        moved = vehicle(t_s=now_s, pos_ned_m=(2.0 * i / hz, 1.0 * i / hz, -10.0))
        out = law.step(target(t_s=now_s), gimbal(t_s=now_s), CAMERA, moved, distance(15.0), now_s)
    assert out.v_ned_m_s == pytest.approx((2.0, 1.0, 0.0), abs=0.01)


def test_the_fed_forward_speed_is_bounded_and_a_jump_in_time_starts_it_anew():
    law = TrailGuidance(TrailConfig(max_target_speed_m_s=3.0))
    for i in range(20):
        now_s = NOW_S + i / 20
        moved = vehicle(t_s=now_s, pos_ned_m=(20.0 * i, 0.0, -10.0))
        out = law.step(target(t_s=now_s), gimbal(t_s=now_s), CAMERA, moved, distance(15.0), now_s)
    assert out.v_ned_m_s == pytest.approx((3.0, 0.0, 0.0))
    later = NOW_S + 5.0
    out = law.step(target(t_s=later), gimbal(t_s=later), CAMERA, vehicle(t_s=later), distance(15.0), later)
    assert out.v_ned_m_s == pytest.approx((0.0, 0.0, 0.0))


def test_coasting_says_so_and_does_not_learn_the_speed_of_the_target_from_predictions():
    law = TrailGuidance(TrailConfig())
    for i in range(60):
        now_s = NOW_S + i / 20
        seen = target(t_s=now_s, status=TargetStatus.COASTING if i > 0 else TargetStatus.LOCKED)
        moved = vehicle(t_s=now_s, pos_ned_m=(2.0 * i / 20, 0.0, -10.0))
        out = law.step(seen, gimbal(t_s=now_s), CAMERA, moved, distance(15.0), now_s)
    assert out.reason is CommandReason.COASTING
    assert out.v_ned_m_s == pytest.approx((0.0, 0.0, 0.0))
    locked = law.step(target(), gimbal(), CAMERA, vehicle(), distance(30.0), NOW_S)
    assert (locked.v_ned_m_s[0], locked.reason) == (pytest.approx(5.0), CommandReason.TRACKING)


@pytest.mark.parametrize(
    "status", [TargetStatus.IDLE, TargetStatus.ACQUIRING, TargetStatus.SEARCHING, TargetStatus.LOST]
)
def test_other_states_hold(status):
    out = look(x_px=600, status=status)
    assert (out.v_ned_m_s, out.yaw_rate_rad_s, out.reason) == ((0.0, 0.0, 0.0), 0.0, CommandReason.HOLD_NO_TARGET)


def test_a_stale_target_holds():
    assert look(t_s=NOW_S - 0.31).reason is CommandReason.HOLD_STALE_TARGET


@pytest.mark.parametrize(
    ("state", "craft"),
    [
        (gimbal(valid=False), vehicle()),
        (gimbal(t_s=NOW_S - 0.6), vehicle()),
        (gimbal(), vehicle(attitude_valid=False)),
        (gimbal(), vehicle(position_valid=False)),
        (gimbal(), vehicle(t_s=NOW_S - 0.6)),
    ],
)
def test_missing_telemetry_holds(state, craft):
    out = look(x_px=600, state=state, craft=craft)
    assert (out.v_ned_m_s, out.yaw_rate_rad_s, out.reason) == ((0.0, 0.0, 0.0), 0.0, CommandReason.HOLD_NO_TELEMETRY)


@pytest.mark.parametrize(
    "no_range",
    [RangeEstimate(math.nan, math.nan, False), RangeEstimate(30.0, 1.0, False), distance(0.0), distance(-3.0),
     distance(3.0, -1.0)],
)  # fmt: skip
def test_without_a_range_it_only_turns(no_range):
    law = TrailGuidance(TrailConfig(height_m=50.0))
    out = law.step(target(600), gimbal(), CAMERA, vehicle(), no_range, NOW_S)
    assert out.v_ned_m_s == (0.0, 0.0, 0.0)
    assert out.yaw_rate_rad_s > 0
    assert out.reason is CommandReason.NO_RANGE


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize(
    "entry",
    ["target_t", "vx", "vy", "growth", "confidence", "cov", "cx", "cy", "w", "h", "g_pitch", "g_yaw", "g_t", "roll",
     "pitch", "yaw", "v_t", "pos0", "pos1", "pos2", "vel0", "vel1", "vel2", "range", "sigma", "now"],
)  # fmt: skip
def test_not_finite_at_any_entry_is_zero(entry, bad):
    def pick(name, good):
        return bad if name == entry else good

    seen = target(
        t_s=pick("target_t", NOW_S),
        vel_px_s=(pick("vx", 1.0), pick("vy", 1.0)),
        growth_per_s=pick("growth", 0.0),
        confidence=pick("confidence", 0.9),
        cov=np.diag([1.0, 1.0, pick("cov", 0.01), 0.01]),
        box=Box(pick("cx", 500.0), pick("cy", 90.0), pick("w", 40.0), pick("h", 40.0)),
    )
    state = gimbal(pick("g_pitch", 0.0), pick("g_yaw", 0.0), t_s=pick("g_t", NOW_S))
    craft = vehicle(
        pick("yaw", 0.0),
        roll_rad=pick("roll", 0.0),
        pitch_rad=pick("pitch", 0.0),
        t_s=pick("v_t", NOW_S),
        pos_ned_m=tuple(pick(f"pos{i}", 0.0) for i in range(3)),
        vel_ned_m_s=tuple(pick(f"vel{i}", 0.0) for i in range(3)),
    )
    law = TrailGuidance(TrailConfig(height_m=20.0))
    out = law.step(seen, state, CAMERA, craft, distance(pick("range", 30.0), pick("sigma", 0.1)), pick("now", NOW_S))
    assert (out.v_ned_m_s, out.yaw_rate_rad_s) == ((0.0, 0.0, 0.0), 0.0)
    assert out.reason is CommandReason.HOLD_NOT_FINITE
    good = law.step(target(500), gimbal(), CAMERA, vehicle(), distance(30.0), NOW_S)
    assert all(math.isfinite(v) for v in good.v_ned_m_s)  # nothing of it stays behind
    assert good.v_ned_m_s[0] > 0


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("standoff_m", 4.0),
        ("standoff_m", math.nan),
        ("min_standoff_m", 0.0),
        ("height_m", -1.0),
        ("height_m", math.nan),
        ("bearing_rad", 10.0),
        ("bearing_rad", math.nan),
        ("position_time_s", 0.0),
        ("bearing_time_s", math.inf),
        ("height_time_s", 0.0),
        ("yaw_time_s", 0.0),
        ("velocity_filter_s", 0.0),
        ("max_target_speed_m_s", -1.0),
        ("max_tangential_m_s", -1.0),
    ],
)
def test_bad_configuration_names_the_field(name, bad):
    with pytest.raises(ValueError, match=rf"TrailConfig\.{name} = "):
        TrailConfig(**{name: bad})


def fly(config, target_of, seconds, hz=20, start=(0.0, 0.0, -10.0), yaw_rad=0.0, lag_s=0.4):
    """A point mass with first-order velocity response behind law and limiter; the camera always sees the target.

    Returns times and ground ranges, positions (N, 3), final heading and the target's last position.
    """
    law, limiter = TrailGuidance(config), VelocityLimiter(VelocityLimits())
    position, velocity, heading = np.array(start), np.zeros(3), yaw_rad
    times, ground, track = [], [], []
    for i in range(round(seconds * hz)):
        now_s = i / hz
        offset = np.array(target_of(now_s)) - position
        look_yaw = math.atan2(offset[1], offset[0])
        state = gimbal(-0.5, look_yaw + 0.1, frame=GimbalFrame.EARTH, t_s=now_s)  # not centred
        pixel = pixel_of_ned(offset, state, heading)
        craft = replace(vehicle(heading), t_s=now_s, pos_ned_m=tuple(float(v) for v in position))
        seen = target(*pixel, t_s=now_s)
        wanted = law.step(seen, state, CAMERA, craft, distance(float(np.linalg.norm(offset))), now_s)
        sent = limiter.step(wanted, now_s)
        for _ in range(round(1000 / hz)):
            velocity += (np.array(sent.v_ned_m_s) - velocity) * 0.001 / lag_s
            position = position + velocity * 0.001
            heading += sent.yaw_rate_rad_s * 0.001
        times.append(now_s)
        ground.append(math.hypot(offset[0], offset[1]))
        track.append(position.copy())
    return np.array(times), np.array(ground), np.array(track), heading, np.array(target_of(now_s))


def test_closed_loop_reaches_the_standoff_without_going_through_it():
    _, ground, track, heading, goal = fly(TrailConfig(), lambda t: (40.0, 30.0, 0.0), 40.0, yaw_rad=-1.0)
    assert ground[-1] == pytest.approx(15.0, abs=0.3)
    assert ground.min() > 14.0
    assert heading == pytest.approx(math.atan2(goal[1] - track[-1][1], goal[0] - track[-1][0]), abs=0.02)
    assert np.ptp(track[:, 2]) == 0.0


def test_closed_loop_from_too_near_only_ever_leaves():
    _, ground, *_ = fly(TrailConfig(), lambda t: (3.0, 0.0, 0.0), 30.0, start=(0.0, 0.0, -3.0))
    assert (np.diff(ground)[ground[1:] < 5.0] >= -1e-9).all()
    assert ground[-1] == pytest.approx(15.0, abs=0.3)


def test_closed_loop_keeps_the_standoff_from_a_runner():
    times, ground, *_ = fly(TrailConfig(), lambda t: (15.0 + 3.0 * t, 0.0, 0.0), 40.0)
    assert np.sqrt(np.mean((ground[times > 15.0] - 15.0) ** 2)) < 0.5
    assert ground.max() < 24.0


def test_closed_loop_a_runner_towards_the_vehicle_does_not_reach_it():
    _, ground, *_ = fly(TrailConfig(), lambda t: (30.0 - 3.0 * t, 0.0, 0.0), 20.0)
    assert ground.min() > 5.0


def test_closed_loop_goes_round_to_a_bearing_without_crossing_the_target():
    config = TrailConfig(bearing_rad=math.radians(10), height_m=14.0)
    _, ground, track, _, goal = fly(config, lambda t: (15.0, 0.0, 0.0), 60.0)
    bearing = math.atan2(track[-1][1] - goal[1], track[-1][0] - goal[0])
    assert bearing == pytest.approx(math.radians(10), abs=0.03)
    assert ground.min() > 12.0
    assert track[-1][2] == pytest.approx(-14.0, abs=0.1)


def test_closed_loop_does_not_depend_on_the_frame_rate():
    # one point per second from each run
    runs = [
        fly(TrailConfig(), lambda t: (40.0 + 1.0 * t, 30.0, 0.0), 20.0, hz=hz)[2][hz - 1 :: hz] for hz in (10, 20, 30)
    ]
    for run in runs[1:]:
        assert np.abs(run - runs[0]).max() < 0.6


@pytest.mark.parametrize("box", [Box(*CENTRE, 0.55 * 640, 100.0), Box(*CENTRE, 100.0, 0.55 * 360)])
def test_a_target_that_fills_the_picture_is_not_approached_whatever_the_range_says(box):
    far = RangeEstimate(60.0, 2.0, True)
    law = TrailGuidance(TrailConfig(standoff_m=15.0))
    small = law.step(target(), gimbal(), CAMERA, vehicle(), far, NOW_S)
    large = TrailGuidance(TrailConfig(standoff_m=15.0)).step(target(box=box), gimbal(), CAMERA, vehicle(), far, NOW_S)
    assert small.v_ned_m_s[0] > 1.0
    assert large.v_ned_m_s[0] <= 0.0
    assert large.reason is CommandReason.TOO_CLOSE
