"""Where a client finds a virtual station: a pseudo-terminal behind a link in the file system, or a TCP port."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

with suppress(ImportError):  # Windows has no pseudo-terminals; TcpLink serves there
    import tty

from jbclog.errors import UsageError
from jbclog.sim.waiting import Waiter

MOST_AT_ONCE = 4096

OnBytes = Callable[[bytes, float], None]
"""Takes what has been written to a port, and when (monotonic seconds)."""


class Link(Protocol):
    """One station's end of the cable. `url` is what the client opens."""

    @property
    def url(self) -> str: ...

    def plug_in(self, on_bytes: OnBytes) -> None:
        """Make the port appear, and give `on_bytes` whatever is written to it."""

    def send(self, data: bytes) -> None:
        """Let the client read `data`; it is lost where nobody listens."""

    def pull_out(self) -> None:
        """Make the port disappear, as a pulled cable does."""


class PtyLink:
    """A pseudo-terminal with a symbolic link to it at `path`.

    The station keeps the client's side open as well, so that a client that closes does not hang it up.
    """

    def __init__(self, path: Path, waiter: Waiter) -> None:
        self.path = path
        self._waiter = waiter
        self._ends: tuple[int, int] | None = None

    @property
    def url(self) -> str:
        return str(self.path)

    def plug_in(self, on_bytes: OnBytes) -> None:
        station, client = os.openpty()
        tty.setraw(client)
        os.set_blocking(station, False)
        self._ends = station, client
        _link(self.path, os.ttyname(client))
        self._waiter.add(station, lambda now: on_bytes(os.read(station, MOST_AT_ONCE), now))

    def send(self, data: bytes) -> None:
        if self._ends is not None:
            try:
                os.write(self._ends[0], data)
            except BlockingIOError:
                return  # nobody has read for thousands of bytes

    def pull_out(self) -> None:
        if self._ends is None:
            return
        ends, self._ends = self._ends, None
        self._waiter.remove(ends[0])
        self.path.unlink(missing_ok=True)
        for end in ends:
            os.close(end)


class TcpLink:
    """A TCP port that serves one client at a time; a second one is turned away while the first is there."""

    def __init__(self, host: str, port: int, waiter: Waiter) -> None:
        self._host = host
        self._port = port
        self._waiter = waiter
        self._server: socket.socket | None = None
        self._client: socket.socket | None = None
        self._on_bytes: OnBytes = _forget

    @property
    def url(self) -> str:
        host = f"[{self._host}]" if ":" in self._host else self._host
        return f"socket://{host}:{self._port}"

    def plug_in(self, on_bytes: OnBytes) -> None:
        self._on_bytes = on_bytes
        family = socket.AF_INET6 if ":" in self._host else socket.AF_INET
        self._server = socket.create_server((self._host, self._port), family=family)
        self._port = self._server.getsockname()[1]
        self._server.setblocking(False)
        self._waiter.add(self._server.fileno(), self._accept)

    def send(self, data: bytes) -> None:
        if self._client is not None:
            try:
                self._client.send(data)
            except OSError:
                self._leave()

    def pull_out(self) -> None:
        self._leave()
        if self._server is not None:
            self._waiter.remove(self._server.fileno())
            self._server.close()
            self._server = None

    def _accept(self, _now: float) -> None:
        if self._server is None:
            return
        try:
            client, _ = self._server.accept()
        except OSError:  # gone again
            return
        if self._client is not None:
            client.close()
            return
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client = client
        self._waiter.add(client.fileno(), self._read)

    def _read(self, now: float) -> None:
        if self._client is None:
            return
        try:
            data = self._client.recv(MOST_AT_ONCE)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._on_bytes(data, now)
        else:
            self._leave()

    def _leave(self) -> None:
        if self._client is not None:
            self._waiter.remove(self._client.fileno())
            self._client.close()
            self._client = None


def _forget(_data: bytes, _now: float) -> None:
    return


def _link(path: Path, target: str) -> None:
    """Make `path` a symbolic link to `target`; only a link may be replaced."""
    if path.exists() and not path.is_symlink():
        raise UsageError(f"{path} is there already and is no link; it is left alone")
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    fresh.symlink_to(target)
    fresh.replace(path)
