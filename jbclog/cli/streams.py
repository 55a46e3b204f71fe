"""The standard streams: open from the start, and non-blocking while a tool is hot.

A parent process may have closed a stream or use a locale without °C. A serial port must never get
the number of a closed stream, or every note would be sent to the station.
"""

from __future__ import annotations

import atexit
import errno
import io
import os
import sys
import threading
import time
from collections import deque
from contextlib import suppress
from typing import IO, TYPE_CHECKING, Final

if TYPE_CHECKING:
    from typing_extensions import Buffer

# -- streams ---------------------------------------------------------------------------------------

_NUMBERS: Final = (0, 1, 2)


def make_usable() -> None:
    """Open the null device for each closed stream; escape characters that cannot be encoded."""
    for number in _NUMBERS:
        _open_null_at(number)
    sys.stdin = sys.stdin or open(0, encoding="utf-8", closefd=False)  # noqa: SIM115  # it is the program's, to its end
    sys.stdout = sys.stdout or open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def point_to_null(number: int) -> None:
    """Redirect a stream without a reader to the null device."""
    with suppress(OSError):
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, number)
        os.close(null)


# -- output that could not be written --------------------------------------------------------------

_failed_writes: list[OSError] = []


def keep_failed_write(error: OSError) -> None:
    """Remember that stdout could not be written, which ends the command with `Exit.OUTPUT`.

    A pipe that its reader closed (`jbclog runs | head`) is no failure: the reader has what it
    wanted.
    """
    if error.errno != errno.EPIPE:
        _failed_writes.append(error)


def failed_output() -> str | None:
    """Return why stdout could not be written, once all output has gone out; None if it could."""
    for output in _outputs:
        output.settle()
    if not _failed_writes:
        return None
    return _failed_writes[0].strerror or str(_failed_writes[0])


def writes_unicode() -> bool:
    """Return whether stdout can encode any character."""
    return (getattr(sys.stdout, "encoding", None) or "").lower().replace("-", "").startswith("utf")


def _open_null_at(number: int) -> None:
    try:
        os.fstat(number)
    except OSError:
        null = os.open(os.devnull, os.O_RDWR)
        if null != number:
            os.dup2(null, number)
            os.close(null)
        os.set_inheritable(number, True)


# -- non-blocking output ---------------------------------------------------------------------------
# A terminal stopped by Ctrl-S, or a pipe without a reader, must not block a command that holds hot
# tools. Such a command calls `never_wait`: a thread writes its output. Output that is not accepted
# within `END_S` after the end is lost; the record has it all.

WAITING_MOST: Final = 1 << 20  # bytes
PIECE: Final = 512
END_S: Final = 2.0
STDOUT: Final = 1

_outputs: list[NonblockingOutput] = []


class NonblockingOutput(io.RawIOBase):
    """Writes to `descriptor` in a thread. `write` never blocks; `settle` does, for `END_S` in all.

    Streams on the same terminal or file share one object, so that their texts keep their order:
    else a live table on stderr would be erased after data was written to stdout, and take the data
    with it.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        _outputs.append(self)
        self.name = f"<{descriptor}>"
        self._descriptor = descriptor
        self._waiting: deque[bytes] = deque()
        self._size = 0
        self._patience_s = END_S
        self._changed = threading.Condition()
        self.lost = 0  # bytes
        threading.Thread(target=self._write_on, name=f"write-{descriptor}", daemon=True).start()

    def fileno(self) -> int:
        return self._descriptor

    def isatty(self) -> bool:
        return os.isatty(self._descriptor)

    def writable(self) -> bool:
        return True

    def write(self, data: Buffer, /) -> int:
        """Queue `data`, or drop it if more than `WAITING_MOST` would be queued."""
        taken = bytes(data)
        with self._changed:
            if self._size + len(taken) > WAITING_MOST:
                self.lost += len(taken)
            else:
                self._waiting.append(taken)
                self._size += len(taken)
                self._changed.notify_all()
        return len(taken)

    def settle(self) -> bool:
        """Wait until all is written, for the rest of `END_S`; return whether it is."""
        began = time.monotonic()
        with self._changed:
            is_done = self._changed.wait_for(lambda: not self._size, self._patience_s)
        self._patience_s = max(self._patience_s - (time.monotonic() - began), 0.0)
        return is_done

    def _write_on(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting)
                data = self._waiting.popleft()
            lost = 0
            try:
                _write(self._descriptor, data)
            except OSError as error:  # the reader has closed it, or the disk is full
                lost = len(data)
                if self._descriptor == STDOUT:
                    keep_failed_write(error)
            with self._changed:
                self._size -= len(data)
                self.lost += lost
                self._changed.notify_all()


def _write(descriptor: int, data: bytes) -> None:
    """Write all of `data`, however long it takes. Raises `OSError`."""
    while data:
        data = data[os.write(descriptor, data[:PIECE]) :]


def never_wait() -> None:
    """Make stdout and stderr non-blocking; streams without a descriptor stay unchanged."""
    made: list[NonblockingOutput] = []
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        stream = getattr(sys, name)
        if _is_at(stream, descriptor):
            stream.flush()
            if not (made and os.path.sameopenfile(1, 2)):
                made.append(NonblockingOutput(descriptor))
                atexit.register(made[-1].settle)
            setattr(sys, name, _around(made[-1], stream))


def _is_at(stream: IO[str], descriptor: int) -> bool:
    try:
        return (
            isinstance(stream, io.TextIOWrapper)
            and stream.fileno() == descriptor
            and not isinstance(stream.buffer, NonblockingOutput)
        )
    except (OSError, ValueError):
        return False


def _around(raw: NonblockingOutput, like: io.TextIOWrapper) -> io.TextIOWrapper:
    return io.TextIOWrapper(raw, encoding=like.encoding, errors=like.errors, write_through=True)
