import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.gimbal import GAIN_TIMES_DELAY, MAX_ANGLE_LEAD_RAD, MIN_LOOP_DELAY_S, GimbalLaw, GimbalLawConfig
from control.messages import CommandReason, GimbalFrame
from tests.control.builders import CAMERA, CENTRE, NOW_S, gimbal, target, vehicle
from tracker.box import Box
from tracker.messages import TargetStatus

PLAIN = GimbalLawConfig(dead_zone_rad=0.0, feed_forward=0.0)


def law(**changes) -> GimbalLaw:
    return GimbalLaw(replace(GimbalLawConfig(), **changes))


def hold_still(the_law, x_px, y_px, state, seconds=0.5, hz=20, start_s=NOW_S, **changes):
    """The last of the commands for a target and a gimbal that do not move."""
    out = None
    for i in range(round(seconds * hz)):
        now_s = start_s + i / hz
        seen = target(x_px, y_px, t_s=now_s, **changes)
        out = the_law.step(seen, replace(state, t_s=now_s), CAMERA, now_s)
    return out


def rates(command):
    return command.pitch_rate_rad_s, command.yaw_rate_rad_s


@pytest.mark.parametrize(
    ("offset", "pitch_sign", "yaw_sign"),
    [((80, 0), 0, 1), ((-80, 0), 0, -1), ((0, 80), -1, 0), ((0, -80), 1, 0), ((80, 80), -1, 1)],
)
def test_signs_right_is_positive_yaw_and_below_is_negative_pitch(offset, pitch_sign, yaw_sign):
    out = law().step(target(CENTRE[0] + offset[0], CENTRE[1] + offset[1]), gimbal(), CAMERA, NOW_S)
    assert [np.sign(round(r, 9)) for r in rates(out)] == [pitch_sign, yaw_sign]
    assert out.reason is CommandReason.TRACKING
    assert out.t_s == NOW_S
    assert out.pitch_rad == pytest.approx(out.pitch_rate_rad_s * 0.05)
    assert out.yaw_rad == pytest.approx(out.yaw_rate_rad_s * 0.05)


def test_gain_comes_from_the_delay_and_has_a_ceiling():
    assert GimbalLawConfig(loop_delay_s=0.15).gain_per_s(0.0) == pytest.approx(GAIN_TIMES_DELAY / 0.15)
    assert GimbalLawConfig(loop_delay_s=0.15).gain_per_s(0.1) == pytest.approx(GAIN_TIMES_DELAY / 0.20)
    assert GimbalLawConfig(loop_delay_s=0.0).gain_per_s(0.0) == pytest.approx(GAIN_TIMES_DELAY / MIN_LOOP_DELAY_S)


@pytest.mark.parametrize("hz", [10, 30])
def test_the_gain_follows_the_measured_frame_interval(hz):
    out = hold_still(GimbalLaw(PLAIN), CENTRE[0] + 20, CENTRE[1], gimbal(), seconds=6.0, hz=hz)
    assert out.yaw_rate_rad_s == pytest.approx(PLAIN.gain_per_s(1 / hz) * math.atan(20 / CAMERA.fx_px), rel=1e-3)


def test_gain_in_the_picture_grows_with_pitch():
    level = hold_still(GimbalLaw(PLAIN), CENTRE[0] + 20, CENTRE[1], gimbal())
    steep = hold_still(GimbalLaw(PLAIN), CENTRE[0] + 20, CENTRE[1], gimbal(math.radians(-60)))
    assert steep.yaw_rate_rad_s / level.yaw_rate_rad_s == pytest.approx(2.0, rel=0.01)


@given(st.floats(0, 640), st.floats(0, 360), st.floats(-1.4, 0.4), st.floats(-2.9, 2.9))
def test_mirrored_picture_gives_mirrored_command(x, y, pitch, yaw):
    a = law().step(target(x, y), gimbal(pitch, yaw), CAMERA, NOW_S)
    b = law().step(target(640 - x, y), gimbal(pitch, -yaw), CAMERA, NOW_S)
    assert rates(b) == pytest.approx((a.pitch_rate_rad_s, -a.yaw_rate_rad_s), abs=1e-9)


@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(-2, 2), st.floats(-4, 4), st.floats(-1, 3), st.booleans())
def test_rates_and_changes_of_rate_are_bounded(x, y, pitch, yaw, dt_s, coasting):
    config = GimbalLawConfig()
    the_law, now_s, before = GimbalLaw(config), NOW_S, (0.0, 0.0)
    for i in range(6):
        status = TargetStatus.COASTING if coasting else TargetStatus.LOCKED
        side = 1 if i % 2 else -1
        seen = target(x * side, y, t_s=now_s, status=status)
        out = the_law.step(seen, gimbal(pitch, yaw, t_s=now_s), CAMERA, now_s)
        assert max(abs(r) for r in rates(out)) <= config.max_rate_rad_s
        assert max(abs(a - b) for a, b in zip(rates(out), before, strict=True)) <= config.max_accel_rad_s2 * 0.25 + 1e-9
        before, now_s = rates(out), now_s + dt_s


def test_saturation_says_limited_and_coasting_says_coasting():
    out = hold_still(law(max_rate_rad_s=0.1), 640, CENTRE[1], gimbal())
    assert rates(out) == pytest.approx((0.0, 0.1), abs=1e-9)
    assert out.reason is CommandReason.LIMITED
    coasting = hold_still(law(), 640, CENTRE[1], gimbal(), status=TargetStatus.COASTING)
    assert coasting.reason is CommandReason.COASTING
    assert coasting.yaw_rate_rad_s > 0


@pytest.mark.parametrize("hz", [10, 20, 50])
def test_slew_is_per_second_at_every_rate(hz):
    the_law = law(max_accel_rad_s2=1.0, feed_forward=0.0)
    hold_still(the_law, *CENTRE, gimbal(), seconds=1 / hz, hz=hz)
    out = hold_still(the_law, 640, CENTRE[1], gimbal(), seconds=0.5, hz=hz, start_s=NOW_S + 1 / hz)
    assert out.yaw_rate_rad_s == pytest.approx(0.5)


def test_dead_zone_is_still_and_brings_no_jump():
    quiet = law(dead_zone_rad=0.01)
    assert rates(hold_still(quiet, CENTRE[0] + 4, CENTRE[1], gimbal())) == (0.0, 0.0)
    just_outside = hold_still(law(dead_zone_rad=0.01), CENTRE[0] + 5.2, CENTRE[1], gimbal()).yaw_rate_rad_s
    assert 0 < just_outside < 0.005


@pytest.mark.parametrize(
    ("state", "pixel", "blocked"),
    [
        (gimbal(math.radians(-89.9999)), (CENTRE[0], 300), 0),
        (gimbal(math.radians(30)), (CENTRE[0], 60), 0),
        (gimbal(math.radians(40)), (CENTRE[0], 60), 0),
        (gimbal(0.0, 1.0), (640, CENTRE[1]), 1),
        (gimbal(0.0, -1.0), (0, CENTRE[1]), 1),
    ],
)
def test_no_rate_into_a_stop_but_out_of_it(state, pixel, blocked):
    limits = {"yaw_limits_rad": (-1.0, 1.0)}
    out = hold_still(law(**limits), *pixel, state)
    assert abs(rates(out)[blocked]) < 1e-4
    assert out.reason is CommandReason.LIMITED
    other_way = hold_still(law(**limits), 640 - pixel[0], 360 - pixel[1], state)
    assert abs(rates(other_way)[blocked]) > 0.1


def test_the_angle_stays_within_the_stops():
    the_law = law(yaw_limits_rad=(-1.0, 1.0), pitch_min_rad=-0.5)
    out = hold_still(the_law, 640, 360, gimbal(-0.49, 0.99), seconds=2.0)
    assert -0.5 <= out.pitch_rad <= -0.49
    assert 0.99 <= out.yaw_rad <= 1.0


@pytest.mark.parametrize("limit_deg", [170, 175, 180])
@pytest.mark.parametrize("side", [1, -1])
def test_an_angle_never_jumps_from_one_yaw_stop_to_the_other(limit_deg, side):
    limit = math.radians(limit_deg)
    the_law = law(yaw_limits_rad=(-limit, limit))
    for i in range(40):
        now_s = NOW_S + i / 10
        state = gimbal(0.0, side * math.radians(167), t_s=now_s)
        out = the_law.step(target(640 if side > 0 else 0, t_s=now_s), state, CAMERA, now_s)
        assert math.radians(160) < side * out.yaw_rad <= limit


@pytest.mark.parametrize(("pitch_rad", "yaw_rad"), [(math.radians(45), 0.0), (0.0, 1.3), (0.0, -1.3)])
@pytest.mark.parametrize("status", [TargetStatus.LOST, TargetStatus.LOCKED])
def test_a_gimbal_reported_beyond_a_stop_is_not_sent_back_by_a_zero_rate(pitch_rad, yaw_rad, status):
    out = law(yaw_limits_rad=(-1.0, 1.0)).step(target(status=status), gimbal(pitch_rad, yaw_rad), CAMERA, NOW_S)
    assert rates(out) == (0.0, 0.0)
    assert (out.pitch_rad, out.yaw_rad) == pytest.approx((pitch_rad, yaw_rad))


@pytest.mark.parametrize("room_rad", [0.02, 0.05, 0.1])
def test_the_rate_falls_before_a_stop_so_that_the_delay_cannot_carry_it_in(room_rad):
    the_law = law(yaw_limits_rad=(-1.0, 1.0), loop_delay_s=0.2)
    out = hold_still(the_law, 640, CENTRE[1], gimbal(0.0, 1.0 - room_rad), seconds=1.0)
    assert 0 < out.yaw_rate_rad_s <= room_rad / 0.2 + 1e-9


def test_reset_starts_from_rest():
    the_law = law(max_accel_rad_s2=2.0)
    assert hold_still(the_law, 640, CENTRE[1], gimbal(), seconds=1.0).yaw_rate_rad_s > 0.5
    the_law.reset()
    out = the_law.step(target(640, t_s=NOW_S + 1), gimbal(t_s=NOW_S + 1), CAMERA, NOW_S + 1)
    assert out.yaw_rate_rad_s == pytest.approx(2.0 * 0.05)


def test_time_that_goes_back_and_forth_is_no_time():
    the_law = law(max_accel_rad_s2=2.0)
    for i in range(20):
        now_s = NOW_S - 0.2 * (i % 2)
        out = the_law.step(target(640, t_s=now_s), gimbal(t_s=now_s), CAMERA, now_s)
    assert out.yaw_rate_rad_s == pytest.approx(2.0 * 0.05)  # the first step's, no more


def test_yaw_stops_are_not_those_of_the_earth_frame():
    state = gimbal(0.0, 1.0, frame=GimbalFrame.EARTH)
    out = hold_still(law(yaw_limits_rad=(-1.0, 1.0)), 640, CENTRE[1], state)
    assert out.yaw_rate_rad_s > 0.5
    assert out.frame is GimbalFrame.EARTH


def test_the_angle_leads_the_report_by_a_bounded_amount_across_the_seam():
    out = hold_still(law(), 640, CENTRE[1], gimbal(0.0, 3.1), seconds=3.0)
    assert out.yaw_rad == pytest.approx(3.1 + MAX_ANGLE_LEAD_RAD - math.tau)
    below = hold_still(law(), CENTRE[0], 360, gimbal(-0.5), seconds=3.0)
    assert below.pitch_rad == pytest.approx(-0.5 - MAX_ANGLE_LEAD_RAD)


@pytest.mark.parametrize("why", ["invalid", "stale"])
def test_without_a_gimbal_state_there_is_a_rate_and_no_angle(why):
    state = gimbal(math.nan, math.nan, valid=False) if why == "invalid" else gimbal(t_s=NOW_S - 0.6)
    out = law().step(target(640, CENTRE[1]), state, CAMERA, NOW_S)
    assert out.yaw_rate_rad_s > 0
    assert (out.pitch_rad, out.yaw_rad) == (None, None)


def test_a_known_camera_rate_is_fed_forward_even_without_a_gimbal_state():
    the_law = law(feed_forward_filter_s=0.0)
    for i in range(10):
        now_s = NOW_S + i / 20
        seen = target(t_s=now_s, vel_px_s=(0.1 * CAMERA.fx_px, 0.0))
        out = the_law.step(seen, gimbal(valid=False), CAMERA, now_s, (0.2, 0.3))
    assert rates(out) == pytest.approx((0.2, 0.4), rel=1e-6)


@pytest.mark.parametrize(
    "status", [TargetStatus.IDLE, TargetStatus.ACQUIRING, TargetStatus.SEARCHING, TargetStatus.LOST]
)
def test_other_states_stop_at_once_and_hold_the_reported_angle(status):
    the_law = law()
    hold_still(the_law, 640, CENTRE[1], gimbal(-0.2, 0.5), seconds=1.0)
    later = NOW_S + 1.0
    out = the_law.step(target(640, 90, status=status, t_s=later), gimbal(-0.2, 0.6, t_s=later), CAMERA, later)
    assert rates(out) == (0.0, 0.0)
    assert out.reason is CommandReason.HOLD_NO_TARGET
    assert (out.pitch_rad, out.yaw_rad) == pytest.approx((-0.2, 0.6))
    # and a camera that is pushed a little is held where it was
    drifted = gimbal(-0.2, 0.7, t_s=later + 0.05)
    again = the_law.step(target(status=status, t_s=later + 0.05), drifted, CAMERA, later + 0.05)
    assert again.yaw_rad == pytest.approx(0.6)


def test_after_a_hold_the_feed_forward_starts_from_rest():
    the_law = law(feed_forward_filter_s=0.0)
    for i in range(10):  # centred on a target that moves with the camera
        now_s = NOW_S + i / 20
        moving = the_law.step(target(t_s=now_s), gimbal(0.0, 0.01 * i, t_s=now_s), CAMERA, now_s)
    assert moving.yaw_rate_rad_s == pytest.approx(0.2, rel=1e-3)
    for i, status in ((10, TargetStatus.SEARCHING), (11, TargetStatus.LOCKED)):
        now_s = NOW_S + i / 20
        out = the_law.step(target(t_s=now_s, status=status), gimbal(0.0, 0.01 * i, t_s=now_s), CAMERA, now_s)
    assert rates(out) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_a_stale_target_stops():
    out = law().step(target(640, t_s=NOW_S - 0.31), gimbal(), CAMERA, NOW_S)
    assert (rates(out), out.reason) == ((0.0, 0.0), CommandReason.HOLD_STALE_TARGET)


BAD = [math.nan, math.inf, -math.inf, 1e300]


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize(
    "entry",
    ["t_s", "vx", "vy", "growth", "confidence", "cov", "cx", "cy", "w", "h", "pitch", "yaw", "gimbal_t", "now",
     "camera_pitch", "camera_yaw"],
)  # fmt: skip
def test_not_finite_at_any_entry_is_zero(entry, bad):
    box = {f"{k}_px": v for k, v in {"cx": 500.0, "cy": 100.0, "w": 40.0, "h": 40.0}.items()}
    if f"{entry}_px" in box:
        box[f"{entry}_px"] = bad
    cov = np.diag([1.0, 1.0, bad if entry == "cov" else 0.01, 0.01])
    velocity = (bad if entry == "vx" else 0.0, bad if entry == "vy" else 0.0)
    scalars = {"t_s": NOW_S, "growth_per_s": 0.0, "confidence": 0.9}
    scalars |= {k: bad for k in scalars if k.removesuffix("_per_s") == entry}
    seen = target(box=Box(**box), cov=cov, vel_px_s=velocity, **scalars)
    state = gimbal(
        bad if entry == "pitch" else 0.0,
        bad if entry == "yaw" else 0.0,
        t_s=bad if entry == "gimbal_t" else NOW_S,
    )
    camera = (bad if entry == "camera_pitch" else 0.0, bad if entry == "camera_yaw" else 0.0)
    the_law = law()
    hold_still(the_law, 640, CENTRE[1], gimbal(), seconds=0.5, start_s=NOW_S - 0.5)
    out = the_law.step(seen, state, CAMERA, bad if entry == "now" else NOW_S, camera)
    assert rates(out) == (0.0, 0.0)
    assert out.reason is CommandReason.HOLD_NOT_FINITE
    assert all(v is None or math.isfinite(v) for v in (out.pitch_rad, out.yaw_rad))
    good = the_law.step(target(640, t_s=NOW_S + 0.05), gimbal(t_s=NOW_S + 0.05), CAMERA, NOW_S + 0.05)
    assert good.yaw_rate_rad_s > 0  # nothing of it stays behind


@pytest.mark.parametrize("step_s", [0.0, -0.05])
def test_time_that_does_not_go_on_changes_no_rate(step_s):
    the_law = law(feed_forward=0.0)
    first = the_law.step(target(640), gimbal(), CAMERA, NOW_S)
    again = the_law.step(target(0, t_s=NOW_S + step_s), gimbal(t_s=NOW_S + step_s), CAMERA, NOW_S + step_s)
    assert rates(again) == rates(first)
    assert again.yaw_rad == pytest.approx(first.yaw_rad)


def test_a_pause_is_not_one_large_step():
    the_law = law(max_accel_rad_s2=1.0)
    the_law.step(target(), gimbal(), CAMERA, NOW_S)
    later = NOW_S + 60.0
    out = the_law.step(target(640, t_s=later), gimbal(t_s=later), CAMERA, later)
    assert out.yaw_rate_rad_s == pytest.approx(0.25)
    assert out.yaw_rad == pytest.approx(0.25 * 0.25)


def test_a_new_yaw_frame_starts_from_the_new_report():
    the_law = law()
    hold_still(the_law, 640, CENTRE[1], gimbal(0.0, 0.0), seconds=1.0)
    later = NOW_S + 1.0
    state = gimbal(0.0, 2.0, frame=GimbalFrame.EARTH, t_s=later)
    out = the_law.step(target(640, t_s=later), state, CAMERA, later)
    assert out.frame is GimbalFrame.EARTH
    assert out.yaw_rad == pytest.approx(2.0 + out.yaw_rate_rad_s * 0.05)


@pytest.mark.parametrize("between", ["frame", "no report"])
def test_the_jump_of_angles_between_two_yaw_frames_is_no_motion(between):
    the_law = law()
    hold_still(the_law, *CENTRE, gimbal(0.0, 0.0), seconds=0.5)
    frame = GimbalFrame.EARTH if between == "frame" else GimbalFrame.VEHICLE
    if between == "no report":
        the_law.step(target(t_s=NOW_S + 0.5), gimbal(valid=False), CAMERA, NOW_S + 0.5)
    out = hold_still(the_law, *CENTRE, gimbal(0.0, 1.0, frame=frame), seconds=0.2, start_s=NOW_S + 0.55)
    assert rates(out) == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("loop_delay_s", -0.1),
        ("loop_delay_s", math.nan),
        ("feed_forward", 1.1),
        ("feed_forward_filter_s", -1.0),
        ("max_rate_rad_s", 0.0),
        ("max_accel_rad_s2", math.inf),
        ("pitch_min_rad", -2.0),
        ("pitch_max_rad", -1.6),
        ("pitch_max_rad", 1.6),
        ("dead_zone_rad", -0.1),
        ("yaw_limits_rad", (0.1, 1.0)),
        ("yaw_limits_rad", (-1.0, math.nan)),
    ],
)
def test_bad_configuration_names_the_field(name, bad):
    with pytest.raises(ValueError, match=rf"GimbalLawConfig\.{name} = "):
        GimbalLawConfig(**{name: bad})


def test_builders_are_good_inputs():
    assert vehicle().attitude_valid
    assert law().step(target(), gimbal(), CAMERA, NOW_S).reason is CommandReason.TRACKING
