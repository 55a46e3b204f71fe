"""Rows of a wire as lines of its file, and back to the bit."""

from __future__ import annotations

import json
from math import isfinite
from typing import Final, cast, get_args

from jbclog.core.wire_capture import Passed, PassedName, Row, Told, ToldName, WishName

BYTES: Final = ("sent", "heard")
PASSED: Final = get_args(PassedName)
TOLD: Final = get_args(ToldName)
WISHES: Final = get_args(WishName)


def line_of(row: Row) -> str:
    """A row as it stands in the file; moments with all the digits that tell them apart."""
    if isinstance(row, Passed):
        return f"{row.at_s!r}\t{row.what}\t{row.data.hex() or _escaped(row.text)}\n"
    if row.what != "told":
        return f"{row.at_s!r}\t{row.what}\t{row.wish} {_escaped(row.text)}\n"
    if row.late_s:
        return f"{row.at_s!r}\ttold\t{row.wish} {row.size} {row.sent_s!r} {row.late_s!r}\n"
    if row.wish == "ask":
        return f"{row.at_s!r}\ttold\task {row.size} {row.sent_s!r}\n"
    return f"{row.at_s!r}\ttold\t{row.wish} {row.size}\n"


def row_of(line: str) -> Row:
    """The row in a line. Raises `ValueError` where it is none."""
    columns = line.rstrip("\n").split("\t")
    if len(columns) != 3:
        raise ValueError("it has not three columns")
    at, what, data = columns
    moment = _finite(at)
    if what in BYTES:
        return Passed(moment, cast(PassedName, what), bytes.fromhex(data))
    if what in PASSED:
        return Passed(moment, cast(PassedName, what), b"", _plain(data))
    wish, _, rest = data.partition(" ")
    if what not in TOLD or wish not in WISHES:
        raise ValueError(f"{what} {wish} is not what a wire record tells")
    if what == "told":
        size, sent, late, *more = *rest.split(" "), "", ""
        if any(more):
            raise ValueError(f"{rest} is more than a wire record tells")
        return Told(moment, "told", cast(WishName, wish), _count(size), _finite(sent or "0"), late_s=_finite(late or "0"))
    return Told(moment, cast(ToldName, what), cast(WishName, wish), text=_plain(rest))


def _finite(text: str) -> float:
    number = float(text)
    if not isfinite(number):
        raise ValueError(f"{text} is no moment")
    return number


def _count(text: str) -> int:
    if not text.isdecimal():
        raise ValueError(f"{text} is no number of bytes")
    return int(text)


def _escaped(text: str) -> str:
    return json.dumps(text)[1:-1]


def _plain(text: str) -> str:
    return str(json.loads(f'"{text}"'))
