"""What every link is: bytes out, bytes in, never blocking, never raising inside the loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

# More than a kernel receive buffer holds: only a sender faster than we read reaches it, and the next call goes on.
MAX_READ_BYTES = 4 * 1024 * 1024
READ_CHUNK_BYTES = 65536  # the largest datagram; also a good size for streams
# About one second of our own traffic: commands older than that must not be delivered in a burst after a stall.
MAX_UNSENT_BYTES = 4096
RECONNECT_FIRST_S = 0.5  # an autopilot reboots in 1-2 s, so the first tries come soon
RECONNECT_MAX_S = 8.0  # a link that has been away for long is still found within some seconds


class LinkError(OSError):
    """A link that can't be opened; one line: what, where, what to do next."""


@dataclass(frozen=True, slots=True)
class LinkStats:
    """A snapshot of what went through a link. A packet is one `write` out, one datagram or chunk in.

    `dropped_packets` were handed to `write` and never left (no peer, full buffer, closed); `errors` counts failures
    of the medium and `last_error` words the newest.
    """

    bytes_in: int = 0
    packets_in: int = 0
    bytes_out: int = 0
    packets_out: int = 0
    dropped_packets: int = 0
    errors: int = 0
    last_error: str = ""


class Link(Protocol):
    """A carrier of MAVLink bytes, used by one thread."""

    def write(self, data: bytes) -> None:
        """Hand over one frame; it is sent, kept for the next call, or counted as dropped. Never blocks or raises."""

    def read_available(self) -> bytes:
        """Return all bytes that have arrived, b"" when there are none. Never blocks or raises."""

    def close(self) -> None:
        """Release the medium; a second call does nothing."""

    def fileno(self) -> int | None:
        """A descriptor to wait on with `select` until something arrives, None when there is none just now."""

    @property
    def is_open(self) -> bool:
        """Whether `close` has not been called."""

    @property
    def is_connected(self) -> bool:
        """Whether a `write` has somewhere to go, as far as is known here. Liveness is judged by heartbeats."""

    @property
    def stats(self) -> LinkStats:
        """What has gone through so far."""


class Counters:
    """Counts what goes through one link."""

    def __init__(self) -> None:
        self._bytes_in = self._packets_in = self._bytes_out = self._packets_out = 0
        self._dropped_packets = self._errors = 0
        self._last_error = ""

    def received(self, size_bytes: int) -> None:
        """Count one datagram or chunk."""
        self._bytes_in += size_bytes
        self._packets_in += 1

    def sent(self, size_bytes: int) -> None:
        """Count one packet that was handed to the medium."""
        self._bytes_out += size_bytes
        self._packets_out += 1

    def dropped(self) -> None:
        """Count one packet that went nowhere."""
        self._dropped_packets += 1

    def failed(self, error: object) -> None:
        """Count one failure of the medium."""
        self._errors += 1
        self._last_error = str(error)

    def snapshot(self) -> LinkStats:
        """The counts so far."""
        return LinkStats(
            self._bytes_in,
            self._packets_in,
            self._bytes_out,
            self._packets_out,
            self._dropped_packets,
            self._errors,
            self._last_error,
        )


class Outbox:
    """Bytes a stream did not take at once; whole packets are refused when `MAX_UNSENT_BYTES` already wait."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def offer(self, data: bytes) -> bool:
        """Queue a packet; False when it does not fit. A packet larger than the limit passes only an empty queue."""
        if self._waiting and len(self._waiting) + len(data) > MAX_UNSENT_BYTES:
            return False
        self._waiting += data
        return True

    def flush(self, send: Callable[[bytes], int]) -> None:
        """Send what waits by `send`, which returns how many bytes it took; stops when the medium is full.

        Raises the `OSError` of `send`, except for "would block".
        """
        while self._waiting:
            try:
                taken = send(bytes(self._waiting))
            except (BlockingIOError, InterruptedError):
                return
            if taken <= 0:
                return
            del self._waiting[:taken]

    def clear(self) -> None:
        """Forget what waits: old commands must not reach a peer that comes back."""
        self._waiting.clear()


class Backoff:
    """When to try a connection again: `RECONNECT_FIRST_S`, doubling up to `RECONNECT_MAX_S`."""

    def __init__(self) -> None:
        self._delay_s = RECONNECT_FIRST_S
        self._next_s = float("-inf")

    def is_due(self, now_s: float) -> bool:
        """Whether a try is due at `now_s`."""
        return now_s >= self._next_s

    def failed(self, now_s: float) -> None:
        """Put off the next try."""
        self._next_s = now_s + self._delay_s
        self._delay_s = min(2 * self._delay_s, RECONNECT_MAX_S)

    def succeeded(self) -> None:
        """Begin again with the short delay."""
        self._delay_s = RECONNECT_FIRST_S
        self._next_s = float("-inf")
