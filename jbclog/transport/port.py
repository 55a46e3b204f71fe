"""An open port: bytes in and out without waiting, and how much is taken at a time.

pyserial opens and sets up a port; after that its descriptor is used directly. pyserial's own `read` waits in
`select()`, which cannot watch a descriptor above 1023, and what it throws at a pulled cable is SerialException, OSError,
termios.error, TypeError, ValueError or AttributeError, depending on where it was (docs/reference/faults.md, F-15).

One thread reads and writes a port; any thread may close it.
"""

from __future__ import annotations

import _thread
import contextlib
import os
import select
import sys
import threading
import time
from collections.abc import Callable
from typing import Final, Protocol

import serial
from jbclog.core.errors import LinkError

# -- port ---------------------------------------------------------------------------------------------------------------------

MOST_AT_ONCE = 1024  # bytes of a read: many answers
CLOSE_S = 0.2  # a driver may hang in close(); then a thread is left to wait for it
SLICE_S = 0.02  # the time-out that a port without a descriptor is opened with; rfc2217 negotiates anew when it is changed
CLOSED = -1  # in place of the descriptor: the system refuses it like any other that is gone

try:
    import fcntl
    import termios

    BROKEN: tuple[type[Exception], ...] = (OSError, ValueError, TypeError, AttributeError, termios.error)
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]  # told apart above
    BROKEN = (OSError, ValueError, TypeError, AttributeError)
"""What pyserial throws when a port is unplugged, closed or gone; SerialException is an OSError."""


class Port(Protocol):
    """One open port. Every method but `close` raises `LinkError` when the link is gone, and nothing else."""

    @property
    def url(self) -> str: ...

    def fileno(self) -> int | None:
        """A descriptor that can be watched for bytes to read, or None where the port has none."""

    def write(self, data: bytes) -> None:
        """Hand all of `data` to the system, at once."""

    def read_now(self) -> bytes:
        """What is there, `MOST_AT_ONCE` bytes at the most; nothing where nothing is."""

    def read(self, timeout_s: float) -> bytes:
        """Wait for the first bytes, about `MOST_AT_ONCE` at the most; nothing where none came within `timeout_s`."""

    def close(self) -> None:
        """Give the port back. Never raises, never waits for long; twice is as good as once."""


def give_back(*steps: Callable[[], object]) -> None:
    """Do `steps` in a thread of their own and wait for the first, at most `CLOSE_S`. What is gone already is no matter."""
    done = threading.Event()

    def work() -> None:
        for step in steps:
            with contextlib.suppress(*BROKEN):
                step()
            done.set()

    try:
        _thread.start_new_thread(work, ())  # `Thread.start` waits for ever for one that is refused memory
    except (RuntimeError, MemoryError):
        work()
    done.wait(CLOSE_S)


def unread(descriptor: int | None) -> int:
    """How many bytes have come that nobody has read; 0 where the system does not say."""
    if descriptor is None or fcntl is None:
        return 0
    try:
        return int.from_bytes(fcntl.ioctl(descriptor, termios.FIONREAD, bytes(4)), sys.byteorder)
    except OSError:
        return 0


def lost(url: str, what: str, error: BaseException | None = None) -> LinkError:
    """The one error of a link that is gone."""
    return LinkError(f"{url}: {what}" + (f" ({_reason(error)})" if error is not None else ""))


def _reason(error: BaseException) -> str:
    number = getattr(error, "errno", None)
    return os.strerror(number) if isinstance(number, int) else str(error)


class DescriptorPort:
    """A port with a descriptor: a serial device or a socket. The descriptor does not block and is the port's own.

    `let_go` gives it back.
    """

    __slots__ = ("_descriptor", "_let_go", "url")

    def __init__(self, url: str, descriptor: int, let_go: Callable[[], object]) -> None:
        self.url = url
        self._descriptor = descriptor
        self._let_go = let_go

    def fileno(self) -> int | None:
        return self._descriptor if self._descriptor != CLOSED else None

    def write(self, data: bytes) -> None:
        try:
            written = os.write(self._descriptor, data)
        except BlockingIOError:
            written = 0
        except OSError as error:
            raise self._gone("it cannot be written to", error) from error
        if written != len(data):  # a frame is far smaller than any buffer: nothing has drained this one for seconds
            raise lost(self.url, f"the line is stuck: it took {written} of {len(data)} bytes")

    def read_now(self) -> bytes:
        try:
            data = os.read(self._descriptor, MOST_AT_ONCE)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._gone("it cannot be read", error) from error
        if not data:  # with one byte as the least to read, a port that gives none is at its end
            raise lost(self.url, "it was hung up: unplugged, or the server ended the connection")
        return data

    def read(self, timeout_s: float) -> bytes:
        watched = select.poll()
        try:
            watched.register(self._descriptor, select.POLLIN)
        except ValueError as error:
            raise lost(self.url, "the port is closed") from error
        return self.read_now() if watched.poll(max(timeout_s, 0.0) * 1000) else b""

    def close(self) -> None:
        if self._descriptor != CLOSED:
            self._descriptor = CLOSED
            give_back(self._let_go)

    def _gone(self, what: str, error: OSError) -> LinkError:
        if self._descriptor == CLOSED:
            return lost(self.url, "the port is closed")
        return lost(self.url, f"{what}; is it unplugged?", error)


class ObjectPort:
    """A port that only pyserial can read: rfc2217, loop, spy, and every port on Windows.

    pyserial waits at most `SLICE_S` at a time, so that a time-out is met within that. `hang_up` ends what pyserial's own
    closing would take long over.
    """

    __slots__ = ("_hang_up", "_opened", "url")

    def __init__(self, url: str, opened: serial.SerialBase, hang_up: Callable[[], object] | None = None) -> None:
        self.url = url
        self._opened: serial.SerialBase | None = opened
        self._hang_up = hang_up

    def fileno(self) -> int | None:
        return None

    def write(self, data: bytes) -> None:
        opened = self._object()
        try:
            opened.write(data)
        except BROKEN as error:
            raise self._gone("it cannot be written to", error) from error

    def read_now(self) -> bytes:
        opened = self._object()
        try:
            return opened.read(min(waiting, MOST_AT_ONCE)) if (waiting := _waiting(opened)) else b""
        except BROKEN as error:
            raise self._gone("it cannot be read", error) from error

    def read(self, timeout_s: float) -> bytes:
        until = time.monotonic() + timeout_s
        while True:
            first = self._first()
            if first:
                return first + self.read_now()
            if time.monotonic() >= until:
                return b""

    def close(self) -> None:
        opened, self._opened = self._opened, None
        if opened is not None:
            give_back(*filter(None, (self._hang_up, opened.close)))

    def _first(self) -> bytes:
        opened = self._object()
        try:
            return opened.read(1)
        except BROKEN as error:
            raise self._gone("it cannot be read", error) from error

    def _object(self) -> serial.SerialBase:
        if self._opened is None:
            raise lost(self.url, "the port is closed")
        return self._opened

    def _gone(self, what: str, error: Exception) -> LinkError:
        if self._opened is None:  # closed by another thread meanwhile: pyserial stumbles over what is missing
            return lost(self.url, "the port is closed")
        return lost(self.url, f"{what}; is it unplugged?", error)


def _waiting(opened: serial.SerialBase) -> int:
    waiting: int = opened.in_waiting  # type: ignore[attr-defined]  # every port has it, the stubs' base has not
    return waiting


# -- read budget --------------------------------------------------------------------------------------------------------------
# How much of what comes over one port is taken at a time, so that a port that never falls silent costs the others nothing.
#
# An answer has some sixty bytes at the most. A read that gives `MOST_AT_ONCE`, and one more after `MOST_READS` that brought no
# answer, are no station's: then the port is not read for `REST_S`. What comes meanwhile waits in the system, whose own limit stops
# the sender; a serial device loses it. Of bytes that came unasked `MOST_KEPT` or a little more are kept, and then nothing is read
# until the session has taken them.
#
# What a flood is, and what becomes of the link then, is for whoever speaks to the station.

MOST_KEPT: Final = MOST_AT_ONCE
MOST_READS: Final = 64  # since the last question: more than an answer has bytes, should they come one by one
REST_S: Final = 0.05


class Budget:
    """What one port may still give until it has to rest."""

    __slots__ = ("_reads",)

    def __init__(self) -> None:
        self._reads = 0

    def asked(self) -> None:
        """A question goes out: its answer may come in pieces."""
        self._reads = 0

    def is_spent(self, size: int) -> bool:
        """Whether the port has to rest after a read that gave `size` bytes."""
        self._reads += 1
        return size >= MOST_AT_ONCE or self._reads > MOST_READS
