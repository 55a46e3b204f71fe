"""The live store's files: SQLite, write-ahead log, every commit synced to the disk before it counts.

A store is one file, `live.sqlite`. After an input/output error a file is not trusted with anything new (what a failed
fsync lost is gone, however often one asks again): recording goes on in `live-1.sqlite` and so on, with the batches that
were not acknowledged written again under their own numbers.
"""

from __future__ import annotations

import contextlib
import re
import sqlite3
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from jbclog.core.errors import RecordError
from jbclog.core.foreign.database import Database, open_database
from jbclog.record.batches import Batch
from jbclog.record.schema import SCHEMA_VERSION

BUSY_S = 10.0  # a sealing child holds the file for a few hundredths of a second
DELETE_AT_ONCE = 40  # batches deleted in one transaction: some 50 ms, which a commit of the recorder can wait for

_CREATE = """
PRAGMA journal_mode = WAL;
BEGIN IMMEDIATE;
CREATE TABLE batch (
  number INTEGER PRIMARY KEY, name TEXT NOT NULL, rows INTEGER NOT NULL, crc INTEGER NOT NULL, data BLOB NOT NULL
);
CREATE TABLE note (kind TEXT NOT NULL, key TEXT NOT NULL, text TEXT NOT NULL, crc INTEGER NOT NULL, PRIMARY KEY (kind, key));
COMMIT;
"""
COLUMNS = {"batch": ("number", "name", "rows", "crc", "data"), "note": ("kind", "key", "text", "crc")}
_ADD_BATCH = "INSERT OR REPLACE INTO batch VALUES (?, ?, ?, ?, ?)"  # one whose commit was not seen to be done comes again
_SET_NOTE = "INSERT INTO note VALUES (?, ?, ?, ?) ON CONFLICT (kind, key) DO UPDATE SET text = excluded.text, crc = excluded.crc"

META = "meta"  # notes of the store itself: schema, run, last (number stored), sealed (through that number), dropped (rows)
FACTS = "facts"  # notes by station: StationFacts as JSON

Notes = Mapping[tuple[str, str], str]
"""(kind, key) -> text."""


@dataclass(frozen=True, slots=True)
class Stored:
    """A batch as it was found, with the check sum that was stored beside it."""

    batch: Batch
    crc: int


def segment_name(index: int) -> str:
    return "live.sqlite" if index == 0 else f"live-{index}.sqlite"


def segments(folder: Path) -> list[Path]:
    """The store's files that are there, in the order in which they were begun."""
    found = [
        (int(match[1] or 0), path) for path in folder.iterdir() if (match := re.fullmatch(r"live(?:-(\d+))?\.sqlite", path.name))
    ]
    return [path for _, path in sorted(found)]


def companions(segment: Path) -> list[Path]:
    """A segment's log and index, and what is left of its making, where they are there."""
    return [path for path in (segment.with_name(segment.name + end) for end in ("-wal", "-shm", "-journal")) if path.exists()]


class Segment:
    """One file of the store, open. Used by one thread at a time."""

    def __init__(self, path: Path, connection: Database, *, only_reads: bool = False) -> None:
        self.path = path
        self._db = connection
        self._only_reads = only_reads

    @classmethod
    def create(cls, path: Path) -> Segment:
        """A new, empty one. Raises sqlite3.Error where it cannot be made."""
        connection = _connect(path)
        try:
            connection.executescript(_CREATE)
        except sqlite3.Error:
            connection.close()
            raise
        return cls(path, connection)

    @classmethod
    def open(cls, path: Path) -> Segment:
        """One that is there, to be deleted from beside the recorder."""
        return cls(path, _connect(path))

    @classmethod
    def look(cls, path: Path) -> Segment:
        """One that is there, only to be read, beside a recorder that may be writing. Needs no room on the disk."""
        connection = open_database(path, only_reads=True, busy_s=BUSY_S)
        return cls(path, connection, only_reads=True)

    def close(self) -> None:
        self._db.close()
        if self._only_reads and not self.path.exists():
            self._remove_made_for_reading()

    def _remove_made_for_reading(self) -> None:
        """SQLite makes a log and an index for a reader, too, and did so beside a store that is removed meanwhile."""
        for path in companions(self.path):
            with contextlib.suppress(OSError):  # gone already, or not ours to remove
                if not (path.name.endswith("-wal") and path.stat().st_size):  # a log with something in it is no reader's
                    path.unlink()

    def is_begun(self) -> bool:
        """Whether its tables are there: a kill may have come between making the file and making them.

        Raises `NotAStore` where others are there as well, or views or triggers that would be worked at without end.
        """
        return self._db.expect_tables(COLUMNS)

    # -- writing -----------------------------------------------------------------------------------------------------

    def add(self, batches: Iterable[Batch], notes: Notes) -> None:
        """Store all of it in one transaction, synced when this returns. Raises sqlite3.Error, and then stored nothing."""
        with self._transaction():
            self._db.executemany(_ADD_BATCH, ((b.number, b.table, b.rows, b.crc, b.data) for b in batches))
            self._note(notes)

    def _note(self, notes: Notes) -> None:
        self._db.executemany(_SET_NOTE, ((kind, key, text, _note_crc(kind, key, text)) for (kind, key), text in notes.items()))

    def delete_through(self, number: int) -> None:
        """Delete the batches up to `number`, a few at a time; `sealed` in `meta` says how far it got."""
        while True:
            with self._transaction():
                rows = self._db.execute(
                    "SELECT number FROM batch WHERE number <= ? ORDER BY number LIMIT ?", (number, DELETE_AT_ONCE)
                ).fetchall()
                end = number if len(rows) < DELETE_AT_ONCE else rows[-1][0]
                self._db.execute("DELETE FROM batch WHERE number <= ?", (end,))
                self._note({(META, "sealed"): str(end)})
            if end == number:
                return

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        if self._db.in_transaction:  # one whose beginning or end was refused memory
            self._db.execute("ROLLBACK")
        try:
            self._db.execute("BEGIN IMMEDIATE")
            yield
            self._db.execute("COMMIT")
        except BaseException:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")
            raise

    # -- reading -----------------------------------------------------------------------------------------------------

    @contextmanager
    def snapshot(self) -> Iterator[None]:
        """Everything read inside is the state of one moment."""
        self._db.execute("BEGIN")
        try:
            self._db.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchone()  # from here on the moment is fixed
            yield
        finally:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")

    def notes(self, kind: str) -> dict[str, str]:
        """The notes of a kind by their key; one that rotted is left out, as if it had never been taken."""
        self._db.within()
        rows = self._db.execute("SELECT key, text, crc FROM note WHERE kind = ?", (kind,))
        return {key: text for key, text, crc in rows if _note_crc(kind, key, text) == crc}

    def index(self) -> dict[int, str]:
        """The batches that are there and the table of each. Raises sqlite3.DatabaseError where pages are damaged."""
        self._db.within()
        return {int(number): str(name) for number, name in self._db.execute("SELECT number, name FROM batch ORDER BY number")}

    def get(self, number: int) -> Stored | None:
        """One batch. Raises sqlite3.DatabaseError where its page is damaged."""
        self._db.within()
        row = self._db.execute("SELECT name, rows, crc, data FROM batch WHERE number = ?", (number,)).fetchone()
        if row is None:
            return None
        name, rows, crc, data = row
        sound = isinstance(name, str) and isinstance(rows, int) and isinstance(crc, int) and isinstance(data, bytes)
        return Stored(Batch(number, name, rows, data), crc) if sound else Stored(Batch(number, "", 0, b""), -1)


def _note_crc(kind: object, key: object, text: object) -> int:
    return zlib.crc32(f"{kind} {key} {text}".encode(errors="replace"))


def _connect(path: Path) -> Database:
    connection = open_database(path, only_reads=False, busy_s=BUSY_S)
    try:
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("PRAGMA fullfsync = ON")  # macOS: to the disk, not to its cache
        connection.execute(f"PRAGMA journal_size_limit = {16 << 20}")
    except sqlite3.Error:
        connection.close()
        raise
    return connection


def refuse_newer(folder: Path) -> None:
    """Raise `RecordError` where the store was written by a newer jbclog than this."""
    for path in segments(folder):
        try:
            with closing(Segment.look(path)) as segment:
                version = segment.notes(META).get("schema", "") if segment.is_begun() else ""
        except sqlite3.Error:
            continue  # damaged, or not even begun: what reads it will say so
        if version.isdigit() and int(version) > SCHEMA_VERSION:
            known = f"this jbclog knows {SCHEMA_VERSION}. Nothing was changed; use a newer jbclog."
            raise RecordError(f"{path}: written with schema {version}; {known}")
