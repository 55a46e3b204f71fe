"""Read a live store, beside its recorder or after a crash, even if parts of it are damaged."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.core.database import NotAStore
from jbclog.core.errors import RecordError
from jbclog.core.rows import TABLES
from jbclog.record.batches import MOST_ROWS, Damaged, decode
from jbclog.record.parts import ROWS_A_GROUP, Damage, regroup, through
from jbclog.record.store import FACTS, META, Segment, segments

LEAST_BYTES: Final = 1024  # no batch is smaller, which bounds the number of batches in a file
MOST_DAMAGE: Final = 100  # places of damage that are listed
LARGEST_NUMBER: Final = 1 << 62
MORE: Final = Damage(
    "the live store",
    None,
    f"more than {MOST_DAMAGE} places of it are damaged; the others are not listed",
)

TRANSIENT: Final = (
    *(sqlite3.SQLITE_IOERR, sqlite3.SQLITE_FULL, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_NOMEM),
    *(sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_PERM),
)
UNREADABLE: Final = (
    sqlite3.SQLITE_IOERR_READ,
    sqlite3.SQLITE_IOERR_SHORT_READ,
    sqlite3.SQLITE_IOERR_CORRUPTFS,
)
"""Damage to one place of the disk: the rest of the file can still be read."""


def expect_damage(path: Path, error: Exception) -> None:
    """Raise `RecordError` if `error` has a temporary cause and shows no damage to the file."""
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT)
    if code & 0xFF in TRANSIENT and code not in UNREADABLE:
        raise RecordError(f"{path} cannot be read now: {error}; nothing was changed") from error


_Place = tuple[str, tuple[Segment, ...]]
"""The table of a batch, empty if it is none of a run, and the segments that have it."""


class StoreReader:
    """A read-only snapshot of all segments of a run's live store. `damage` grows as damage is
    found.

    `rows` counts those that the batches declare. A batch in two segments is read from the first in
    which it is sound. A temporary cause (no space for SQLite's index, missing permission, a failing
    disk) is not damage: any call raises `RecordError`. If files disappear while they are opened,
    the run is being sealed, and the reader lists them again. Read manifest and parts after this, so
    that no row is missed: they exist before the store's files are removed.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        while not self._opened():
            pass  # the run is being sealed: its rows are in parts now

    def _opened(self) -> bool:
        """Open and index all segments; return False if a file disappeared meanwhile."""
        self.damage: list[Damage] = []
        self.segments: list[Segment] = []
        self._where: dict[int, _Place] = {}
        self.rows = 0
        there = segments(self.folder)
        with contextlib.ExitStack() as opened:
            try:
                for path in there:
                    self._open(path, opened)
                self.notes = self._all_notes(META)
                self._index()
            except (RecordError, OSError):
                if all(map(os.path.lexists, there)):
                    raise
                return False
            if self.damage and not all(map(os.path.lexists, there)):
                return False
            self._snapshots = opened.pop_all()
        return True

    def __enter__(self) -> StoreReader:
        return self

    def __exit__(self, *_: object) -> None:
        self._snapshots.close()

    def _open(self, path: Path, opened: contextlib.ExitStack) -> None:
        try:
            segment = Segment.look(path)
            opened.callback(segment.close)
            opened.enter_context(segment.snapshot())
            begun = segment.is_begun()
        except sqlite3.DatabaseError as error:
            if getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_READONLY_ROLLBACK:
                return  # a crash during creation: nothing was ever committed
            expect_damage(path, error)
            self._note(path.name, None, f"cannot be read at all: {error}")
        else:
            self.segments += [segment] * begun

    @property
    def last(self) -> int:
        """The number of the last batch that exists or should exist."""
        return max(max(self._where, default=0), self._number("last"), self._number("sealed"))

    @property
    def mean_rows(self) -> int:
        """Average number of rows in a batch, at least 1."""
        return max(self.rows // max(len(self._where), 1), 1)

    def numbers_of(self, table: str, after: int) -> list[int]:
        """Return the numbers of a table's batches above `after`, ascending."""
        return sorted(
            number for number, (name, _) in self._where.items() if name == table and number > after
        )

    def tables(self, numbers: Sequence[int]) -> Iterator[pa.Table]:
        """Yield the rows of these batches in pieces of at most `ROWS_A_GROUP`; skip and note
        damaged ones.
        """
        for number in numbers:
            table = self._sound(number)
            if table is not None:
                yield from (
                    table.slice(at, ROWS_A_GROUP) for at in range(0, table.num_rows, ROWS_A_GROUP)
                )

    def row_groups(self, numbers: Sequence[int]) -> Iterator[pa.Table]:
        """Yield the same rows in the row groups of a part."""
        return regroup(self.tables(numbers))

    @property
    def was_closed(self) -> bool:
        """True if the recorder committed everything and closed the store itself."""
        return self.notes.get("closed") == "1"

    @property
    def dropped_rows(self) -> int:
        """Rows that the recorder could not store."""
        return self._number("dropped")

    def facts(self) -> dict[str, str]:
        """Return the latest facts of each station, as JSON."""
        return self._all_notes(FACTS)

    def _all_notes(self, kind: str) -> dict[str, str]:
        """Return the notes of a kind; later segments override."""
        notes: dict[str, str] = {}
        for segment in self.segments:
            try:
                notes.update(segment.notes(kind))
            except sqlite3.DatabaseError as error:
                expect_damage(segment.path, error)
                self._note(segment.path.name, 0, f"notes ({kind}) cannot be read: {error}")
        return notes

    def _number(self, key: str) -> int:
        text = self.notes.get(key, "")
        return (
            min(int(text), LARGEST_NUMBER)
            if text.isdecimal() and len(text) <= len(str(LARGEST_NUMBER))
            else 0
        )

    def _index(self) -> None:
        # few differ, so an index of millions of batches stays small
        places: dict[_Place, _Place] = {}
        for segment in self.segments:
            for number, table, rows in self._listed(segment):
                name, before = self._where.get(number, ("", ()))
                place = (
                    name if name in TABLES else table if table in TABLES else "",
                    (
                        *before,
                        segment,
                    ),
                )
                self._where[number] = places.setdefault(place, place)
                self.rows += rows if not before and 0 <= rows <= MOST_ROWS else 0
        self._note_gaps()
        for number, (table, _) in self._where.items():
            if table not in TABLES:
                self._note(f"batch {number}", None, "belongs to no table")

    def _listed(self, segment: Segment) -> Iterator[tuple[int, str, int]]:
        """Yield number, table and rows of a segment's batches."""
        try:
            yield from segment.index()
        except NotAStore as error:
            self._note(segment.path.name, None, f"not read further: {error}")
        except sqlite3.DatabaseError as error:
            expect_damage(segment.path, error)
            self._note(
                segment.path.name, None, f"damaged ({error}); its batches were read one by one"
            )
            yield from (
                one
                for one in self._probe(segment)
                if segment not in self._where.get(one[0], ("", ()))[1]
            )

    def _probe(self, segment: Segment) -> Iterator[tuple[int, str, int]]:
        """Read every possible number one by one; yield number, table and rows of each found."""
        first = self._number("sealed") + 1
        end = first + segment.path.stat().st_size // LEAST_BYTES
        last = self._number("last")
        for number in range(first, min(last + 1, end) if last else end):
            with contextlib.suppress(sqlite3.DatabaseError):
                stored = segment.get(number)
                if stored is not None:
                    yield number, stored.batch.table, stored.batch.rows

    def _note_gaps(self) -> None:
        """Note missing numbers: there is no gap from the last deleted to the last stored one."""
        if not self.segments:
            return  # sealed: no batch is stored, and the parts need not be opened to know that
        expected = (
            self._number("sealed") or max(through(self.folder, table) for table in TABLES)
        ) + 1
        for number in [*sorted(n for n in self._where if n >= expected), self.last + 1]:
            if number > expected:
                which = (
                    f"batch {expected}"
                    if number == expected + 1
                    else f"batches {expected} to {number - 1}"
                )
                self._note(which, None, "missing from the live store")
            expected = number + 1

    def _sound(self, number: int) -> pa.Table | None:
        why, rows = "missing", None
        table, segments = self._where[number]
        for segment in segments:
            try:
                stored = segment.get(number)
                if stored is not None:
                    rows = stored.batch.rows if 0 <= stored.batch.rows <= LARGEST_NUMBER else None
                    return decode(stored.batch, stored.crc)
            except (Damaged, sqlite3.DatabaseError) as error:
                expect_damage(segment.path, error)
                why = str(error)
        self._note(f"batch {number} ({table})", rows, why)
        return None

    def _note(self, place: str, rows: int | None, why: str) -> None:
        if len(self.damage) <= MOST_DAMAGE:
            damage = Damage(place, rows, why) if len(self.damage) < MOST_DAMAGE else MORE
            self.damage += [damage] * (damage not in self.damage)
