from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.telemetry import euler, quaternion
from tests.sitl.autopilot.rig import ACCEPTED, FAILED, NAN, Rig

PITCHYAW, CONFIGURE = 1000, 1001
FOLLOW, LOCK = 44, 92  # what a careful sender sends
NOTHING = (NAN, NAN, NAN)


@pytest.fixture
def rig() -> Rig:
    return ready()


def ready(yaw_rad: float = 0.0, **parameters: float) -> Rig:
    rig = Rig(yaw_rad=yaw_rad, **parameters)
    rig.command(511, 285, 20_000)
    return rig


def attitude(rig: Rig, q=(NAN,) * 4, rates=NOTHING, flags=FOLLOW, device=0, settle_s=0.1) -> None:
    rig.companion.mav.gimbal_manager_set_attitude_send(1, 1, flags, device, list(q), *rates)
    rig.run(settle_s)


def pitch_yaw(rig: Rig, pitch=NAN, yaw=NAN, pitch_rate=NAN, yaw_rate=NAN, flags=0, device=0) -> None:
    rig.companion.mav.gimbal_manager_set_pitchyaw_send(1, 1, flags, device, pitch, yaw, pitch_rate, yaw_rate)
    rig.run(0.1)


def reported(rig: Rig) -> tuple[float, float]:
    """Pitch and yaw as GIMBAL_DEVICE_ATTITUDE_STATUS says."""
    return euler(rig.companion.last("GIMBAL_DEVICE_ATTITUDE_STATUS").q)[1:]


def flags_of(rig: Rig) -> int:
    return rig.companion.last("GIMBAL_DEVICE_ATTITUDE_STATUS").flags


def test_message_282_points(rig):
    attitude(rig, quaternion(0.0, -0.6, 0.4))
    assert reported(rig) == pytest.approx((-0.6, 0.4), abs=1e-3)
    assert flags_of(rig) == 0x2C
    status = rig.companion.last("GIMBAL_DEVICE_ATTITUDE_STATUS")
    assert status.gimbal_device_id == 1
    assert (status.get_srcSystem(), status.get_srcComponent()) == (1, 1)
    assert math.isnan(status.angular_velocity_z)
    assert math.isnan(status.delta_yaw)
    rig.run(2.0)
    assert (rig.gimbal.pitch_rad, rig.gimbal.yaw_rad) == pytest.approx((-0.6, 0.4), abs=0.02)


def test_a_servo_reports_at_once_and_a_device_what_it_measures():
    servo, device = ready(), ready(MNT1_TYPE=6)
    for rig in (servo, device):
        attitude(rig, quaternion(0.0, -0.8, 0.0), settle_s=0.08)
    assert reported(servo)[0] == pytest.approx(-0.8, abs=1e-3)
    assert reported(device)[0] > -0.4  # it still moves
    device.run(3.0)
    assert reported(device)[0] == pytest.approx(-0.8, abs=0.02)


def test_message_287_points(rig):
    pitch_yaw(rig, -0.3, 0.2)
    assert reported(rig) == pytest.approx((-0.3, 0.2), abs=1e-3)
    pitch_yaw(rig, -0.1, -0.2, device=1)
    assert reported(rig) == pytest.approx((-0.1, -0.2), abs=1e-3)


def test_the_command_is_in_degrees(rig):
    assert rig.command(PITCHYAW, -30, 10, NAN, NAN, 12) == ACCEPTED
    rig.run(0.1)
    assert reported(rig) == pytest.approx((math.radians(-30), math.radians(10)), abs=1e-3)
    assert rig.command(PITCHYAW, NAN, NAN, 0, 10, 12) == ACCEPTED
    rig.run(1.0)
    assert reported(rig)[1] == pytest.approx(math.radians(20), abs=0.02)
    assert rig.command(PITCHYAW, -5, 5, 10, 10, 0) == ACCEPTED  # the angle wins
    rig.run(1.0)
    assert reported(rig) == pytest.approx((math.radians(-5), math.radians(5)), abs=1e-3)


def test_command_int_points_too(rig):
    rig.companion.mav.command_int_send(1, 1, 0, PITCHYAW, 0, 0, -20, 15, NAN, NAN, 12, 0, 0)
    rig.run(0.1)
    assert rig.companion.last("COMMAND_ACK").result == ACCEPTED
    assert reported(rig) == pytest.approx((math.radians(-20), math.radians(15)), abs=1e-3)


@pytest.mark.parametrize(
    "values",
    [(-20, NAN, NAN, NAN), (NAN, 10, NAN, NAN), (NAN, NAN, 5, NAN), (NAN, NAN, NAN, 5), (float("inf"), 1, NAN, NAN)],
)
def test_half_a_command_fails(rig, values):
    assert rig.command(PITCHYAW, *values) == FAILED
    rig.run(0.5)
    assert reported(rig) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_an_absent_device(rig):
    assert rig.command(PITCHYAW, -20, 10, NAN, NAN, 0, 0, 2) == FAILED
    assert rig.command(CONFIGURE, 1, 191, -1, -1, 0, 0, 2) == FAILED
    attitude(rig, quaternion(0.0, -0.6, 0.4), device=2)
    pitch_yaw(rig, -0.3, 0.2, device=2)
    assert reported(rig) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_messages_with_everything_or_half_are_ignored(rig):
    attitude(rig, quaternion(0.0, -0.6, 0.4), (0.0, 0.1, 0.1))
    pitch_yaw(rig, -0.3, 0.2, 0.1, 0.1)
    pitch_yaw(rig, pitch=-0.3)
    pitch_yaw(rig, yaw_rate=0.3)
    attitude(rig, (1.0, 0.0, NAN, 0.0), (0.0, NAN, 0.3))
    attitude(rig, (0.0,) * 4, NOTHING)
    rig.run(0.5)
    assert reported(rig) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_a_rate_has_no_time_out_and_stops_at_zero(rig):
    attitude(rig, rates=(0.0, -0.05, 0.1))
    rig.run(9.9)
    assert reported(rig) == pytest.approx((-0.5, 1.0), abs=0.02)
    attitude(rig, rates=(0.0, 0.0, 0.0))
    here = reported(rig)
    rig.run(1.0)
    assert reported(rig) == pytest.approx(here, abs=1e-6)


def test_a_roll_rate_that_is_nan_does_no_harm(rig):
    attitude(rig, rates=(NAN, 0.1, 0.1))
    rig.run(0.9)
    assert reported(rig) == pytest.approx((0.1, 0.1), abs=0.01)


def test_limits_clamp(rig):
    pitch_yaw(rig, math.radians(-120), 0.0)
    assert reported(rig)[0] == pytest.approx(-math.pi / 2, abs=1e-3)
    pitch_yaw(rig, math.radians(60), 0.0)
    assert reported(rig)[0] == pytest.approx(math.radians(30), abs=1e-3)
    pitch_yaw(rig, pitch_rate=1.0, yaw_rate=0.0)
    rig.run(3.0)
    assert reported(rig)[0] == pytest.approx(math.radians(30), abs=1e-3)


def test_lock_is_an_azimuth_and_holds_while_the_vehicle_turns():
    rig = ready(yaw_rad=0.5)
    rig.take_off()
    pitch_yaw(rig, -0.3, 1.2, flags=16)
    assert flags_of(rig) == 0x3C
    rig.fly(3.0, yaw_rate=0.5)
    rig.fly(3.0)
    assert rig.vehicle.yaw_rad == pytest.approx(2.0, abs=0.1)
    assert reported(rig)[1] + rig.vehicle.yaw_rad == pytest.approx(1.2, abs=0.01)
    assert rig.gimbal.yaw_rad + rig.vehicle.yaw_rad == pytest.approx(1.2, abs=0.03)
    # From lock to follow with a rate: it goes on from where it points.
    before = reported(rig)[1]
    attitude(rig, rates=(0.0, 0.0, 0.0), flags=FOLLOW)
    assert flags_of(rig) == 0x2C
    assert reported(rig)[1] == pytest.approx(before, abs=0.01)


@pytest.mark.parametrize(
    ("flags", "locked"), [(0, False), (32, False), (64, False), (12, False), (16, True), (92, True)]
)
def test_only_the_lock_bit_counts(flags, locked):
    rig = ready(yaw_rad=1.0)
    pitch_yaw(rig, 0.0, 0.3, flags=flags)
    assert reported(rig)[1] == pytest.approx(0.3 - 1.0 if locked else 0.3, abs=1e-3)


def test_lock_with_rates_turns_from_north():
    rig = ready(yaw_rad=1.0)
    attitude(rig, rates=(0.0, 0.0, 0.2), flags=LOCK)
    rig.run(0.9)
    assert flags_of(rig) == 0x3C
    assert reported(rig)[1] == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("flag", [1, 2])
def test_retract_and_neutral(rig, flag):
    pitch_yaw(rig, -0.5, 0.5)
    pitch_yaw(rig, flags=flag)
    assert reported(rig) == pytest.approx((0.0, 0.0), abs=1e-3)
    pitch_yaw(rig, -0.2, 0.1)
    assert reported(rig) == pytest.approx((-0.2, 0.1), abs=1e-3)
    assert rig.command(PITCHYAW, NAN, NAN, NAN, NAN, flag) == ACCEPTED
    rig.run(0.1)
    assert reported(rig) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_all_nan_only_sets_the_lock_that_the_manager_reports(rig):
    pitch_yaw(rig, -0.5, 0.5)
    assert rig.command(PITCHYAW, NAN, NAN, NAN, NAN, 16) == ACCEPTED
    rig.run(0.1)
    assert reported(rig) == pytest.approx((-0.5, 0.5), abs=1e-3)
    rig.command(512, 281)
    assert rig.companion.last("GIMBAL_MANAGER_STATUS").flags == 28


def test_control_is_reported_and_never_enforced(rig):
    assert rig.command(CONFIGURE, 255, 190, -1, -1) == ACCEPTED
    for station in rig.stations:  # everybody is told at once
        status = station.last("GIMBAL_MANAGER_STATUS")
        assert (status.primary_control_sysid, status.primary_control_compid) == (255, 190)
        assert (status.flags, status.secondary_control_sysid) == (12, 0)
    pitch_yaw(rig, -0.3, 0.2)
    assert reported(rig) == pytest.approx((-0.3, 0.2), abs=1e-3)
    assert rig.command(CONFIGURE, -3, -3) == ACCEPTED  # not mine: nothing happens
    assert rig.autopilot.state.gimbal_primary == (255, 190)
    assert rig.command(CONFIGURE, -2, -2) == ACCEPTED
    assert rig.autopilot.state.gimbal_primary == (1, 191)
    assert rig.command(CONFIGURE, -1, -1) == ACCEPTED
    assert rig.autopilot.state.gimbal_primary == (1, 191)
    assert rig.command(CONFIGURE, -3, -3) == ACCEPTED
    assert rig.autopilot.state.gimbal_primary == (0, 0)
    assert rig.command(CONFIGURE, NAN, 191) == FAILED
    assert rig.command(CONFIGURE, 300, 191) == FAILED


def test_region_of_interest():
    rig = ready(yaw_rad=0.5)
    rig.take_off(10.0)
    lat_e7, lon_e7 = -353632610 + round(20.0 / 0.0111318845), 1491652300
    roi = mavlink.MAV_CMD_DO_SET_ROI_LOCATION
    rig.companion.mav.command_int_send(1, 1, 3, roi, 0, 0, 0, 0, 0, 0, lat_e7, lon_e7, 0.0)
    rig.run(0.1)
    assert rig.companion.last("COMMAND_ACK").result == ACCEPTED
    assert flags_of(rig) == 0x3C
    assert reported(rig)[0] == pytest.approx(-math.atan2(10.0, 20.0), abs=0.02)
    assert reported(rig)[1] + rig.vehicle.yaw_rad == pytest.approx(0.0, abs=0.02)
    rig.fly(4.0, (0.0, 3.0, 0.0))
    north, east, _ = rig.vehicle.pos_ned_m
    assert reported(rig)[1] + rig.vehicle.yaw_rad == pytest.approx(math.atan2(-east, 20.0 - north), abs=0.03)
    assert rig.command(mavlink.MAV_CMD_DO_SET_ROI_NONE) == ACCEPTED
    azimuth = reported(rig)[1] + rig.vehicle.yaw_rad
    rig.fly(2.0, (0.0, 3.0, 0.0))
    assert reported(rig)[1] + rig.vehicle.yaw_rad == pytest.approx(azimuth, abs=0.03)
    assert flags_of(rig) == 0x3C
    assert rig.command(roi, 0, 0, 0, 0, NAN, 0, 0) == FAILED
    rig.fly(4.0)  # upright again: servos report the lean too
    # The frame of the altitude counts: from sea level here, and home is at 584 m.
    rig.companion.mav.command_int_send(1, 1, 5, roi, 0, 0, 0, 0, 0, 0, lat_e7, lon_e7, 584.08)
    rig.run(0.1)
    assert reported(rig)[0] == pytest.approx(-math.atan2(10.0, math.hypot(20.0, rig.vehicle.pos_ned_m[1])), abs=0.02)


def test_the_old_mount_command(rig):
    assert rig.command(205, -25, 0, 15, 0, 0, 0, 2) == ACCEPTED
    rig.run(0.1)
    assert reported(rig) == pytest.approx((math.radians(-25), math.radians(15)), abs=1e-3)
    assert rig.command(205, -95, 0, 0, 0, 0, 0, 2) == FAILED
    assert rig.command(205, 0, 0, 0, 0, 0, 0, 1) == ACCEPTED
    rig.run(0.1)
    assert reported(rig) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_no_gimbal():
    rig = ready(MNT1_TYPE=0)
    assert rig.command(PITCHYAW, -20, 10, NAN, NAN) == FAILED
    assert rig.command(512, 280) == FAILED
    attitude(rig, quaternion(0.0, -0.6, 0.4))
    rig.run(0.5)
    assert rig.companion.of("GIMBAL_DEVICE_ATTITUDE_STATUS") == []


def test_servos_lean_against_the_vehicle():
    """At roll 27.5 and pitch -7.1 degrees with a target of -20 a real one reported roll -27.4 and pitch -12.9."""
    rig = ready()
    rig.take_off()
    pitch_yaw(rig, math.radians(-20), 0.0)
    rig.fly(0.8, (5.0, 0.0, 0.0))
    lean = rig.vehicle.pitch_rad
    assert lean < math.radians(-8)
    assert reported(rig)[0] == pytest.approx(math.radians(-20) - lean, abs=0.02)
    attitude(rig, quaternion(0.0, 0.0, math.pi / 2))
    rig.fly(0.5, (5.0, 0.0, 0.0))
    roll, _, _ = euler(rig.companion.last("GIMBAL_DEVICE_ATTITUDE_STATUS").q)
    assert roll == pytest.approx(-rig.vehicle.pitch_rad, abs=0.03)  # looking right, the pitch is its roll
