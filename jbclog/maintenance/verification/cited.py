"""Which verification a run stands on: the last valid one of each port, and of the tip in it where the run says which that is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

from jbclog.core.errors import RecordError
from jbclog.core.rows import TipCheck
from jbclog.maintenance.verification.verification import Verification
from jbclog.maintenance.verification.verifications_file import NAME, Book, read_book

DAY_S = 86400.0
NONE, OTHER_TIP, UNREADABLE = "none", "other tip", "unreadable"


def last_valid(book: Book, station: str, port: int, tip: str | None = None, before: datetime | None = None) -> Verification | None:
    """The last verification of this port that was not invalid; with `tip` of that tip; made before `before`."""
    fitting = (
        one
        for one in reversed(book.all)
        if (one.station, one.port) == (station, port)
        and one.is_valid
        and (tip is None or one.tip == tip)
        and (before is None or datetime.fromisoformat(one.time) <= before)
    )
    return next(fitting, None)


def cited(
    out: Path, places: Iterable[tuple[str, int]], tips: Mapping[tuple[str, int], str | None], begin: datetime
) -> list[TipCheck]:
    """What a run that begins at `begin` in the folder of runs `out` has to carry for each place (station, port). Never raises."""
    try:
        book = read_book(out)
    except RecordError as error:
        return [TipCheck(station, port, UNREADABLE, str(error)) for station, port in places]
    return [_one(book, station, port, tips.get((station, port)), begin) for station, port in places]


def _one(book: Book, station: str, port: int, tip: str | None, begin: datetime) -> TipCheck:
    damaged = [f"line {number} {text}" for number, text in book.wrong if "cut off" not in text]
    if damaged:
        return TipCheck(station, port, UNREADABLE, f"{NAME} is not whole: {damaged[0]}.")
    found = last_valid(book, station, port, tip, begin)
    if found is not None:
        return _told(book, found, begin, found.result, found.text)
    other = last_valid(book, station, port, None, begin)
    if other is not None:
        return _told(book, other, begin, OTHER_TIP, f"The tip in it is {tip}; the last verification was of tip {other.tip}.")
    return TipCheck(station, port, NONE, "No valid verification of its tip is known.")


def _told(book: Book, one: Verification, begin: datetime, state: str, text: str) -> TipCheck:
    days = round((begin.astimezone(UTC) - datetime.fromisoformat(one.time)).total_seconds() / DAY_S, 3)
    seen = (one.time, max(days, 0.0), one.tip, one.instrument, one.offset_c, one.limit_c, one.adjust_c, one.seq, book.hash_of(one))
    return TipCheck(one.station, one.port, state, text, *seen)


def places_of(book: Book, station: str) -> Sequence[int]:
    """The ports of a station that were ever verified."""
    return sorted({one.port for one in book.all if one.station == station})
