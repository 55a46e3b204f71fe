"""Serial formats and URLs, and whether two URLs name the same port."""

from __future__ import annotations

import ipaddress
import os
import re
import socket
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple
from urllib.parse import urlsplit

BAUDRATES = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 250000, 460800, 500000)
"""Rates printed in manual 000 (2.1); newer units support 19200 only."""

_FORMAT = re.compile(r"8([NEO])([12])")

# characters of a frame besides code and data: STX, header, ETX, check byte; OMEGA: STX, ETX, two
# for the sum
FRAMING = 4
ADDRESSES = 4  # extra characters on links with addresses (manual 002, "Data Link Layer")
CODE, DIGITS = 3, 5  # characters of the usual request and its answer


SCHEMES: Final = ("socket", "rfc2217", "loop", "hwgrep")
"""URL schemes that may be opened. Others of pyserial are unsafe: spy:// writes any file its URL
names, alt:// loads code.
"""


def scheme_of(url: str) -> str:
    """Return a URL's scheme in lower case; "" for a device."""
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
        """Duration of one character: start bit, eight data bits, parity, stop bits."""
        return (9 + (self.parity != "N") + self.stop_bits) / self.baudrate

    def seconds(self, characters: int) -> float:
        return characters * self.character_s

    def read_s(self) -> float:
        """Duration of an addressed five-digit read without response time: 14.06 ms at 19200 8N1."""
        return self.seconds(2 * (FRAMING + CODE + ADDRESSES) + DIGITS)


NETWORK: Final = ("socket", "rfc2217")
LOOPBACK: Final = "loopback"  # localhost, 127.0.0.1 and ::1 are this computer


class PortAddress(NamedTuple):
    """Target of a URL: a device path or name, or a host with its TCP port."""

    name: str
    number: int | None = None

    def is_at(self, other: PortAddress) -> bool:
        """Return True if both are the same port. Resolves host names only if all else is equal."""
        if self.number is None or self.number != other.number:
            return self == other
        return self.name == other.name or bool(_addresses(self.name) & _addresses(other.name))


def port_address(url: str) -> PortAddress:
    """Parse `url`; ignores options after `?` and the case of host and scheme."""
    scheme, _, _ = url.partition("://")
    if scheme.lower() in NETWORK:
        with suppress(ValueError):  # no number
            parts = urlsplit(url)
            return PortAddress(parts.hostname or "", parts.port or 0)
    with suppress(ValueError):  # not a path
        return PortAddress(os.path.realpath(url) if url.startswith("/") else url)
    return PortAddress(url)


def is_one_port(url: str, other: str) -> bool:
    """Return True if both URLs lead to the same port; follows device links, resolves host names."""
    return url == other or port_address(url).is_at(port_address(other))


@lru_cache
def _addresses(host: str) -> frozenset[str]:
    """Return a host's addresses and its name; an unresolvable host equals only itself."""
    found = {host}
    with suppress(OSError, UnicodeError):
        found |= {
            _plain(str(where[0]))
            for *_, where in socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
        }
    return frozenset(found)


def _plain(address: str) -> str:
    with suppress(ValueError):
        known = ipaddress.ip_address(address.partition("%")[0])
        known = getattr(known, "ipv4_mapped", None) or known
        return LOOPBACK if known.is_loopback or known.is_unspecified else str(known)
    return address
