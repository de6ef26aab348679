"""Byte links: how the simulated autopilot hears and speaks."""

from __future__ import annotations

from typing import Protocol


class ByteLink(Protocol):
    """One end of a two-way stream of bytes. Neither call waits."""

    def write(self, data: bytes) -> None:
        """Send `data`."""

    def read_available(self) -> bytes:
        """Everything that arrived since the last call; empty when nothing did."""


class PipeEnd:
    """One end of an in-process pipe; see `pipe`."""

    __slots__ = ("_inbox", "_outbox")

    def __init__(self, inbox: bytearray, outbox: bytearray) -> None:
        self._inbox = inbox
        self._outbox = outbox

    def write(self, data: bytes) -> None:
        """Hand `data` to the other end."""
        self._outbox += data

    def read_available(self) -> bytes:
        """What the other end wrote since the last call."""
        data = bytes(self._inbox)
        self._inbox.clear()
        return data


def pipe() -> tuple[PipeEnd, PipeEnd]:
    """Two ends of a lossless pipe without delay; each reads what the other wrote."""
    there, back = bytearray(), bytearray()
    return PipeEnd(back, there), PipeEnd(there, back)
