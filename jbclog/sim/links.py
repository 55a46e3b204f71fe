"""Where a client finds a virtual station: pseudo-terminals and TCP ports, with the timing of a wire."""

from __future__ import annotations

import ctypes
import os
import select
import selectors
import socket
import struct
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Protocol

from jbclog.core.errors import UsageError
from jbclog.core.serial_line import LineFormat

# -- terminal line ------------------------------------------------------------------------------------------------------------
# The line format that a client has set on a pseudo-terminal, which has no wire and passes bytes on at any.
#
# Linux keeps rate, stop bits and the mark for odd parity, and drops the one for parity as such: there even cannot be told
# from none.

with suppress(ImportError):  # Windows has no terminals
    import fcntl
    import termios


TCGETS2 = 0x802C542A  # rates of any number; the same on all machines but MIPS, PowerPC, SPARC and Alpha
_SETTINGS = struct.Struct("4I B 19s 2I")


def line_set(descriptor: int, like: LineFormat) -> LineFormat:
    """What the client of the terminal behind `descriptor` has set; `like` where, or as far as, that cannot be told."""
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


# -- uart ---------------------------------------------------------------------------------------------------------------------
# What a receiver makes of characters that were sent at another rate or parity than its own: bit by bit, as on a wire.
#
# A receiver waits for a falling edge and looks at the line in the middle of each bit that should follow, by its own clock.
# Of the stop bits it looks at the first only, so that one or two make no difference to it.

IDLE = 1
DATA_BITS = 8


def heard(data: bytes, sender: LineFormat, receiver: LineFormat, *, keeps_errors: bool = False) -> bytes:
    """What `receiver` hears of `data`, sent without a pause by `sender`.

    Characters whose parity or stop bit is wrong are dropped, as a careful station does, or kept, as Linux does with the
    settings that serial programs use.
    """
    if (sender.baudrate, sender.parity) == (receiver.baudrate, receiver.parity):
        return data
    levels = [level for byte in data for level in _character(byte, sender)]
    return bytes(byte for byte, is_good in _received(levels, sender.baudrate, receiver) if is_good or keeps_errors)


def _character(byte: int, line: LineFormat) -> list[int]:
    """The levels of one character, bit after bit: start, data from the lowest bit up, parity, stop."""
    data = [byte >> place & 1 for place in range(DATA_BITS)]
    return [0, *data, *_parity(sum(data), line), *[IDLE] * line.stop_bits]


def _parity(ones: int, line: LineFormat) -> list[int]:
    return [] if line.parity == "N" else [(ones + (line.parity == "O")) & 1]


def _received(levels: list[int], baudrate: int, receiver: LineFormat) -> Iterator[tuple[int, bool]]:
    """Each character that the receiver finds in the levels, and whether its parity and stop bit hold."""

    def level_at(seconds: float) -> int:
        place = int(seconds * baudrate)
        return levels[place] if place < len(levels) else IDLE

    parities = receiver.parity != "N"
    edge = _falling_edge(levels, 0)
    while edge is not None:
        starts = edge / baudrate
        looked = [starts + (bit + 0.5) / receiver.baudrate for bit in range(1 + DATA_BITS + parities + 1)]
        start, *bits = [level_at(moment) for moment in looked]
        data, parity, stop = bits[:DATA_BITS], bits[DATA_BITS:-1], bits[-1]
        if start == 0:  # else a spike that was over too soon
            yield sum(bit << place for place, bit in enumerate(data)), stop == IDLE and parity == _parity(sum(data), receiver)
        done = looked[-1] if start == 0 else looked[0]
        edge = _falling_edge(levels, max(int(done * baudrate), edge + 1))


def _falling_edge(levels: list[int], first: int) -> int | None:
    """The first place from `first` on at which the line goes from idle to 0."""
    before = levels[first - 1] if 0 < first <= len(levels) else IDLE
    for place in range(first, len(levels)):
        if before and not levels[place]:
            return place
        before = levels[place]
    return None


# -- waiting ------------------------------------------------------------------------------------------------------------------
# Waits for many descriptors, exactly: epoll counts whole milliseconds, and a paced wire needs less than one.
#
# Where the selector is epoll, the last word has select(), which counts microseconds and can watch one
# descriptor: epoll's own. A question that comes meanwhile is heard at once. Where the system lets it, timers
# are exact to the nanosecond instead of 50 µs, and a long wait aims `LEAD_S` before its end, because a processor
# that has slept for long needs about as much to wake.

Ready = Callable[[float], None]
"""Called with the moment (monotonic seconds) at which there was something to read."""

MOST_FOR_SELECT = 1024  # a selector that is made first has a low number
LEAD_S = 40e-6
LONG_S = 1e-3
PR_SET_TIMERSLACK = 29


def exact_timers() -> None:
    """Ask Linux to end this thread's waits when they end, and not up to 50 µs later."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)


class Waiter:
    """Descriptors, and what to call when there is something to read on each."""

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
        """Wait until something can be read or `seconds` have nearly gone by, and call whoever is concerned.

        Who is called removes no descriptor but its own.
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
        os.write(self._wake_write, b".")

    def close(self) -> None:
        self._selector.close()
        os.close(self._wake_read)
        os.close(self._wake_write)

    def _awake(self, _now: float) -> None:
        os.read(self._wake_read, 4096)


# -- links --------------------------------------------------------------------------------------------------------------------

with suppress(ImportError):  # Windows has no pseudo-terminals; TcpLink serves there
    import fcntl
    import termios
    import tty


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
    make of it (`links.py`).
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
