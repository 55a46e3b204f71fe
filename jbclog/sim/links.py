"""Where a client finds a virtual station: a pseudo-terminal behind a link in the file system, or a TCP port."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

with suppress(ImportError):  # Windows has no pseudo-terminals; TcpLink serves there
    import fcntl
    import termios
    import tty

from jbclog.core.errors import UsageError
from jbclog.core.line_format import LineFormat
from jbclog.sim.terminal_line import line_set
from jbclog.sim.uart import heard
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

    While no client has it open the station holds the client's side itself, so that it does not hang up; it
    lets go of it at the first byte, so that it learns when the client closes. Then it takes back the exclusive
    use, which outlives the client.

    Where the client has set another line format than the station's, `line`, each hears of the other what a wire would
    make of it (`uart.py`).
    """

    def __init__(self, path: Path, waiter: Waiter, line: LineFormat) -> None:
        self.path = path
        self._waiter = waiter
        self._line = line
        self._station: int | None = None
        self._held: int | None = None
        self._device = ""
        self._on_bytes: OnBytes = _forget

    @property
    def url(self) -> str:
        return str(self.path)

    def plug_in(self, on_bytes: OnBytes) -> None:
        self._on_bytes = on_bytes
        self._station, self._held = os.openpty()
        self._device = os.ttyname(self._held)
        tty.setraw(self._held)
        os.set_blocking(self._station, False)
        self._waiter.add(self._station, self._read)
        _link(self.path, self._device)

    def send(self, data: bytes) -> None:
        if self._station is not None:
            with suppress(BlockingIOError):  # nobody has read for thousands of bytes
                os.write(self._station, heard(data, self._line, line_set(self._station, self._line), keeps_errors=True))

    def pull_out(self) -> None:
        if self._station is None:
            return
        station, self._station = self._station, None
        self._waiter.remove(station)
        if self.path.is_symlink() and str(self.path.readlink()) == self._device:
            self.path.unlink()
        os.close(station)
        self._let_go()

    def _read(self, now: float) -> None:
        if self._station is None:
            return
        try:
            data = os.read(self._station, MOST_AT_ONCE)
        except BlockingIOError:
            return
        except OSError:  # EIO: the last client has closed
            data = b""
        if data:
            self._let_go()
            understood = heard(data, line_set(self._station, self._line), self._line)
            if understood:
                self._on_bytes(understood, now)
        else:
            self._hold()

    def _let_go(self) -> None:
        if self._held is not None:
            held, self._held = self._held, None
            os.close(held)

    def _hold(self) -> None:
        with suppress(OSError):  # the next client has it already, for itself alone
            self._held = os.open(self._device, os.O_RDWR | os.O_NOCTTY)
            fcntl.ioctl(self._held, termios.TIOCNXCL)  # and no more: the next client may be setting up its own already


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
