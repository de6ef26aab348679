"""An in-process byte pipe: the deterministic link of lockstep simulation and tests."""

from __future__ import annotations

from uavfollow.mavlink.transport import Counters, LinkStats

# Many seconds of telemetry; a reader that far behind has stopped, and memory must not grow for it.
PIPE_CAPACITY_BYTES = 1024 * 1024


class PipeLink:
    """One end of a pipe; make both with `pair`. Whole writes are dropped and counted when the pipe is full."""

    def __init__(self, inbox: bytearray, outbox: bytearray, capacity_bytes: int) -> None:
        self._inbox = inbox
        self._outbox = outbox
        self._capacity_bytes = capacity_bytes
        self._peer: PipeLink | None = None
        self._is_open = True
        self._counters = Counters()

    @classmethod
    def pair(cls, capacity_bytes: int = PIPE_CAPACITY_BYTES) -> tuple[PipeLink, PipeLink]:
        """Two ends; what one writes the other reads. `capacity_bytes` bounds each direction."""
        if capacity_bytes < 1:
            raise ValueError(f"capacity_bytes of a pipe is {capacity_bytes}; give at least 1")
        there, back = bytearray(), bytearray()
        first, second = cls(back, there, capacity_bytes), cls(there, back, capacity_bytes)
        first._peer, second._peer = second, first
        return first, second

    def write(self, data: bytes) -> None:
        """Append to the other end's inbox, or count a drop when it is full or either end is closed."""
        if not self.is_connected or len(self._outbox) + len(data) > self._capacity_bytes:
            self._counters.dropped()
            return
        self._outbox += data
        self._counters.sent(len(data))

    def read_available(self) -> bytes:
        """Everything the other end has written since the last call."""
        if not self._is_open or not self._inbox:
            return b""
        data = bytes(self._inbox)
        self._inbox.clear()
        self._counters.received(len(data))
        return data

    def close(self) -> None:
        """Close this end; the other end's writes then count as dropped."""
        self._is_open = False
        self._inbox.clear()

    def fileno(self) -> int | None:
        """None: there is nothing to wait on."""
        return None

    @property
    def is_open(self) -> bool:
        """Whether this end has not been closed."""
        return self._is_open

    @property
    def is_connected(self) -> bool:
        """Whether both ends are open."""
        return self._is_open and self._peer is not None and self._peer._is_open

    @property
    def stats(self) -> LinkStats:
        """What has gone through this end."""
        return self._counters.snapshot()
