"""Messages that are meant for the autopilot: what each of them does."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.channel import Channel, Message
from sitl.autopilot.commands import Command, Commands
from sitl.autopilot.guided import Setpoint
from sitl.autopilot.modes import Mode, ModeReason
from sitl.autopilot.telemetry import euler

if TYPE_CHECKING:
    from sitl.autopilot.core import Core

# PARAM_VALUE.param_index when the parameter was asked for by name or has changed.
NO_INDEX = 65535
# DO_SET_MODE and SET_MODE: custom_mode is valid.
CUSTOM_MODE = 1


class Messages:
    """Dispatch by message id; what is not in the table is ignored, as a real autopilot does."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._commands = Commands(core)
        self._table: dict[int, Callable[[Message, Channel], None]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_SET_MODE: self._set_mode,
            mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ: self._param_read,
            mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: self._param_list,
            mavlink.MAVLINK_MSG_ID_PARAM_SET: self._param_set,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: self._rc_override,
            mavlink.MAVLINK_MSG_ID_COMMAND_INT: self._command_int,
            mavlink.MAVLINK_MSG_ID_COMMAND_LONG: self._command_long,
            mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED: self._setpoint,
            mavlink.MAVLINK_MSG_ID_TIMESYNC: self._timesync,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_SET_ATTITUDE: self._gimbal_attitude,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_SET_PITCHYAW: self._gimbal_pitch_yaw,
        }

    def handle(self, message: Message, channel: Channel) -> None:
        """Do what `message`, which came on `channel`, asks for."""
        handler = self._table.get(message.get_msgId())
        if handler is not None:
            handler(message, channel)

    # --- commands ------------------------------------------------------------------------------------------------

    def _command_long(self, message: Message, channel: Channel) -> None:
        p = (
            message.param1, message.param2, message.param3, message.param4, message.param5, message.param6,
            message.param7,
        )  # fmt: skip
        self._run(message, p, (p[4], p[5]), mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, channel)

    def _command_int(self, message: Message, channel: Channel) -> None:
        p = (
            message.param1, message.param2, message.param3, message.param4, float(message.x), float(message.y),
            message.z,
        )  # fmt: skip
        self._run(message, p, (message.x * 1e-7, message.y * 1e-7), message.frame, channel)

    def _run(
        self, message: Message, p: tuple[float, ...], place: tuple[float, float], frame: int, channel: Channel
    ) -> None:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        result = self._commands.run(Command(message.command, p, place, frame, sender), channel)
        channel.send(mavlink.MAVLink_command_ack_message(message.command, int(result), 0, 0, *sender))

    # --- flight --------------------------------------------------------------------------------------------------

    def _heartbeat(self, message: Message, channel: Channel) -> None:
        if message.get_srcSystem() == self._core.parameters["MAV_GCS_SYSID"]:
            self._core.flight.failsafes.gcs_heard_at_s = self._core.flight.t_s

    def _set_mode(self, message: Message, channel: Channel) -> None:
        if message.base_mode & CUSTOM_MODE:
            self._core.flight.request_mode(message.custom_mode, ModeReason.COMMAND)

    def _setpoint(self, message: Message, channel: Channel) -> None:
        """Without a word ignored in every mode but GUIDED."""
        flight = self._core.flight
        if flight.mode is not Mode.GUIDED:
            return
        setpoint = Setpoint(
            message.coordinate_frame,
            message.type_mask,
            (message.x, message.y, message.z),
            (message.vx, message.vy, message.vz),
            (message.afx, message.afy, message.afz),
            message.yaw,
            message.yaw_rate,
        )
        flight.guided.accept(setpoint, flight.t_s)

    def _rc_override(self, message: Message, channel: Channel) -> None:
        """Only the ground station may move the sticks."""
        core = self._core
        if message.get_srcSystem() == core.parameters["MAV_GCS_SYSID"]:
            pwm = tuple(getattr(message, f"chan{i}_raw") for i in range(1, 9))
            core.rc.override(pwm, core.flight.t_s)

    def _timesync(self, message: Message, channel: Channel) -> None:
        """Answer a request; answers of others are not used."""
        if message.tc1 == 0:
            channel.send(mavlink.MAVLink_timesync_message(self._core.telemetry.boot_ns, message.ts1))

    # --- gimbal --------------------------------------------------------------------------------------------------

    def _gimbal_attitude(self, message: Message, channel: Channel) -> None:
        """282: a complete quaternion is an angle, else the rates count; both complete: ignored."""
        rates = (message.angular_velocity_x, message.angular_velocity_y, message.angular_velocity_z)
        angles = all(math.isfinite(v) for v in message.q)
        if angles and all(math.isfinite(v) for v in rates):
            return
        roll, pitch, yaw = euler(message.q)
        self._obey(message, pitch, yaw, rates[1], rates[2], roll)

    def _gimbal_pitch_yaw(self, message: Message, channel: Channel) -> None:
        """287: a pair of angles or a pair of rates; all four: ignored."""
        values = (message.pitch, message.yaw, message.pitch_rate, message.yaw_rate)
        if not all(math.isfinite(v) for v in values):
            self._obey(message, *values)

    def _obey(
        self, message: Message, pitch: float, yaw: float, pitch_rate: float, yaw_rate: float, roll: float = 0.0
    ) -> None:
        gimbal = self._core.gimbal
        if gimbal.has(message.gimbal_device_id):
            gimbal.obey(message.flags, pitch, yaw, pitch_rate, yaw_rate, roll)

    # --- parameters ----------------------------------------------------------------------------------------------

    def _param_read(self, message: Message, channel: Channel) -> None:
        """An unknown parameter gets no answer."""
        parameters = self._core.parameters
        index = parameters.find(message.param_id, message.param_index)
        if index is not None:
            shown = index if message.param_index >= 0 else NO_INDEX
            channel.send(self._core.param_value(index, shown))

    def _param_list(self, message: Message, channel: Channel) -> None:
        self._core.list_parameters(channel)

    def _param_set(self, message: Message, channel: Channel) -> None:
        """Every link hears of the new value (which may be clamped); an unknown parameter gets no answer."""
        core = self._core
        if core.parameters.set(message.param_id, message.param_value):
            index = core.parameters.find(message.param_id, -1)
            if index is not None:
                core.announce(core.param_value(index, NO_INDEX))
            core.take_parameters()
