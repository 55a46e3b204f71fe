"""The live store's files: SQLite, with a reserve of disk space and a successor for a file that
fails.

The store is one file, `live.sqlite`. After an input/output error it accepts nothing more, because
data lost by a failed fsync stays lost: recording continues in `live-1.sqlite` and so on, and
unacknowledged batches are written again under their numbers.
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

from jbclog.core.database import Database, NotAStore, open_database
from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError
from jbclog.core.operating_system import sync_file, sync_folder
from jbclog.core.rows import SCHEMA_VERSION
from jbclog.record.batches import MOST_PACKED, Batch

MOST_BATCHES: Final = 2_000_000  # of a file: more than two weeks of commits never sealed
MOST_NOTES_BYTES: Final = 16 << 20  # 250 stations take less than one
BUSY_S = 10.0  # a sealing child holds the file for some 0.05 s
# batches deleted in one transaction, some 50 ms: the recorder's commit can wait that long
DELETE_AT_ONCE = 40

_CREATE = """
PRAGMA journal_mode = WAL;
BEGIN IMMEDIATE;
CREATE TABLE batch (
  number INTEGER PRIMARY KEY, name TEXT NOT NULL, rows INTEGER NOT NULL, crc INTEGER NOT NULL,
  data BLOB NOT NULL
);
CREATE TABLE note (
  kind TEXT NOT NULL, key TEXT NOT NULL, text TEXT NOT NULL, crc INTEGER NOT NULL,
  PRIMARY KEY (kind, key)
);
COMMIT;
"""
COLUMNS = {
    "batch": ("number", "name", "rows", "crc", "data"),
    "note": ("kind", "key", "text", "crc"),
}
# a batch whose commit was not confirmed is written again
_ADD_BATCH = "INSERT OR REPLACE INTO batch VALUES (?, ?, ?, ?, ?)"
_INDEX = "SELECT number, substr(name, 1, 20), rows FROM batch ORDER BY number"
_GET = (
    "SELECT substr(name, 1, 20), rows, crc, length(data), CASE WHEN length(data) <= ? THEN data END"
    " FROM batch WHERE number = ?"
)
LEAST_NOTE = 64  # bytes of memory for a note beside its text
_SET_NOTE = (
    "INSERT INTO note VALUES (?, ?, ?, ?) ON CONFLICT (kind, key) DO UPDATE SET text ="
    " excluded.text, crc = excluded.crc"
)

# notes of the store itself: schema, run, last (number stored), sealed (through that number),
# dropped (rows)
META = "meta"
FACTS = "facts"  # notes by station: StationFacts as JSON

Notes = Mapping[tuple[str, str], str]
"""(kind, key) -> text."""


@dataclass(frozen=True, slots=True)
class Stored:
    """A batch as found, with its stored checksum."""

    batch: Batch
    crc: int


def segment_name(index: int) -> str:
    return "live.sqlite" if index == 0 else f"live-{index}.sqlite"


def segments(folder: Path) -> list[Path]:
    """Return the store's files, oldest first."""
    found = [
        (int(match[1] or 0), path)
        for path in folder.iterdir()
        if (match := re.fullmatch(r"live(?:-(\d+))?\.sqlite", path.name))
    ]
    return [path for _, path in sorted(found)]


def companions(segment: Path) -> list[Path]:
    """Return a segment's existing log, index and journal files."""
    return [
        path
        for path in (segment.with_name(segment.name + end) for end in ("-wal", "-shm", "-journal"))
        if path.exists()
    ]


class Segment:
    """One open file of the store. Used by one thread at a time."""

    def __init__(self, path: Path, connection: Database, *, only_reads: bool = False) -> None:
        self.path = path
        self._db = connection
        self._only_reads = only_reads

    @classmethod
    def create(cls, path: Path) -> Segment:
        """Create an empty segment. Raises sqlite3.Error."""
        connection = _connect(path)
        try:
            connection.executescript(_CREATE)
        except sqlite3.Error:
            connection.close()
            raise
        return cls(path, connection)

    @classmethod
    def open(cls, path: Path) -> Segment:
        """Open a segment for deletion, beside its recorder."""
        return cls(path, _connect(path))

    @classmethod
    def look(cls, path: Path) -> Segment:
        """Open a segment read-only, also beside a recorder. Needs no space on the disk."""
        connection = open_database(path, only_reads=True, busy_s=BUSY_S)
        return cls(path, connection, only_reads=True)

    def close(self) -> None:
        self._db.close()
        if self._only_reads and not self.path.exists():
            self._remove_made_for_reading()

    def _remove_made_for_reading(self) -> None:
        """Remove the log and index created for this reader, if the store was removed meanwhile."""
        for path in companions(self.path):
            with contextlib.suppress(OSError):  # already gone, or not ours to remove
                # a log with content is not a reader's
                if not (path.name.endswith("-wal") and path.stat().st_size):
                    path.unlink()

    def is_begun(self) -> bool:
        """True if its tables exist: a kill can come between creating the file and creating them.

        Raises `NotAStore` if it has others.
        """
        return self._db.has_tables(COLUMNS)

    def add(self, batches: Iterable[Batch], notes: Notes) -> None:
        """Store everything in one synced transaction. Raises sqlite3.Error, with nothing stored."""
        with self._transaction():
            self._db.executemany(
                _ADD_BATCH, ((b.number, b.table, b.rows, b.crc, b.data) for b in batches)
            )
            self._note(notes)

    def _note(self, notes: Notes) -> None:
        self._db.executemany(
            _SET_NOTE,
            ((kind, key, text, _note_crc(kind, key, text)) for (kind, key), text in notes.items()),
        )

    def delete_through(self, number: int) -> None:
        """Delete the batches up to `number`, a few at a time; the note `sealed` has progress."""
        while True:
            with self._transaction():
                rows = self._db.execute(
                    "SELECT number FROM batch WHERE number <= ? ORDER BY number LIMIT ?",
                    (number, DELETE_AT_ONCE),
                ).fetchall()
                end = number if len(rows) < DELETE_AT_ONCE else rows[-1][0]
                self._db.execute("DELETE FROM batch WHERE number <= ?", (end,))
                self._note({(META, "sealed"): str(end)})
            if end == number:
                return

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        if self._db.in_transaction:  # memory was refused at its beginning or end
            self._db.execute("ROLLBACK")
        try:
            self._db.execute("BEGIN IMMEDIATE")
            yield
            self._db.execute("COMMIT")
        except BaseException:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")
            raise

    @contextmanager
    def snapshot(self) -> Iterator[None]:
        """Read everything inside the ``with`` from one snapshot."""
        self._db.execute("BEGIN")
        try:
            # this fixes the snapshot
            self._db.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchone()
            yield
        finally:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")

    def notes(self, kind: str) -> dict[str, str]:
        """Return the notes of a kind by key, without those whose checksum fails."""
        found, size = dict[str, str](), 0
        for key, text, crc in self._db.execute(
            "SELECT key, text, crc FROM note WHERE kind = ?", (kind,)
        ):
            size += len(str(key)) + len(str(text)) + LEAST_NOTE
            if size > MOST_NOTES_BYTES:
                raise NotAStore(f"its notes have more than {MOST_NOTES_BYTES >> 20} MiB")
            if isinstance(key, str) and isinstance(text, str) and _note_crc(kind, key, text) == crc:
                found[key] = text
        return found

    def index(self) -> Iterator[tuple[int, str, int]]:
        """Yield each batch's number, table and declared rows. Raises sqlite3.DatabaseError."""
        rows = self._db.execute(_INDEX)
        for count, (number, name, declared) in enumerate(rows):
            if count >= MOST_BATCHES:
                raise NotAStore(f"it has more than {MOST_BATCHES} batches")
            yield int(number), str(name), declared if isinstance(declared, int) else 0

    def get(self, number: int) -> Stored | None:
        """Return a batch; None if it is missing. Raises sqlite3.DatabaseError for a damaged page,
        `NotAStore` for a batch that is too large.
        """
        row = self._db.execute(_GET, (MOST_PACKED, number)).fetchone()
        if row is None:
            return None
        name, rows, crc, size, data = row
        if data is None:
            raise NotAStore(f"it has {size} bytes; a recorder's batches have at most {MOST_PACKED}")
        sound = (
            isinstance(name, str)
            and isinstance(rows, int)
            and isinstance(crc, int)
            and isinstance(data, bytes)
        )
        return (
            Stored(Batch(number, name, rows, data), crc)
            if sound
            else Stored(Batch(number, "", 0, b""), -1)
        )


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
    """Raise `RecordError` for a store of a newer jbclog."""
    for path in segments(folder):
        try:
            with closing(Segment.look(path)) as segment:
                version = segment.notes(META).get("schema", "") if segment.is_begun() else ""
        except sqlite3.Error:
            continue  # damaged or empty: its reader reports it
        if version.isdecimal() and len(version) < 20 and int(version) > SCHEMA_VERSION:
            known = f"this jbclog knows {SCHEMA_VERSION}. Nothing was changed; use a newer jbclog."
            raise RecordError(f"{path}: written with schema {version}; {known}")


RESERVE: Final = "live.reserve"
RESERVE_BYTES: Final = 4 << 20
NEW_FILE_ON: Final = (sqlite3.SQLITE_IOERR, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)


@dataclass(frozen=True, slots=True)
class Kept:
    """Result of storing: whether everything is safe, and any trouble.

    `moved_to` names a new file in which recording continues. Trouble without it means that the disk
    is failing or full, even if it accepted this.
    """

    safe: bool
    trouble: str | None = None
    moved_to: str | None = None


# created beforehand: a refused allocation must not hide that something was stored
KEPT: Final = Kept(True)


class StoreWriter:
    """Stores batches in `folder`. Used by one thread at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._segment: Segment | None = None
        self._index = 0
        # never write through a link or into another folder in its place
        self._home = folder.lstat()

    def begin(self, notes: Notes) -> None:
        """Allocate the reserve and create the first file. Raises OSError or sqlite3.Error, leaving
        nothing open.
        """
        self._allocate_reserve()
        segment = Segment.create(self.folder / segment_name(0))
        try:
            segment.add([], notes)
            sync_folder(self.folder)
        except BaseException:
            segment.close()
            raise
        self._segment = segment

    def add(self, batches: Sequence[Batch], fresh: Notes, everything: Notes) -> Kept:
        """Store `batches` and the `fresh` notes in one transaction; in a new file, `everything`."""
        if self._segment is None:
            return Kept(False, "the store is not open")
        if not self._is_home_there():  # SQLite would keep writing to the removed file
            return Kept(False, "its folder was removed during the run")
        if not self._segment.path.exists():
            return Kept(False, f"{self._segment.path} was removed during the run")
        try:
            self._segment.add(batches, fresh)
        except sqlite3.Error as error:
            return self._retry(error, batches, everything)
        return KEPT

    def _is_home_there(self) -> bool:
        try:
            return os.path.samestat(self.folder.lstat(), self._home)
        except OSError:
            return False

    def release_reserve(self) -> None:
        """Release half of the remaining reserve for the last rows; sealing needs the rest."""
        with contextlib.suppress(OSError):
            self._shrink(RESERVE_BYTES // 4)

    def close(self) -> None:
        """Close the file and release the reserve for sealing."""
        if self._segment is not None:
            with contextlib.suppress(sqlite3.Error):
                self._segment.close()
            self._segment = None
        with contextlib.suppress(OSError):  # already reported; `conclude` or `recover` removes it
            (self.folder / RESERVE).unlink(missing_ok=True)

    def _retry(self, error: sqlite3.Error, batches: Sequence[Batch], everything: Notes) -> Kept:
        """Try once more: in the same file with space from the reserve, or in a new file."""
        full = _code(error) == sqlite3.SQLITE_FULL
        trouble = f"writing failed: {write_failure(error, self.folder)}"
        try:
            if full and self._segment is not None and self._release_half():
                self._segment.add(batches, everything)
                return Kept(True, trouble)
            if _code(error) in NEW_FILE_ON:
                return Kept(True, trouble, self._move(batches, everything))
        except (sqlite3.Error, OSError) as second:
            return Kept(False, f"{trouble}; then {write_failure(second, self.folder)}")
        return Kept(False, trouble)

    def _move(self, batches: Sequence[Batch], everything: Notes) -> str:
        """Store everything in a new file and continue in it; return its name."""
        path = self.folder / segment_name(self._index + 1)
        for leaving in (path, *companions(path)):
            leaving.unlink(missing_ok=True)  # of a failed attempt
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

    def _allocate_reserve(self) -> None:
        """Reserve space for a full disk: half of it for the last rows, half for sealing them."""
        (self.folder / RESERVE).write_bytes(bytes(RESERVE_BYTES))
        sync_file(self.folder / RESERVE)  # some file systems allocate only now

    def _release_half(self) -> bool:
        """Release half of the reserve; return False if that was done before."""
        return self._shrink(RESERVE_BYTES // 2)

    def _shrink(self, size: int) -> bool:
        reserve = self.folder / RESERVE
        if not reserve.exists() or reserve.stat().st_size <= size:
            return False
        os.truncate(reserve, size)
        return True


def _code(error: sqlite3.Error) -> int:
    """Return SQLite's primary result code; 0 if the error carries none."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF
