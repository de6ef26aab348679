"""The setpoint stream of a run as a tlog, as pymavlink's mavlogfile and mavlogdump.py read it."""

from __future__ import annotations

from pathlib import Path

from control.messages import CommandReason, GimbalCommand, GimbalFrame, VelocityCommand
from uavfollow.app import StepRecord
from uavfollow.mavlink.gimbal import gimbal_rate
from uavfollow.mavlink.heartbeat import HEARTBEAT_PERIOD_S, controller_heartbeat
from uavfollow.mavlink.ids import CONTROLLER_COMPONENT
from uavfollow.mavlink.packer import Message, Packer
from uavfollow.mavlink.setpoints import velocity_setpoint
from uavfollow.mavlink.tlog import TlogWriter

VEHICLE_SYSTEM = 1
ALL_GIMBALS = 0


class SetpointTlog:
    """Writes, for each step, the gimbal rate (282) and velocity (84) that would be sent, and a heartbeat a second."""

    def __init__(self, path: Path, start_unix_us: int) -> None:
        self._writer = TlogWriter(path)
        self._packer = Packer(VEHICLE_SYSTEM, CONTROLLER_COMPONENT)
        self._start_unix_us = start_unix_us
        self._next_heartbeat_s = 0.0
        self._frame = GimbalFrame.VEHICLE

    def write(self, record: StepRecord) -> None:
        """Append the messages of one step."""
        if record.t_s >= self._next_heartbeat_s:
            self._send(record.t_s, controller_heartbeat())
            self._next_heartbeat_s = record.t_s + HEARTBEAT_PERIOD_S
        self._frame = record.gimbal_command.frame
        self._send(record.t_s, gimbal_rate(record.gimbal_command, ALL_GIMBALS, VEHICLE_SYSTEM))
        self._send(record.t_s, velocity_setpoint(record.velocity_command, VEHICLE_SYSTEM, record.t_s))

    def stop(self, t_s: float) -> None:
        """The stream's end: zero rate and zero velocity. On ArduPilot a gimbal rate goes on for ever without it."""
        still = GimbalCommand(0.0, 0.0, None, None, self._frame, t_s, CommandReason.HOLD_NO_TARGET)
        hover = VelocityCommand((0.0, 0.0, 0.0), 0.0, t_s, CommandReason.HOLD_NO_TARGET)
        self._send(t_s, gimbal_rate(still, ALL_GIMBALS, VEHICLE_SYSTEM))
        self._send(t_s, velocity_setpoint(hover, VEHICLE_SYSTEM, t_s))

    def _send(self, t_s: float, message: Message) -> None:
        self._writer.write(self._start_unix_us + round(t_s * 1e6), self._packer.pack(message))

    def close(self) -> None:
        """Complete the file."""
        self._writer.close()

    def abort(self) -> None:
        """Delete the file."""
        self._writer.abort()
