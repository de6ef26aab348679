"""TCP links: a client that reconnects and a server for one client, both driven by calls and never blocking."""

from __future__ import annotations

import errno
import os
import socket
import time
from collections.abc import Callable

from uavfollow.mavlink.transport import (
    MAX_READ_BYTES,
    READ_CHUNK_BYTES,
    Backoff,
    Counters,
    LinkError,
    LinkStats,
    Outbox,
)

OPEN_TIMEOUT_S = 3.0  # the first connection may block at start-up; a reachable peer answers well within it
CONNECT_TIMEOUT_S = 5.0  # later tries: a peer that does not even refuse is tried afresh
SEND_BUFFER_BYTES = 8192  # a small kernel buffer: what waits in it is stale when a stalled peer comes back
UNACKNOWLEDGED_MAX_MS = 5000  # a cable pulled out: the kernel alone would go on resending for a quarter of an hour


class TcpClientLink:
    """Connects to `host:port` and connects again, with back-off, whenever the connection is lost.

    With `must_connect` the first connection is made here (blocking for up to `OPEN_TIMEOUT_S`) and its failure raises
    `LinkError`; without, it is tried by the later calls. An unknown host raises `LinkError` either way.
    """

    def __init__(
        self, host: str, port: int, must_connect: bool = True, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._clock = clock
        self._counters = Counters()
        self._backoff = Backoff()
        self._stream: _Stream | None = None
        self._connecting: socket.socket | None = None
        self._connect_deadline_s = 0.0
        self._is_open = True
        self._family, self._address = _resolve(host, port)
        if must_connect:
            self._connect_now(host, port)

    def write(self, data: bytes) -> None:
        """Send, or count as dropped while there is no connection."""
        stream = self._advance()
        if stream is None:
            self._counters.dropped()
        else:
            stream.write(data)

    def read_available(self) -> bytes:
        """All bytes that have arrived; b"" while there is no connection."""
        stream = self._advance()
        return b"" if stream is None else stream.read()

    def close(self) -> None:
        """Close the connection and try no more."""
        self._is_open = False
        if self._stream is not None:
            self._stream.close()
        if self._connecting is not None:
            self._connecting.close()
        self._stream = self._connecting = None

    def fileno(self) -> int | None:
        """The connection's socket, None while there is none."""
        return self._stream.fileno() if self._stream is not None else None

    @property
    def is_open(self) -> bool:
        """Whether `close` has not been called."""
        return self._is_open

    @property
    def is_connected(self) -> bool:
        """Whether a connection stands."""
        return self._stream is not None and self._stream.is_alive

    @property
    def stats(self) -> LinkStats:
        """What has gone through, over all connections."""
        return self._counters.snapshot()

    def _connect_now(self, host: str, port: int) -> None:
        tcp = socket.socket(self._family, socket.SOCK_STREAM)
        tcp.settimeout(OPEN_TIMEOUT_S)
        try:
            tcp.connect(self._address)
        except OSError as error:
            tcp.close()
            raise LinkError(
                f"can't connect to TCP {host}:{port}: {error.strerror or error}; start the program that listens there "
                "or correct the address"
            ) from error
        self._stream = _Stream(tcp, self._counters)

    def _advance(self) -> _Stream | None:
        now_s = self._clock()
        if self._stream is not None and not self._stream.is_alive:
            self._stream = None
            self._backoff.failed(now_s)
        if self._stream is None and self._is_open:
            if self._connecting is None and self._backoff.is_due(now_s):
                self._begin_connecting(now_s)
            if self._connecting is not None:
                self._finish_connecting(now_s)
        return self._stream

    def _begin_connecting(self, now_s: float) -> None:
        self._connecting = socket.socket(self._family, socket.SOCK_STREAM)
        self._connecting.setblocking(False)
        self._connect_deadline_s = now_s + CONNECT_TIMEOUT_S
        code = self._connecting.connect_ex(self._address)
        if code not in (0, errno.EINPROGRESS):
            self._give_up_connecting(now_s, code)

    def _finish_connecting(self, now_s: float) -> None:
        tcp = self._connecting
        assert tcp is not None
        # A second connect tells the state without waiting: done, still under way, or the reason of the failure.
        code = tcp.connect_ex(self._address)
        if code in (0, errno.EISCONN):
            self._connecting = None
            self._backoff.succeeded()
            self._stream = _Stream(tcp, self._counters)
        elif code not in (errno.EALREADY, errno.EINPROGRESS):
            self._give_up_connecting(now_s, code)
        elif now_s >= self._connect_deadline_s:
            self._give_up_connecting(now_s, errno.ETIMEDOUT)

    def _give_up_connecting(self, now_s: float, code: int) -> None:
        assert self._connecting is not None
        self._connecting.close()
        self._connecting = None
        self._counters.failed(os.strerror(code))
        self._backoff.failed(now_s)


class TcpServerLink:
    """Listens on `host:port` for one client; a new client replaces the old one.

    Two clients at once would interleave parts of frames; and a client that restarts must not wait for its own dead
    connection. `port` 0 takes any free one. Raises `LinkError` when the address is in use or not ours.
    """

    def __init__(self, host: str, port: int) -> None:
        family, address = _resolve(host, port)
        self._counters = Counters()
        self._stream: _Stream | None = None
        self._listener = socket.socket(family, socket.SOCK_STREAM)
        # For TCP this only lets a restarted program listen while old connections time out; it shares no port.
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.setblocking(False)
        try:
            self._listener.bind(address)
            self._listener.listen()
        except OSError as error:
            self._listener.close()
            raise LinkError(
                f"can't listen on TCP {host}:{port}: {error.strerror}; close the program that uses the port, or use "
                "another port or one of this machine's addresses"
            ) from error

    @property
    def port(self) -> int:
        """The port listened on."""
        return int(self._listener.getsockname()[1])

    def write(self, data: bytes) -> None:
        """Send to the client, or count as dropped while there is none."""
        stream = self._advance()
        if stream is None:
            self._counters.dropped()
        else:
            stream.write(data)

    def read_available(self) -> bytes:
        """All bytes the client has sent."""
        stream = self._advance()
        return b"" if stream is None else stream.read()

    def close(self) -> None:
        """Close the client's connection and listen no more."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None
        self._listener.close()

    def fileno(self) -> int | None:
        """The client's socket, or the listening one while there is no client."""
        if not self.is_open:
            return None
        return self._stream.fileno() if self._stream is not None else self._listener.fileno()

    @property
    def is_open(self) -> bool:
        """Whether it listens."""
        return self._listener.fileno() >= 0

    @property
    def is_connected(self) -> bool:
        """Whether a client's connection stands."""
        return self._stream is not None and self._stream.is_alive

    @property
    def stats(self) -> LinkStats:
        """What has gone through, over all clients."""
        return self._counters.snapshot()

    def _advance(self) -> _Stream | None:
        if self._stream is not None and not self._stream.is_alive:
            self._stream = None
        if not self.is_open:
            return None
        try:
            client, _ = self._listener.accept()
        except (BlockingIOError, InterruptedError):
            return self._stream
        except OSError as error:
            self._counters.failed(error)
            return self._stream
        if self._stream is not None:
            self._stream.close()
        self._stream = _Stream(client, self._counters)
        return self._stream


class _Stream:
    """One connected socket; not alive any more after its first failure or the peer's end."""

    def __init__(self, tcp: socket.socket, counters: Counters) -> None:
        tcp.setblocking(False)
        tcp.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        tcp.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            tcp.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNACKNOWLEDGED_MAX_MS)
        self._tcp = tcp
        self._counters = counters
        self._outbox = Outbox()
        self.is_alive = True

    def write(self, data: bytes) -> None:
        if not self._outbox.offer(data):
            self._counters.dropped()
            self._flush()
            return
        self._flush()
        if self.is_alive:
            self._counters.sent(len(data))
        else:
            self._counters.dropped()

    def read(self) -> bytes:
        self._flush()
        data = bytearray()
        while self.is_alive and len(data) < MAX_READ_BYTES:
            try:
                chunk = self._tcp.recv(READ_CHUNK_BYTES)
            except (BlockingIOError, InterruptedError):
                break
            except OSError as error:
                self._fail(error)
                break
            if not chunk:
                self._fail("the peer closed the connection")
                break
            data += chunk
        if data:
            self._counters.received(len(data))
        return bytes(data)

    def close(self) -> None:
        self.is_alive = False
        self._outbox.clear()
        self._tcp.close()

    def fileno(self) -> int | None:
        return self._tcp.fileno() if self.is_alive else None

    def _flush(self) -> None:
        if not self.is_alive:
            return
        try:
            self._outbox.flush(self._tcp.send)
        except OSError as error:
            self._fail(error)

    def _fail(self, error: object) -> None:
        self._counters.failed(error)
        self.close()


def _resolve(host: str, port: int) -> tuple[socket.AddressFamily, tuple[object, ...]]:
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError) as error:
        raise LinkError(f"can't find the host {host!r} of TCP {host}:{port}: {error}; check the name") from error
    return family, address
