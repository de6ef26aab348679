from __future__ import annotations

import math

import pytest

from tests.sitl.autopilot.rig import ACCEPTED, BRAKE, GUIDED, LAND, LOITER, NAN, VELOCITY_ONLY, Rig

INTERVAL = 511
YAW_RAD = 0.6


def flying(height_m: float = 4.0, yaw_rad: float = 0.0, **parameters: float) -> Rig:
    rig = Rig(yaw_rad=yaw_rad, **parameters)
    rig.take_off(height_m)
    return rig


def along(angle_rad: float, speed: float) -> tuple[float, float]:
    return speed * math.cos(angle_rad), speed * math.sin(angle_rad)


@pytest.mark.parametrize("frame", [1, 7])
def test_earth_frames(frame):
    rig = flying(yaw_rad=YAW_RAD)
    rig.fly(4.0, (2.0, -1.0, 0.5), frame=frame)
    assert rig.vehicle.vel_ned_m_s == pytest.approx((2.0, -1.0, 0.5), abs=0.12)


@pytest.mark.parametrize("frame", [8, 9])
def test_body_frames_turn_with_the_heading(frame):
    rig = flying(yaw_rad=YAW_RAD)
    rig.fly(4.0, (2.0, 0.0, 0.0), frame=frame)
    assert rig.vehicle.vel_ned_m_s[:2] == pytest.approx(along(YAW_RAD, 2.0), abs=0.12)
    assert rig.vehicle.yaw_rad == pytest.approx(YAW_RAD, abs=0.03)
    rig.fly(4.0, (0.0, 2.0, 0.0), frame=frame)
    assert rig.vehicle.vel_ned_m_s[:2] == pytest.approx(along(YAW_RAD + math.pi / 2, 2.0), abs=0.2)


@pytest.mark.parametrize(
    "wrong",
    [
        {"frame": 12}, {"frame": 20}, {"frame": 0}, {"frame": 255},
        {"velocity": (NAN, 0.0, 0.0)}, {"velocity": (3.0, float("inf"), 0.0)}, {"velocity": (5000.0, 0.0, 0.0)},
        {"mask": 0xFFF}, {"mask": 1507}, {"mask": 1479 | 8}, {"mask": 0xDFF}, {"mask": (1479 & ~0x1C0) | 0x200},
    ],
    ids=str,
)  # fmt: skip
def test_what_it_does_not_understand_makes_it_stop(wrong):
    rig = flying()
    rig.fly(3.0, (3.0, 0.0, 0.0))
    assert rig.speed > 2.5
    rig.fly(4.0, **{"velocity": (3.0, 0.0, 0.0), **wrong})
    assert rig.speed < 0.15
    assert rig.autopilot.state.mode == GUIDED
    assert rig.companion.of("COMMAND_ACK", rig.t_s - 4.0) == []
    assert rig.companion.of("STATUSTEXT", rig.t_s - 4.0) == []


def test_one_ignored_axis_drops_the_whole_velocity():
    rig = flying()
    rig.fly(2.0, (3.0, 3.0, 0.0), mask=1479 | 16)
    assert rig.speed < 0.05


@pytest.mark.parametrize(("to", "obeyed"), [((1, 1), True), ((0, 0), True), ((1, 191), True), ((2, 1), False)])
def test_whom_setpoints_are_addressed_to(to, obeyed):
    rig = flying()
    rig.fly(2.0, (2.0, 0.0, 0.0), to=to)
    assert (rig.speed > 1.0) is obeyed


@pytest.mark.parametrize("mode", [LOITER, BRAKE, LAND])
def test_setpoints_do_nothing_in_other_modes(mode):
    rig = flying()
    assert rig.mode(mode) == ACCEPTED
    rig.fly(2.0, (3.0, 0.0, 0.0))
    assert rig.speed < 0.05
    assert rig.autopilot.state.mode == mode


def test_setpoints_do_nothing_on_the_ground():
    rig = Rig()
    rig.mode(GUIDED)
    rig.arm()
    rig.fly(6.0, (2.0, 0.0, -2.0))
    assert rig.vehicle.on_ground
    assert rig.vehicle.pos_ned_m == (0.0, 0.0, 0.0)


def test_a_velocity_during_the_climb_ends_the_take_off():
    rig = Rig()
    rig.mode(GUIDED)
    rig.arm()
    rig.command(22, 0, 0, 0, 0, 0, 0, 10)
    while rig.vehicle.pos_ned_m[2] > -5.0:
        rig.run(0.1)
        assert rig.t_s < 20.0
    rig.fly(6.0)
    assert -8.5 < rig.vehicle.pos_ned_m[2] < -5.0
    assert abs(rig.vehicle.vel_ned_m_s[2]) < 0.05


@pytest.mark.parametrize("timeout_s", [3.0, 1.0])
def test_silence_brakes_after_the_time_out(timeout_s):
    rig = flying(GUID_TIMEOUT=timeout_s)
    rig.command(INTERVAL, 85, 50_000)
    rig.fly(4.0, (3.0, 0.0, 0.0), yaw_rate=0.3)
    rig.run(timeout_s - 0.1)
    assert rig.speed > 2.9
    assert rig.vehicle.rates_rad_s[2] == pytest.approx(0.3, abs=0.03)
    assert rig.companion.last("POSITION_TARGET_LOCAL_NED").vx == 3.0
    rig.run(0.3)
    assert rig.companion.last("POSITION_TARGET_LOCAL_NED").vx == 0.0
    rig.run(2.5)
    assert rig.speed < 0.15
    assert abs(rig.vehicle.rates_rad_s[2]) < 0.02
    assert rig.autopilot.state.mode == GUIDED
    assert rig.autopilot.state.setpoint_age_s == pytest.approx(timeout_s + 2.7, abs=0.1)


def test_step_response():
    """0 to 5 m/s as it was seen: 0.33 after 0.5 s, 1.65 after 1 s, 2.9, 4.1 after 2 s, 4.95 after 3.5 s."""
    rig = flying()
    speeds = []
    for _ in range(7):
        rig.fly(0.5, (0.0, 5.0, 0.0))
        speeds.append(rig.speed)
    assert speeds[:4] == pytest.approx([0.33, 1.65, 2.9, 4.1], abs=0.25)
    assert speeds[6] == pytest.approx(4.95, abs=0.1)


def test_speed_limits():
    """The cap is 7 % above WPNAV_SPEED, as seen (10.7 at 10)."""
    rig = flying(6.0, WPNAV_SPEED=500)
    rig.fly(7.0, (30.0, 0.0, 0.0))
    assert rig.speed == pytest.approx(5.35, abs=0.15)
    rig.fly(5.0, (0.0, 0.0, -9.0))
    assert rig.vehicle.vel_ned_m_s[2] == pytest.approx(-2.5, abs=0.1)
    rig.fly(5.0, (0.0, 0.0, 9.0))
    assert rig.vehicle.vel_ned_m_s[2] == pytest.approx(1.5, abs=0.1)


def test_without_a_yaw_the_nose_turns_into_the_course():
    rig = flying()
    rig.fly(1.0, (0.0, 0.8, 0.0), mask=VELOCITY_ONLY)
    assert abs(rig.vehicle.yaw_rad) < 0.02  # too slow to have a course
    rig.fly(5.0, (0.0, 4.0, 0.0), mask=VELOCITY_ONLY)
    assert rig.vehicle.yaw_rad == pytest.approx(math.pi / 2, abs=0.1)
    rig.fly(4.0, (-4.0, 0.0, 0.0))
    assert rig.vehicle.yaw_rad == pytest.approx(math.pi / 2, abs=0.1)  # yaw rate 0 keeps the nose


def test_the_yaw_behaviour_is_a_parameter():
    rig = flying(WP_YAW_BEHAVIOR=0)
    rig.fly(3.0, (0.0, 4.0, 0.0), mask=VELOCITY_ONLY)
    assert abs(rig.vehicle.yaw_rad) < 0.02


@pytest.mark.parametrize(("frame", "wanted"), [(1, 1.0), (8, YAW_RAD + 1.0)])
def test_yaw_angles_are_relative_in_body_frames(frame, wanted):
    rig = flying(yaw_rad=YAW_RAD)
    rig.setpoint(frame=frame, mask=2503, yaw=1.0)
    rig.run(2.9)
    assert rig.vehicle.yaw_rad == pytest.approx(wanted, abs=0.05)


def test_yaw_rate():
    rig = flying()
    rig.fly(4.0, yaw_rate=-0.5)
    assert rig.vehicle.rates_rad_s[2] == pytest.approx(-0.5, abs=0.02)
    rig.fly(3.0)
    assert rig.vehicle.yaw_rad == pytest.approx(-2.0, abs=0.1)


def test_position_targets():
    rig = flying()
    rig.command(INTERVAL, 85, 100_000)
    rig.setpoint(position=(6.0, -3.0, -6.0), mask=0x5F8)
    rig.run(10.0)  # no time-out for positions
    assert rig.vehicle.pos_ned_m == pytest.approx((6.0, -3.0, -6.0), abs=0.15)
    target = rig.companion.last("POSITION_TARGET_LOCAL_NED")
    assert target.type_mask == 0xDF8
    assert (target.x, target.y, target.z) == (6.0, -3.0, -6.0)
    rig.setpoint(position=(0.0, 4.0, 0.0), mask=0x5F8, frame=9)
    rig.run(8.0)
    assert rig.vehicle.pos_ned_m == pytest.approx((6.0, 1.0, -6.0), abs=0.3)


def test_the_target_is_told_only_in_guided():
    rig = flying()
    rig.command(INTERVAL, 85, 100_000)
    rig.fly(1.0, (1.0, 2.0, -0.5))
    target = rig.companion.last("POSITION_TARGET_LOCAL_NED")
    assert (target.coordinate_frame, target.type_mask) == (1, 0xC07)
    assert (target.vx, target.vy, target.vz) == (1.0, 2.0, -0.5)
    rig.mode(BRAKE)
    before_s = rig.t_s
    rig.run(1.0)
    assert rig.companion.of("POSITION_TARGET_LOCAL_NED", before_s) == []


def test_coming_back_to_guided_starts_at_rest():
    rig = flying()
    rig.fly(3.0, (3.0, 0.0, 0.0))
    rig.mode(BRAKE)
    rig.run(3.0)
    rig.mode(GUIDED)
    rig.run(1.0)
    assert rig.speed < 0.1
    rig.fly(3.0, (0.0, 2.0, 0.0))
    assert rig.vehicle.vel_ned_m_s[1] == pytest.approx(2.0, abs=0.2)
