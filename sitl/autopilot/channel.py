"""One link of the autopilot: parser, packer with a sequence of its own, message intervals."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.link import ByteLink

# MAV_COMP_ID_AUTOPILOT1
AUTOPILOT_COMPID = 1
# Bytes handed to the parser at once: it copies what it has not used yet.
CHUNK_BYTES = 4096
NEVER_S = float("inf")
# Times are sums of intervals: rounding must not cost a tick.
TIME_SLACK_S = 1e-9

Message = Any  # pymavlink has no types


class Channel:
    """What is particular to one link; `due_s` is when its next streamed message is to be sent."""

    __slots__ = ("_intervals", "_link", "_mav", "_next", "_parser", "due_s", "name")

    def __init__(self, link: ByteLink, name: str, sysid: int) -> None:
        self.name = name
        self._link = link
        self._mav = mavlink.MAVLink(link, srcSystem=sysid, srcComponent=AUTOPILOT_COMPID)
        self._parser = self._new_parser()
        self._intervals: dict[int, float] = {}
        self._next: dict[int, float] = {}
        self.due_s = NEVER_S

    @staticmethod
    def _new_parser() -> Message:
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        return parser

    def set_sysid(self, sysid: int) -> None:
        """Send as another system from now on."""
        self._mav.srcSystem = sysid

    def reset(self) -> None:
        """As after a reboot: nothing is streamed, half a frame is forgotten."""
        self._parser = self._new_parser()
        self._intervals.clear()
        self._next.clear()
        self.due_s = NEVER_S

    def receive(self) -> list[Message]:
        """Every whole message that has arrived; what is no MAVLink is passed over."""
        data = self._link.read_available()
        messages: list[Message] = []
        for start in range(0, len(data), CHUNK_BYTES):
            messages += self._parse(data[start : start + CHUNK_BYTES])
        return messages

    def _parse(self, chunk: bytes) -> list[Message]:
        try:
            parsed = self._parser.parse_buffer(chunk) or []
        except Exception:  # a parser that stumbles over bytes must not end the flight: start it afresh
            self._parser = self._new_parser()
            return []
        return [m for m in parsed if m.get_msgId() >= 0]

    def send(self, message: Message) -> None:
        """Send a message of the autopilot's own."""
        self._mav.send(message)

    def forward(self, message: Message) -> None:
        """Pass on someone else's message, byte for byte."""
        self._link.write(bytes(message.get_msgbuf()))

    # --- streams -------------------------------------------------------------------------------------------------

    def set_interval(self, message_id: int, interval_s: float | None, now_s: float) -> None:
        """Stream a message from now on, or no more (None)."""
        if interval_s is None:
            self._intervals.pop(message_id, None)
            self._next.pop(message_id, None)
        else:
            self._intervals[message_id] = interval_s
            self._next[message_id] = now_s
        self.due_s = min(self._next.values(), default=NEVER_S)

    def interval(self, message_id: int) -> float | None:
        """Interval of a streamed message; None if it is not."""
        return self._intervals.get(message_id)

    def take_due(self, now_s: float) -> list[int]:
        """Ids to be sent now, each at most once, in the order of the ids; their next time is set."""
        due = sorted(i for i, t in self._next.items() if t <= now_s + TIME_SLACK_S)
        for message_id in due:
            following = self._next[message_id] + self._intervals[message_id]
            # A rate beyond that of the physics is sent in every tick, without a backlog.
            self._next[message_id] = max(following, now_s)
        self.due_s = min(self._next.values(), default=NEVER_S)
        return due
