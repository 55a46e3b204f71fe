"""Links of virtual stations: pseudo-terminals and TCP ports, with a serial line's timing."""

from __future__ import annotations

import ctypes
import os
import select
import selectors
import signal
import socket
import struct
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Protocol

from jbclog.core.errors import UsageError
from jbclog.core.serial_line import LineFormat

# A pseudo-terminal passes bytes at any format. Linux keeps the client's rate, stop bits and odd
# parity, but not even parity, so even and none cannot be distinguished.

with suppress(ImportError):  # Windows has no terminals
    import fcntl
    import termios


# arbitrary rates; the same on all machines but MIPS, PowerPC, SPARC and Alpha
TCGETS2 = 0x802C542A
_SETTINGS = struct.Struct("4I B 19s 2I")


def line_set(descriptor: int, like: LineFormat) -> LineFormat:
    """Return the line format set by the client of the terminal behind `descriptor`, completed from
    `like`.
    """
    try:
        settings = fcntl.ioctl(descriptor, TCGETS2, bytes(_SETTINGS.size))
    except (OSError, NameError):
        return like
    _, _, flags, _, _, _, baudrate, _ = _SETTINGS.unpack(settings)
    is_odd = bool(flags & termios.PARODD)
    if baudrate <= 0 or (baudrate == like.baudrate and is_odd == (like.parity == "O")):
        return like
    parity = "O" if is_odd else "N" if like.parity == "O" else like.parity
    return LineFormat(baudrate, f"8{parity}{like.stop_bits}")


JUNK = b"\x00\xf8\x80"  # no start, end, or part of a frame


def heard(
    data: bytes, sender: LineFormat, receiver: LineFormat, *, keeps_errors: bool = False
) -> bytes:
    """Return what `receiver` reads when `sender` sends `data`.

    A careful station reads nothing at another rate or parity. A receiver that `keeps_errors`, as
    Linux does with the usual settings, reads at most three junk bytes at another rate, and does not
    mind the parity.
    """
    if sender.baudrate == receiver.baudrate and (keeps_errors or sender.parity == receiver.parity):
        return data
    return JUNK[: len(data)] if keeps_errors else b""


# epoll counts whole milliseconds, but a simulated line needs shorter waits. So select(), which
# counts microseconds, ends each wait and watches one descriptor, that of epoll, so that a request
# arriving meanwhile is noticed at once. Where possible timers are exact to the nanosecond instead
# of 50 µs, and a long wait aims `LEAD_S` before its end, because a sleeping processor needs about
# that long to wake.

Ready = Callable[[float], None]
"""Called when bytes can be read, with the time (monotonic seconds)."""

MOST_FOR_SELECT = 1024  # a selector created early has a low number
LEAD_S = 40e-6
LONG_S = 1e-3
PR_SET_TIMERSLACK = 29


def exact_timers() -> None:
    """Make Linux end this thread's waits exactly, not up to 50 µs late."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)


class Waiter:
    """Waits for descriptors and calls back for each that is readable."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        epoll = isinstance(self._selector, getattr(selectors, "EpollSelector", ()))
        self._coarse = epoll and self._selector.fileno() < MOST_FOR_SELECT
        self._wake_read, self._wake_write = os.pipe()
        os.set_blocking(self._wake_write, False)
        self.add(self._wake_read, self._awake)

    def add(self, descriptor: int, ready: Ready) -> None:
        self._selector.register(descriptor, selectors.EVENT_READ, ready)

    def remove(self, descriptor: int) -> None:
        self._selector.unregister(descriptor)

    def wait(self, seconds: float | None) -> None:
        """Wait until a descriptor is readable or `seconds` are nearly over, and call back.

        A callback may remove only its own descriptor.
        """
        if self._coarse and seconds is not None:
            aim = seconds - LEAD_S if seconds > LONG_S else max(seconds, 0.0)
            if not select.select([self._selector], [], [], aim)[0]:
                return
            seconds = 0.0
        found = self._selector.select(seconds)
        now = monotonic()
        for key, _ in found:
            key.data(now)

    def wake(self) -> None:
        """End a wait, from a signal handler or another thread."""
        with suppress(BlockingIOError):  # full: it wakes anyway
            os.write(self._wake_write, b".")

    def wake_on_signals(self) -> None:
        """Let each signal with a handler end a wait, even one that arrives just before the wait,
        whose handler Python would call only afterwards.
        """
        signal.set_wakeup_fd(self._wake_write, warn_on_full_buffer=False)

    def close(self) -> None:
        self._selector.close()
        os.close(self._wake_read)
        os.close(self._wake_write)

    def _awake(self, _now: float) -> None:
        os.read(self._wake_read, 4096)


with suppress(ImportError):  # Windows has no pseudo-terminals; TcpLink works there
    import fcntl
    import termios
    import tty


MOST_AT_ONCE = 4096

OnBytes = Callable[[bytes, float], None]
"""Takes bytes written to a port, with their time (monotonic seconds)."""


class Link(Protocol):
    """One station's end of the cable. `url` is for the client."""

    @property
    def url(self) -> str: ...

    def plug_in(self, on_bytes: OnBytes) -> None:
        """Create the port, and pass bytes written to it to `on_bytes`."""

    def send(self, data: bytes) -> None:
        """Send `data` to the client; lost without a client."""

    def pull_out(self) -> None:
        """Remove the port, as a pulled cable does."""


class PtyLink:
    """A pseudo-terminal with a symbolic link to it at `path`.

    Without a client the station holds the client's side open itself, so that the terminal stays
    connected. It closes it at the first byte, to notice when the client closes, and then clears the
    exclusive mode, which outlives the client.

    If the client has set another line format than the station's, `line`, each receives what a real
    line would deliver.
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
            with suppress(BlockingIOError):  # the buffer is full because nobody reads
                os.write(
                    self._station,
                    heard(data, self._line, line_set(self._station, self._line), keeps_errors=True),
                )

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
        with suppress(OSError):  # the next client has opened it exclusively
            self._held = os.open(self._device, os.O_RDWR | os.O_NOCTTY)
            # nothing more: the next client may be configuring it
            fcntl.ioctl(self._held, termios.TIOCNXCL)


class TcpLink:
    """A TCP port that serves one client at a time; a second one is refused."""

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
        except OSError:  # already gone
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
    """Make `path` a symbolic link to `target`; replaces only a link."""
    if path.exists() and not path.is_symlink():
        raise UsageError(f"{path} is there already and is no link; it is left alone")
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    fresh.symlink_to(target)
    fresh.replace(path)
