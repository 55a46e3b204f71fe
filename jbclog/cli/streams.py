"""The three streams of the program, made usable before anything else happens.

Who starts a program may have closed one of them, or may live in a locale that cannot write °C. Neither is a reason not to
solder; and a port that is opened must not get the number of a closed stream, where every note would be sent to the station.
"""

from __future__ import annotations

import io
import os
import sys
from contextlib import suppress
from typing import Final

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
