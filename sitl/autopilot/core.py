"""One power-on of the autopilot: everything that a reboot forgets."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.channel import Channel, Message
from sitl.autopilot.config import ArduCopterConfig
from sitl.autopilot.flight import INFO, Flight
from sitl.autopilot.gimbal_manager import GimbalManager
from sitl.autopilot.messages import Messages
from sitl.autopilot.parameters import TABLE, Parameters
from sitl.autopilot.ports import Gimbal, Vehicle
from sitl.autopilot.rc import RcInput
from sitl.autopilot.routing import Routes
from sitl.autopilot.telemetry import Telemetry

# From power-on until "ArduPilot Ready", as recorded; never longer than the estimator takes.
INITIALISING_S = 2.45
# The autopilot's own TIMESYNC requests.
TIMESYNC_S = 10.0


@dataclass(frozen=True, slots=True)
class Hardware:
    """What survives a reboot."""

    config: ArduCopterConfig
    parameters: Parameters
    rc: RcInput
    vehicle: Vehicle
    gimbal: Gimbal
    channels: list[Channel]
    routes: Routes
    seed: int


class Core:
    """Flight, gimbal manager and telemetry of one power-on, and what they say on the links."""

    HEARTBEAT_S = 1.0
    LOOP_HZ = 400.0

    def __init__(self, hardware: Hardware, boot_s: float, now_s: float) -> None:
        config = hardware.config
        self.config = config
        self.parameters = hardware.parameters
        self.rc = hardware.rc
        self._channels = hardware.channels
        self._routes = hardware.routes
        self._outbox: deque[tuple[Channel | None, Message]] = deque()
        self._parameter_queue: deque[tuple[Channel, int]] = deque()
        self.reboot_asked = False
        ready_at_s = boot_s + config.ready_after_s
        self.flight = Flight(hardware.vehicle, self.parameters, self.rc, self.say, now_s, ready_at_s)
        self.gimbal = GimbalManager(hardware.gimbal, hardware.vehicle, self.parameters, now_s)
        self.telemetry = Telemetry(config, self.flight, self.gimbal, hardware.seed)
        self.telemetry.boot_s = boot_s
        self.telemetry.initialising_until_s = boot_s + min(INITIALISING_S, config.ready_after_s)
        self._messages = Messages(self)
        self._announced_mode = self.flight.mode
        self._greeted = self._located = False
        self._timesync_due_s = boot_s + TIMESYNC_S
        for channel in self._channels:
            self.open(channel)

    def open(self, channel: Channel) -> None:
        """A link begins: heartbeats, nothing else."""
        channel.set_interval(mavlink.MAVLINK_MSG_ID_HEARTBEAT, self.HEARTBEAT_S, self.flight.t_s)

    # --- what is said --------------------------------------------------------------------------------------------

    def say(self, severity: int, text: str) -> None:
        """STATUSTEXT on every link."""
        self.announce(mavlink.MAVLink_statustext_message(severity, text.encode("ascii", "replace")[:50]))

    def announce(self, message: Message | None) -> None:
        """Send on every link, after the acknowledgement of the command at hand."""
        if message is not None:
            self._outbox.append((None, message))

    def after_ack(self, channel: Channel, message: Message) -> None:
        """Send on one link, after the acknowledgement of the command at hand."""
        self._outbox.append((channel, message))

    def flush(self) -> None:
        """Send what waits, and the heartbeat at once when the mode has changed."""
        if self.flight.mode is not self._announced_mode:
            self._announced_mode = self.flight.mode
            self._outbox.appendleft((None, self.telemetry.heartbeat()))
        while self._outbox:
            channel, message = self._outbox.popleft()
            for receiver in self._channels if channel is None else (channel,):
                receiver.send(message)

    def param_value(self, index: int, shown_index: int) -> Message:
        """PARAM_VALUE; every value travels as a float."""
        spec = TABLE[index]
        return mavlink.MAVLink_param_value_message(
            spec.name.encode("ascii"), self.parameters[spec.name], spec.kind, len(TABLE), shown_index
        )

    def list_parameters(self, channel: Channel) -> None:
        """Send the whole table on a link, one parameter a tick."""
        self._parameter_queue.extend((channel, index) for index in range(len(TABLE)))

    def take_parameters(self) -> None:
        """A parameter has changed: take over those that are kept elsewhere too."""
        sysid = int(self.parameters["MAV_SYSID"])
        self._routes.sysid = sysid
        for channel in self._channels:
            channel.set_sysid(sysid)

    # --- time ----------------------------------------------------------------------------------------------------

    def receive(self, channel: Channel) -> None:
        """Read a link and do what it asks for."""
        for message in channel.receive():
            if self._routes.handle(message, channel, self._channels):
                self._messages.handle(message, channel)
                self.flush()

    def tick(self, next_s: float, dt_s: float, silent: bool) -> None:
        """Advance to `next_s` and send what is due by then; `silent` while the processor starts."""
        t_s = self.flight.t_s
        self.flight.tick(next_s, dt_s)
        self.gimbal.update(t_s, dt_s)
        if silent:
            return
        self._greet()
        self.flush()
        for channel in self._channels:
            if channel.due_s <= next_s:
                self._stream(channel, next_s)
        if self._parameter_queue:
            channel, index = self._parameter_queue.popleft()
            channel.send(self.param_value(index, index))
        if next_s >= self._timesync_due_s:
            self._timesync_due_s += TIMESYNC_S
            request = mavlink.MAVLink_timesync_message(0, self.telemetry.boot_ns + int(self.parameters["MAV_SYSID"]))
            for channel in self._channels:
                channel.send(request)

    def _stream(self, channel: Channel, now_s: float) -> None:
        initialising = self.telemetry.initialising
        for message_id in channel.take_due(now_s):
            if initialising and message_id != mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                continue
            message = self.telemetry.build(message_id)
            if message is not None:
                channel.send(message)

    def _greet(self) -> None:
        if not self._greeted and not self.telemetry.initialising:
            self._greeted = True
            self.say(INFO, "ArduPilot Ready")
        if not self._located and self.flight.has_position:
            self._located = True
            self.say(INFO, "EKF3 IMU0 is using GPS")
            self.announce(self.telemetry.home())
            self.announce(self.telemetry.origin())
