from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.config import ArduCopterConfig
from tests.sitl.autopilot.rig import (
    ACCEPTED,
    AUTO,
    BRAKE,
    DENIED,
    FAILED,
    GUIDED,
    LAND,
    LOITER,
    NAN,
    RTL,
    STABILIZE,
    UNSUPPORTED,
    Rig,
)  # fmt: skip

ARM, TAKEOFF, INTERVAL, GET_INTERVAL, REQUEST = 400, 22, 511, 510, 512
FORCE = 21196.0


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_the_acknowledgement_goes_to_the_sender_on_its_link_only(rig):
    assert rig.mode(GUIDED) == ACCEPTED
    ack = rig.companion.last("COMMAND_ACK")
    assert (ack.target_system, ack.target_component, ack.progress, ack.result_param2) == (1, 191, 0, 0)
    assert (ack.get_srcSystem(), ack.get_srcComponent()) == (1, 1)
    assert rig.station.of("COMMAND_ACK") == []


@pytest.mark.parametrize("mode", [GUIDED, LOITER, RTL, LAND, BRAKE, STABILIZE])
def test_a_new_mode_is_in_a_heartbeat_at_once_on_every_link(rig, mode):
    rig.run(0.1)
    rig.mode(LAND if mode == STABILIZE else STABILIZE)
    before_s = rig.t_s
    assert rig.mode(mode) == ACCEPTED
    for station in rig.stations:
        beat = station.of("HEARTBEAT", before_s)[-1]
        assert beat.custom_mode == mode
        assert beat.base_mode == (0x51 if mode == STABILIZE else 0x59)


def test_heartbeats_are_one_a_second(rig):
    rig.run(10.1)
    assert len(rig.companion.of("HEARTBEAT", 0.1)) == 10
    beat = rig.companion.last("HEARTBEAT")
    assert (beat.type, beat.autopilot, beat.system_status, beat.mavlink_version) == (2, 3, 3, 3)


def test_without_a_request_only_heartbeats_come(rig):
    rig.run(9.0)
    kinds = {m.get_type() for t, m in rig.companion.heard if t > 0.1}
    assert kinds == {"HEARTBEAT"}
    rig.run(2.0)
    assert {m.get_type() for t, m in rig.companion.heard if t > 0.1} == {"HEARTBEAT", "TIMESYNC"}


def test_modes_that_do_not_start(rig):
    assert rig.mode(99) == FAILED
    assert "No such mode 99" in rig.texts()
    assert rig.mode(AUTO) == FAILED
    assert any(t.startswith("Mode change to AUTO failed") for t in rig.texts())
    assert rig.command(176, 0, GUIDED) == DENIED
    assert rig.command(176, NAN, GUIDED) == DENIED
    assert rig.command(176, 1, NAN) == FAILED
    assert rig.autopilot.state.mode == STABILIZE


def test_without_a_position():
    rig = Rig(ArduCopterConfig(ready_after_s=5.0))
    rig.command(INTERVAL, 32, 100_000)
    rig.command(INTERVAL, 193, 100_000)
    assert rig.mode(GUIDED) == FAILED
    assert "Mode change to GUIDED failed: requires position" in rig.texts()
    assert rig.arm() == ACCEPTED  # STABILIZE arms without GPS
    rig.run(4.0)
    assert rig.companion.of("LOCAL_POSITION_NED") == []
    assert rig.companion.last("EKF_STATUS_REPORT").flags != 831
    rig.run(1.0)
    assert rig.companion.of("LOCAL_POSITION_NED") != []
    assert rig.companion.last("EKF_STATUS_REPORT").flags == 831
    assert rig.mode(GUIDED) == ACCEPTED


def test_boot_says_so_and_streams_nothing_yet():
    rig = Rig(ArduCopterConfig(ready_after_s=40.0))
    rig.command(INTERVAL, 30, 100_000)
    rig.run(2.3)
    assert {m.system_status for m in rig.companion.of("HEARTBEAT")} == {1}
    assert rig.companion.of("ATTITUDE") == []
    rig.run(1.0)
    assert rig.companion.last("HEARTBEAT").system_status == 3
    assert rig.companion.of("ATTITUDE") != []


def test_set_mode_message_has_no_acknowledgement(rig):
    rig.companion.mav.set_mode_send(1, 1, GUIDED)
    rig.run(0.1)
    assert rig.autopilot.state.mode == GUIDED
    assert rig.companion.of("COMMAND_ACK") == []


@pytest.mark.parametrize("mode", [LAND, RTL, BRAKE])
def test_modes_that_do_not_arm(rig, mode):
    rig.mode(mode)
    assert rig.arm() == FAILED
    assert any(t.startswith("Arm: ") and "not armable" in t for t in rig.texts())


def test_arming(rig):
    rig.mode(GUIDED)
    rig.autopilot.set_rc((1500, 1500, 1500))
    assert rig.arm() == FAILED
    assert "Arm: Throttle (RC3) is not neutral" in rig.texts()
    rig.autopilot.set_rc((1500, 1500, 1000))
    assert rig.arm() == ACCEPTED
    assert "Arming motors" in rig.texts()
    assert rig.arm() == ACCEPTED
    rig.run(1.0)
    assert rig.companion.last("HEARTBEAT").base_mode == 0xD9
    assert rig.command(ARM, 0) == ACCEPTED
    assert not rig.autopilot.state.armed
    assert rig.command(ARM, 7) == UNSUPPORTED


def test_forced_arming_skips_the_checks(rig):
    rig.mode(LAND)
    assert rig.command(ARM, 1, FORCE) == ACCEPTED
    assert rig.autopilot.state.armed


def test_nobody_takes_off_disarms_after_ten_seconds(rig):
    rig.mode(GUIDED)
    rig.arm()
    rig.run(9.8)
    assert rig.autopilot.state.armed
    rig.run(0.4)
    assert not rig.autopilot.state.armed
    assert "Disarming motors" in rig.texts()


def test_take_off_is_refused_disarmed_and_in_the_air(rig):
    rig.mode(GUIDED)
    assert rig.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 5) == FAILED
    rig.take_off()
    assert rig.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 20) == FAILED


def test_take_off_is_refused_outside_guided_and_without_a_height(rig):
    rig.arm()
    assert rig.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 5) == FAILED
    rig.mode(GUIDED)
    assert rig.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 0) == FAILED
    assert rig.command(TAKEOFF, 0, 0, 0, 0, 0, 0, NAN) == FAILED


def test_take_off_reaches_ten_metres_in_about_nine_seconds(rig):
    rig.command(INTERVAL, 245, 100_000)
    rig.mode(GUIDED)
    rig.arm()
    rig.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 10)
    start_s = rig.t_s
    while rig.vehicle.pos_ned_m[2] > -9.5:
        rig.run(0.1)
        assert rig.t_s < 30.0
    assert 8.0 < rig.t_s - start_s < 11.5
    rig.run(4.0)
    assert rig.vehicle.pos_ned_m[2] == pytest.approx(-10.0, abs=0.05)
    states = [m.landed_state for m in rig.companion.of("EXTENDED_SYS_STATE")]
    assert [s for i, s in enumerate(states) if i == 0 or states[i - 1] != s] == [1, 3, 2]
    assert rig.companion.last("HEARTBEAT").system_status == 4


def test_disarming_in_flight(rig):
    rig.take_off()
    assert rig.command(ARM, 0) == FAILED
    assert rig.autopilot.state.armed
    assert rig.command(ARM, 0, FORCE) == ACCEPTED
    rig.run(1.5)
    assert rig.vehicle.on_ground  # it fell


def test_landing_disarms(rig):
    rig.take_off(3.0)
    assert rig.command(mavlink.MAV_CMD_NAV_LAND) == ACCEPTED
    rig.command(INTERVAL, 245, 100_000)
    assert rig.autopilot.state.mode == LAND
    rig.run(0.2)
    assert rig.companion.last("EXTENDED_SYS_STATE").landed_state == 4
    while not rig.vehicle.on_ground:
        rig.run(0.1)
        assert rig.t_s < 60.0
    touched_s = rig.t_s
    while rig.autopilot.state.armed:
        rig.run(0.1)
        assert rig.t_s < 60.0
    assert rig.t_s - touched_s == pytest.approx(2.1, abs=0.3)


def test_change_speed_is_accepted_and_does_nothing(rig):
    rig.take_off()
    assert rig.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 4, -1) == ACCEPTED
    rig.fly(5.0, (8.0, 0.0, 0.0))
    assert rig.speed > 7.0


@pytest.mark.parametrize("number", [2004, 2005, 2010, 2000, 42000])
def test_unsupported_commands(rig, number):
    assert rig.command(number, 0.5, 0.5) == UNSUPPORTED


def test_command_int_is_the_same(rig):
    rig.companion.mav.command_int_send(1, 1, 6, 176, 0, 0, 1, GUIDED, NAN, NAN, 0, 0, NAN)
    rig.run(0.1)
    assert rig.companion.last("COMMAND_ACK").result == ACCEPTED
    rig.arm()
    rig.companion.mav.command_int_send(1, 1, mavlink.MAV_FRAME_GLOBAL_INT, TAKEOFF, 0, 0, 0, 0, 0, 0, 0, 0, 590.0)
    rig.run(0.1)
    assert rig.companion.last("COMMAND_ACK").result == DENIED
    rig.companion.mav.command_int_send(1, 1, 3, TAKEOFF, 0, 0, 0, 0, 0, 0, 0, 0, 4.0)
    rig.run(0.1)
    assert rig.companion.last("COMMAND_ACK").result == ACCEPTED


# --- messages ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("message_id", "kind", "hz"),
    [
        (30, "ATTITUDE", 50), (31, "ATTITUDE_QUATERNION", 20), (32, "LOCAL_POSITION_NED", 20),
        (33, "GLOBAL_POSITION_INT", 10), (245, "EXTENDED_SYS_STATE", 2), (65, "RC_CHANNELS", 5),
        (285, "GIMBAL_DEVICE_ATTITUDE_STATUS", 20), (281, "GIMBAL_MANAGER_STATUS", 5), (1, "SYS_STATUS", 2),
        (193, "EKF_STATUS_REPORT", 2), (74, "VFR_HUD", 4), (2, "SYSTEM_TIME", 1), (0, "HEARTBEAT", 5),
        (85, "POSITION_TARGET_LOCAL_NED", 10), (242, "HOME_POSITION", 1),
    ],
)  # fmt: skip
def test_intervals_are_kept(rig, message_id, kind, hz):
    rig.mode(GUIDED)
    assert rig.command(INTERVAL, message_id, 1e6 / hz, NAN, NAN, NAN, NAN, NAN) == ACCEPTED
    start_s = rig.t_s
    rig.run(4.0)
    assert abs(len(rig.companion.of(kind, start_s)) - 4 * hz) <= 1
    others = 4 if kind == "HEARTBEAT" else 0
    assert abs(len(rig.station.of(kind, start_s)) - others) <= others // 4  # intervals belong to a link
    assert rig.command(INTERVAL, message_id, -1) == ACCEPTED
    stop_s = rig.t_s
    rig.run(2.0)
    assert rig.companion.of(kind, stop_s) == []


def test_intervals_that_are_refused(rig):
    for message_id in (9999, 265, 230, -5):
        assert rig.command(INTERVAL, message_id, 100_000) == DENIED
        assert f"No ap_message for mavlink id ({message_id})" in rig.texts()
    assert rig.command(INTERVAL, NAN, 100_000) == DENIED
    assert rig.command(INTERVAL, 30, 1000) == DENIED  # faster than the main loop can


def test_the_interval_can_be_asked_for(rig):
    rig.command(INTERVAL, 30, 40_000)
    assert rig.command(GET_INTERVAL, 30) == ACCEPTED
    answer = rig.companion.last("MESSAGE_INTERVAL")
    assert (answer.message_id, answer.interval_us) == (30, 40_000)
    assert rig.command(GET_INTERVAL, 32) == ACCEPTED
    assert rig.companion.last("MESSAGE_INTERVAL").interval_us == -1
    assert rig.command(GET_INTERVAL, 9999) == FAILED


def test_messages_on_request(rig):
    assert rig.command(REQUEST, 280, NAN, NAN, NAN, NAN, NAN, NAN) == ACCEPTED
    info = rig.companion.last("GIMBAL_MANAGER_INFORMATION")
    assert (info.cap_flags, info.gimbal_device_id) == (206847, 1)
    assert (info.pitch_min, info.pitch_max) == pytest.approx((-math.pi / 2, math.pi / 6))
    kinds = [m.get_type() for _, m in rig.companion.heard]
    assert kinds.index("COMMAND_ACK") < kinds.index("GIMBAL_MANAGER_INFORMATION")
    assert rig.command(REQUEST, 148) == ACCEPTED
    assert rig.companion.last("AUTOPILOT_VERSION").flight_sw_version >> 16 == 0x0407
    assert rig.command(REQUEST, 283) == FAILED
    assert rig.command(REQUEST, 9999) == FAILED
    assert rig.command(REQUEST, NAN) == FAILED


def test_telemetry_is_the_truth():
    rig = Rig(yaw_rad=0.5)
    for message_id in (30, 31, 32, 33, 74):
        rig.command(INTERVAL, message_id, 20_000)
    rig.take_off(4.0)
    rig.fly(2.0, (2.0, -1.0, 0.0), 0.2)
    vehicle = rig.vehicle
    here = rig.companion.last("LOCAL_POSITION_NED")
    assert (here.x, here.y, here.z) == pytest.approx(vehicle.pos_ned_m, abs=0.05)
    assert (here.vx, here.vy, here.vz) == pytest.approx(vehicle.vel_ned_m_s, abs=0.05)
    attitude = rig.companion.last("ATTITUDE")
    assert (attitude.roll, attitude.pitch) == pytest.approx((vehicle.roll_rad, vehicle.pitch_rad), abs=0.01)
    assert attitude.yaw == pytest.approx(vehicle.yaw_rad, abs=0.01)
    q = rig.companion.last("ATTITUDE_QUATERNION")
    yaw = math.atan2(2 * (q.q1 * q.q4 + q.q2 * q.q3), 1 - 2 * (q.q3**2 + q.q4**2))
    assert yaw == pytest.approx(attitude.yaw, abs=0.01)
    assert math.asin(2 * (q.q1 * q.q3 - q.q4 * q.q2)) == pytest.approx(attitude.pitch, abs=0.01)
    place = rig.companion.last("GLOBAL_POSITION_INT")
    assert place.relative_alt == pytest.approx(-here.z * 1000, abs=50)
    assert place.alt - place.relative_alt == 584_080
    assert (place.lat + 353632610) * 0.0111318845 == pytest.approx(here.x, abs=0.06)
    east_m = (place.lon - 1491652300) * 0.0111318845 * math.cos(math.radians(35.363261))
    assert east_m == pytest.approx(here.y, abs=0.06)
    assert place.vx == pytest.approx(here.vx * 100, abs=5)
    assert place.hdg == pytest.approx(math.degrees(vehicle.yaw_rad) * 100 % 36000, abs=100)
    assert rig.companion.last("VFR_HUD").groundspeed == pytest.approx(rig.speed, abs=0.05)


def test_time_sync(rig):
    rig.run(3.0)
    rig.companion.mav.send(mavlink.MAVLink_timesync_message(0, 123_456_789))
    rig.run(0.02)
    answer = rig.companion.last("TIMESYNC")
    assert answer.ts1 == 123_456_789
    assert answer.tc1 == pytest.approx(3.0e9, abs=1e7)
    rig.run(8.0)
    request = rig.companion.last("TIMESYNC")
    assert request.tc1 == 0
    assert request.ts1 == pytest.approx(10.0e9, abs=1e7)
    rig.companion.mav.send(mavlink.MAVLink_timesync_message(5, request.ts1))
    before_s = rig.t_s
    rig.run(0.1)
    assert rig.companion.of("TIMESYNC", before_s) == []


# --- reboot ------------------------------------------------------------------------------------------------------


def test_reboot_forgets_intervals_and_starts_time_again(rig):
    rig.command(INTERVAL, 30, 20_000)
    rig.mode(GUIDED)
    rig.run(2.0)
    rig.companion.mav.param_set_send(1, 1, b"GUID_TIMEOUT", 2.0, 9)
    assert rig.companion.last("ATTITUDE").time_boot_ms > 1900
    assert rig.command(246, 1) == ACCEPTED
    start_s = rig.t_s
    rig.run(1.1)
    assert [m for t, m in rig.companion.heard if t > start_s] == []
    rig.run(1.0)
    assert rig.companion.of("HEARTBEAT", start_s) != []
    assert rig.companion.of("ATTITUDE", start_s) == []
    assert rig.autopilot.state.mode == STABILIZE
    rig.command(INTERVAL, 30, 20_000)
    rig.run(0.5)
    assert rig.companion.last("ATTITUDE").time_boot_ms == pytest.approx((rig.t_s - start_s) * 1000, abs=50)
    rig.companion.mav.param_request_read_send(1, 1, b"GUID_TIMEOUT", -1)
    rig.run(0.1)
    assert rig.companion.last("PARAM_VALUE").param_value == 2.0


def test_reboot_is_refused_armed_and_for_other_values(rig):
    assert rig.command(246, 0) == UNSUPPORTED
    rig.arm()
    assert rig.command(246, 1) == FAILED


# --- parameters --------------------------------------------------------------------------------------------------


def test_parameters_can_be_read_listed_and_set(rig):
    rig.companion.mav.param_request_list_send(1, 1)
    rig.run(1.0)
    values = rig.companion.of("PARAM_VALUE")
    assert [v.param_index for v in values] == list(range(values[0].param_count))
    named = {v.param_id: v for v in values}
    assert named["GUID_TIMEOUT"].param_value == 3.0
    assert named["MNT1_TYPE"].param_value == 1.0
    assert rig.station.of("PARAM_VALUE") == []
    rig.companion.mav.param_set_send(1, 1, b"GUID_TIMEOUT", 60.0, 9)
    rig.run(0.1)
    for station in rig.stations:
        assert station.last("PARAM_VALUE").param_value == 5.0  # clamped, and everybody hears it


def test_unknown_parameters_get_no_answer(rig):
    rig.run(0.1)
    rig.companion.mav.param_request_read_send(1, 1, b"SYSID_THISMAV", -1)
    rig.companion.mav.param_request_read_send(1, 1, b"", 999)
    rig.companion.mav.param_set_send(1, 1, b"SR0_POSITION", 4.0, 9)
    rig.companion.mav.param_set_send(1, 1, b"RTL_ALT", NAN, 9)
    rig.run(0.2)
    assert rig.companion.of("PARAM_VALUE") == []


def test_the_system_id_is_a_parameter(rig):
    rig.companion.mav.param_set_send(1, 1, b"MAV_SYSID", 7.0, 4)
    rig.run(1.1)
    assert rig.companion.last("HEARTBEAT").get_srcSystem() == 7
    assert rig.command(176, 1, GUIDED, to=(7, 1)) == ACCEPTED
    rig.command(176, 1, STABILIZE, to=(1, 1))
    assert rig.autopilot.state.mode == GUIDED


@pytest.mark.parametrize(
    ("name", "value"), [("sysid", 0), ("physics_hz", 10), ("home_lat_deg", 90.0), ("ready_after_s", -1.0)]
)
def test_bad_settings(name, value):
    with pytest.raises(ValueError, match=name.split("_")[0]):
        ArduCopterConfig(**{name: value})


def test_an_unknown_parameter_in_the_settings():
    with pytest.raises(ValueError, match="GUID_TIMEOUTS"):
        Rig(ArduCopterConfig(parameters={"GUID_TIMEOUTS": 1.0}))
