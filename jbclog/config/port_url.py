"""Urls of ports: device paths, COM ports, and what pyserial opens by a scheme."""

from __future__ import annotations

import re
from ipaddress import ip_address
from pathlib import PurePosixPath
from urllib.parse import urlsplit

from jbclog.config.schema import said, shown, unknown
from jbclog.core.line_format import SCHEMES, scheme_of

_WINDOWS_PORT = re.compile(r"COM\d{1,3}|\\\\\.\\.+", re.IGNORECASE)


def is_path(url: str) -> bool:
    """Whether the url is a path of a device, not a scheme or a COM port."""
    return "://" not in url and not _WINDOWS_PORT.fullmatch(url)


def checked_url(value: str) -> str:
    """A device path, absolute or below the line file's folder, or one of pyserial's URLs with what it needs."""
    if "://" not in value:
        path = PurePosixPath(value)
        if ".." in path.parts and not path.is_absolute():
            raise said(f"{shown(value)} is not allowed; a relative path stays below the line file's folder")
        return value
    problem = url_problem(value)
    if problem:
        raise said(problem)
    return value


def url_problem(value: str) -> str | None:
    """What is wrong with a url that has a scheme; None where it may be opened, or is a path."""
    scheme = scheme_of(value)
    if "://" not in value:
        return None
    if scheme not in SCHEMES:
        return f"the kind of port {shown(scheme)} is {unknown(scheme, list(SCHEMES))}"
    if scheme in ("socket", "rfc2217") and not _has_host_and_port(value):
        return f"{shown(value)} is not allowed; {scheme}://HOST:PORT"
    return None


def is_served_here(url: str) -> bool:
    """Whether it is where stations are served on this machine: a relative path, or a TCP port of its own."""
    if is_path(url):
        return not PurePosixPath(url).is_absolute()
    return scheme_of(url) == "socket" and is_this_host(urlsplit(url).hostname or "")


def tcp_port(url: str) -> str | None:
    """``host:port`` of socket:// and rfc2217://, this machine always by one name; None for any other url. No name is looked up."""
    if scheme_of(url) not in ("socket", "rfc2217") or not _has_host_and_port(url):
        return None
    parts = urlsplit(url)
    host = parts.hostname or ""
    return f"{'localhost' if is_this_host(host) else host}:{parts.port}"


def is_this_host(host: str) -> bool:
    """Whether that is what this machine calls itself, and nobody else can be meant."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


def _has_host_and_port(url: str) -> bool:
    try:
        parts = urlsplit(url)
        return bool(parts.hostname) and bool(parts.port)
    except ValueError:
        return False
