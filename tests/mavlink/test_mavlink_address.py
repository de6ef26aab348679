"""Addresses: every right form, every kind of wrong one, and the round trip through text."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uavfollow.mavlink.address import MAX_BAUD, MAX_PORT, AddressError, LinkAddress, LinkKind, parse_address


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("udpin:0.0.0.0:14550", LinkAddress(LinkKind.UDP_IN, "0.0.0.0", 14550)),
        ("udp:127.0.0.1:1", LinkAddress(LinkKind.UDP_IN, "127.0.0.1", 1)),
        ("udpout:companion.local:65535", LinkAddress(LinkKind.UDP_OUT, "companion.local", 65535)),
        ("tcp:127.0.0.1:5760", LinkAddress(LinkKind.TCP_CLIENT, "127.0.0.1", 5760)),
        ("tcpin:0.0.0.0:5760", LinkAddress(LinkKind.TCP_SERVER, "0.0.0.0", 5760)),
        ("udpin:[::1]:14550", LinkAddress(LinkKind.UDP_IN, "::1", 14550)),
        ("tcp:[fe80::1%eth0]:5760", LinkAddress(LinkKind.TCP_CLIENT, "fe80::1%eth0", 5760)),
        ("serial:/dev/ttyACM0,115200", LinkAddress(LinkKind.SERIAL, path="/dev/ttyACM0", baud=115200)),
        ("/dev/serial/by-id/usb-a,b,57600", LinkAddress(LinkKind.SERIAL, path="/dev/serial/by-id/usb-a,b", baud=57600)),
        ("tlog:out/flight", LinkAddress(LinkKind.TLOG, path="out/flight")),
        ("out/flight.tlog", LinkAddress(LinkKind.TLOG, path="out/flight.tlog")),
        ("  UDPIN:0.0.0.0:14550 ", LinkAddress(LinkKind.UDP_IN, "0.0.0.0", 14550)),
    ],
)
def test_right_addresses(text: str, expected: LinkAddress) -> None:
    assert parse_address(text) == expected


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "empty"),
        ("udpin", "does not begin with"),
        ("127.0.0.1:14550", "does not begin with"),
        ("udpin:14550", "has no port"),
        ("udpin::14550", "has no host"),
        ("udpin:0.0.0.0:", "port ''"),
        ("udpin:0.0.0.0:0", "port '0'"),
        ("udpin:0.0.0.0:65536", "port '65536'"),
        ("udpin:0.0.0.0:-1", "port '-1'"),
        ("udpin:0.0.0.0:1_000", "port '1_000'"),
        ("udpin:0.0.0.0:١٢", "port '١٢'"),
        ("udpin:0.0.0.0:" + "9" * 5000, "port '9"),
        ("udpin:::1:14550", "brackets"),
        ("udpin:a b:14550", "not a host name"),
        ("udpin://0.0.0.0:14550", "'//'"),
        ("serial:/dev/ttyACM0", "baud rate"),
        ("serial:,57600", "no device"),
        ("/dev/ttyACM0", "baud rate"),
        ("/dev/ttyACM0,0", "baud rate '0'"),
        ("/dev/ttyACM0,fast", "baud rate 'fast'"),
        (f"/dev/ttyACM0,{MAX_BAUD + 1}", "baud rate"),
        ("tlog:", "no file name"),
        ("pipe", "inside one process"),
        ("pipe:a.tlog", "inside one process"),
        ("udpin:0.0.0.0:14\x00550", "control character"),
    ],
)
def test_wrong_addresses_are_named_in_one_line(text: str, says: str) -> None:
    with pytest.raises(AddressError) as caught:
        parse_address(text)
    message = str(caught.value)
    assert says in message
    assert "\n" not in message
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize("kind", list(LinkKind))
def test_the_example_of_an_error_is_itself_right(kind: LinkKind) -> None:
    with pytest.raises(AddressError) as caught:
        parse_address(f"{kind.value}:")
    example = str(caught.value).rsplit("for example ", 1)[1]
    assert parse_address(example).kind is kind


_HOSTS = st.from_regex(r"[a-z0-9][a-z0-9.-]{0,20}", fullmatch=True) | st.sampled_from(["::1", "fe80::1%eth0", "::"])
_NETWORK = st.builds(
    LinkAddress,
    st.sampled_from([LinkKind.UDP_IN, LinkKind.UDP_OUT, LinkKind.TCP_CLIENT, LinkKind.TCP_SERVER]),
    _HOSTS,
    st.integers(1, MAX_PORT),
)
_SERIAL = st.builds(
    lambda name, baud: LinkAddress(LinkKind.SERIAL, path=f"/dev/{name}", baud=baud),
    st.from_regex(r"[A-Za-z0-9,:_/-]{1,20}", fullmatch=True),
    st.integers(1, MAX_BAUD),
)


@settings(derandomize=True)
@given(_NETWORK | _SERIAL)
def test_text_and_address_round_trip(address: LinkAddress) -> None:
    assert parse_address(str(address)) == address


@settings(derandomize=True, max_examples=300)
@given(st.text() | st.builds("{}:{}".format, st.sampled_from([kind.value for kind in LinkKind]), st.text()))
def test_any_text_gives_a_usable_address_or_the_one_error(text: str) -> None:
    try:
        address = parse_address(text)
    except AddressError as error:
        message = str(error)
    else:
        message = ""
    if message:
        assert "\n" not in message
        return
    assert parse_address(str(address)) == address
    if address.kind is LinkKind.SERIAL:
        assert address.path
        assert 1 <= address.baud <= MAX_BAUD
    elif address.kind is LinkKind.TLOG:
        assert address.path
    else:
        assert address.host
        assert 1 <= address.port <= MAX_PORT
