"""The file of the live store: SQLite, and what is done when it fails.

A store is one file, `live.sqlite`. After an input/output error a file is not trusted with anything new (what a failed
fsync lost is gone, however often one asks again): recording goes on in `live-1.sqlite` and so on, with the batches that
were not acknowledged written again under their own numbers.
"""

from __future__ import annotations

import contextlib
import os
import re
import sqlite3
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jbclog.core.durable_files import sync_file, sync_folder
from jbclog.core.errors import RecordError
from jbclog.core.foreign.database import Database, open_database
from jbclog.record.batches import Batch
from jbclog.record.schema import SCHEMA_VERSION

# -- store --------------------------------------------------------------------------------------------------------------------

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


# -- store writer -------------------------------------------------------------------------------------------------------------
# The store's file in use, and what is done when it fails: room from the reserve, or a new file.

RESERVE: Final = "live.reserve"
RESERVE_BYTES: Final = 4 << 20
NEW_FILE_ON: Final = (sqlite3.SQLITE_IOERR, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)


@dataclass(frozen=True, slots=True)
class Kept:
    """What came of storing: whether it is safe, and what went wrong on the way, if anything.

    `moved_to` names the new file in which recording goes on. Trouble without it means that the disk does not take what
    the run brings, even where it took this.
    """

    safe: bool
    trouble: str | None = None
    moved_to: str | None = None


KEPT: Final = Kept(True)  # there already: what is stored must not fail to be known as stored for want of memory


class StoreWriter:
    """Stores batches in `folder`. Used by one thread at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._segment: Segment | None = None
        self._index = 0
        self._home = folder.lstat()  # a link, or another folder, in its place is not where a run may write

    def begin(self, notes: Notes) -> None:
        """Take the reserve and make the first file. Raises OSError or sqlite3.Error; then nothing is left open."""
        self._take_reserve()
        segment = Segment.create(self.folder / segment_name(0))
        try:
            segment.add([], notes)
            sync_folder(self.folder)
        except BaseException:
            segment.close()
            raise
        self._segment = segment

    def add(self, batches: Sequence[Batch], fresh: Notes, everything: Notes) -> Kept:
        """Store `batches` and the `fresh` notes in one transaction; a new file gets `everything` that is to be noted."""
        if self._segment is None:
            return Kept(False, "the store is not open")
        if not self._is_there(self._segment.path):  # SQLite would go on writing to a file that nobody can open any more
            return Kept(False, f"{self._segment.path} was removed during the run")
        try:
            self._segment.add(batches, fresh)
        except sqlite3.Error as error:
            return self._again(error, batches, everything)
        return KEPT

    def _is_there(self, path: Path) -> bool:
        try:
            return os.path.samestat(self.folder.lstat(), self._home) and path.exists()
        except OSError:
            return False

    def give_for_the_end(self) -> None:
        """Give the rows that are still waiting half of what of the reserve is left; the rest is for sealing."""
        with contextlib.suppress(OSError):
            self._shrink(RESERVE_BYTES // 4)

    def close(self) -> None:
        """Close the file and give the reserve up: its room belongs to the sealing."""
        if self._segment is not None:
            with contextlib.suppress(sqlite3.Error):
                self._segment.close()
            self._segment = None
        with contextlib.suppress(OSError):  # a disk that fails has been told of; `conclude` removes it, or `recover`
            (self.folder / RESERVE).unlink(missing_ok=True)

    # -- when it fails -------------------------------------------------------------------------------------------------

    def _again(self, error: sqlite3.Error, batches: Sequence[Batch], everything: Notes) -> Kept:
        """Once more where there is hope: in the same file with the reserve's room, or in a new file."""
        full, trouble = _code(error) == sqlite3.SQLITE_FULL, f"writing failed: {error}"
        try:
            if full and self._segment is not None and self._give_half():
                self._segment.add(batches, everything)
                return Kept(True, trouble)
            if _code(error) in NEW_FILE_ON:
                return Kept(True, trouble, self._move(batches, everything))
        except (sqlite3.Error, OSError) as second:
            return Kept(False, f"{trouble}; then {second}")
        return Kept(False, trouble)

    def _move(self, batches: Sequence[Batch], everything: Notes) -> str:
        """Store them in a new file and go on in that; give its name."""
        path = self.folder / segment_name(self._index + 1)
        for leaving in (path, *companions(path)):
            leaving.unlink(missing_ok=True)  # of a try that failed
        segment = Segment.create(path)
        try:
            segment.add(batches, everything)
            sync_folder(self.folder)
        except BaseException:
            segment.close()
            raise
        if self._segment is not None:
            with contextlib.suppress(sqlite3.Error):
                self._segment.close()
        self._segment, self._index = segment, self._index + 1
        return path.name

    # -- the reserve ---------------------------------------------------------------------------------------------------

    def _take_reserve(self) -> None:
        """Take room that is given back when the disk is full: half of it for the last rows, half for sealing them."""
        (self.folder / RESERVE).write_bytes(bytes(RESERVE_BYTES))
        sync_file(self.folder / RESERVE)  # some disks give out room only then

    def _give_half(self) -> bool:
        """Give half of it back; False where that was done before."""
        return self._shrink(RESERVE_BYTES // 2)

    def _shrink(self, size: int) -> bool:
        reserve = self.folder / RESERVE
        if not reserve.exists() or reserve.stat().st_size <= size:
            return False
        os.truncate(reserve, size)
        return True


def _code(error: sqlite3.Error) -> int:
    """SQLite's primary result code, or 0 where the error carries none."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF
