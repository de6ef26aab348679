"""UDP links: `udpin` listens and answers whoever spoke, `udpout` speaks to one address."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from enum import Enum

from uavfollow.mavlink.transport import MAX_READ_BYTES, READ_CHUNK_BYTES, Counters, LinkError, LinkStats

PEER_TIMEOUT_S = 10.0  # ten missed heartbeats; a peer that restarts on another port is then forgotten
MAX_PEERS = 16  # a port scan must not turn us into an amplifier
MAX_PENDING_ERRORS = 16  # a refused port reports one error per datagram we sent; more in one call are left for later


class AnswerTo(str, Enum):
    """Whom a listening link answers."""

    ALL = "all"
    LAST = "last"


class UdpInLink:
    """Listens on `host:port` and writes to the peers heard within `PEER_TIMEOUT_S`.

    `port` 0 takes any free one, see `port`. The address is never shared: two programs on one port would each get only
    a part of the datagrams. Raises `LinkError` when the address is in use or not ours.
    """

    def __init__(
        self,
        host: str,
        port: int,
        answer_to: AnswerTo = AnswerTo.ALL,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._socket, address = _udp_socket(host, port)
        self._answer_to = answer_to
        self._clock = clock
        self._heard_s: dict[tuple[object, ...], float] = {}
        self._counters = Counters()
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            raise LinkError(
                f"can't listen on UDP {host}:{port}: {error.strerror}; close the program that uses the port, or use "
                "another port or one of this machine's addresses"
            ) from error

    @property
    def port(self) -> int:
        """The port listened on."""
        return int(self._socket.getsockname()[1])

    def write(self, data: bytes) -> None:
        """Send one datagram to each peer (or the last); counted as dropped when nobody has spoken yet."""
        if not self.is_open:
            self._counters.dropped()
            return
        delivered = False
        for peer in self._current_peers():
            try:
                self._socket.sendto(data, peer)
                delivered = True
            except OSError as error:
                self._counters.failed(error)
        if delivered:
            self._counters.sent(len(data))
        else:
            self._counters.dropped()

    def read_available(self) -> bytes:
        """All datagrams that have arrived, joined; their senders become peers."""
        if not self.is_open:
            return b""
        return _drain(self._socket, self._counters, self._remember)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def fileno(self) -> int | None:
        """The socket."""
        return self._socket.fileno() if self.is_open else None

    @property
    def is_open(self) -> bool:
        """Whether the socket is open."""
        return self._socket.fileno() >= 0

    @property
    def is_connected(self) -> bool:
        """Whether anybody was heard within `PEER_TIMEOUT_S`."""
        return self.is_open and bool(self._current_peers())

    @property
    def stats(self) -> LinkStats:
        """What has gone through; a datagram to several peers counts once."""
        return self._counters.snapshot()

    def _remember(self, peer: tuple[object, ...]) -> None:
        # Moved to the end, so that the order is from the longest silent to the last heard.
        self._heard_s.pop(peer, None)
        self._heard_s[peer] = self._clock()
        if len(self._heard_s) > MAX_PEERS:
            del self._heard_s[next(iter(self._heard_s))]

    def _current_peers(self) -> list[tuple[object, ...]]:
        oldest_s = self._clock() - PEER_TIMEOUT_S
        self._heard_s = {peer: t_s for peer, t_s in self._heard_s.items() if t_s >= oldest_s}
        peers = list(self._heard_s)
        return peers[-1:] if self._answer_to is AnswerTo.LAST else peers


class UdpOutLink:
    """Speaks to `host:port` and hears only that address. Raises `LinkError` when it can't be resolved or reached.

    Nobody listening there is no error: it is counted, and the next write tries again.
    """

    def __init__(self, host: str, port: int) -> None:
        self._socket, address = _udp_socket(host, port)
        self._counters = Counters()
        try:
            self._socket.connect(address)
        except OSError as error:
            self._socket.close()
            raise LinkError(
                f"can't reach UDP {host}:{port}: {error.strerror}; check the address and the network"
            ) from error

    def write(self, data: bytes) -> None:
        """Send one datagram."""
        if not self.is_open:
            self._counters.dropped()
            return
        # The kernel reports the refusal of an earlier datagram on a later one, which then was not sent: try once more.
        for _ in range(2):
            try:
                self._socket.send(data)
            except ConnectionRefusedError as error:
                self._counters.failed(error)
            except OSError as error:
                self._counters.failed(error)
                break
            else:
                self._counters.sent(len(data))
                return
        self._counters.dropped()

    def read_available(self) -> bytes:
        """All datagrams that have arrived, joined."""
        if not self.is_open:
            return b""
        return _drain(self._socket, self._counters, lambda _peer: None)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def fileno(self) -> int | None:
        """The socket."""
        return self._socket.fileno() if self.is_open else None

    @property
    def is_open(self) -> bool:
        """Whether the socket is open."""
        return self._socket.fileno() >= 0

    @property
    def is_connected(self) -> bool:
        """Whether the socket is open: UDP knows no more."""
        return self.is_open

    @property
    def stats(self) -> LinkStats:
        """What has gone through."""
        return self._counters.snapshot()


def _udp_socket(host: str, port: int) -> tuple[socket.socket, tuple[object, ...]]:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except (OSError, UnicodeError) as error:
        raise LinkError(f"can't find the host {host!r} of UDP {host}:{port}: {error}; check the name") from error
    udp = socket.socket(family, kind, protocol)
    udp.setblocking(False)
    return udp, address


def _drain(udp: socket.socket, counters: Counters, heard: Callable[[tuple[object, ...]], None]) -> bytes:
    data = bytearray()
    errors_left = MAX_PENDING_ERRORS
    while len(data) < MAX_READ_BYTES and errors_left > 0:
        try:
            datagram, peer = udp.recvfrom(READ_CHUNK_BYTES)
        except (BlockingIOError, InterruptedError):
            break
        except OSError as error:
            counters.failed(error)
            errors_left -= 1
            continue
        counters.received(len(datagram))
        heard(peer)
        data += datagram
    return bytes(data)
