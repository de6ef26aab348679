"""Link addresses as text: `udpin:HOST:PORT`, `tcp:HOST:PORT`, `/dev/ttyACM0,115200`, `flight.tlog`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

from uavfollow.errors import InputError

MAX_PORT = 65535  # UDP and TCP ports are 16 bits; 0 means "any", which no peer could know
MAX_BAUD = 12_500_000  # the fastest USB adapters; more is a typing error
MAX_DIGITS = 10  # more digits than any port or baud rate has; keeps int() away from absurd text

_HOST_PATTERN = re.compile(r"[A-Za-z0-9._-]+")
_IPV6_PATTERN = re.compile(r"\[([0-9A-Fa-f:.]+(?:%[A-Za-z0-9._-]+)?)\]")
_TLOG_SUFFIX = ".tlog"


class AddressError(InputError):
    """A link address that can't be used; one line: what was wrong, where, and a right one."""


class LinkKind(str, Enum):
    """How a link carries its bytes; the value is the word before the first colon."""

    UDP_IN = "udpin"
    UDP_OUT = "udpout"
    TCP_CLIENT = "tcp"
    TCP_SERVER = "tcpin"
    SERIAL = "serial"
    TLOG = "tlog"


_EXAMPLES = {
    LinkKind.UDP_IN: "udpin:0.0.0.0:14550",
    LinkKind.UDP_OUT: "udpout:127.0.0.1:14550",
    LinkKind.TCP_CLIENT: "tcp:127.0.0.1:5760",
    LinkKind.TCP_SERVER: "tcpin:0.0.0.0:5760",
    LinkKind.SERIAL: "serial:/dev/ttyACM0,115200",
    LinkKind.TLOG: "tlog:flight.tlog",
}
# pymavlink's own spellings
_SYNONYMS = {"udp": LinkKind.UDP_IN}
_NETWORK_KINDS = frozenset({LinkKind.UDP_IN, LinkKind.UDP_OUT, LinkKind.TCP_CLIENT, LinkKind.TCP_SERVER})


@dataclass(frozen=True, slots=True)
class LinkAddress:
    """Where a link goes: `host` and `port` for a network, `path` and `baud` for a device, `path` for a tlog.

    `str()` gives the canonical text; `parse_address(str(address)) == address` for every parsed address.
    """

    kind: LinkKind
    host: str = ""
    port: int = 0
    path: str = ""
    baud: int = 0

    def __str__(self) -> str:
        if self.kind in _NETWORK_KINDS:
            host = f"[{self.host}]" if ":" in self.host else self.host
            return f"{self.kind.value}:{host}:{self.port}"
        if self.kind is LinkKind.SERIAL:
            return f"{self.kind.value}:{self.path},{self.baud}"
        return f"{self.kind.value}:{self.path}"


def parse_address(text: str) -> LinkAddress:
    """Read a pymavlink-style link address; raises `AddressError` for anything else.

    Ports are 1..65535, baud rates bit/s above 0; IPv6 hosts stand in brackets; `udp:` means `udpin:`. The in-process
    pipe has no address.
    """
    stripped = text.strip()
    if not stripped:
        raise AddressError(f"link address is empty; write for example {_EXAMPLES[LinkKind.UDP_IN]}")
    if not stripped.isprintable():
        raise AddressError(f"link address {text!r} holds a control character; retype it")
    bare = _parse_bare(stripped)
    if bare is not None:
        return bare
    word, colon, rest = stripped.partition(":")
    kind = _kind_of(word, bool(colon), text)
    if kind in _NETWORK_KINDS:
        return _parse_network(kind, rest, text)
    if kind is LinkKind.SERIAL:
        return _parse_serial(rest, text)
    if not rest.strip():
        raise _error(text, "has no file name", kind)
    return LinkAddress(kind, path=rest.strip())


def _parse_bare(stripped: str) -> LinkAddress | None:
    if stripped.startswith("/dev/"):
        return _parse_serial(stripped, stripped)
    word = stripped.partition(":")[0].lower()
    named = word in _SYNONYMS or word in {kind.value for kind in LinkKind} or word == "pipe"
    if stripped.endswith(_TLOG_SUFFIX) and not named:
        return LinkAddress(LinkKind.TLOG, path=stripped)
    return None


def _kind_of(word: str, has_colon: bool, text: str) -> LinkKind:
    lowered = word.lower()
    if lowered == "pipe":
        raise AddressError(f"link address {text!r}: a pipe exists only inside one process; use udpin, tcp or serial")
    if has_colon and lowered in _SYNONYMS:
        return _SYNONYMS[lowered]
    kind = next((kind for kind in LinkKind if kind.value == lowered), None)
    if kind is None or not has_colon:
        known = ", ".join(f"{kind.value}:" for kind in LinkKind)
        raise AddressError(
            f"link address {text!r} does not begin with one of {known}; for example {_EXAMPLES[LinkKind.UDP_IN]}"
        )
    return kind


def _parse_network(kind: LinkKind, rest: str, text: str) -> LinkAddress:
    if rest.startswith("//"):
        raise _error(text, "has '//' before the host", kind)
    host_text, colon, port_text = rest.rpartition(":")
    if not colon:
        raise _error(text, "has no port", kind)
    if not host_text:
        raise _error(text, "has no host (0.0.0.0 means all interfaces)", kind)
    bracketed = _IPV6_PATTERN.fullmatch(host_text)
    if bracketed is None and ":" in host_text:
        raise _error(text, f"host {host_text!r}: an IPv6 host stands in brackets, like [::1]", kind)
    if bracketed is None and _HOST_PATTERN.fullmatch(host_text) is None:
        raise _error(text, f"host {host_text!r} is not a host name or address", kind)
    host = bracketed.group(1) if bracketed else host_text
    return LinkAddress(kind, host=host, port=_number(port_text, "port", MAX_PORT, kind, text))


def _parse_serial(rest: str, text: str) -> LinkAddress:
    path, comma, baud_text = rest.rpartition(",")
    if not comma:
        raise _error(text, "has no baud rate after a comma", LinkKind.SERIAL)
    if not path.strip():
        raise _error(text, "has no device before the comma", LinkKind.SERIAL)
    baud = _number(baud_text.strip(), "baud rate", MAX_BAUD, LinkKind.SERIAL, text)
    return LinkAddress(LinkKind.SERIAL, path=path.strip(), baud=baud)


def _number(digits: str, name: str, maximum: int, kind: LinkKind, text: str) -> int:
    # int() alone would take "1_000", "+5" and other scripts' digits.
    if not (digits.isascii() and digits.isdigit() and len(digits) <= MAX_DIGITS and 1 <= int(digits) <= maximum):
        raise _error(text, f"{name} {digits!r} is not a whole number from 1 to {maximum}", kind)
    return int(digits)


def _error(text: str, what: str, kind: LinkKind) -> AddressError:
    return AddressError(f"link address {text!r}: {what}; write for example {_EXAMPLES[kind]}")
