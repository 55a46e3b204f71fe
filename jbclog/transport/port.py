"""An open port: non-blocking reads and writes, and limits for floods.

pyserial opens and configures a port; afterwards its descriptor is used directly. pyserial's own
`read` waits in `select()`, which cannot watch a descriptor above 1023, and on a pulled cable raises
SerialException, OSError, termios.error, TypeError, ValueError or AttributeError, depending on the
moment (docs/reference/faults.md, F-15).

One thread reads and writes a port; any thread may close it.
"""

from __future__ import annotations

import _thread
import contextlib
import fcntl
import os
import select
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from typing import Final, Protocol

import serial
from jbclog.core.errors import LinkError
from jbclog.core.text import clean

MOST_AT_ONCE = 1024  # bytes of one read: many answers
CLOSE_S = 0.2  # a driver's close() may hang; after this, a thread waits for it
SLICE_S = 0.02  # time-out of a port without a descriptor; rfc2217 renegotiates when it changes
LONGEST_GREETING: Final = 512  # bytes
SHOWN_GREETING: Final = 120  # characters
LOST: Final = "connection lost (cable unplugged or server closed it)"
CLOSED = -1  # replaces the descriptor of a closed port; the system refuses it

BROKEN: Final = (OSError, ValueError, TypeError, AttributeError, termios.error)
"""Errors that pyserial raises when a port is unplugged or closed; SerialException is an OSError."""


class Port(Protocol):
    """One open port. Every method but `close` raises only `LinkError`, when the link is lost."""

    @property
    def url(self) -> str: ...

    def fileno(self) -> int | None:
        """Return a descriptor to watch for bytes; None if the port has none."""

    def write(self, data: bytes) -> None:
        """Write all of `data` without waiting."""

    def read_now(self) -> bytes:
        """Return available bytes, at most `MOST_AT_ONCE`, possibly none."""

    def read(self, timeout_s: float) -> bytes:
        """Wait for bytes and return about `MOST_AT_ONCE` at most; none after `timeout_s`."""

    def close(self) -> None:
        """Close the port. Never raises and never blocks for long; may be called twice."""


def close_in_thread(*steps: Callable[[], object]) -> None:
    """Run `steps` in a thread and wait up to `CLOSE_S` for the first. Ignores errors of a lost
    port.
    """
    done = threading.Event()

    def work() -> None:
        for step in steps:
            with contextlib.suppress(*BROKEN):
                step()
            done.set()

    try:
        # `Thread.start` never returns if the new thread gets no memory
        _thread.start_new_thread(work, ())
    except (RuntimeError, MemoryError):
        work()
    done.wait(CLOSE_S)


def unread(descriptor: int | None) -> int:
    """Return the number of received, unread bytes; 0 if unknown."""
    if descriptor is None:
        return 0
    try:
        return int.from_bytes(fcntl.ioctl(descriptor, termios.FIONREAD, bytes(4)), sys.byteorder)
    except OSError:
        return 0


def link_lost(url: str, what: str, error: BaseException | None = None) -> LinkError:
    """Return the error for a lost link, with the system's reason."""
    if error is None:
        return LinkError(f"{url}: {what}")
    number = getattr(error, "errno", None)
    reason = os.strerror(number) if isinstance(number, int) else str(error)
    return LinkError(f"{url}: {what} ({reason})")


class DescriptorPort:
    """A port with its own non-blocking descriptor: a serial device or a socket. `let_go` closes
    it.
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
            raise self._gone("cannot be written to", error) from error
        # a frame is far smaller than any buffer, so the buffer has not drained for seconds
        if written != len(data):
            raise link_lost(self.url, f"write buffer full: {written} of {len(data)} bytes accepted")

    def read_now(self) -> bytes:
        try:
            data = os.read(self._descriptor, MOST_AT_ONCE)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._gone("cannot be read", error) from error
        if not data:  # readable, but no bytes: the end of the connection
            raise link_lost(self.url, LOST)
        return data

    def read(self, timeout_s: float) -> bytes:
        watched = select.poll()
        try:
            watched.register(self._descriptor, select.POLLIN)
        except ValueError as error:
            raise link_lost(self.url, "the port is closed") from error
        if not watched.poll(max(timeout_s, 0.0) * 1000):
            return b""
        return self.read_now()

    def close(self) -> None:
        if self._descriptor != CLOSED:
            self._descriptor = CLOSED
            close_in_thread(self._let_go)

    def _gone(self, what: str, error: OSError) -> LinkError:
        if self._descriptor == CLOSED:
            return link_lost(self.url, "the port is closed")
        return link_lost(self.url, f"{what}; is it unplugged?", error)


class SocketPort(DescriptorPort):
    """A connection to a server. One that refuses says why in a text before it closes (ser2net:
    "Port already in use"); the text is in the error.

    `greeting`: what had come when the connection was made, still to be read. The first request may
    cost it: a server that has closed answers with a reset, which discards what was not read.
    """

    __slots__ = ("_first", "_has_read")

    def __init__(
        self, url: str, descriptor: int, let_go: Callable[[], object], greeting: bytes = b""
    ) -> None:
        super().__init__(url, descriptor, let_go)
        self._first = greeting  # what the server said first, as far as it can be a greeting
        self._has_read = False

    def read_now(self) -> bytes:
        try:
            data = super().read_now()
        except LinkError as error:
            raise self._with_greeting(error) from error
        if not self._has_read:
            self._has_read = True
            self._first = b""
        if len(self._first) <= LONGEST_GREETING:
            self._first += data[: LONGEST_GREETING + 1]
        return data

    def write(self, data: bytes) -> None:
        try:
            super().write(data)
        except LinkError as error:
            with contextlib.suppress(LinkError):  # what came before the connection was closed
                self.read_now()
            raise self._with_greeting(error) from error

    def _with_greeting(self, error: LinkError) -> LinkError:
        """Return the error with the server's text if it sent nothing but a text."""
        text = greeting_text(self._first)
        if not text:
            return error
        return link_lost(
            self.url,
            f'the server closed the connection and said "{text}"; see what else uses its port',
        )


def greeting_text(data: bytes) -> str:
    """Return a server's greeting, one line of at most `SHOWN_GREETING` characters; empty if these
    bytes are no text, or more than a greeting.
    """
    if len(data) > LONGEST_GREETING or b"\x02" in data:  # STX begins every frame of a station
        return ""
    text = clean(data.decode("utf-8", "replace").strip())
    letters = sum(sign.isalnum() or sign.isspace() for sign in text)
    if 2 * letters < len(text):
        return ""
    return text[:SHOWN_GREETING]


class ObjectPort:
    """A port that only pyserial can read: rfc2217 and loop.

    pyserial waits in slices of `SLICE_S`, which limits the precision of time-outs. `hang_up` ends a
    connection that pyserial would close slowly.
    """

    __slots__ = ("_hang_up", "_opened", "url")

    def __init__(
        self, url: str, opened: serial.SerialBase, hang_up: Callable[[], object] | None = None
    ) -> None:
        self.url = url
        self._opened: serial.SerialBase | None = opened
        self._hang_up = hang_up

    def fileno(self) -> int | None:
        return None

    def write(self, data: bytes) -> None:
        with self._object("cannot be written to") as opened:
            opened.write(data)

    def read_now(self) -> bytes:
        with self._object("cannot be read") as opened:
            waiting: int = opened.in_waiting  # type: ignore[attr-defined]  # every port has it, the stubs' base has not
            if not waiting:
                return b""
            return opened.read(min(waiting, MOST_AT_ONCE))

    def read(self, timeout_s: float) -> bytes:
        until = time.monotonic() + timeout_s
        while True:
            with self._object("cannot be read") as opened:
                first = opened.read(1)
            if first:
                return first + self.read_now()
            if time.monotonic() >= until:
                return b""

    def close(self) -> None:
        opened = self._opened
        self._opened = None
        if opened is None:
            return
        if self._hang_up is None:
            close_in_thread(opened.close)
        else:
            close_in_thread(self._hang_up, opened.close)

    @contextlib.contextmanager
    def _object(self, what: str) -> Iterator[serial.SerialBase]:
        """Give pyserial's object; raise its errors as `LinkError`, which says what failed."""
        if self._opened is None:
            raise link_lost(self.url, "the port is closed")
        try:
            yield self._opened
        except BROKEN as error:
            # closed by another thread meanwhile, which pyserial reports as any error
            if self._opened is None:
                raise link_lost(self.url, "the port is closed") from error
            raise link_lost(self.url, f"{what}; is it unplugged?", error) from error


# Limits that prevent a flooded port from starving the others. An answer has about sixty bytes at
# most. After a read of `MOST_AT_ONCE` bytes, or `MOST_READS` reads for one request, the port is not
# read for `REST_S`: the system's buffers then block the sender, or a serial device loses bytes.
# About `MOST_KEPT` unsolicited bytes are kept; more are read once the session has taken them. The
# protocol's client decides what a flood is and what happens to the link.

MOST_KEPT: Final = MOST_AT_ONCE
# for one request: enough for an answer that arrives byte by byte
MOST_READS: Final = 64
REST_S: Final = 0.05


class Budget:
    """Decides when to pause a port. `reads`: since the last request, which sets it to 0."""

    def __init__(self) -> None:
        self.reads = 0

    def is_spent(self, size: int) -> bool:
        """Count a read of `size` bytes; return True if the port needs a pause."""
        self.reads += 1
        return size >= MOST_AT_ONCE or self.reads > MOST_READS
