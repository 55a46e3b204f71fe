"""The program's streams: usable from the start, and never waited for while a tool is hot.

Who starts a program may have closed one of them, or may live in a locale that cannot write °C. Neither is a reason not to
solder; and a port that is opened must not get the number of a closed stream, where every note would be sent to the station.
"""

from __future__ import annotations

import atexit
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

# -- streams ------------------------------------------------------------------------------------------------------------------

_NUMBERS: Final = (0, 1, 2)


def make_usable() -> None:
    """Put the null device where a stream is closed; let what cannot be encoded be written as an escape."""
    for number in _NUMBERS:
        _open_null_at(number)
    sys.stdin = sys.stdin or open(0, encoding="utf-8", closefd=False)  # noqa: SIM115  # it is the program's, to its end
    sys.stdout = sys.stdout or open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def point_to_null(number: int) -> None:
    """Let everything that is still to be written to a stream vanish: nobody reads it any more."""
    with suppress(OSError):
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, number)
        os.close(null)


def writes_unicode() -> bool:
    """Whether stdout takes any character as it is."""
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


# -- nonblocking stdio --------------------------------------------------------------------------------------------------------
# Output that nobody waits for: a terminal that is held (Ctrl-S), or a pipe that nobody reads, holds no verb with hot tools.
#
# The verbs that hold stations call `never_wait`. From there on what they print is written in a thread, as soon as it is taken;
# at the end it is waited for a little, and what has not been taken by then is lost. The record has it all.

WAITING_MOST: Final = 1 << 20  # bytes
PIECE: Final = 512
END_S: Final = 2.0  # what people may take at the end of a verb to go on reading


class NonblockingOutput(io.RawIOBase):
    """Writes to `descriptor` in a thread. `write` never waits; `settle` does, for `END_S` in all."""

    def __init__(self, descriptor: int) -> None:
        super().__init__()
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
        """Take all of `data`, or lose it where too much is waiting already."""
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
        """Wait until all is written, for what is left of `END_S`; give whether it is."""
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
            is_taken = _write(self._descriptor, data)
            with self._changed:
                self._size -= len(data)
                self.lost += 0 if is_taken else len(data)
                self._changed.notify_all()


def _write(descriptor: int, data: bytes) -> bool:
    """Write all of it, however long that takes; whether anybody takes it at all."""
    try:
        while data:
            data = data[os.write(descriptor, data[:PIECE]) :]
    except OSError:  # nobody reads it any more, or its disk is full
        return False
    return True


def never_wait() -> None:
    """Have what is printed from now on taken at once. Streams that are no descriptors (as in tests) stay as they are."""
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        stream = getattr(sys, name)
        if _is_at(stream, descriptor):
            stream.flush()
            unheld = NonblockingOutput(descriptor)
            setattr(sys, name, _around(unheld, stream))
            atexit.register(unheld.settle)


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
