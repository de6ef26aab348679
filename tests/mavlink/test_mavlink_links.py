"""Every kind of link over loopback, without sleeping: each wait is a bounded number of selects."""

from __future__ import annotations

import os
import pty
import select
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from types import ModuleType

import pytest

from uavfollow.mavlink.heartbeat import controller_heartbeat
from uavfollow.mavlink.link import (
    AddressError,
    AnswerTo,
    Link,
    LinkError,
    PipeLink,
    SerialLink,
    TcpClientLink,
    TcpServerLink,
    TlogLink,
    UdpInLink,
    UdpOutLink,
    open_link,
)
from uavfollow.mavlink.packer import Packer
from uavfollow.mavlink.tlog import TlogReader
from uavfollow.mavlink.transport import MAX_UNSENT_BYTES, RECONNECT_FIRST_S, RECONNECT_MAX_S, Backoff, Outbox
from uavfollow.mavlink.udp import MAX_PEERS, PEER_TIMEOUT_S

HOST = "127.0.0.1"
MAX_WAITS = 200
WAIT_S = 0.02


class ManualClock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as links:
        yield links


def _own(stack: ExitStack, link: Link) -> None:
    stack.enter_context(closing(link))


def _wait(link: Link) -> None:
    descriptor = link.fileno()
    select.select([] if descriptor is None else [descriptor], [], [], WAIT_S)


def _read(link: Link, size: int) -> bytes:
    data = b""
    for _ in range(MAX_WAITS):
        data += link.read_available()
        if len(data) >= size:
            return data
        _wait(link)
    return data


def _until(condition: Callable[[], bool], *links: Link) -> bool:
    for _ in range(MAX_WAITS):
        for link in links:
            link.read_available()
        if condition():
            return True
        _wait(links[0])
    return False


# --- pipe


def test_a_pipe_carries_both_ways_and_drops_whole_writes_when_full() -> None:
    here, there = PipeLink.pair(capacity_bytes=8)
    here.write(b"12345")
    here.write(b"6789")
    here.write(b"678")
    there.write(b"back")
    assert there.read_available() == b"12345678"
    assert there.read_available() == b""
    assert here.read_available() == b"back"
    assert (here.stats.packets_out, here.stats.bytes_out, here.stats.dropped_packets) == (2, 8, 1)
    assert (there.stats.packets_in, there.stats.bytes_in) == (1, 8)
    assert here.fileno() is None


def test_a_closed_pipe_drops() -> None:
    here, there = PipeLink.pair()
    there.close()
    here.write(b"x")
    there.write(b"x")
    assert (here.stats.dropped_packets, there.stats.dropped_packets) == (1, 1)
    assert not there.is_open
    assert here.is_open
    assert not here.is_connected
    with pytest.raises(ValueError, match="capacity_bytes"):
        PipeLink.pair(0)


# --- UDP


def test_udp_carries_both_ways_and_joins_all_datagrams(stack: ExitStack) -> None:
    server = UdpInLink(HOST, 0)
    _own(stack, server)
    client = UdpOutLink(HOST, server.port)
    _own(stack, client)
    server.write(b"nobody")
    assert server.stats.dropped_packets == 1
    assert not server.is_connected
    for packet in (b"one", b"two", b"three"):
        client.write(packet)
    _wait(server)
    # On loopback all three have arrived when the first has been seen, so one call must drain them.
    assert server.read_available() == b"onetwothree"
    assert server.stats.packets_in == 3
    assert server.is_connected
    server.write(b"answer")
    assert _read(client, 6) == b"answer"
    assert client.read_available() == b""
    assert (client.stats.packets_out, client.stats.bytes_out) == (3, 11)


def test_udp_answers_all_peers_or_the_last_and_forgets_the_silent(stack: ExitStack) -> None:
    clock = ManualClock()
    to_all, to_last = UdpInLink(HOST, 0, AnswerTo.ALL, clock), UdpInLink(HOST, 0, AnswerTo.LAST, clock)
    for server, heard_by_first in ((to_all, b"hello"), (to_last, b"")):
        _own(stack, server)
        first, second = UdpOutLink(HOST, server.port), UdpOutLink(HOST, server.port)
        _own(stack, first)
        _own(stack, second)
        first.write(b"a")
        assert _read(server, 1) == b"a"
        second.write(b"b")
        assert _read(server, 1) == b"b"
        server.write(b"hello")
        assert _read(second, 5) == b"hello"
        assert first.read_available() == heard_by_first
    clock.now_s += PEER_TIMEOUT_S + 0.1
    assert not to_all.is_connected
    to_all.write(b"late")
    assert to_all.stats.dropped_packets == 1


def test_udp_remembers_a_bounded_number_of_peers(stack: ExitStack) -> None:
    server = UdpInLink(HOST, 0)
    _own(stack, server)
    clients = [UdpOutLink(HOST, server.port) for _ in range(MAX_PEERS + 1)]
    for client in clients:
        _own(stack, client)
        client.write(b"x")
        assert _read(server, 1) == b"x"
    server.write(b"y")
    assert _read(clients[-1], 1) == b"y"
    assert clients[0].read_available() == b""
    assert clients[1].read_available() == b"y"


def test_udp_to_nobody_counts_errors_and_goes_on_when_somebody_listens(stack: ExitStack) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind((HOST, 0))
        port = taken.getsockname()[1]
    client = UdpOutLink(HOST, port)
    _own(stack, client)
    for _ in range(4):
        client.write(b"lost")
        assert client.read_available() == b""
    assert client.stats.errors >= 1
    assert "refused" in client.stats.last_error
    # The refusal of this one is still pending when somebody listens, and must not cost the next.
    client.write(b"lost")
    server = UdpInLink(HOST, port)
    _own(stack, server)
    client.write(b"heard")
    assert _read(server, 5) == b"heard"


def test_udp_port_in_use_is_a_clear_error(stack: ExitStack) -> None:
    server = UdpInLink(HOST, 0)
    _own(stack, server)
    with pytest.raises(LinkError, match=rf"UDP 127.0.0.1:{server.port}: Address already in use; close the program"):
        UdpInLink(HOST, server.port)
    assert isinstance(LinkError("x"), OSError)


def test_closed_udp_links_drop(stack: ExitStack) -> None:
    server = UdpInLink(HOST, 0)
    client = UdpOutLink(HOST, server.port)
    for link in (server, client):
        link.close()
        link.close()
        link.write(b"x")
        assert link.read_available() == b""
        assert not link.is_open
        assert not link.is_connected
        assert link.fileno() is None
        assert link.stats.dropped_packets == 1


# --- TCP


def test_tcp_carries_both_ways(stack: ExitStack) -> None:
    server = TcpServerLink(HOST, 0)
    _own(stack, server)
    server.write(b"nobody")
    assert server.stats.dropped_packets == 1
    client = TcpClientLink(HOST, server.port)
    _own(stack, client)
    client.write(b"one")
    client.write(b"two")
    assert _read(server, 6) == b"onetwo"
    server.write(b"answer")
    assert _read(client, 6) == b"answer"
    assert client.is_connected
    assert server.is_connected


def test_tcp_client_comes_back_after_the_server_went_away(stack: ExitStack) -> None:
    clock = ManualClock()
    server = TcpServerLink(HOST, 0)
    port = server.port
    client = TcpClientLink(HOST, port, clock=clock)
    _own(stack, client)
    client.write(b"before")
    assert _read(server, 6) == b"before"
    server.close()
    assert _until(lambda: not client.is_connected, client)
    assert "closed the connection" in client.stats.last_error
    client.write(b"lost")
    assert client.stats.dropped_packets == 1
    clock.now_s += RECONNECT_FIRST_S + 0.01
    # Nobody listens: refused, and put off by the next delay.
    assert _until(lambda: "refused" in client.stats.last_error, client)
    errors = client.stats.errors
    assert client.read_available() == b""
    assert client.stats.errors == errors
    server = TcpServerLink(HOST, port)
    _own(stack, server)
    clock.now_s += RECONNECT_MAX_S
    assert _until(lambda: client.is_connected and server.is_connected, client, server)
    client.write(b"again")
    assert _read(server, 5) == b"again"
    server.write(b"back")
    assert _read(client, 4) == b"back"


def test_tcp_client_may_start_before_its_server(stack: ExitStack) -> None:
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        port = taken.getsockname()[1]
    with pytest.raises(LinkError, match=rf"can't connect to TCP 127.0.0.1:{port}: Connection refused; start"):
        open_link(f"tcp:{HOST}:{port}")
    clock = ManualClock()
    client = open_link(f"tcp:{HOST}:{port}", must_connect=False, clock=clock)
    _own(stack, client)
    assert client.fileno() is None
    assert _until(lambda: client.stats.errors == 1, client)
    server = TcpServerLink(HOST, port)
    _own(stack, server)
    clock.now_s += RECONNECT_FIRST_S + 0.01
    assert _until(lambda: client.is_connected and server.is_connected, client, server)


def test_tcp_server_takes_a_new_client_in_place_of_the_old(stack: ExitStack) -> None:
    server = TcpServerLink(HOST, 0)
    _own(stack, server)
    old = TcpClientLink(HOST, server.port)
    _own(stack, old)
    assert _until(lambda: server.is_connected, server)
    new = TcpClientLink(HOST, server.port)
    _own(stack, new)
    assert _until(lambda: not old.is_connected, old, server)
    new.write(b"new")
    assert _read(server, 3) == b"new"
    server.write(b"to new")
    assert _read(new, 6) == b"to new"


def test_tcp_to_a_peer_that_reads_nothing_drops_instead_of_blocking_or_hoarding(stack: ExitStack) -> None:
    with socket.socket() as listener:
        listener.bind((HOST, 0))
        listener.listen()
        client = TcpClientLink(HOST, listener.getsockname()[1])
        _own(stack, client)
        peer, _ = listener.accept()
        with peer:
            frame = bytes(range(200)) * 5
            for _ in range(20_000):
                client.write(frame)
            assert client.stats.dropped_packets > 0
            assert client.is_connected
            assert len(client._stream._outbox._waiting) <= MAX_UNSENT_BYTES  # type: ignore[union-attr]
            received = b""
            peer.settimeout(WAIT_S)
            for _ in range(MAX_WAITS * 100):
                client.read_available()
                try:
                    received += peer.recv(65536)
                except TimeoutError:
                    break
    # Packets were dropped whole: what arrived is whole frames.
    assert received == frame * (len(received) // len(frame))
    assert len(received) == client.stats.bytes_out


def test_tcp_write_to_a_dead_peer_is_counted(stack: ExitStack) -> None:
    server = TcpServerLink(HOST, 0)
    _own(stack, server)
    client = TcpClientLink(HOST, server.port)
    assert _until(lambda: server.is_connected, server)
    client.close()
    client.close()
    client.write(b"x")
    assert client.stats.dropped_packets == 1
    assert client.read_available() == b""
    for _ in range(MAX_WAITS):
        server.write(b"x")
        if server.stats.dropped_packets:
            break
    assert server.stats.errors >= 1
    assert server.stats.dropped_packets >= 1


def test_tcp_port_in_use_and_unknown_host_are_clear_errors(stack: ExitStack) -> None:
    server = TcpServerLink(HOST, 0)
    _own(stack, server)
    with pytest.raises(LinkError, match=rf"TCP 127.0.0.1:{server.port}: Address already in use"):
        TcpServerLink(HOST, server.port)
    for open_it in (TcpClientLink, TcpServerLink, UdpInLink, UdpOutLink):
        with pytest.raises(LinkError, match="check the name"):
            open_it("no..host", 5760)
    server.close()
    server.write(b"x")
    assert server.read_available() == b""
    assert server.fileno() is None
    assert not server.is_open


# --- serial


def test_serial_carries_both_ways_over_a_pseudo_terminal(stack: ExitStack) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed (extra 'serial')")
    master, slave = pty.openpty()
    stack.callback(os.close, master)
    link = open_link(f"serial:{os.ttyname(slave)},57600")
    os.close(slave)
    _own(stack, link)
    data = bytes(range(256))  # every byte: nothing is translated as a terminal would
    link.write(data)
    received = b""
    while len(received) < 256 and select.select([master], [], [], 1.0)[0]:
        received += os.read(master, 4096)
    assert received == data
    os.write(master, data)
    assert _read(link, 256) == data
    assert link.read_available() == b""
    assert (link.stats.bytes_out, link.stats.bytes_in) == (256, 256)


def test_serial_counts_a_vanished_device_and_looks_for_it_again(stack: ExitStack, tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed (extra 'serial')")
    clock = ManualClock()
    name = tmp_path / "ttyTest"
    master, slave = pty.openpty()
    name.symlink_to(os.ttyname(slave))
    link = SerialLink(str(name), 57600, clock)
    _own(stack, link)
    os.close(slave)
    os.close(master)
    name.unlink()
    assert link.read_available() == b""
    link.write(b"x")
    assert not link.is_connected
    assert link.fileno() is None
    assert link.stats.errors == 1
    assert link.stats.dropped_packets == 1
    clock.now_s += RECONNECT_FIRST_S + 0.01
    link.write(b"x")
    assert "ttyTest" in link.stats.last_error
    master, slave = pty.openpty()
    stack.callback(os.close, master)
    name.symlink_to(os.ttyname(slave))
    clock.now_s += RECONNECT_MAX_S
    link.write(b"back")
    os.close(slave)
    assert link.is_connected
    assert select.select([master], [], [], 1.0)[0]
    assert os.read(master, 10) == b"back"
    link.close()
    assert not link.is_open
    link.write(b"x")
    assert link.stats.dropped_packets == 3


def test_serial_device_that_is_unplugged_and_reads_as_empty_is_noticed(
    stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed (extra 'serial')")
    master, slave = pty.openpty()
    link = SerialLink(os.ttyname(slave), 57600, ManualClock())
    _own(stack, link)
    os.close(slave)
    os.close(master)
    # A pseudo-terminal fails to read; a USB port that was pulled out reads as empty, like an idle line.
    with monkeypatch.context() as patch:
        patch.setattr(os, "read", lambda _descriptor, _size: b"")
        link.read_available()
        link.read_available()
    assert not link.is_connected
    assert "hung up" in link.stats.last_error


def test_serial_line_that_takes_nothing_drops_instead_of_blocking(stack: ExitStack) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed (extra 'serial')")
    master, slave = pty.openpty()
    stack.callback(os.close, master)
    stack.callback(os.close, slave)
    link = SerialLink(os.ttyname(slave), 57600)
    _own(stack, link)
    for _ in range(2000):
        link.write(b"x" * 100)
    assert link.stats.dropped_packets > 0
    assert link.is_connected


def test_serial_errors_name_the_device_and_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed (extra 'serial')")
    with pytest.raises(LinkError, match=r"/dev/no-such-port at 57600 baud.*dialout"):
        SerialLink("/dev/no-such-port", 57600)
    without_pyserial: ModuleType | None = None
    monkeypatch.setitem(sys.modules, "serial", without_pyserial)  # type: ignore[arg-type]
    with pytest.raises(LinkError, match=r"pip install 'uavfollow\[serial\]'"):
        SerialLink("/dev/ttyACM0", 57600)


# --- tlog and the factory


def test_a_tlog_link_writes_stamped_frames_and_counts_what_is_none(tmp_path: Path) -> None:
    path = tmp_path / "out.tlog"
    link = TlogLink(path, unix_us=lambda: 1_700_000_000_000_000)
    frame = Packer(1, 191).pack(controller_heartbeat())
    link.write(frame)
    link.write(frame[:-1])
    assert link.read_available() == b""
    assert (link.stats.packets_out, link.stats.errors, link.stats.dropped_packets) == (1, 1, 1)
    link.close()
    link.close()
    link.write(frame)
    assert link.stats.dropped_packets == 2
    assert [(record.t_us, record.frame) for record in TlogReader(path)] == [(1_700_000_000_000_000, frame)]
    with pytest.raises(LinkError, match="exists already"):
        TlogLink(path)


def test_the_factory_opens_what_the_address_says(stack: ExitStack, tmp_path: Path) -> None:
    with socket.socket() as one:
        one.bind((HOST, 0))
        port = one.getsockname()[1]
    for text, kind in (
        (f"udpin:{HOST}:{port}", UdpInLink),
        (f"udpout:{HOST}:{port}", UdpOutLink),
        (f"tcpin:{HOST}:{port}", TcpServerLink),
        (f"tcp:{HOST}:{port}", TcpClientLink),
        (f"tlog:{tmp_path / 'a.tlog'}", TlogLink),
    ):
        link = open_link(text)
        _own(stack, link)
        assert type(link) is kind
        assert link.is_open
    with pytest.raises(AddressError):
        open_link("nonsense")


# --- parts


def test_backoff_doubles_to_its_limit_and_starts_over() -> None:
    backoff = Backoff()
    assert backoff.is_due(0.0)
    delays = []
    for _ in range(7):
        backoff.failed(0.0)
        delays.append(next(s for s in (0.5, 1.0, 2.0, 4.0, 8.0, 16.0) if backoff.is_due(s)))
        assert not backoff.is_due(delays[-1] - 0.01)
    assert delays == [0.5, 1.0, 2.0, 4.0, 8.0, 8.0, 8.0]
    backoff.succeeded()
    assert backoff.is_due(0.0)
    backoff.failed(0.0)
    assert backoff.is_due(0.5)


def test_the_outbox_keeps_whole_packets_and_the_rest_of_a_partial_one() -> None:
    outbox, taken = Outbox(), bytearray()

    def take_three(data: bytes) -> int:
        if len(taken) >= 6:
            raise BlockingIOError
        taken.extend(data[:3])
        return min(3, len(data))

    assert outbox.offer(b"12345")
    assert outbox.offer(b"6789")
    assert not outbox.offer(b"x" * MAX_UNSENT_BYTES)
    outbox.flush(take_three)
    assert taken == b"123456"
    taken.clear()
    outbox.flush(take_three)
    assert taken == b"789"
    assert outbox.offer(b"x" * (2 * MAX_UNSENT_BYTES))
    outbox.clear()
    outbox.flush(take_three)
    assert taken == b"789"
