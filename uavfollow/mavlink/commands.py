"""Commands to the autopilot, one after the other: each is sent again until it is answered."""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega

from uavfollow.mavlink.ids import AUTOPILOT_COMPONENT, CMD_REQUEST_MESSAGE, CMD_SET_MESSAGE_INTERVAL
from uavfollow.mavlink.packer import Message

log = logging.getLogger(__name__)

RETRY_S = 1.0  # answers come within 10 ms on a wire and some 100 ms on a radio
MAX_TRIES = 5
RESULT_ACCEPTED = 0
RESULT_IN_PROGRESS = 5


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a command ended: the MAV_RESULT of its answer, None when none came."""

    command: int
    param1: float
    result: int | None

    @property
    def accepted(self) -> bool:
        """Whether the autopilot said yes."""
        return self.result == RESULT_ACCEPTED


class CommandQueue:
    """COMMAND_LONG messages in order; the next one waits for the answer to the one before, or for `MAX_TRIES`."""

    def __init__(self, own_system: int, own_component: int) -> None:
        self._own = (own_system, own_component)
        self._waiting: deque[Message] = deque()
        self._tries = 0
        self._sent_s = 0.0
        self.outcomes: list[Outcome] = []

    def add(self, message: Message) -> None:
        """Queue a COMMAND_LONG."""
        self._waiting.append(message)

    def clear(self) -> None:
        """Drop what waits, as after a reboot of the autopilot."""
        self._waiting.clear()
        self._tries = 0

    @property
    def is_idle(self) -> bool:
        """Nothing waits for an answer."""
        return not self._waiting

    def due(self, now_s: float) -> Message | None:
        """The message to send now, if any; its `confirmation` counts the tries."""
        while self._waiting:
            if self._tries and now_s - self._sent_s < RETRY_S:
                return None
            if self._tries < MAX_TRIES:
                message = self._waiting[0]
                message.confirmation = self._tries
                self._tries, self._sent_s = self._tries + 1, now_s
                return message
            self._finish(None)
        return None

    def answered(self, ack: Message) -> None:
        """Take a COMMAND_ACK; one that answers somebody else, or nothing that waits, changes nothing."""
        if not self._waiting or ack.command != self._waiting[0].command or self._tries == 0:
            return
        if (ack.target_system, ack.target_component) not in (self._own, (0, 0)):
            return
        if ack.result != RESULT_IN_PROGRESS:
            self._finish(int(ack.result))

    def _finish(self, result: int | None) -> None:
        message = self._waiting.popleft()
        self._tries = 0
        outcome = Outcome(int(message.command), float(message.param1), result)
        self.outcomes.append(outcome)
        if not outcome.accepted:
            answer = "no answer" if result is None else f"result {result}"
            log.warning("command %d (%g): %s from the autopilot", outcome.command, outcome.param1, answer)


def message_interval(target_system: int, message_id: int, rate_hz: float) -> Message:
    """COMMAND_LONG SET_MESSAGE_INTERVAL (511): `message_id` at `rate_hz` (above 0) on this link."""
    return _command(target_system, CMD_SET_MESSAGE_INTERVAL, float(message_id), float(round(1e6 / rate_hz)))


def request_message(target_system: int, message_id: int) -> Message:
    """COMMAND_LONG REQUEST_MESSAGE (512)."""
    return _command(target_system, CMD_REQUEST_MESSAGE, float(message_id), 0.0)


def _command(target_system: int, command: int, param1: float, param2: float) -> Message:
    return ardupilotmega.MAVLink_command_long_message(
        target_system=target_system,
        target_component=AUTOPILOT_COMPONENT,
        command=command,
        confirmation=0,
        param1=param1,
        param2=param2,
        param3=0.0,
        param4=0.0,
        param5=0.0,
        param6=0.0,
        param7=0.0,
    )
