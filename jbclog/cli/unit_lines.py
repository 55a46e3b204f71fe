"""`--units`: where serials come from while a run goes on, and a keyboard whose typing does not spoil the table."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Final

from jbclog.cli.options import check_text
from jbclog.cli.output import is_terminal
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.transport.typed_lines import LineSource, TypedLine

LONGEST_LIST: Final = 1_000_000  # bytes of a plain file
KEYBOARD: Final = 0


def listed(name: str | None) -> list[str]:
    """The serials of a plain file, units of the run from its start; none where lines come later. Raises `UsageError`."""
    from jbclog.transport.typed_lines import is_plain_file, lines_of_file

    if name is None or not is_plain_file(name):
        return []
    return list(dict.fromkeys(_serial(name, line) for line in lines_of_file(name, LONGEST_LIST)))


def _serial(name: str, line: TypedLine) -> str:
    """Raises `UsageError` where it could not be kept or shown as it is: a file can be corrected before anything is sent."""
    if not line.is_clear or not line.is_whole:
        raise UsageError(f"--units {name}: {line.text:.60}: too long for a serial, or it holds what does not show")
    check_text(f"--units {name}", line.text)
    return line.text


def source_of(name: str | None) -> LineSource | None:
    """What serials are read from while the run goes on. Raises `UsageError`."""
    from jbclog.transport.typed_lines import is_plain_file, open_source

    return None if name is None or is_plain_file(name) else open_source(name)


@contextmanager
def unshown(source: LineSource | None) -> Iterator[None]:
    """While a table is shown, what a barcode reader types must not stand in it: it is told as events."""
    if source is None or source.name != "stdin" or not source.is_typed or not is_terminal() or not _is_ours():
        yield
        return
    import termios

    before = termios.tcgetattr(KEYBOARD)
    silent = [*before]
    silent[3] &= ~termios.ECHO
    termios.tcsetattr(KEYBOARD, termios.TCSADRAIN, silent)
    try:
        yield
    finally:
        with suppress(termios.error):
            termios.tcsetattr(KEYBOARD, termios.TCSADRAIN, before)


def _is_ours() -> bool:
    """Whether what is typed at the terminal goes to this program; one in the background would be stopped for touching it."""
    try:
        return os.tcgetpgrp(KEYBOARD) == os.getpgrp()
    except OSError:
        return False
