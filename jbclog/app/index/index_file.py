"""The file of the index: entries of bytes in one SQLite table, each with a stamp of its sources and
a checksum.

The file belongs to the user. A file that is damaged or of another version is removed and rebuilt;
if the folder cannot be written there is no index. None of that is an error. Nothing is synced: a
power cut costs the index at most.
"""

from __future__ import annotations

import os
import sqlite3
import stat
import time
from collections.abc import Callable
from collections.abc import Set as AbstractSet
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path
from typing import Final, NamedTuple

from jbclog import __version__
from jbclog.core.database import ENDINGS, Database, open_database
from jbclog.core.files import LIMITS, MIB, Kind, NotReadable, expect_regular

NAME: Final = "runs-1.sqlite"  # the number is the version of the table
COLUMNS: Final = {"entries": ("place", "kind", "run", "stamp", "data", "sum")}
CREATE: Final = (
    f"CREATE TABLE entries ({', '.join(COLUMNS['entries'])}, PRIMARY KEY (place, kind, run))"
    " WITHOUT ROWID"
)
DIGEST: Final = 16
BY: Final = f"jbclog {__version__}".encode()  # another version may read a run differently
BUSY_S: Final = 2.0  # wait for another program that writes; then this one does without the index
STATEMENT_S: Final = 20.0
MOST_WAITING, MOST_WAIT_S = 20_000, 5.0  # entries, and the time after which they are written
# entries of a kind in a folder; 10 000 runs take 10 MB
MOST_ROWS, MOST_BYTES = 1_000_000, 192 * MIB
MOST_OF_A_RUN: Final = 32 * MIB  # a manifest has half of that
PAGE: Final = 4096
SPARE_PAGES: Final = 1000
UNUSABLE: Final = (
    *(
        sqlite3.SQLITE_BUSY,
        sqlite3.SQLITE_LOCKED,
        sqlite3.SQLITE_READONLY,
        sqlite3.SQLITE_CANTOPEN,
        sqlite3.SQLITE_IOERR,
    ),
    *(sqlite3.SQLITE_PERM, sqlite3.SQLITE_AUTH, sqlite3.SQLITE_NOMEM, sqlite3.SQLITE_INTERRUPT),
)
"""Errors that are not caused by the file's content; all others, and a full disk, remove it."""


def cache_folder() -> Path | None:
    """Return jbclog's folder in the user's cache folder, created if missing; None if that is not
    possible, or others can write there.
    """
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        folder = (given if given.is_absolute() else Path.home() / ".cache") / "jbclog"
        # belongs to another user, perhaps the owner of this home
        if _nearest(folder).stat().st_uid != os.geteuid():
            return None
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        there = folder.lstat()
    except (OSError, RuntimeError):
        return None
    is_ours = (
        stat.S_ISDIR(there.st_mode)
        and there.st_uid == os.geteuid()
        and not there.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    )
    return folder if is_ours else None


def _nearest(folder: Path) -> Path:
    return next(one for one in (folder, *folder.parents) if os.path.lexists(one))


class Entry(NamedTuple):
    """Entry of a run: data made from files with this stamp."""

    stamp: bytes
    data: bytes
    sum: bytes


Entries = dict[bytes, Entry]
"""Run -> entry, for a place and a kind."""


class IndexFile:
    """The entries in the file at `path`; no entries without a path, or if it cannot be used."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._database = None if path is None else self._opened(path)
        self._known: dict[tuple[bytes, str], Entries] = {}
        self._waiting: dict[tuple[bytes, str, bytes], Entry] = {}
        self._written_s = time.monotonic()

    def entries(self, place: bytes, kind: str) -> Entries:
        """Return the entries of a place and kind, not checked yet (`data_of`)."""
        if (place, kind) not in self._known:
            waiting = {
                key[2]: entry for key, entry in self._waiting.items() if key[:2] == (place, kind)
            }
            self._known[place, kind] = self._read(place, kind) | waiting
        return self._known[place, kind]

    def data_of(self, place: bytes, kind: str, run: bytes, stamp: bytes) -> bytes | None:
        """Return a run's data if they were made from files with this stamp, by this program, and
        are intact.
        """
        entry = self.entries(place, kind).get(run)
        if (
            entry is None
            or entry.stamp != stamp
            or entry.sum != self._sum(place, kind, run, entry.stamp, entry.data)
        ):
            return None
        return entry.data

    def put(self, place: bytes, kind: str, run: bytes, stamp: bytes, data: bytes) -> None:
        """Add an entry, or replace it."""
        entry = Entry(stamp, data, self._sum(place, kind, run, stamp, data))
        self._waiting[place, kind, run] = entry
        if (place, kind) in self._known:
            self._known[place, kind][run] = entry
        if len(self._waiting) >= MOST_WAITING or time.monotonic() - self._written_s > MOST_WAIT_S:
            self.write()

    def keep_only(self, place: bytes, kind: str, runs: AbstractSet[bytes]) -> None:
        """Write, and remove all entries of the runs of a place that have an entry of `kind` and are
        not among `runs`.
        """
        self.write()
        gone = self.entries(place, kind).keys() - runs
        if not gone:
            return
        for (where, _), entries in self._known.items():
            for run in gone if where == place else ():
                entries.pop(run, None)
        self._change(lambda database: _delete(database, place, gone))

    def write(self) -> None:
        """Write the added entries; they are lost without an index, or while another program
        writes.
        """
        waiting, self._waiting, self._written_s = self._waiting, {}, time.monotonic()
        rows = [(*key, *entry) for key, entry in waiting.items()]
        if rows:
            self._change(
                lambda database: database.executemany(
                    "INSERT OR REPLACE INTO entries VALUES (?, ?, ?, ?, ?, ?)", rows
                )
            )

    def _change(self, change: Callable[[Database], object]) -> None:
        if self._database is None:
            return
        try:
            self._database.within(STATEMENT_S)
            self._database.execute("BEGIN IMMEDIATE")
            try:
                change(self._database)
                self._database.execute("COMMIT")
            finally:
                if self._database.in_transaction:
                    self._database.execute("ROLLBACK")
        except sqlite3.Error as error:
            self._give_up(error)

    def close(self) -> None:
        """Write, and close the file."""
        self.write()
        if self._database is not None:
            self._database.close()
            self._database = None

    def _read(self, place: bytes, kind: str) -> Entries:
        if self._database is None:
            return {}
        try:
            self._database.within(STATEMENT_S)
            asked = "SELECT run, stamp, data, sum FROM entries WHERE place = ? AND kind = ?"
            rows = self._database.rows(
                asked, (place, kind), most_rows=MOST_ROWS, most_bytes=MOST_BYTES
            )
        except sqlite3.Error as error:
            self._give_up(error)
            return {}
        return {
            run: Entry(*found)
            for run, *found in rows
            if all(isinstance(one, bytes) for one in (run, *found))
        }

    @staticmethod
    def _sum(place: bytes, kind: str, run: bytes, stamp: bytes, data: bytes) -> bytes:
        return blake2b(
            b"\0".join((BY, place, stamp, kind.encode(), run, data)), digest_size=DIGEST
        ).digest()

    def _opened(self, path: Path) -> Database | None:
        for _ in range(2):
            try:
                return _open(path)
            except (NotReadable, sqlite3.DatabaseError) as error:
                if isinstance(error, sqlite3.Error) and not _is_of_content(error):
                    return None
                _remove(path)
            except OSError:
                return None
        return None

    def _give_up(self, error: sqlite3.Error) -> None:
        """Continue without the index; remove it if its content is at fault."""
        if self._database is not None and self._path is not None:
            self._database.close()
            self._database = None
            if _is_of_content(error):
                _remove(self._path)


def _delete(database: Database, place: bytes, runs: AbstractSet[bytes]) -> None:
    kinds = database.execute(
        "SELECT DISTINCT kind FROM entries WHERE place = ?", (place,)
    ).fetchall()
    these = [(place, kind, run) for (kind,) in kinds for run in runs]
    database.executemany("DELETE FROM entries WHERE place = ? AND kind = ? AND run = ?", these)


def _open(path: Path) -> Database:
    with suppress(FileNotFoundError):
        expect_regular(path, Kind.INDEX)
    database = open_database(path, only_reads=False, busy_s=BUSY_S)
    try:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_OF_A_RUN)
        database.execute("PRAGMA synchronous = OFF")
        database.execute(f"PRAGMA max_page_count = {LIMITS[Kind.INDEX] // PAGE - SPARE_PAGES}")
        if not database.expect_tables(COLUMNS):
            database.execute(CREATE)
    except BaseException:
        database.close()
        raise
    return database


def _is_of_content(error: sqlite3.Error) -> bool:
    return getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF not in UNUSABLE


def _remove(path: Path) -> None:
    with suppress(OSError):
        for one in (path, *(path.with_name(path.name + ending) for ending in ENDINGS)):
            one.unlink(missing_ok=True)
