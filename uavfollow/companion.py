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

from control.gate import MAX_COMMAND_AGE_S, is_fresh
from control.messages import FlightStatus, GimbalFrame, VelocityCommand
from control.supervisor import FlightPermission, FlightReason, FlightSupervisor
from tracker.box import Box
from tracker.messages import Candidate, Frame, TargetStatus
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
STREAM_NAMES = (
    "HEARTBEAT", "EXTENDED_SYS_STATE", "ATTITUDE", "LOCAL_POSITION_NED", "GIMBAL_DEVICE_ATTITUDE_STATUS",
    "EKF_STATUS_REPORT", "GIMBAL_MANAGER_STATUS",
)  # fmt: skip
STREAMS_LOST_S = 3.0  # six of the rarest did not come
STREAMS_RETRY_S = 10.0  # an autopilot that refuses is not to be flooded
# `poll` is called at 50 Hz or more. After a pause this long nobody knows how old what waits in the link is.
MAX_POLL_GAP_S = 1.0
# An angle that rests on an older decision is not sent again: the gimbal stays there anyway.
MAX_GIMBAL_AGE_S = 0.5


@dataclass(frozen=True, slots=True)
class CompanionConfig:
    """Whom it speaks to and how often. `gimbal`: the camera may be moved."""

    target_system: int = 1
    gimbal: bool = True
    gimbal_device_id: int = 1
    gimbal_frame: GimbalFrame = GimbalFrame.EARTH  # the autopilot takes the vehicle's turns out at its own rate
    # A decision is sent at the next poll, and again after this time when no new one has come: pictures at 13 Hz or more
    # set the pace, and it is never below the 10 Hz of mavlink.md 3.1.
    repeat_after_s: float = 0.075


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
        self._polled_s = self._trusted_after_s = -math.inf
        self.faults = 0

    # ---- what the operator asks for

    def select(self, frame: Frame | None, box: Box, now_s: float, t_capture_s: float | None = None) -> LoopRecord:
        """Track what is in `box` of `frame` (None: candidates will come), and let the gimbal follow if it may.

        A vehicle that follows stops following: another target is another decision. Raises ValueError when it cannot be
        selected; nothing changes then.
        """
        t_s = frame.t_capture_s if frame is not None else now_s if t_capture_s is None else t_capture_s
        try:
            record = self._app.start(frame, box, self._telemetry(t_s, now_s), now_s, t_s)
        except ValueError:
            raise
        except Exception:
            self.stop_following(now_s)  # it is not known what is tracked now
            raise
        self.stop_following(now_s)
        self._record, self._flight_record = record, None
        if self._config.gimbal:
            self.grant.ask(self._commands)
        return self._loop_record(record, now_s)

    def start_following(self, now_s: float) -> FlightPermission:
        """Let velocity setpoints out, from standstill; refused with the reason when vehicle or target is not ready."""
        was_allowed = self.supervisor.permission.allowed
        obstacle = self._start_obstacle(now_s)
        if obstacle is not None and not was_allowed:
            return FlightPermission(False, obstacle, now_s)
        permission = self.supervisor.engage(self.autopilot.status(now_s), now_s)
        if permission.allowed and not was_allowed:
            self._app.reset_flight()
            self._flight_record = None  # what was decided before the start had no vehicle to move
        return permission

    def _start_obstacle(self, now_s: float) -> FlightReason | None:
        """What keeps a start back besides the vehicle's state."""
        if self.autopilot.status(now_s).t_heartbeat_s <= self._trusted_after_s:
            return FlightReason.STALLED
        record = self._record
        if record is None or record.target.status is not TargetStatus.LOCKED:
            return FlightReason.NO_TARGET
        if not is_fresh(record.t_s, now_s, MAX_COMMAND_AGE_S):
            return FlightReason.NO_TARGET
        return None if record.range_estimate.valid else FlightReason.NO_RANGE

    def stop_following(self, now_s: float) -> None:
        """End the setpoints with one explicit stop, if they are still ours to send."""
        self._stop(now_s, FlightReason.STOPPED)

    def close(self, now_s: float) -> None:
        """End everything in order: stop following, give the gimbal back. Nothing waits for an answer any more."""
        self.stop_following(now_s)
        self._record = self._flight_record = None
        self._commands.clear()
        self.grant.release(self._commands)
        self._guarded("release", self._send_commands, now_s)

    # ---- the loop

    def see(
        self, seen: Frame | Sequence[Candidate] | None, now_s: float, t_capture_s: float | None = None
    ) -> LoopRecord:
        """One picture (or its candidates, exposed at `t_capture_s`): decide. The next `poll` sends what may leave.

        Nothing is sent here: the network may have taken long, and the mode may have changed meanwhile.
        """
        t_s = seen.t_capture_s if isinstance(seen, Frame) else now_s if t_capture_s is None else t_capture_s
        self._guarded("receive", self._receive, now_s)
        record = self._app.step(seen, self._telemetry(t_s, now_s), now_s, t_capture_s)
        self._record = self._flight_record = record
        self._due_s.pop("stream", None)
        if record.target.status is TargetStatus.LOST:
            self._stop(now_s, FlightReason.HELD_LONG)
        return self._loop_record(record, now_s)

    def searches(self, t_s: float) -> int:
        """How many windows will be searched in a picture exposed at `t_s`."""
        return self._app.searches(t_s)

    def searched_px(self, t_s: float) -> tuple[tuple[float, float], ...]:
        """Centre of the search region in a picture exposed at `t_s`; None while nothing is selected."""
        return self._app.searched_px(t_s)

    def poll(self, now_s: float) -> None:
        """Receive, keep the link alive, look at the mode, send what is due. Call it often; it costs little."""
        if now_s - self._polled_s > MAX_POLL_GAP_S:
            self.supervisor.stop(now_s, FlightReason.STALLED)
            self._trusted_after_s = now_s
        self._polled_s = now_s
        self._guarded("receive", self._receive, now_s)
        self.supervisor.step(self.autopilot.status(now_s), now_s)
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
                self._stop(now_s, FlightReason.FAULT)

    def _stop(self, now_s: float, reason: FlightReason) -> None:
        """End following; the last word is a stop, for ArduPilot flies on for 3 s after silence."""
        try:
            self._send_stop(now_s)
        except Exception:  # it ends all the same
            self.faults += 1
            log.exception("the stop could not be sent at %.3f s", now_s)
        self.supervisor.stop(now_s, reason)

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
            # After each, not after all: a mode that came and went between two polls has been here too.
            self.supervisor.step(self.autopilot.status(now_s), now_s)
        if self.autopilot.reboots != self._reboots:
            self._reboots = self.autopilot.reboots
            self._restarted(now_s)
        view = self.autopilot
        self.grant.update(self._commands.outcomes, view.gimbal_primary, view.gimbal_primary_s, now_s)
        self._commands.outcomes.clear()

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
        if math.isinf(self.autopilot.status(now_s).t_heartbeat_s):
            return  # nobody there yet
        silent = now_s - self.autopilot.oldest_stream_s(STREAM_NAMES) > STREAMS_LOST_S
        if self._asked_streams and self._commands.is_idle and silent:
            # A restart of the autopilot or another route of the link: nothing comes unless it is asked for.
            self._asked_streams = not self._is_due("streams", STREAMS_RETRY_S, now_s)
        if not self._asked_streams:
            self._asked_streams = True
            self._due_s["streams"] = now_s + STREAMS_RETRY_S
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
        if not self._is_due("stream", self._config.repeat_after_s, now_s):
            return
        record, flown = self._record, self._flight_record
        command = flown.velocity_command if flown is not None else None
        t_picture_s = flown.target.t_s if flown is not None else now_s
        passed = self.supervisor.passed(command, t_picture_s, self.autopilot.status(now_s), now_s)
        if passed is not None:
            self._send_velocity(passed, now_s)
            if passed is not command:
                self._app.reset_flight()  # zeros went out: the limits start from there
        if record is not None and self.grant.state is GrantState.HELD:
            self._send_gimbal(record, now_s)

    def _send_gimbal(self, record: StepRecord, now_s: float) -> None:
        gimbal = record.gimbal_command
        has_angle = gimbal.pitch_rad is not None and gimbal.yaw_rad is not None
        if has_angle and is_fresh(gimbal.t_s, now_s, MAX_GIMBAL_AGE_S):
            self._send(gimbal_angle(gimbal, self._config.gimbal_device_id, self._config.target_system))

    def _send_stop(self, now_s: float) -> None:
        hold = self.supervisor.passed(None, now_s, self.autopilot.status(now_s), now_s)
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

    def _loop_record(self, record: StepRecord, now_s: float) -> LoopRecord:
        return LoopRecord(record, self.supervisor.permission, self.autopilot.status(now_s), self.grant.state)
