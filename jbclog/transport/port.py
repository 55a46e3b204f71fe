"""An open port: bytes in and out, without waiting, and one error for every way in which a cable can go.

pyserial opens and sets up a port; after that its descriptor is used directly. pyserial's own `read` waits in
`select()`, which cannot watch a descriptor above 1023, and what it throws at a pulled cable is SerialException, OSError,
termios.error, TypeError or ValueError, depending on where it was (faults.md, row 15).
"""

from __future__ import annotations

import os
import select
import threading
from typing import Protocol

import serial

from jbclog.errors import LinkError

MOST_AT_ONCE = 4096
CLOSE_S = 1.0  # a driver may hang in close(); then a thread is left to wait for it

try:
    import termios

    BROKEN: tuple[type[Exception], ...] = (OSError, ValueError, TypeError, AttributeError, termios.error)
except ImportError:  # Windows
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
        """What is there; nothing where nothing is."""

    def read(self, timeout_s: float) -> bytes:
        """Wait for the first bytes; nothing where none came within `timeout_s`."""

    def close(self) -> None:
        """Give the port back. Never raises, never waits for long; twice is as good as once."""


class _Opened:
    """What both kinds of ports share: the URL, and closing."""

    def __init__(self, url: str, opened: serial.SerialBase) -> None:
        self.url = url
        self._opened: serial.SerialBase | None = opened

    def close(self) -> None:
        opened, self._opened = self._opened, None
        if opened is None:
            return
        closing = threading.Thread(target=_close, args=(opened,), name="close-port", daemon=True)
        closing.start()
        closing.join(CLOSE_S)

    def _lost(self, what: str, error: BaseException | None = None) -> LinkError:
        why = f": {error}" if error is not None else ""
        return LinkError(f"{self.url}: {what}{why}")


def _close(opened: serial.SerialBase) -> None:
    try:
        opened.close()
    except BROKEN:
        return  # it was gone already


class DescriptorPort(_Opened):
    """A port with a descriptor: a serial device or a socket."""

    def __init__(self, url: str, opened: serial.SerialBase, descriptor: int) -> None:
        super().__init__(url, opened)
        self._descriptor = descriptor
        os.set_blocking(descriptor, False)

    def fileno(self) -> int | None:
        return None if self._opened is None else self._descriptor

    def write(self, data: bytes) -> None:
        if self._opened is None:
            raise self._lost("the port is closed")
        try:
            written = os.write(self._descriptor, data)
        except BROKEN as error:
            raise self._lost("writing failed; is it unplugged?", error) from error
        if written != len(data):  # a frame is far smaller than any buffer: nothing has drained it for seconds
            raise self._lost(f"the port took only {written} of {len(data)} bytes; the line is stuck")

    def read_now(self) -> bytes:
        if self._opened is None:
            raise self._lost("the port is closed")
        try:
            data = os.read(self._descriptor, MOST_AT_ONCE)
        except (BlockingIOError, InterruptedError):
            return b""
        except BROKEN as error:
            raise self._lost("reading failed; is it unplugged?", error) from error
        if not data:  # a port that can be read and gives nothing is at its end
            raise self._lost("it was hung up: unplugged, or the server is gone")
        return data

    def read(self, timeout_s: float) -> bytes:
        if self._opened is None:
            raise self._lost("the port is closed")
        watched = select.poll()
        watched.register(self._descriptor, select.POLLIN)
        return self.read_now() if watched.poll(max(timeout_s, 0.0) * 1000) else b""


class ObjectPort(_Opened):
    """A port that only pyserial can read: rfc2217, or Windows."""

    def fileno(self) -> int | None:
        return None

    def write(self, data: bytes) -> None:
        try:
            self._object().write(data)
        except BROKEN as error:
            raise self._lost("writing failed; is it unplugged?", error) from error

    def read_now(self) -> bytes:
        return self.read(0.0)

    def read(self, timeout_s: float) -> bytes:
        try:
            opened = self._object()
            opened.timeout = max(timeout_s, 0.0)
            first: bytes = opened.read(1)
            waiting: int = opened.in_waiting  # type: ignore[attr-defined]  # every port has it, the stubs' base has not
            return first + opened.read(waiting) if first else b""
        except BROKEN as error:
            raise self._lost("reading failed; is it unplugged?", error) from error

    def _object(self) -> serial.SerialBase:
        if self._opened is None:
            raise self._lost("the port is closed")
        return self._opened
