"""Opening a link by its address; also the one place to import link types from."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from uavfollow.mavlink.address import AddressError, LinkAddress, LinkKind, parse_address
from uavfollow.mavlink.pipe import PipeLink
from uavfollow.mavlink.serial_port import SerialLink
from uavfollow.mavlink.tcp import TcpClientLink, TcpServerLink
from uavfollow.mavlink.tlog_link import TlogLink
from uavfollow.mavlink.transport import Link, LinkError, LinkStats
from uavfollow.mavlink.udp import AnswerTo, UdpInLink, UdpOutLink

__all__ = [
    "AddressError",
    "AnswerTo",
    "Link",
    "LinkAddress",
    "LinkError",
    "LinkKind",
    "LinkStats",
    "PipeLink",
    "SerialLink",
    "TcpClientLink",
    "TcpServerLink",
    "TlogLink",
    "UdpInLink",
    "UdpOutLink",
    "open_link",
    "parse_address",
]


def open_link(
    address: LinkAddress | str,
    *,
    must_connect: bool = True,
    answer_to: AnswerTo = AnswerTo.ALL,
    clock: Callable[[], float] = time.monotonic,
) -> Link:
    """Open the link an address names; raises `AddressError` for bad text and `LinkError` when it can't be opened.

    `must_connect` False lets a TCP client start without its peer; `answer_to` is for `udpin`; `clock` gives monotonic
    seconds for peer time-outs and back-off.
    """
    where = parse_address(address) if isinstance(address, str) else address
    if where.kind is LinkKind.UDP_IN:
        return UdpInLink(where.host, where.port, answer_to, clock)
    if where.kind is LinkKind.UDP_OUT:
        return UdpOutLink(where.host, where.port)
    if where.kind is LinkKind.TCP_CLIENT:
        return TcpClientLink(where.host, where.port, must_connect, clock)
    if where.kind is LinkKind.TCP_SERVER:
        return TcpServerLink(where.host, where.port)
    if where.kind is LinkKind.SERIAL:
        return SerialLink(where.path, where.baud, clock)
    return TlogLink(Path(where.path))
