"""What the autopilot reports: one builder a message, from the state of the flight.

Ids that a real ArduCopter also knows but that are not modelled (raw sensors, missions, logs, ...) are not in the
table: asking for them is answered as for an id that does not exist.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.channel import Message
from sitl.autopilot.config import ArduCopterConfig
from sitl.autopilot.flight import Flight
from sitl.autopilot.gimbal_manager import CAP_FLAGS, DEVICE_ID, ROLL_LIMIT_RAD, GimbalManager
from sitl.autopilot.guided import SubMode
from sitl.autopilot.modes import Mode, base_mode
from sitl.autopilot.rc import CHANNELS

NAN = float("nan")
# EKF_STATUS_REPORT.flags as recorded: before the origin is known, and good.
EKF_WAITING, EKF_GOOD = 167, 831
# SYS_STATUS sensor bits as recorded on the ground before and after the estimator was ready.
SENSORS_PRESENT, SENSORS_ENABLED = 1383201839, 1382153263
SENSORS_HEALTHY, SENSORS_WAITING = 1450310703, 1179753519
BATTERY_MV = 12600
# POSITION_TARGET_LOCAL_NED.type_mask as recorded: velocity and acceleration, or position.
MASK_VELOCITY, MASK_POSITION = 0xC07, 0xDF8
VTOL_STATE_MULTICOPTER = 3
MAV_STATE_BOOT, MAV_STATE_STANDBY, MAV_STATE_ACTIVE, MAV_STATE_CRITICAL = 1, 3, 4, 5
# 4.7.0-dev: major, minor, patch, type (0 = dev).
FIRMWARE_VERSION = 0x04070000
# MAV_PROTOCOL_CAPABILITY: float parameters, COMMAND_INT, local setpoints, MAVLink 2.
CAPABILITIES = 0x2 | 0x8 | 0x80 | 0x2000
# Degrees of latitude per metre times 1e7.
E7_PER_M = 1e7 / 111318.84502145034


class Telemetry:
    """Builders by message id. `build` gives None for what must not be sent now."""

    def __init__(self, config: ArduCopterConfig, flight: Flight, gimbal: GimbalManager, seed: int) -> None:
        self._config = config
        self._flight = flight
        self._gimbal = gimbal
        self._random = random.Random(seed)
        self.boot_s = config.booted_at_s
        self.initialising_until_s = config.booted_at_s
        self._builders: dict[int, Callable[[], Message | None]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self.heartbeat,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self._system_time,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self._attitude_quaternion,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global_position,
            mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self.origin,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS: self._rc_channels,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self._vfr_hud,
            mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: self._position_target,
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._version,
            mavlink.MAVLINK_MSG_ID_FENCE_STATUS: lambda: None,  # accepted, but without a fence never sent
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._ekf_status,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: self.home,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_sys_state,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: self._gimbal_information,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: self.gimbal_status,
            mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: self._gimbal_attitude,
        }

    def knows(self, message_id: int) -> bool:
        """Whether the message exists here."""
        return message_id in self._builders

    def build(self, message_id: int) -> Message | None:
        """The message as of now."""
        return self._builders[message_id]()

    @property
    def boot_ns(self) -> int:
        """Time since boot in ns, as TIMESYNC has it."""
        return round((self._flight.t_s - self.boot_s) * 1e9)

    @property
    def _boot_ms(self) -> int:
        return max(0, round((self._flight.t_s - self.boot_s) * 1e3)) & 0xFFFFFFFF

    @property
    def initialising(self) -> bool:
        """Just switched on: heartbeats only."""
        return self._flight.t_s < self.initialising_until_s

    def heartbeat(self) -> Message:
        """Mode, armed, state."""
        flight = self._flight
        if self.initialising:
            mode, state = base_mode(Mode.GUIDED, armed=False), MAV_STATE_BOOT
        else:
            mode = base_mode(flight.mode, flight.armed)
            flying = flight.armed and not flight.land_complete
            state = MAV_STATE_ACTIVE if flying else MAV_STATE_STANDBY
            state = MAV_STATE_CRITICAL if flight.failsafes.pending else state
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mode, int(flight.mode), state, 3
        )

    def _sys_status(self) -> Message:
        health = SENSORS_HEALTHY if self._flight.has_position else SENSORS_WAITING
        return mavlink.MAVLink_sys_status_message(
            SENSORS_PRESENT, SENSORS_ENABLED, health, 0, BATTERY_MV, 0, 100, 0, 0, 0, 0, 0, 0
        )

    def _system_time(self) -> Message:
        return mavlink.MAVLink_system_time_message(0, self._boot_ms)

    def _attitude(self) -> Message:
        vehicle = self._flight.vehicle
        return mavlink.MAVLink_attitude_message(
            self._boot_ms, vehicle.roll_rad, vehicle.pitch_rad, vehicle.yaw_rad, *vehicle.rates_rad_s
        )

    def _attitude_quaternion(self) -> Message:
        vehicle = self._flight.vehicle
        q = quaternion(vehicle.roll_rad, vehicle.pitch_rad, vehicle.yaw_rad)
        return mavlink.MAVLink_attitude_quaternion_message(self._boot_ms, *q, *vehicle.rates_rad_s)

    def _noisy(self, vector: tuple[float, float, float], sigma: float) -> tuple[float, float, float]:
        if sigma == 0.0:
            return vector
        gauss = self._random.gauss
        return vector[0] + gauss(0.0, sigma), vector[1] + gauss(0.0, sigma), vector[2] + gauss(0.0, sigma)

    def _local_position(self) -> Message | None:
        if not self._flight.has_position:
            return None
        position = self._noisy(self._flight.vehicle.pos_ned_m, self._config.position_noise_m)
        velocity = self._noisy(self._flight.vehicle.vel_ned_m_s, self._config.velocity_noise_m_s)
        return mavlink.MAVLink_local_position_ned_message(self._boot_ms, *position, *velocity)

    def _lat_lon_e7(self, north_m: float, east_m: float) -> tuple[int, int]:
        config = self._config
        shrink = math.cos(math.radians(config.home_lat_deg))
        return (
            round(config.home_lat_deg * 1e7 + north_m * E7_PER_M),
            round(config.home_lon_deg * 1e7 + east_m * E7_PER_M / shrink),
        )

    def ned_of(self, lat_deg: float, lon_deg: float, height_m: float) -> tuple[float, float, float]:
        """A place by latitude, longitude and height above home in NED."""
        config = self._config
        shrink = math.cos(math.radians(config.home_lat_deg))
        north = (lat_deg - config.home_lat_deg) * 1e7 / E7_PER_M
        return north, (lon_deg - config.home_lon_deg) * 1e7 * shrink / E7_PER_M, -height_m

    def _global_position(self) -> Message:
        if not self._flight.has_position:
            return mavlink.MAVLink_global_position_int_message(self._boot_ms, 0, 0, 0, 0, 0, 0, 0, 0)
        vehicle = self._flight.vehicle
        north, east, down = self._noisy(vehicle.pos_ned_m, self._config.position_noise_m)
        velocity = self._noisy(vehicle.vel_ned_m_s, self._config.velocity_noise_m_s)
        lat, lon = self._lat_lon_e7(north, east)
        height_mm = round(-down * 1e3)
        return mavlink.MAVLink_global_position_int_message(
            self._boot_ms, lat, lon, round(self._config.home_alt_m * 1e3) + height_mm, height_mm,
            *(max(-32768, min(32767, round(v * 100.0))) for v in velocity), self._heading_cdeg(),
        )  # fmt: skip

    def _heading_cdeg(self) -> int:
        return round(math.degrees(self._flight.vehicle.yaw_rad) * 100.0) % 36000

    def origin(self) -> Message:
        """GPS_GLOBAL_ORIGIN: the origin of the local frame."""
        lat, lon = self._lat_lon_e7(0.0, 0.0)
        return mavlink.MAVLink_gps_global_origin_message(
            lat, lon, round(self._config.home_alt_m * 1e3), self.boot_ns // 1000
        )

    def home(self) -> Message:
        """HOME_POSITION: home is the origin."""
        lat, lon = self._lat_lon_e7(0.0, 0.0)
        return mavlink.MAVLink_home_position_message(
            lat,
            lon,
            round(self._config.home_alt_m * 1e3),
            0.0,
            0.0,
            0.0,
            [NAN] * 4,
            0.0,
            0.0,
            0.0,
            self.boot_ns // 1000,
        )

    def _rc_channels(self) -> Message:
        channels = self._flight.rc.channels(self._flight.t_s)
        return mavlink.MAVLink_rc_channels_message(self._boot_ms, CHANNELS, *channels, *([0] * (18 - CHANNELS)), 255)

    def _vfr_hud(self) -> Message:
        vehicle = self._flight.vehicle
        north, east, down = vehicle.vel_ned_m_s
        speed = math.hypot(north, east)
        alt = self._config.home_alt_m - vehicle.pos_ned_m[2]
        throttle = 0 if self._flight.land_complete else 36  # the hover throttle of the recording
        return mavlink.MAVLink_vfr_hud_message(speed, speed, self._heading_cdeg() // 100, throttle, alt, -down)

    def _position_target(self) -> Message | None:
        """Only in GUIDED. A take-off reports the position target that it does not use: zero, as recorded."""
        flight = self._flight
        if flight.mode is not Mode.GUIDED:
            return None
        guided = flight.guided
        if guided.sub_mode is SubMode.VELOCITY:
            mask, position, velocity = MASK_VELOCITY, (0.0, 0.0, 0.0), guided.velocity_ned_m_s
        else:
            position = guided.position_ned_m if guided.sub_mode is SubMode.POSITION else (0.0, 0.0, 0.0)
            mask, velocity = MASK_POSITION, (0.0, 0.0, 0.0)
        return mavlink.MAVLink_position_target_local_ned_message(
            self._boot_ms, mavlink.MAV_FRAME_LOCAL_NED, mask, *position, *velocity, 0.0, 0.0, 0.0, 0.0, 0.0
        )

    def _version(self) -> Message:
        none = [0] * 8
        return mavlink.MAVLink_autopilot_version_message(
            CAPABILITIES, FIRMWARE_VERSION, 0, 0, 0, none, none, none, 0, 0, self._config.sysid
        )

    def _ekf_status(self) -> Message:
        flags = EKF_GOOD if self._flight.has_position else EKF_WAITING
        return mavlink.MAVLink_ekf_status_report_message(flags, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def _extended_sys_state(self) -> Message:
        return mavlink.MAVLink_extended_sys_state_message(VTOL_STATE_MULTICOPTER, int(self._flight.landed_state))

    def _gimbal_information(self) -> Message | None:
        if not self._gimbal.has(0):
            return None
        pitch, yaw = self._gimbal.pitch_limits_rad, self._gimbal.yaw_limits_rad
        return mavlink.MAVLink_gimbal_manager_information_message(
            self._boot_ms, CAP_FLAGS, DEVICE_ID, -ROLL_LIMIT_RAD, ROLL_LIMIT_RAD, *pitch, *yaw
        )

    def gimbal_status(self) -> Message | None:
        """GIMBAL_MANAGER_STATUS: who is in control; the flags are 12 even in lock, as recorded."""
        if not self._gimbal.has(0):
            return None
        flags = mavlink.GIMBAL_MANAGER_FLAGS_ROLL_LOCK | mavlink.GIMBAL_MANAGER_FLAGS_PITCH_LOCK
        if self._gimbal.yaw_lock:
            flags |= mavlink.GIMBAL_MANAGER_FLAGS_YAW_LOCK
        return mavlink.MAVLink_gimbal_manager_status_message(
            self._boot_ms, flags, DEVICE_ID, *self._gimbal.primary, 0, 0
        )

    def _gimbal_attitude(self) -> Message | None:
        if not self._gimbal.has(0):
            return None
        report = self._gimbal.report()
        q = quaternion(report.roll_rad, report.pitch_rad, report.yaw_rad)
        return mavlink.MAVLink_gimbal_device_attitude_status_message(
            0, 0, self._boot_ms, report.flags, list(q), NAN, NAN, NAN, 0, NAN, NAN, DEVICE_ID
        )


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float, float, float]:
    """w, x, y, z of the rotation yaw, then pitch, then roll."""
    cr, sr = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    cp, sp = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    cy, sy = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def euler(q: list[float]) -> tuple[float, float, float]:
    """Roll, pitch, yaw of a quaternion w, x, y, z of any length but zero; NaN for what has none."""
    length = math.sqrt(sum(v * v for v in q))
    if not math.isfinite(length) or length == 0.0:
        return NAN, NAN, NAN
    w, x, y, z = (v / length for v in q)
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    return roll, pitch, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
