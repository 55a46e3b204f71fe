"""The SQLite file of a batch: its journal, and what the executor and the jobs exchange.

The rules:

1. A `transaction` is synced when it returns, except with ``synced=False``: after a power cut the
   store is consistent, and such rows may be missing.
2. Several processes write, the executor and each job. A transaction is a few statements; others
   wait for it, `BUSY_S` at most. A process killed in a transaction leaves nothing of it.
3. SQLite does not detect a row that was changed or deleted. The hash chain of the journal's lines
   does.
"""

from __future__ import annotations

import contextlib
import errno
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from jbclog.core.database import Database, open_database
from jbclog.core.files import Kind, expect_regular
from jbclog.core.operating_system import sync_folder

NAME: Final = "batch.sqlite"
BUSY_S: Final = 5.0
COLUMNS: Final = {
    "journal": ("number", "line"),
    "attempt": ("name", "spec", "run", "progress", "result", "ended"),
    "event": ("number", "attempt", "line"),
}
_CREATE: Final = (
    "CREATE TABLE IF NOT EXISTS journal (number INTEGER PRIMARY KEY, line BLOB NOT NULL)",
    (
        "CREATE TABLE IF NOT EXISTS attempt (name TEXT PRIMARY KEY, spec BLOB, run TEXT, progress"
        " TEXT, result TEXT, ended REAL)"
    ),
    (
        "CREATE TABLE IF NOT EXISTS event (number INTEGER PRIMARY KEY, attempt TEXT NOT NULL, line"
        " TEXT NOT NULL)"
    ),
)
ADD_LINE: Final = "INSERT INTO journal (line) VALUES (?)"
ADD_EVENT: Final = "INSERT INTO event (attempt, line) VALUES (?, ?)"


class BatchStore:
    """The store in the folder of a batch, opened at first use. Thread-safe. Methods raise
    `OSError`.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / NAME
        self._db: Database | None = None
        self._using = threading.RLock()

    def rows(self, sql: str, values: tuple[object, ...] = ()) -> list[tuple[Any, ...]]:
        """Return the rows of a query; none if there is no store."""
        with self._using, _as_os_error():
            if self._db is None and not self.path.exists():
                return []
            return self._opened().execute(sql, values).fetchall()

    @contextmanager
    def transaction(self, *, synced: bool = True) -> Iterator[Database]:
        """Write in one transaction."""
        with self._using, _as_os_error():
            db = self._opened()
            if db.in_transaction:  # the end of the transaction failed
                db.execute("ROLLBACK")
            db.execute(f"PRAGMA synchronous = {'FULL' if synced else 'NORMAL'}")
            try:
                db.execute("BEGIN IMMEDIATE")
                yield db
                db.execute("COMMIT")
            except BaseException:
                if db.in_transaction:
                    db.execute("ROLLBACK")
                raise

    def close(self) -> None:
        with self._using:
            if self._db is not None:
                with contextlib.suppress(sqlite3.Error):
                    self._db.close()
                self._db = None

    def _opened(self) -> Database:
        # SQLite would write to a file that nobody can open any more
        if self._db is not None and not self.path.exists():
            raise FileNotFoundError(errno.ENOENT, "it was removed")
        if self._db is None:
            if self.path.is_symlink() or self.path.exists():
                expect_regular(self.path, Kind.JOURNAL)
            db = open_database(self.path, only_reads=False, busy_s=BUSY_S, kind=Kind.JOURNAL)
            try:
                if not db.has_tables(COLUMNS):
                    _create(db)
                    sync_folder(self.path.parent)
            except BaseException:
                db.close()
                raise
            self._db = db
        return self._db


def _create(db: Database) -> None:
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("BEGIN IMMEDIATE")
    for statement in _CREATE:
        db.execute(statement)
    db.execute("COMMIT")


@contextmanager
def _as_os_error() -> Iterator[None]:
    """Raise errors of SQLite as `OSError`."""
    try:
        yield
    except sqlite3.Error as error:
        raise OSError(getattr(error, "sqlite_errorcode", 0), str(error)) from error
