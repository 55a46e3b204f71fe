"""What is known of a wire: how long bytes take, whether two urls are one port, the rows of its record."""

from __future__ import annotations

import ipaddress
import os
import re
import socket
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal, NamedTuple
from urllib.parse import urlsplit

# -- line format --------------------------------------------------------------------------------------------------------------
# How long bytes take: the arithmetic of an asynchronous serial line, without any port.

BAUDRATES = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 250000, 460800, 500000)
"""The rates that manual 000 prints (2.1); the newer units have 19200 only."""

_FORMAT = re.compile(r"8([NEO])([12])")

AROUND = 4  # characters of a frame beside code and data: STX, header, ETX and check byte; of OMEGA's STX, ETX and two of the sum
ADDRESSES = 4  # more of them where the line has addresses (manual 002, "Data Link Layer")
CODE, DIGITS = 3, 5  # of the usual question and its answer


SCHEMES: Final = ("socket", "rfc2217", "loop", "hwgrep")
"""The kinds of url that may be opened. pyserial knows more; spy:// writes any file that its url names, alt:// loads code."""


def scheme_of(url: str) -> str:
    """The kind of port that a url names, in small letters; empty for a device."""
    scheme, is_url, _ = url.partition("://")
    return scheme.lower() if is_url else ""


@dataclass(frozen=True, slots=True)
class LineFormat:
    """Baud rate, parity and stop bits, as in ``19200`` and ``8N1``."""

    baudrate: int = 19200
    format: str = "8N1"

    def __post_init__(self) -> None:
        if not _FORMAT.fullmatch(self.format):
            raise ValueError(f"{self.format!r} is not a line format such as 8N1, 8E1 or 8O2")
        if self.baudrate <= 0:
            raise ValueError(f"{self.baudrate} is not a baud rate")

    def __str__(self) -> str:
        return f"{self.baudrate} {self.format}"

    @property
    def parity(self) -> str:
        return self.format[1]

    @property
    def stop_bits(self) -> int:
        return int(self.format[2])

    @property
    def character_s(self) -> float:
        """Seconds that one character takes: start bit, eight data bits, parity, stop bits."""
        return (9 + (self.parity != "N") + self.stop_bits) / self.baudrate

    def seconds(self, characters: int) -> float:
        """Seconds that `characters` take."""
        return characters * self.character_s

    def read_s(self, addressed: bool = True) -> float:
        """Seconds of one read and its five-digit answer, without turnaround: 14.06 ms at 19200 8N1."""
        return self.seconds(2 * (AROUND + CODE + (ADDRESSES if addressed else 0)) + DIGITS)


# -- same port ----------------------------------------------------------------------------------------------------------------
# Whether two urls are one port: links to devices are followed, the names of hosts resolved.

NETWORK: Final = ("socket", "rfc2217")
LOOPBACK: Final = "loopback"  # localhost, 127.0.0.1 and ::1 are this computer


class PortPlace(NamedTuple):
    """Where a url leads: a path or a name, or a host with the number of its TCP port."""

    name: str
    number: int | None = None

    def is_at(self, other: PortPlace) -> bool:
        """Whether both are one port. Names of hosts are resolved only where all else is the same."""
        if self.number is None or self.number != other.number:
            return self == other
        return self.name == other.name or bool(_addresses(self.name) & _addresses(other.name))


def place_of(url: str) -> PortPlace:
    """Where `url` leads; options behind `?` and the case of letters in hosts and schemes mean nothing."""
    scheme, _, _ = url.partition("://")
    if scheme.lower() in NETWORK:
        with suppress(ValueError):  # which it raises for what is no number
            parts = urlsplit(url)
            return PortPlace(parts.hostname or "", parts.port or 0)
    with suppress(ValueError):  # which it raises for what can be no path
        return PortPlace(os.path.realpath(url) if url.startswith("/") else url)
    return PortPlace(url)


def is_one_port(url: str, other: str) -> bool:
    """Whether two urls are one port."""
    return url == other or place_of(url).is_at(place_of(other))


@lru_cache
def _addresses(host: str) -> frozenset[str]:
    """The addresses of a host, and its name: where nothing resolves it, it is like itself only."""
    found = {host}
    with suppress(OSError, UnicodeError):
        found |= {_plain(str(where[0])) for *_, where in socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)}
    return frozenset(found)


def _plain(address: str) -> str:
    with suppress(ValueError):
        known = ipaddress.ip_address(address.partition("%")[0])
        known = getattr(known, "ipv4_mapped", None) or known
        return LOOPBACK if known.is_loopback or known.is_unspecified else str(known)
    return address


# -- wire capture -------------------------------------------------------------------------------------------------------------
# What passed over one wire, and what its session was told of it: the rows of a wire record, in the order they came in.
#
# A session knows nothing but what it is told (`core.io_requests`). Told the same again, byte for byte and moment for moment, it
# does the same again; so these rows are enough to live through a run once more. `transport` notes what passed, `drive`
# what was told, `record` keeps both, and a replay is made of them.
#
# All moments are monotonic seconds of the recorder.

WishName = Literal["ask", "listen", "wait", "reopen", "gather"]
PassedName = Literal["sent", "heard", "opened", "failed", "lost", "closed"]
ToldName = Literal["told", "broke", "stopped", "not_started", "left_out", "done"]


class Passed(NamedTuple):
    """Bytes that went one way at once, or a change of the link.

    ``sent``: `data` is about to be handed over. ``heard``: `data` has come. ``opened``, ``failed`` (it could not be
    opened), ``lost`` (it broke), ``closed``: `text` says more.
    """

    at_s: float
    what: PassedName
    data: bytes = b""
    text: str = ""


class Told(NamedTuple):
    """What the session was told, and the wish that this answered.

    ``told``: the moment and the next `size` bytes that had come; `sent_s` is when its question left, where it had asked
    one; `late_s` by how much the recorder itself was seen to be late. ``broke``: the link, as `text` says. ``stopped``: the run
    ends, as `text` says. ``not_started``: it does not start because of the stations that `text` names; ``left_out``: without
    this one, as `text` says. ``done``: nothing, the session had ended.
    """

    at_s: float
    what: ToldName
    wish: WishName
    size: int = 0
    sent_s: float = 0.0
    text: str = ""
    late_s: float = 0.0


Row = Passed | Told
