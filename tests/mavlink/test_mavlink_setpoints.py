"""The bytes of setpoints, gimbal messages and heartbeats, decoded by an independent instance and by hand."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.quaternion import QuaternionBase

from control.messages import CommandReason, GimbalCommand, GimbalFrame, VelocityCommand
from uavfollow.mavlink import ids
from uavfollow.mavlink.gimbal import (
    MAX_PITCH_RAD,
    gimbal_angle,
    gimbal_rate,
    gimbal_release_control,
    gimbal_take_control,
)
from uavfollow.mavlink.heartbeat import camera_heartbeat, controller_heartbeat
from uavfollow.mavlink.packer import Packer
from uavfollow.mavlink.setpoints import FLOAT32_MAX, SetpointError, time_boot_ms, velocity_setpoint

VELOCITY = VelocityCommand((1.5, -2.25, 0.5), -0.75, 10.0, CommandReason.TRACKING)
GIMBAL = GimbalCommand(-0.25, 0.5, -0.6, 0.4, GimbalFrame.VEHICLE, 10.0, CommandReason.TRACKING)
NOT_FINITE = [math.nan, math.inf, -math.inf, 1e39, -(10**400), None, "fast"]
FINITE = st.floats(-FLOAT32_MAX, FLOAT32_MAX, width=32)


def _decode(message: Any) -> Any:
    """Through the wire, by a pymavlink instance of the test's own."""
    frame = Packer(1, 191).pack(message)
    (decoded,) = dialect.MAVLink(None).parse_buffer(frame)
    return decoded


def test_the_numbers_are_those_of_the_dialect() -> None:
    assert ids.AUTOPILOT_COMPONENT == dialect.MAV_COMP_ID_AUTOPILOT1
    assert ids.CAMERA_COMPONENT == dialect.MAV_COMP_ID_CAMERA
    assert ids.CONTROLLER_COMPONENT == dialect.MAV_COMP_ID_ONBOARD_COMPUTER
    assert ids.TYPE_ONBOARD_CONTROLLER == dialect.MAV_TYPE_ONBOARD_CONTROLLER
    assert ids.TYPE_CAMERA == dialect.MAV_TYPE_CAMERA
    assert ids.AUTOPILOT_ARDUPILOT == dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert ids.MODE_FLAG_ARMED == dialect.MAV_MODE_FLAG_SAFETY_ARMED
    assert {dialect.MAV_TYPE_QUADROTOR, dialect.MAV_TYPE_HEXAROTOR, dialect.MAV_TYPE_OCTOROTOR} <= ids.TYPES_COPTER
    assert dialect.MAV_TYPE_FIXED_WING not in ids.TYPES_COPTER
    assert ids.CMD_SET_MESSAGE_INTERVAL == dialect.MAV_CMD_SET_MESSAGE_INTERVAL
    assert ids.CMD_REQUEST_MESSAGE == dialect.MAV_CMD_REQUEST_MESSAGE
    assert ids.LANDED_STATE_IN_AIR == dialect.MAV_LANDED_STATE_IN_AIR
    assert ids.ESTIMATOR_VELOCITY_HORIZ == dialect.ESTIMATOR_VELOCITY_HORIZ
    assert ids.ESTIMATOR_POSITION_HORIZ == dialect.ESTIMATOR_POS_HORIZ_REL | dialect.ESTIMATOR_POS_HORIZ_ABS
    for name in ("HEARTBEAT", "ATTITUDE", "LOCAL_POSITION_NED", "EKF_STATUS_REPORT", "EXTENDED_SYS_STATE",
                 "GIMBAL_MANAGER_STATUS", "GIMBAL_DEVICE_ATTITUDE_STATUS"):  # fmt: skip
        assert getattr(ids, f"MESSAGE_{name}") == getattr(dialect, f"MAVLINK_MSG_ID_{name}")
    assert ids.AUTOPILOT_INVALID == dialect.MAV_AUTOPILOT_INVALID
    assert ids.STATE_STANDBY == dialect.MAV_STATE_STANDBY
    assert ids.STATE_ACTIVE == dialect.MAV_STATE_ACTIVE
    assert ids.FRAME_LOCAL_NED == dialect.MAV_FRAME_LOCAL_NED
    assert ids.CMD_GIMBAL_MANAGER_CONFIGURE == dialect.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE
    assert ids.YAW_LOCK == dialect.GIMBAL_MANAGER_FLAGS_YAW_LOCK
    assert ids.YAW_IN_VEHICLE_FRAME == dialect.GIMBAL_MANAGER_FLAGS_YAW_IN_VEHICLE_FRAME
    assert ids.YAW_IN_EARTH_FRAME == dialect.GIMBAL_MANAGER_FLAGS_YAW_IN_EARTH_FRAME
    assert ids.ROLL_LOCK == dialect.GIMBAL_MANAGER_FLAGS_ROLL_LOCK
    assert ids.PITCH_LOCK == dialect.GIMBAL_MANAGER_FLAGS_PITCH_LOCK
    assert (ids.VELOCITY_YAW_RATE_MASK, ids.FOLLOW_FLAGS, ids.LOCK_FLAGS) == (1479, 44, 92)


def test_a_velocity_setpoint_as_decoded() -> None:
    got = _decode(velocity_setpoint(VELOCITY, 7, 12.3456))
    assert got.get_msgId() == 84
    assert (got.target_system, got.target_component, got.coordinate_frame, got.type_mask) == (7, 1, 1, 1479)
    assert got.time_boot_ms == 12345
    assert (got.vx, got.vy, got.vz, got.yaw_rate) == (1.5, -2.25, 0.5, -0.75)
    assert (got.x, got.y, got.z, got.afx, got.afy, got.afz, got.yaw) == (0.0,) * 7


def test_a_velocity_setpoint_by_hand_from_the_definition() -> None:
    frame = Packer(1, 191).pack(velocity_setpoint(VELOCITY, 7, 1.0))
    assert int.from_bytes(frame[7:10], "little") == 84
    # Wire order: the 32-bit fields, the mask, then the bytes; trailing zeros are cut off in MAVLink 2.
    payload = frame[10:-2].ljust(53, b"\x00")
    fields = struct.unpack("<I11fHBBB", payload)
    assert fields == (1000, 0, 0, 0, 1.5, -2.25, 0.5, 0, 0, 0, 0, -0.75, 1479, 7, 1, 1)


@settings(derandomize=True)
@given(FINITE, FINITE, FINITE, FINITE)
def test_every_finite_velocity_arrives_unchanged(north: float, east: float, down: float, yaw_rate: float) -> None:
    got = _decode(velocity_setpoint(replace(VELOCITY, v_ned_m_s=(north, east, down), yaw_rate_rad_s=yaw_rate), 1, 0.0))
    assert (got.vx, got.vy, got.vz, got.yaw_rate) == (north, east, down, yaw_rate)


@pytest.mark.parametrize("bad", NOT_FINITE)
@pytest.mark.parametrize(("index", "name"), [(0, "north"), (1, "east"), (2, "down")])
def test_no_velocity_that_is_not_finite_reaches_the_wire(bad: Any, index: int, name: str) -> None:
    velocity = [0.0, 0.0, 0.0]
    velocity[index] = bad
    with pytest.raises(SetpointError, match=name):
        velocity_setpoint(replace(VELOCITY, v_ned_m_s=tuple(velocity)), 1, 0.0)


@pytest.mark.parametrize("bad", NOT_FINITE)
def test_no_yaw_rate_or_time_that_is_not_finite_reaches_the_wire(bad: Any) -> None:
    with pytest.raises(SetpointError, match="yaw_rate_rad_s"):
        velocity_setpoint(replace(VELOCITY, yaw_rate_rad_s=bad), 1, 0.0)
    with pytest.raises(SetpointError, match="now_s"):
        velocity_setpoint(VELOCITY, 1, bad)


def test_a_velocity_of_two_numbers_is_refused() -> None:
    with pytest.raises(SetpointError, match="has 2 numbers"):
        velocity_setpoint(replace(VELOCITY, v_ned_m_s=(1.0, 2.0)), 1, 0.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("bad", [0, -1, 256, True, 1.0, None])
def test_a_setpoint_goes_to_one_named_vehicle(bad: Any) -> None:
    for build in (
        lambda: velocity_setpoint(VELOCITY, bad, 0.0),
        lambda: gimbal_rate(GIMBAL, 1, bad),
        lambda: gimbal_angle(GIMBAL, 1, bad),
        lambda: gimbal_take_control(1, 191, bad),
        lambda: gimbal_release_control(bad),
    ):
        with pytest.raises(SetpointError, match="target_system"):
            build()


def test_time_boot_ms_wraps_at_32_bits() -> None:
    wrap_s = 2**32 / 1000
    assert time_boot_ms(wrap_s - 0.001) == 2**32 - 1
    assert time_boot_ms(wrap_s) == 0
    assert time_boot_ms(wrap_s + 1.5) == 1500
    assert _decode(velocity_setpoint(VELOCITY, 1, 1e30)).time_boot_ms < 2**32


@pytest.mark.parametrize(("frame", "flags"), [(GimbalFrame.VEHICLE, 44), (GimbalFrame.EARTH, 92)])
def test_a_gimbal_rate_as_decoded(frame: GimbalFrame, flags: int) -> None:
    got = _decode(gimbal_rate(replace(GIMBAL, frame=frame), 154, 7))
    assert got.get_msgId() == 282
    assert (got.target_system, got.target_component, got.gimbal_device_id, got.flags) == (7, 1, 154, flags)
    assert all(math.isnan(value) for value in got.q)
    assert (got.angular_velocity_x, got.angular_velocity_y, got.angular_velocity_z) == (0.0, -0.25, 0.5)


def test_a_gimbal_rate_needs_no_angle() -> None:
    assert _decode(gimbal_rate(replace(GIMBAL, pitch_rad=None, yaw_rad=None), 1, 1)).angular_velocity_z == 0.5


@pytest.mark.parametrize(("frame", "flags"), [(GimbalFrame.VEHICLE, 44), (GimbalFrame.EARTH, 92)])
def test_a_gimbal_angle_as_decoded(frame: GimbalFrame, flags: int) -> None:
    got = _decode(gimbal_angle(replace(GIMBAL, frame=frame), 1, 7, manager_component=154))
    assert (got.target_system, got.target_component, got.gimbal_device_id, got.flags) == (7, 154, 1, flags)
    # The quaternion that the recorded flights carry for pitch -0.6, yaw 0.4.
    assert got.q == pytest.approx([0.936293363571167, 0.05871080234646797, -0.2896294891834259, 0.1897960603237152])
    rates = (got.angular_velocity_x, got.angular_velocity_y, got.angular_velocity_z)
    assert all(math.isnan(value) for value in rates)


@settings(derandomize=True)
@given(st.floats(-1.6, 1.6), st.floats(-math.pi, math.pi))
def test_the_receiver_gets_the_angles_back_even_straight_down(pitch: float, yaw: float) -> None:
    got = _decode(gimbal_angle(replace(GIMBAL, pitch_rad=pitch, yaw_rad=yaw), 1, 1))
    roll_back, pitch_back, yaw_back = QuaternionBase(got.q).euler
    assert roll_back == pytest.approx(0.0, abs=1e-3)
    # Near 90 degrees the sine is flat: a rounding of 1e-7 moves its angle by up to 5e-4.
    assert pitch_back == pytest.approx(max(-MAX_PITCH_RAD, min(MAX_PITCH_RAD, pitch)), abs=1e-3)
    assert math.remainder(yaw_back - yaw, math.tau) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("bad", NOT_FINITE)
@pytest.mark.parametrize(
    ("field", "build"),
    [
        ("pitch_rate_rad_s", gimbal_rate),
        ("yaw_rate_rad_s", gimbal_rate),
        ("pitch_rad", gimbal_angle),
        ("yaw_rad", gimbal_angle),
    ],
)
def test_no_gimbal_value_that_is_not_finite_reaches_the_wire(bad: Any, field: str, build: Callable[..., Any]) -> None:
    with pytest.raises(SetpointError, match=field):
        build(replace(GIMBAL, **{field: bad}), 1, 1)


@pytest.mark.parametrize("bad", [-1, 256, 1.0])
def test_a_device_id_out_of_range_is_refused(bad: Any) -> None:
    for build in (
        lambda: gimbal_rate(GIMBAL, bad, 1),
        lambda: gimbal_angle(GIMBAL, bad, 1),
        lambda: gimbal_take_control(1, 191, 1, device_id=bad),
    ):
        with pytest.raises(SetpointError, match="device_id"):
            build()


def test_control_is_taken_with_explicit_ids_and_released_with_minus_three() -> None:
    take = _decode(gimbal_take_control(7, 191, 7, device_id=2))
    assert (take.target_system, take.target_component, take.command) == (7, 1, 1001)
    assert (take.param1, take.param2, take.param3, take.param4) == (7, 191, -1, -1)
    assert (take.param5, take.param6, take.param7) == (0, 0, 2)
    release = _decode(gimbal_release_control(7))
    assert (release.command, release.param1, release.param2, release.param7) == (1001, -3, -3, 0)
    with pytest.raises(SetpointError, match="own_system"):
        gimbal_take_control(0, 191, 1)
    with pytest.raises(SetpointError, match="own_component"):
        gimbal_take_control(1, -2, 1)


def test_heartbeats_tell_controller_and_camera_apart() -> None:
    controller = _decode(controller_heartbeat())
    assert (controller.type, controller.autopilot, controller.system_status) == (18, 8, 4)
    assert (controller.base_mode, controller.custom_mode, controller.mavlink_version) == (0, 0, 3)
    assert (_decode(camera_heartbeat(True)).type, _decode(camera_heartbeat(True)).system_status) == (30, 4)
    assert _decode(camera_heartbeat(False)).system_status == 3


@pytest.mark.parametrize("yaw", [-2.5, 0.0, 1.2, 3.0])
def test_straight_down_keeps_the_yaw(yaw: float) -> None:
    got = _decode(gimbal_angle(replace(GIMBAL, pitch_rad=-math.pi / 2, yaw_rad=yaw), 1, 1))
    assert QuaternionBase(got.q).euler[2] == pytest.approx(yaw, abs=1e-3)
