"""Whether the S3 server that the environment names reacts at all: the library has far longer limits
of its own for each request.
"""

from __future__ import annotations

import os
import socket
from functools import lru_cache
from typing import Final
from urllib.parse import urlsplit

from jbclog.core.errors import StoreError
from jbclog.core.foreign.files import ANSWERS_S

ENDPOINT: Final = "AWS_ENDPOINT_URL"
PROXIES: Final = ("http_proxy", "https_proxy", "all_proxy")
PORTS: Final = {"http": 80, "https": 443}


def expect_reaction(store: str) -> None:
    """Raise `StoreError` where the server of `store` does not react within `ANSWERS_S`.

    Any reaction counts, also that of a server which expects TLS; the library reports each other
    mistake. Through a proxy, and at Amazon's own addresses, nothing is asked.
    """
    if any(os.environ.get(name) or os.environ.get(name.upper()) for name in PROXIES):
        return
    try:
        url = urlsplit(os.environ.get(ENDPOINT, ""))
        host, port = url.hostname, url.port or PORTS.get(url.scheme)
    except ValueError:
        return
    try:
        if host is not None and port is not None:
            _ask(host, port)
    except TimeoutError:
        raise StoreError(
            f"{store}: {host} port {port} ({ENDPOINT}) does not answer within {ANSWERS_S:g} s"
        ) from None


@lru_cache
def _ask(host: str, port: int) -> None:
    """Ask once: one that has reacted may be slow later. Raises TimeoutError."""
    try:
        with socket.create_connection((host, port), ANSWERS_S) as opened:
            opened.sendall(f"HEAD / HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
            opened.recv(1)
    except TimeoutError:
        raise
    except (OSError, ValueError):
        return
