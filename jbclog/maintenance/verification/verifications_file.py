"""The file of verifications, and which of them a run cites.

It lies there because that is what its runs are looked for in, and what a line's recorders share. Each line holds the SHA-256 of
the one before it, the first one that of the file's name, and its own (`core/durable_files.py`). Each run carries the hash of the
lines that it stands on in its manifest, so that a line that is taken off the end shows by the runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from jbclog.core.durable_files import add_line, chain_in, fields_of, first_faults, line_of, sha256, sync_folder
from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.core.foreign.json_reader import builder
from jbclog.core.rows import TipCheck
from jbclog.maintenance.verification.verification import Verification

_build_verification: Final = builder(Verification)

# -- verifications file -------------------------------------------------------------------------------------------------------

NAME: Final = "verifications.jsonl"
FIRST: Final = sha256(NAME.encode())
LONGEST: Final = 2000


@dataclass(frozen=True, slots=True)
class Book:
    """Every verification that can be read, oldest first, with the hashes of their lines; what is wrong (line, sentence)."""

    all: list[Verification] = field(default_factory=list)
    hashes: list[str] = field(default_factory=list)
    wrong: list[tuple[int, str]] = field(default_factory=list)
    head: str = FIRST

    def hash_of(self, one: Verification) -> str:
        return self.hashes[self.all.index(one)]


def keep(out: Path, one: Verification) -> tuple[Verification, str]:
    """Put it at the end of the file in `out`; give it as it stands there, and the new head. Raises `RecordError`.

    A file whose chain does not hold is not written to: `where-used` and this verb say what is wrong with it.
    """
    found = read_book(out)
    if any("cut off" not in text for _, text in found.wrong):
        number, text = found.wrong[0]
        raise RecordError(f"{out / NAME}: line {number} {text}; nothing is added to it. Put it right from a copy, or set it aside")
    kept: list[Verification] = []

    def made(seq: int, previous: str) -> bytes:
        kept.append(replace(one, seq=seq, prev_sha256=previous))
        return line_of(asdict(kept[0]))

    try:
        if not out.is_dir():
            out.mkdir(parents=True)
            sync_folder(out.absolute().parent)
        head = add_line(out / NAME, FIRST, _parsed, made)
    except OSError as error:
        raise RecordError(f"{out / NAME} cannot be written: {error.strerror or error}") from error
    return kept[0], head


def read_book(out: Path) -> Book:
    """Every verification in the folder of runs `out`; none where there is no file. Raises `RecordError`."""
    try:
        found = chain_in(
            read_foreign(out / NAME, Kind.VERIFICATIONS), FIRST, _parsed, what="verification", of_first="the file's name"
        )
    except FileNotFoundError:
        return Book()
    except OSError as error:
        raise RecordError(f"{out / NAME} cannot be read: {error.strerror or error}") from error
    return Book(found.entries, found.hashes, first_faults(found.wrong), found.head)


def _parsed(line: bytes) -> Verification | None:
    try:
        said = _build_verification(fields_of(line))
        return said if line_of(asdict(said)) == line else None
    except ValueError:
        return None


# -- cited --------------------------------------------------------------------------------------------------------------------
# Which verification a run stands on: the last valid one of each port, and of the tip in it where the run says which that is.

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
