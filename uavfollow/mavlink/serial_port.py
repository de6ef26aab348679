"""Serial links: a UART or USB port, opened again with back-off when it vanishes."""

from __future__ import annotations

import os
import select
import time
from collections.abc import Callable
from typing import Any

from uavfollow.mavlink.transport import (
    MAX_READ_BYTES,
    READ_CHUNK_BYTES,
    Backoff,
    Counters,
    LinkError,
    LinkStats,
    Outbox,
)

_LOST_EVENTS = select.POLLHUP | select.POLLERR | select.POLLNVAL


class SerialLink:
    """A serial device at `baud` bit/s, 8N1, held exclusively.

    Raises `LinkError` when pyserial is missing or the device can't be opened. A device that vanishes later is counted
    and looked for again by the following calls.
    """

    def __init__(self, device: str, baud: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._device = device
        self._baud = baud
        self._clock = clock
        self._counters = Counters()
        self._backoff = Backoff()
        self._outbox = Outbox()
        self._is_open = True
        self._port: Any = self._open_port()

    def write(self, data: bytes) -> None:
        """Send, keep up to `MAX_UNSENT_BYTES` for a slow line, or count as dropped."""
        if not self._advance() or not self._outbox.offer(data):
            self._counters.dropped()
            return
        self._flush()
        if self._port is not None:
            self._counters.sent(len(data))
        else:
            self._counters.dropped()

    def read_available(self) -> bytes:
        """All bytes that have arrived."""
        if not self._advance():
            return b""
        self._flush()
        data = bytearray()
        while self._port is not None and len(data) < MAX_READ_BYTES:
            try:
                chunk = os.read(self._port.fileno(), READ_CHUNK_BYTES)
            except (BlockingIOError, InterruptedError):
                break
            except OSError as error:
                self._lose(error)
                break
            if not chunk:
                self._check_line()
                break
            data += chunk
        if data:
            self._counters.received(len(data))
        return bytes(data)

    def close(self) -> None:
        """Close the device and look for it no more."""
        self._is_open = False
        self._drop_port()

    def fileno(self) -> int | None:
        """The device, None while it is away."""
        return int(self._port.fileno()) if self._port is not None else None

    @property
    def is_open(self) -> bool:
        """Whether `close` has not been called."""
        return self._is_open

    @property
    def is_connected(self) -> bool:
        """Whether the device is there."""
        return self._port is not None

    @property
    def stats(self) -> LinkStats:
        """What has gone through."""
        return self._counters.snapshot()

    def _open_port(self) -> Any:
        try:
            import serial
        except ImportError as error:
            raise LinkError(
                f"can't open {self._device}: serial links need pyserial; run: pip install 'uavfollow[serial]'"
            ) from error
        try:
            # pyserial sets the line up; reading and writing go to the descriptor, since pyserial's write spins on a
            # full line even with a time-out of 0.
            return serial.Serial(self._device, self._baud, timeout=0, write_timeout=0, exclusive=True)
        except (OSError, ValueError) as error:
            raise LinkError(
                f"can't open {self._device} at {self._baud} baud: {error}; check the cable, the name (ls /dev/tty*), "
                "that no other program uses it, and membership of the group 'dialout'"
            ) from error

    def _advance(self) -> bool:
        """Look for a lost device when it is time to; True when there is one."""
        if not self._is_open:
            return False
        if self._port is None and self._backoff.is_due(self._clock()):
            try:
                self._port = self._open_port()
                self._backoff.succeeded()
            except LinkError as error:
                self._counters.failed(error)
                self._backoff.failed(self._clock())
        return self._port is not None

    def _check_line(self) -> None:
        """Tell a lost line from an idle one: both read as empty."""
        poll = select.poll()
        poll.register(self._port.fileno(), select.POLLIN)
        events = poll.poll(0)
        if events and events[0][1] & _LOST_EVENTS:
            self._lose(f"{self._device} hung up")

    def _flush(self) -> None:
        if self._port is None:
            return
        try:
            self._outbox.flush(lambda data: os.write(self._port.fileno(), data))
        except OSError as error:
            self._lose(error)

    def _lose(self, error: object) -> None:
        self._counters.failed(error)
        self._backoff.failed(self._clock())
        self._drop_port()

    def _drop_port(self) -> None:
        port, self._port = self._port, None
        self._outbox.clear()
        if port is not None:
            try:
                port.close()
            except OSError as error:
                self._counters.failed(error)
