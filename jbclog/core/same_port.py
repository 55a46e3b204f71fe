"""Whether two urls are one port: links to devices are followed, the names of hosts resolved."""

from __future__ import annotations

import ipaddress
import os
import socket
from contextlib import suppress
from functools import lru_cache
from typing import Final, NamedTuple
from urllib.parse import urlsplit

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
