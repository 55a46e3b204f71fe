r"""Lines that arrive during a run, from a barcode scanner or a program. Nothing here blocks.

A line ends with CR, LF or both, depending on the scanner's configuration. Invalid or invisible
characters become escapes (``\x1d`` for the group separator of a GS1 code), so that different
serials never look the same. A line that is too long is marked, because it may be two lines.
"""

from __future__ import annotations

import os
import select
import stat
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jbclog.core.encodings import not_utf8
from jbclog.core.errors import UsageError
from jbclog.core.operating_system import NO_WAIT, PLAIN

STDIN: Final = 0
OWN_STDIN: Final = Path("/proc/self/fd/0")
LONGEST: Final = 200  # characters, as for every text that people enter
KEPT: Final = 4096  # bytes of an unfinished line
A_LOOK: Final = 256  # bytes of one read: more than anybody types; a faster program has to wait
# Unicode categories of invisible characters
HIDDEN: Final = ("Cc", "Cf", "Co", "Cn", "Cs", "Zl", "Zp")
# around a serial: blanks, and the byte order mark with which a file begins, also one that follows
# another file in the same stream (`cat morning.txt evening.txt`)
EDGES: Final = " \t\ufeff"
FLAGS: Final = NO_WAIT | PLAIN


@dataclass(frozen=True, slots=True)
class TypedLine:
    """A line without its end. `is_clear`: nothing was escaped. `is_whole`: not too long."""

    text: str
    is_clear: bool = True
    is_whole: bool = True


class LineSplitter:
    """Splits bytes into lines; empty lines are dropped."""

    def __init__(self) -> None:
        self._rest = b""
        self._is_cut = False

    def feed(self, data: bytes) -> Iterator[TypedLine]:
        """Return the lines completed by `data`."""
        *lines, rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        is_first_cut = self._is_cut
        self._is_cut = len(rest) > KEPT or (self._is_cut and not lines)
        self._rest = rest[:KEPT]
        for number, line in enumerate(lines):
            yield from self._line(line, is_cut=is_first_cut and number == 0)

    def finish(self) -> Iterator[TypedLine]:
        """Return the unfinished line, if any."""
        yield from self._line(self._rest, is_cut=self._is_cut)
        self._rest = b""
        self._is_cut = False

    def _line(self, data: bytes, *, is_cut: bool) -> Iterator[TypedLine]:
        try:
            text = data.decode("utf-8")
            is_text = True
        except UnicodeDecodeError:
            text = data.decode("utf-8", "backslashreplace")
            is_text = False
        text = text.strip(EDGES)
        shown = "".join(_shown(sign) for sign in text)
        if shown:
            is_clear = is_text and shown == text
            yield TypedLine(shown[:LONGEST], is_clear, not is_cut and len(shown) <= LONGEST)


def _shown(sign: str) -> str:
    if unicodedata.category(sign) in HIDDEN:
        return sign.encode("unicode_escape").decode()
    return sign


class SourceLost(Exception):
    """The source is gone: scanner unplugged or terminal closed."""


class LineSource:
    """A non-blocking source of lines. `name` is for people; `is_typed`: a terminal, which
    echoes.
    """

    def __init__(self, descriptor: int, name: str, *, ends: bool = True) -> None:
        """`ends`: its end is intended, as that of a pipe or of typed input."""
        self.name = name
        self.is_typed = os.isatty(descriptor)
        self._descriptor = descriptor
        self._ends = ends
        self._ready = select.poll()
        self._ready.register(descriptor, select.POLLIN)

    def read(self) -> bytes | None:
        """Return available bytes, possibly none; None at the end. Raises `SourceLost`."""
        try:
            if not self._ready.poll(0):
                return b""
            data = os.read(self._descriptor, A_LOOK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise SourceLost(error.strerror or str(error)) from error
        if not data and not self._ends:
            raise SourceLost("connection lost")
        return data or None

    def close(self) -> None:
        if self._descriptor != STDIN:
            os.close(self._descriptor)


def open_source(name: str) -> LineSource:
    """Open stdin for ``-``, else a pipe or a device. Raises `UsageError`."""
    if name == "-":
        return LineSource(_stdin(), "stdin")
    try:
        kind = Path(name).stat().st_mode
        if stat.S_ISDIR(kind):
            raise UsageError(f"--units {name} is a folder: give -, a pipe, a device or a file")
        # open for writing too, because otherwise the pipe ends when a writer closes it
        how = os.O_RDWR if stat.S_ISFIFO(kind) else os.O_RDONLY
        return LineSource(os.open(name, how | FLAGS), name, ends=False)
    except (OSError, ValueError) as error:
        raise UsageError(f"--units {name}: {getattr(error, 'strerror', None) or error}") from error


def _stdin() -> int:
    """Reopen stdin, because its non-blocking mode would also affect the shell, which shares it."""
    with suppress(OSError):
        return os.open(OWN_STDIN, os.O_RDONLY | FLAGS)
    return STDIN


@contextmanager
def echo_off() -> Iterator[None]:
    """Switch off the echo of the terminal on stdin, unless this program is in the background: the
    system stops a background program that changes the terminal.
    """
    import termios

    if not _is_in_foreground():
        yield
        return
    before = termios.tcgetattr(STDIN)
    silent = [*before]
    silent[3] &= ~termios.ECHO
    termios.tcsetattr(STDIN, termios.TCSADRAIN, silent)
    try:
        yield
    finally:
        with suppress(termios.error):
            termios.tcsetattr(STDIN, termios.TCSADRAIN, before)


def _is_in_foreground() -> bool:
    try:
        return os.tcgetpgrp(STDIN) == os.getpgrp()
    except OSError:
        return False


def is_plain_file(name: str) -> bool:
    """Return True if it is a regular file, which has an end."""
    with suppress(OSError, ValueError):
        return stat.S_ISREG(os.fstat(STDIN).st_mode if name == "-" else Path(name).stat().st_mode)
    return False


def lines_of_file(name: str, most_bytes: int) -> list[TypedLine]:
    """Read all lines of a regular file. Raises `UsageError`, also if it is not UTF-8."""
    try:
        with open(STDIN if name == "-" else name, "rb", closefd=name != "-") as file:
            data = file.read(most_bytes + 1)
    except OSError as error:
        raise UsageError(f"--units {name}: {error.strerror or error}") from error
    if len(data) > most_bytes:
        raise UsageError(f"--units {name}: more than {most_bytes} bytes; not a list of serials")
    wrong = not_utf8(data)
    if wrong is not None:
        where = "" if wrong.line is None else f", line {wrong.line}"
        raise UsageError(f"--units {name}{where}: {wrong.text}")
    splitter = LineSplitter()
    return [*splitter.feed(data), *splitter.finish()]
