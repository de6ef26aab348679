"""Messages to bytes and bytes to messages, by pymavlink's `ardupilotmega` dialect of MAVLink 2."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega

# pymavlink ships no types; the name says what is meant.
Message = Any

MAGIC_V1 = 0xFE
MAGIC_V2 = 0xFD
SIGNED_FLAG = 0x01  # the only incompatibility flag MAVLink 2 has (MAVLINK_IFLAG_SIGNED)
_V1_OVERHEAD_BYTES = 8  # 6 of header, 2 of checksum
_V2_OVERHEAD_BYTES = 12  # 10 of header, 2 of checksum
_SIGNATURE_BYTES = 13
_SEQUENCE_MODULUS = 256  # the sequence number is one byte


class PackError(ValueError):
    """A message with a field that does not fit the wire."""


def frame_size_bytes(head: bytes | bytearray) -> int | None:
    """Size of the frame that begins with `head` (its first 3 bytes suffice); None when it is no frame or too short."""
    if len(head) < 3:
        return None
    if head[0] == MAGIC_V1:
        return head[1] + _V1_OVERHEAD_BYTES
    if head[0] == MAGIC_V2:
        return head[1] + _V2_OVERHEAD_BYTES + (_SIGNATURE_BYTES if head[2] & SIGNED_FLAG else 0)
    return None


class Packer:
    """Packs the messages of one component: own ids (1..255), own sequence numbers 0..255, always MAVLink 2."""

    def __init__(self, system_id: int, component_id: int) -> None:
        for name, value in (("system_id", system_id), ("component_id", component_id)):
            if not 1 <= value <= 255:
                raise ValueError(f"{name} of a MAVLink component is {value}; give 1 to 255")
        self.system_id = system_id
        self.component_id = component_id
        self._mav = ardupilotmega.MAVLink(None, srcSystem=system_id, srcComponent=component_id)

    def pack(self, message: Message) -> bytes:
        """One frame; counts the sequence number up. Raises `PackError` and counts nothing when a field does not fit."""
        try:
            frame = bytes(message.pack(self._mav))
        except (struct.error, TypeError, ValueError, IndexError, OverflowError, AttributeError) as error:
            name = message.get_type() if hasattr(message, "get_type") else type(message).__name__
            raise PackError(f"{name} can't be packed: {error}; check the types and ranges of its fields") from error
        self._mav.seq = (self._mav.seq + 1) % _SEQUENCE_MODULUS
        return frame


@dataclass(frozen=True, slots=True)
class ParserStats:
    """What a parser has seen: whole messages, ids the dialect does not know, runs of bad bytes and their size."""

    messages: int = 0
    unknown: int = 0
    bad_data: int = 0
    bad_bytes: int = 0


class Parser:
    """Turns the bytes of one link into messages; garbage is counted and skipped, never raised.

    Fields are given as they came: floats may be NaN. Messages of unknown ids are counted and left out.
    """

    def __init__(self) -> None:
        self._mav = _new_mav()
        self._messages = self._unknown = self._bad_data = self._bad_bytes = 0

    def parse(self, data: bytes) -> list[Message]:
        """All messages completed by `data`, in order; hand over whole chunks, single bytes cost ten times as much.

        pymavlink throws away the whole length that a stray magic byte or a cut frame claims. The bytes after such a
        magic are looked at again here, so the good frames among them are only late, not lost.
        """
        messages: list[Message] = []
        mav = self._mav
        item = mav.parse_char(data)
        while item is not None:
            if item.get_type() == "BAD_DATA" or (_is_unknown(item) and not self._next_can_begin_a_frame()):
                self._skip_bad(item.data)
            else:
                self._take(item, messages)
            item = mav.parse_char(b"")
        # pymavlink frees its buffer only when a chunk ends with a frame, which a byte stream need never do.
        del mav.buf[: mav.buf_index]
        mav.buf_index = 0
        return messages

    def decode(self, frame: bytes) -> Message | None:
        """The message of exactly one frame, None (counted) when it is bad or unknown. Leaves `parse` undisturbed."""
        if frame_size_bytes(frame) != len(frame):
            self._count_bad(len(frame))
            return None
        messages: list[Message] = []
        try:
            self._take(_new_mav().decode(bytearray(frame)), messages)
        except ardupilotmega.MAVError:
            self._count_bad(len(frame))
        return messages[0] if messages else None

    @property
    def stats(self) -> ParserStats:
        """What has been seen so far."""
        return ParserStats(self._messages, self._unknown, self._bad_data, self._bad_bytes)

    def _take(self, item: Message, messages: list[Message]) -> None:
        if _is_unknown(item):
            self._unknown += 1
        else:
            self._messages += 1
            messages.append(item)

    def _next_can_begin_a_frame(self) -> bool:
        """Whether the byte after the last frame is a magic or has not come yet.

        The checksum of an unknown id can't be checked; what follows it is the only sign that its length was true.
        """
        following = self._mav.buf[self._mav.buf_index : self._mav.buf_index + 1]
        return not following or following[0] in (MAGIC_V1, MAGIC_V2)

    def _skip_bad(self, bad: bytearray) -> None:
        """Count bad bytes, and give all but a magic that began no good frame back to the parser's buffer."""
        if bad[0] not in (MAGIC_V1, MAGIC_V2):
            self._count_bad(len(bad))
            return
        self._count_bad(1)
        if self._mav.buf_index:
            self._mav.buf_index -= len(bad) - 1
        else:
            # The bad bytes were the last, and pymavlink has let go of its buffer.
            self._mav.buf = bytearray(bad[1:])

    def _count_bad(self, size_bytes: int) -> None:
        self._bad_data += 1
        self._bad_bytes += size_bytes


def _is_unknown(item: Message) -> bool:
    return bool(item.get_type().startswith("UNKNOWN_"))


def _new_mav() -> Any:
    mav = ardupilotmega.MAVLink(None)
    mav.robust_parsing = True
    return mav
