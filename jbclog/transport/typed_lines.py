"""Lines that come in while sessions go on: typed by a barcode reader, written by a program. Nothing here ever waits.

Who asks gets what is there at that moment. A line ends with CR, LF or both, as readers of bar codes are set up either way;
what is no text, or does not show, is kept as an escape (``\\x1d`` for the group separator of a GS1 code), so that two serials
that differ never look the same. A line that is too long is told as such, for it may be two that ran into each other.
"""

from __future__ import annotations

import os
import select
import stat
import unicodedata
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jbclog.core.errors import UsageError

STDIN: Final = 0
OWN_STDIN: Final = Path("/proc/self/fd/0")
LONGEST: Final = 200  # characters, as of every text that people give
KEPT: Final = 4096  # bytes of a line without an end
A_LOOK: Final = 256  # bytes taken at once: nobody types faster, and a program that does has to wait
HIDDEN: Final = ("Cc", "Cf", "Co", "Cn", "Cs", "Zl", "Zp")  # categories of characters that do not show
BOM: Final = "\ufeff"
FLAGS: Final = os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC


@dataclass(frozen=True, slots=True)
class Line:
    """One line without its end. `is_clear`: nothing had to be escaped. `is_whole`: it was not too long."""

    text: str
    is_clear: bool = True
    is_whole: bool = True


class Splitter:
    """Bytes in, lines out; empty ones are none."""

    def __init__(self) -> None:
        self._rest = b""
        self._is_cut = False
        self._is_first = True

    def feed(self, data: bytes) -> Iterator[Line]:
        """The lines that end with `data`."""
        *ended, rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        is_cut, self._is_cut = self._is_cut, len(rest) > KEPT or (self._is_cut and not ended)
        self._rest = rest[:KEPT]
        for place, line in enumerate(ended):
            yield from self._line(line, is_cut=is_cut and place == 0)

    def finish(self) -> Iterator[Line]:
        """What came without an end."""
        yield from self._line(self._rest, is_cut=self._is_cut)
        self._rest, self._is_cut = b"", False

    def _line(self, data: bytes, *, is_cut: bool) -> Iterator[Line]:
        text = data.decode("utf-8", "backslashreplace")
        if self._is_first:
            text = text.removeprefix(BOM)
        self._is_first = False
        text = text.strip(" \t")
        shown = "".join(_shown(sign) for sign in text)
        if shown:
            is_clear = shown.encode() == data.strip(b" \t").removeprefix(BOM.encode())
            yield Line(shown[:LONGEST], is_clear, not is_cut and len(shown) <= LONGEST)


def _shown(sign: str) -> str:
    return sign.encode("unicode_escape").decode() if unicodedata.category(sign) in HIDDEN else sign


class Gone(Exception):
    """The source is not there any more: a reader that was unplugged, a terminal that hung up."""


class Source:
    """What lines are read from, without ever waiting. `name` is for people; `is_typed`: a terminal, which shows what is typed."""

    def __init__(self, descriptor: int, name: str, *, ends: bool = True) -> None:
        """`ends`: its end is one that somebody meant, as that of a pipe or of what is typed."""
        self.name = name
        self.is_typed = os.isatty(descriptor)
        self._descriptor = descriptor
        self._ends = ends
        self._ready = select.poll()
        self._ready.register(descriptor, select.POLLIN)

    def read(self) -> bytes | None:
        """What is there now, nothing included; None at the end. Raises `Gone`."""
        try:
            if not self._ready.poll(0):
                return b""
            data = os.read(self._descriptor, A_LOOK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise Gone(error.strerror or str(error)) from error
        if not data and not self._ends:
            raise Gone("it hung up")
        return data or None

    def close(self) -> None:
        if self._descriptor != STDIN:
            os.close(self._descriptor)


def open_source(name: str) -> Source:
    """Stdin for ``-``, else a pipe or a device with that name. Raises `UsageError`."""
    if name == "-":
        return Source(_stdin(), "stdin")
    try:
        kind = Path(name).stat().st_mode
        if stat.S_ISDIR(kind):
            raise UsageError(f"--units {name} is a folder: give -, a pipe, a device or a file")
        # a pipe that is open for writing, too, has no end when one of its writers goes
        how = os.O_RDWR if stat.S_ISFIFO(kind) else os.O_RDONLY
        return Source(os.open(name, how | FLAGS), name, ends=False)
    except (OSError, ValueError) as error:
        raise UsageError(f"--units {name}: {getattr(error, 'strerror', None) or error}") from error


def _stdin() -> int:
    """Stdin opened anew, so that not waiting for it is this program's alone and not that of the shell that shares it."""
    with suppress(OSError):
        return os.open(OWN_STDIN, os.O_RDONLY | FLAGS)
    return STDIN


def is_plain_file(name: str) -> bool:
    """Whether it is a file that has an end, and so nothing that is typed into."""
    with suppress(OSError, ValueError):
        return stat.S_ISREG(os.fstat(STDIN).st_mode if name == "-" else Path(name).stat().st_mode)
    return False


def lines_of_file(name: str, most_bytes: int) -> list[Line]:
    """All lines of a plain file. Raises `UsageError`."""
    try:
        with open(STDIN if name == "-" else name, "rb", closefd=name != "-") as file:
            data = file.read(most_bytes + 1)
    except OSError as error:
        raise UsageError(f"--units {name}: {error.strerror or error}") from error
    if len(data) > most_bytes:
        raise UsageError(f"--units {name}: more than {most_bytes} bytes; that is no list of serials")
    splitter = Splitter()
    return [*splitter.feed(data), *splitter.finish()]
