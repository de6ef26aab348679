"""MAV_CMD by MAV_CMD: what is done and which MAV_RESULT is answered.

COMMAND_LONG and COMMAND_INT come here as one `Command`; a parameter that is NaN means "default".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.channel import Channel
from sitl.autopilot.flight import FORCE_MAGIC, INFO
from sitl.autopilot.modes import Mode, ModeReason

if TYPE_CHECKING:
    from sitl.autopilot.core import Core


class Result(IntEnum):
    """MAV_RESULT, as far as it is used."""

    ACCEPTED = 0
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


ACCEPTED, DENIED, UNSUPPORTED, FAILED = Result.ACCEPTED, Result.DENIED, Result.UNSUPPORTED, Result.FAILED
# SET_MESSAGE_INTERVAL: slowest interval, and the fastest share of the main loop (as ArduPilot's limits).
INTERVAL_MAX_S = 60.0
LOOP_SHARE = 0.8
# MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
CUSTOM_MODE = 1
# DO_MOUNT_CONTROL: MAV_MOUNT_MODE
MOUNT_RETRACT, MOUNT_NEUTRAL, MOUNT_TARGETING, MOUNT_RC = 0, 1, 2, 3
# Frames whose altitude counts from sea level.
GLOBAL_FRAMES = frozenset({mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT})
# Frames whose altitude counts from home; COMMAND_LONG has this meaning here.
RELATIVE_FRAMES = frozenset({mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT})


@dataclass(frozen=True, slots=True)
class Command:
    """One command. `p` are param1 to param7 as they came; `lat_lon_deg` is param5 and 6 read as a place."""

    number: int
    p: tuple[float, ...]
    lat_lon_deg: tuple[float, float]
    frame: int
    sender: tuple[int, int]

    def number_at(self, index: int, default: float = 0.0) -> float:
        """Parameter 1 to 7, or the default where it is NaN or infinite."""
        value = self.p[index - 1]
        return value if math.isfinite(value) else default


class Commands:
    """Does commands. `run` returns the result for COMMAND_ACK."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._table: dict[int, Callable[[Command, Channel], Result]] = {
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: self._rtl,
            mavlink.MAV_CMD_NAV_LAND: self._land,
            mavlink.MAV_CMD_NAV_TAKEOFF: self._takeoff,
            mavlink.MAV_CMD_DO_SET_MODE: self._set_mode,
            mavlink.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            mavlink.MAV_CMD_DO_SET_ROI_LOCATION: self._roi,
            mavlink.MAV_CMD_DO_SET_ROI_NONE: self._roi_none,
            mavlink.MAV_CMD_DO_MOUNT_CONTROL: self._mount_control,
            mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: self._reboot,
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: self._gimbal_pitch_yaw,
            mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: self._gimbal_configure,
        }

    def run(self, command: Command, channel: Channel) -> Result:
        """Do it; UNSUPPORTED for what is not in the table (camera tracking among it)."""
        handler = self._table.get(command.number)
        return UNSUPPORTED if handler is None else handler(command, channel)

    # --- flight --------------------------------------------------------------------------------------------------

    def _mode(self, number: int) -> Result:
        return ACCEPTED if self._core.flight.request_mode(number, ModeReason.COMMAND) else FAILED

    def _rtl(self, command: Command, channel: Channel) -> Result:
        return self._mode(Mode.RTL)

    def _land(self, command: Command, channel: Channel) -> Result:
        return self._mode(Mode.LAND)

    def _set_mode(self, command: Command, channel: Channel) -> Result:
        if not int(command.number_at(1)) & CUSTOM_MODE:
            return DENIED
        return self._mode(int(command.number_at(2, -1.0)))

    def _takeoff(self, command: Command, channel: Channel) -> Result:
        if command.frame not in RELATIVE_FRAMES:
            return DENIED
        return ACCEPTED if self._core.flight.take_off(command.number_at(7)) else FAILED

    def _arm(self, command: Command, channel: Channel) -> Result:
        core, force = self._core, command.number_at(2) == FORCE_MAGIC
        wanted = command.number_at(1, -1.0)
        if wanted == 1.0:
            was_armed = core.flight.armed
            done = core.flight.arm(force)
            if done and not was_armed and core.flight.has_position:
                core.announce(core.telemetry.home())
                core.announce(core.telemetry.origin())
            return ACCEPTED if done else FAILED
        if wanted == 0.0:
            return ACCEPTED if core.flight.disarm(force) else FAILED
        return UNSUPPORTED

    def _change_speed(self, command: Command, channel: Channel) -> Result:
        """Accepted, and it does not limit velocity setpoints: as seen."""
        return ACCEPTED if command.number_at(2) > 0.0 else DENIED

    def _reboot(self, command: Command, channel: Channel) -> Result:
        if command.number_at(1) not in (1.0, 3.0):
            return UNSUPPORTED
        if self._core.flight.armed:
            return FAILED
        self._core.reboot_asked = True
        return ACCEPTED

    # --- messages ------------------------------------------------------------------------------------------------

    def _message_id(self, command: Command) -> int:
        return int(command.number_at(1, -1.0))

    def _set_interval(self, command: Command, channel: Channel) -> Result:
        core, message_id = self._core, self._message_id(command)
        if not core.telemetry.knows(message_id):
            core.say(INFO, f"No ap_message for mavlink id ({message_id})")
            return DENIED
        interval_s = command.number_at(2) * 1e-6
        if interval_s <= 0.0:  # -1 is off, 0 the default: which is off, but for the heartbeat
            heartbeat = message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT and interval_s == 0.0
            channel.set_interval(message_id, core.HEARTBEAT_S if heartbeat else None, core.flight.t_s)
            return ACCEPTED
        if interval_s < 1.0 / (LOOP_SHARE * core.LOOP_HZ):
            return DENIED
        channel.set_interval(message_id, min(interval_s, INTERVAL_MAX_S), core.flight.t_s)
        return ACCEPTED

    def _get_interval(self, command: Command, channel: Channel) -> Result:
        core, message_id = self._core, self._message_id(command)
        if not core.telemetry.knows(message_id):
            channel.send(mavlink.MAVLink_message_interval_message(message_id & 0xFFFF, 0))
            return FAILED
        interval_s = channel.interval(message_id)
        interval_us = -1 if interval_s is None else round(interval_s * 1e6)
        channel.send(mavlink.MAVLink_message_interval_message(message_id, interval_us))
        return ACCEPTED

    def _request_message(self, command: Command, channel: Channel) -> Result:
        core, message_id = self._core, self._message_id(command)
        message = core.telemetry.build(message_id) if core.telemetry.knows(message_id) else None
        if message is None:
            return FAILED
        core.after_ack(channel, message)
        return ACCEPTED

    # --- gimbal --------------------------------------------------------------------------------------------------

    def _gimbal_pitch_yaw(self, command: Command, channel: Channel) -> Result:
        gimbal = self._core.gimbal
        if not gimbal.has(int(command.number_at(7))):
            return FAILED
        pitch, yaw, pitch_rate, yaw_rate = (math.radians(v) for v in command.p[:4])
        done = gimbal.obey(int(command.number_at(5)), pitch, yaw, pitch_rate, yaw_rate)
        return ACCEPTED if done else FAILED

    def _gimbal_configure(self, command: Command, channel: Channel) -> Result:
        core = self._core
        if not core.gimbal.has(int(command.number_at(7))):
            return FAILED
        before = core.gimbal.primary
        if not core.gimbal.configure(command.p[0], command.p[1], command.sender):
            return FAILED
        if core.gimbal.primary != before:
            core.announce(core.telemetry.gimbal_status())
        return ACCEPTED

    def _roi(self, command: Command, channel: Channel) -> Result:
        core = self._core
        latitude, longitude = command.lat_lon_deg
        if not (core.gimbal.has(0) and abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            return FAILED
        height = command.number_at(7)
        if command.frame in GLOBAL_FRAMES:
            height -= core.config.home_alt_m
        core.gimbal.look_at(core.telemetry.ned_of(latitude, longitude, height))
        return ACCEPTED

    def _roi_none(self, command: Command, channel: Channel) -> Result:
        self._core.gimbal.leave_place()
        return ACCEPTED

    def _mount_control(self, command: Command, channel: Channel) -> Result:
        gimbal, mode = self._core.gimbal, int(command.number_at(7))
        if not gimbal.has(0):
            return FAILED
        if mode in (MOUNT_RETRACT, MOUNT_NEUTRAL):
            gimbal.park()
            return ACCEPTED
        pitch, roll, yaw = command.number_at(1), command.number_at(2), command.number_at(3)
        if mode != MOUNT_TARGETING or abs(pitch) > 90.0:
            return ACCEPTED if mode == MOUNT_RC else FAILED
        gimbal.point(math.radians(roll), math.radians(pitch), math.radians(yaw), lock=False)
        return ACCEPTED
