"""The application beside an autopilot: the loop of `App`, its telemetry, and what may leave over MAVLink.

No thread, socket, sleep or clock: `poll` is called often (50 Hz or more), `see` for every picture that was taken up.
The live program and the lockstep simulation call the same two.

Three authorisations, each asked for on its own: `select` (tracking), `CompanionConfig.gimbal` (the camera follows what
was selected), `start_following` (the vehicle does).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega

from control.messages import FlightStatus, GimbalFrame, VelocityCommand
from control.supervisor import FlightPermission, FlightReason, FlightSupervisor
from tracker.box import Box
from tracker.messages import Candidate, Frame
from uavfollow.app import App, StepRecord, Telemetry
from uavfollow.mavlink import ids
from uavfollow.mavlink.autopilot import AutopilotView
from uavfollow.mavlink.boot_clock import PERIOD_S as TIMESYNC_PERIOD_S
from uavfollow.mavlink.commands import CommandQueue, message_interval
from uavfollow.mavlink.connection import Connection
from uavfollow.mavlink.gimbal import gimbal_angle
from uavfollow.mavlink.gimbal_grant import GimbalGrant, GrantState
from uavfollow.mavlink.heartbeat import HEARTBEAT_PERIOD_S, controller_heartbeat
from uavfollow.mavlink.packer import Message
from uavfollow.mavlink.setpoints import velocity_setpoint

log = logging.getLogger(__name__)

# What the loop needs, at the rates of mavlink.md 3.6. The heartbeat faster than 1 Hz shows a pilot's take-over sooner.
STREAMS_HZ = {
    ids.MESSAGE_HEARTBEAT: 5.0,
    ids.MESSAGE_EXTENDED_SYS_STATE: 5.0,
    ids.MESSAGE_ATTITUDE: 50.0,
    ids.MESSAGE_LOCAL_POSITION_NED: 25.0,
    ids.MESSAGE_GIMBAL_DEVICE_ATTITUDE_STATUS: 50.0,
    ids.MESSAGE_EKF_STATUS_REPORT: 2.0,
    ids.MESSAGE_GIMBAL_MANAGER_STATUS: 2.0,
}
STREAMS_LOST_S = 3.0  # 150 attitudes that did not come
STREAMS_RETRY_S = 10.0  # an autopilot that refuses is not to be flooded


@dataclass(frozen=True, slots=True)
class CompanionConfig:
    """Whom it speaks to and how often. `gimbal`: the camera may be moved."""

    target_system: int = 1
    gimbal: bool = True
    gimbal_device_id: int = 1
    gimbal_frame: GimbalFrame = GimbalFrame.EARTH  # the autopilot takes the vehicle's turns out at its own rate
    stream_period_s: float = 0.05  # 20 Hz (mavlink.md, 3.1)


@dataclass(frozen=True, slots=True, eq=False)
class LoopRecord:
    """One cycle with what the supervisor made of it. `flight_status` is the autopilot's, as of `step.t_s`."""

    step: StepRecord
    flight: FlightPermission
    flight_status: FlightStatus
    gimbal: GrantState


class Companion:
    """Owns the loop's side of one link. Never raises in `poll` and `see` for what was received or seen."""

    def __init__(self, app: App, connection: Connection, config: CompanionConfig | None = None) -> None:
        self._app = app
        self._connection = connection
        self._config = config or CompanionConfig()
        own = (connection.system_id, ids.CONTROLLER_COMPONENT)
        self.autopilot = AutopilotView(self._config.target_system, self._config.gimbal_device_id)
        self.supervisor = FlightSupervisor()
        self.grant = GimbalGrant(*own, self._config.target_system, self._config.gimbal_device_id)
        self._commands = CommandQueue(*own)
        self._record: StepRecord | None = None
        self._flight_record: StepRecord | None = None  # the newest decision that may move the vehicle
        self._due_s: dict[str, float] = {}
        self._reboots = 0
        self._asked_streams = False
        self.faults = 0

    # ---- what the operator asks for

    def select(self, frame: Frame | None, box: Box, now_s: float, t_capture_s: float | None = None) -> LoopRecord:
        """Track what is in `box` of `frame` (None: candidates will come), and let the gimbal follow if it may.

        A vehicle that follows stops following: another target is another decision. Raises ValueError when it cannot be
        selected; nothing changes then.
        """
        t_s = frame.t_capture_s if frame is not None else now_s if t_capture_s is None else t_capture_s
        record = self._app.start(frame, box, self._telemetry(t_s, now_s), now_s, t_s)
        self.stop_following(now_s)
        self._record, self._flight_record = record, None
        if self._config.gimbal:
            self.grant.ask(self._commands)
        return self._loop_record(record)

    def start_following(self, now_s: float) -> FlightPermission:
        """Let velocity setpoints out, from standstill; refused with the reason when the vehicle is not ready for it."""
        was_allowed = self.supervisor.permission.allowed
        permission = self.supervisor.engage(self.autopilot.status(), now_s)
        if permission.allowed and not was_allowed:
            self._app.reset_flight()
            self._flight_record = None  # what was decided before the start had no vehicle to move
        return permission

    def stop_following(self, now_s: float) -> None:
        """End the setpoints with one explicit stop, if they are still ours to send."""
        self._guarded("stop", self._send_stop, now_s, may_send=True)
        self.supervisor.stop(now_s)

    def close(self, now_s: float) -> None:
        """End everything in order: stop following, give the gimbal back."""
        self.stop_following(now_s)
        self.grant.release(self._commands)
        self._guarded("release", self._send_commands, now_s)

    # ---- the loop

    def see(
        self, seen: Frame | Sequence[Candidate] | None, now_s: float, t_capture_s: float | None = None
    ) -> LoopRecord:
        """One picture (or its candidates, exposed at `t_capture_s`): decide, and send at once what may leave."""
        t_s = seen.t_capture_s if isinstance(seen, Frame) else now_s if t_capture_s is None else t_capture_s
        self._guarded("receive", self._receive, now_s)
        record = self._app.step(seen, self._telemetry(t_s, now_s), now_s, t_capture_s)
        self._record = self._flight_record = record
        self._due_s["stream"] = now_s
        self._guarded("stream", self._stream, now_s, may_send=True)
        return self._loop_record(record)

    def searches_at_px(self, t_s: float) -> tuple[float, float] | None:
        """Centre of the search region in a picture exposed at `t_s`; None while nothing is selected."""
        return self._app.searches_at_px(t_s)

    def poll(self, now_s: float) -> None:
        """Receive, keep the link alive, look at the mode, send what is due. Call it often; it costs little."""
        self._guarded("receive", self._receive, now_s)
        self.supervisor.step(self.autopilot.status(), now_s)
        self._guarded("upkeep", self._upkeep, now_s)
        self._guarded("stream", self._stream, now_s, may_send=True)

    def _guarded(self, what: str, act: Callable[[float], None], now_s: float, may_send: bool = False) -> None:
        """One failure must not end the loop. One in what sends setpoints (`may_send`) ends the authorisation to fly;
        one in what receives shows in the age of the heartbeat if it lasts."""
        try:
            act(now_s)
        except Exception:
            self.faults += 1
            log.exception("%s failed at %.3f s", what, now_s)
            if may_send:
                self.supervisor.stop(now_s, FlightReason.FAULT)

    def _receive(self, now_s: float) -> None:
        for message in self._connection.receive():
            kind = message.get_type()
            if kind in ("COMMAND_ACK", "TIMESYNC") and not self._is_autopilot(message):
                continue
            if kind == "COMMAND_ACK":
                self._commands.answered(message)
            elif kind == "TIMESYNC":
                self._timesync(message, now_s)
            else:
                self.autopilot.take(message, now_s)
        if self.autopilot.reboots != self._reboots:
            self._reboots = self.autopilot.reboots
            self._restarted(now_s)
        self.grant.update(self._commands.outcomes, self.autopilot.gimbal_primary)
        self._commands.outcomes.clear()
        self.supervisor.step(self.autopilot.status(), now_s)

    def _restarted(self, now_s: float) -> None:
        """Message intervals, the gimbal and whatever flew are gone with the autopilot's restart."""
        self._commands.clear()
        self._asked_streams = False
        self.grant.lost()
        self.supervisor.stop(now_s, FlightReason.REBOOTED)

    def _is_autopilot(self, message: Message) -> bool:
        source = (message.get_srcSystem(), message.get_srcComponent())
        return source == (self._config.target_system, ids.AUTOPILOT_COMPONENT)

    def _timesync(self, message: Message, now_s: float) -> None:
        if message.tc1 == 0:
            self._send(ardupilotmega.MAVLink_timesync_message(tc1=int(now_s * 1e9), ts1=message.ts1))
        else:
            self.autopilot.timesync(int(message.tc1), int(message.ts1), now_s)

    def _upkeep(self, now_s: float) -> None:
        if self._is_due("heartbeat", HEARTBEAT_PERIOD_S, now_s):
            self._send(controller_heartbeat())
        if math.isinf(self.autopilot.status().t_heartbeat_s):
            return  # nobody there yet
        if self._asked_streams and self._commands.is_idle and self.autopilot.telemetry_age_s(now_s) > STREAMS_LOST_S:
            # A restart of the autopilot or another route of the link: nothing comes unless it is asked for.
            self._asked_streams = not self._is_due("streams", STREAMS_RETRY_S, now_s)
        if not self._asked_streams:
            self._asked_streams = True
            for message_id, rate_hz in STREAMS_HZ.items():
                self._commands.add(message_interval(self._config.target_system, message_id, rate_hz))
        if self._is_due("timesync", TIMESYNC_PERIOD_S, now_s):
            ts1 = self.autopilot.clock.request(now_s)
            self._send(ardupilotmega.MAVLink_timesync_message(tc1=0, ts1=ts1))
        self._send_commands(now_s)

    def _send_commands(self, now_s: float) -> None:
        message = self._commands.due(now_s)
        if message is not None:
            self._send(message)

    def _stream(self, now_s: float) -> None:
        if not self._is_due("stream", self._config.stream_period_s, now_s):
            return
        record, flown = self._record, self._flight_record
        command = flown.velocity_command if flown is not None else None
        t_picture_s = flown.target.t_s if flown is not None else now_s
        passed = self.supervisor.passed(command, t_picture_s, self.autopilot.status(), now_s)
        if passed is not None:
            self._send_velocity(passed, now_s)
        if record is not None and self.grant.state is GrantState.HELD:
            gimbal = record.gimbal_command
            if gimbal.pitch_rad is not None and gimbal.yaw_rad is not None:
                self._send(gimbal_angle(gimbal, self._config.gimbal_device_id, self._config.target_system))

    def _send_stop(self, now_s: float) -> None:
        hold = self.supervisor.passed(None, now_s, self.autopilot.status(), now_s)
        if hold is not None:
            self._send_velocity(hold, now_s)

    def _send_velocity(self, command: VelocityCommand, now_s: float) -> None:
        self._send(velocity_setpoint(command, self._config.target_system, now_s))

    def _send(self, message: Message) -> None:
        self._connection.send(ids.CONTROLLER_COMPONENT, message)

    def _is_due(self, what: str, period_s: float, now_s: float) -> bool:
        """Whether it is time again, on a grid that does not drift with late calls but skips what was missed."""
        due_s = self._due_s.get(what, now_s)
        if now_s < due_s - 1e-9:
            return False
        self._due_s[what] = max(due_s + period_s, now_s + period_s / 2)
        return True

    def _telemetry(self, t_s: float, now_s: float) -> Telemetry:
        return Telemetry(
            self.autopilot.vehicle_at(t_s, now_s), self.autopilot.gimbal_at(t_s, self._config.gimbal_frame)
        )

    def _loop_record(self, record: StepRecord) -> LoopRecord:
        return LoopRecord(record, self.supervisor.permission, self.autopilot.status(), self.grant.state)
