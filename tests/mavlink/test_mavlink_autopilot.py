"""What the autopilot tells, as values at the time of an exposure; nothing that it tells can break the view."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from control.frames import quaternion_from_rpy
from control.messages import GimbalFrame
from tests.conftest import SHARED
from uavfollow.mavlink.autopilot import AutopilotView, yaw_frame
from uavfollow.mavlink.packer import Packer, Parser
from uavfollow.mavlink.tlog import TlogReader

RECORDED = Path(__file__).resolve().parents[1] / "data" / "arducopter-guided.tlog"
BOOT_S = 40.0  # our clock when theirs was zero
NAN = math.nan


def wired(message, system: int = 1, component: int = 1):
    """The message as it comes out of a link."""
    return Parser().parse(Packer(system, component).pack(message))[0]


def heartbeat(mode: int = 4, base_mode: int = 0xD9, autopilot: int = 3, kind: int = 2):
    return dialect.MAVLink_heartbeat_message(kind, autopilot, base_mode, mode, 4, 3)


def attitude(now_s: float, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0):
    return dialect.MAVLink_attitude_message(round((now_s - BOOT_S) * 1000), roll, pitch, yaw, 0, 0, 0)


def position(now_s: float, *values: float):
    return dialect.MAVLink_local_position_ned_message(round((now_s - BOOT_S) * 1000), *values)


def gimbal(now_s: float, pitch: float, yaw: float, flags: int = 0x2C, device: int = 1):
    q = [float(v) for v in quaternion_from_rpy(0.0, pitch, yaw)]
    return dialect.MAVLink_gimbal_device_attitude_status_message(
        0, 0, round((now_s - BOOT_S) * 1000), flags, q, NAN, NAN, NAN, 0, NAN, NAN, device
    )


def good_estimator():
    return dialect.MAVLink_ekf_status_report_message(831, 0.1, 0.1, 0.1, 0.1, 0.1)


def told(*messages, now_s: float = 100.0) -> AutopilotView:
    view = AutopilotView(1)
    for message in messages:
        view.take(wired(message), now_s)
    return view


@pytest.mark.parametrize(
    ("message", "mode", "accepts", "armed"),
    [
        (heartbeat(), "GUIDED", True, True),
        (heartbeat(base_mode=0x59), "GUIDED", True, False),
        (heartbeat(mode=5), "LOITER", False, True),
        (heartbeat(mode=77), "mode 77", False, True),
        (heartbeat(mode=4, autopilot=12), "autopilot 12 mode 4", False, True),
        (heartbeat(mode=4, kind=1), "autopilot 3 mode 4", False, True),  # a plane: its mode 4 is another one
    ],
)
def test_mode_and_arming(message, mode, accepts, armed):
    status = told(message).status(100.0)
    assert (status.mode, status.accepts_setpoints, status.armed, status.t_heartbeat_s) == (mode, accepts, armed, 100.0)


def test_only_the_autopilot_of_our_vehicle_counts():
    view = AutopilotView(1)
    for source in ((2, 1), (1, 100), (255, 190)):
        view.take(wired(heartbeat(), *source), 100.0)
    assert view.status(100.0).t_heartbeat_s == -math.inf


@pytest.mark.parametrize(("state", "airborne"), [(0, False), (1, False), (2, True), (3, False), (4, False)])
def test_airborne_is_neither_take_off_nor_landing(state, airborne):
    assert told(dialect.MAVLink_extended_sys_state_message(0, state)).status(100.0).airborne is airborne


def test_nothing_heard_is_not_valid():
    view = AutopilotView(1)
    vehicle, gimbal_state = view.vehicle_at(1.0, 1.0), view.gimbal_at(1.0, GimbalFrame.EARTH)
    assert [vehicle.attitude_valid, vehicle.position_valid, gimbal_state.valid] == [False] * 3


def test_vehicle_at_the_exposure_lies_between_the_reports():
    view = told(good_estimator())
    for now_s in (100.0, 100.1):
        view.take(wired(attitude(now_s, 0.1, -0.2, 3.1 + (now_s - 100.0))), now_s)
        view.take(wired(position(now_s, 10 * (now_s - 100.0), 1, -12, 2, 3, 0)), now_s)
    state = view.vehicle_at(100.05, 100.1)
    assert state.attitude_valid
    assert state.position_valid
    assert state.t_s == pytest.approx(100.05, abs=1e-3)
    assert state.yaw_rad == pytest.approx(math.remainder(3.15, math.tau), abs=1e-3)
    assert state.pos_ned_m == pytest.approx((0.5, 1, -12), abs=1e-2)
    assert state.vel_ned_m_s == pytest.approx((2, 3, 0))


@pytest.mark.parametrize(
    ("flags", "good"), [(831, True), (37, False), (2 | 8, True), (2, False), (8 | 16, False), (0, False)]
)
def test_position_is_valid_only_while_the_estimator_says_so(flags, good):
    view = told(dialect.MAVLink_ekf_status_report_message(flags, 0, 0, 0, 0, 0), position(100.0, 1, 2, -3, 0, 0, 0))
    assert view.vehicle_at(100.0, 100.0).position_valid is good
    assert not view.vehicle_at(102.5, 102.5).position_valid, "an estimator that fell silent"


@pytest.mark.parametrize(
    ("flags", "frame"),
    [
        (0, "vehicle"),
        (16, "earth"),
        (0x2C, "vehicle"),
        (0x3C, "vehicle"),
        (0x5C, "earth"),
        (0x1C, "earth"),
        (64, "earth"),
    ],
)
def test_yaw_frame_by_flags(flags, frame):
    assert yaw_frame(flags) is GimbalFrame(frame)


def test_gimbal_yaw_is_converted_by_the_heading_of_the_same_time():
    view = told()
    for now_s in (100.0, 100.1):
        view.take(wired(attitude(now_s, yaw=1.0 + 5 * (now_s - 100.0))), now_s)
        view.take(wired(gimbal(now_s, -0.5, 0.3 - 5 * (now_s - 100.0), flags=0x3C)), now_s)
    in_vehicle, in_earth = (view.gimbal_at(100.05, frame) for frame in (GimbalFrame.VEHICLE, GimbalFrame.EARTH))
    assert in_vehicle.pitch_rad == pytest.approx(-0.5, abs=1e-5)
    assert in_vehicle.yaw_rad == pytest.approx(0.05, abs=1e-3)
    assert in_earth.yaw_rad == pytest.approx(1.3, abs=1e-3), "a locked camera stands still while the vehicle turns"
    assert in_earth.frame is GimbalFrame.EARTH
    assert in_earth.valid


def test_without_a_heading_there_is_no_earth_yaw():
    assert not told(gimbal(100.0, -0.5, 0.3)).gimbal_at(100.0, GimbalFrame.EARTH).valid


def test_other_gimbals_and_broken_quaternions_are_left():
    broken = gimbal(100.0, 0.0, 0.0)
    broken.q = [0.0] * 4
    view = told(gimbal(100.0, -0.5, 0.3, device=2), broken)
    assert not view.gimbal_at(100.0, GimbalFrame.VEHICLE).valid
    assert view.unusable == 1


def test_a_restart_forgets_everything():
    view = told(heartbeat(), attitude(100.0), position(100.0, *[0.0] * 6), good_estimator())
    view.take(wired(dialect.MAVLink_attitude_message(500, 0, 0, 0, 0, 0, 0)), 101.0)
    assert view.reboots == 1
    assert view.status(100.0).t_landed_state_s == -math.inf
    assert not view.vehicle_at(101.0, 101.0).position_valid


def test_a_restart_shows_in_timesync_alone():
    view = told(attitude(100.0))
    view.timesync(int(61e9), view.clock.request(101.0), 101.01)
    assert view.reboots == 0
    view.timesync(int(2e9), view.clock.request(102.0), 102.01)
    assert view.reboots == 1
    view.timesync(int(1e9), 5, 103.0)
    assert view.reboots == 1, "an answer to somebody else"


@given(st.floats(width=32), st.floats(width=32), st.integers(0, 2**32 - 1))
def test_no_number_breaks_the_view_or_comes_out_not_finite(a, b, boot_ms):
    view = told(attitude(100.0), good_estimator())
    for message in (
        dialect.MAVLink_attitude_message(boot_ms, a, b, a, 0, 0, 0),
        dialect.MAVLink_local_position_ned_message(boot_ms, a, b, a, b, a, b),
        dialect.MAVLink_gimbal_device_attitude_status_message(0, 0, boot_ms, 0, [a, b, a, b], 0, 0, 0, 0, 0, 0, 1),
    ):
        view.take(wired(message), 100.1)
    vehicle = view.vehicle_at(100.1, 100.1)
    state = view.gimbal_at(100.1, GimbalFrame.EARTH)
    assert all(math.isfinite(v) for v in (vehicle.yaw_rad, *vehicle.pos_ned_m, state.pitch_rad, state.yaw_rad))


def test_the_recorded_flight_is_understood():
    """The real ArduCopter: GUIDED, armed and in the air in the middle of the flight, gimbal reports included."""
    path = next((p for p in (RECORDED, SHARED / "flights" / RECORDED.name) if p.is_file()), None)
    if path is None:
        pytest.skip("the recorded flight is not here")
    view, first_us, seen = AutopilotView(1), None, {}
    for t_us, message in TlogReader(path).messages():
        first_us = first_us or t_us
        now_s = (t_us - first_us) * 1e-6
        view.take(message, now_s)
        seen[round(now_s)] = (
            view.status(now_s),
            view.vehicle_at(now_s, now_s),
            view.gimbal_at(now_s, GimbalFrame.EARTH),
        )
    status, vehicle, state = seen[64]
    assert (status.mode, status.armed, status.airborne) == ("GUIDED", True, True)
    assert vehicle.position_valid
    assert -vehicle.pos_ned_m[2] == pytest.approx(12.0, abs=1.0)
    assert vehicle.vel_ned_m_s[0] == pytest.approx(3.0, abs=0.5)
    assert state.valid
    assert seen[134][0].mode == "BRAKE"
    assert not seen[134][0].accepts_setpoints
    assert seen[10][1].position_valid is False
    assert view.unusable == 0
    assert view.reboots == 0
