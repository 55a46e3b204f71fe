"""Open SQLite files."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from jbclog.core.files import Kind, expect_regular

ENDINGS: Final = ("-wal", "-shm", "-journal")


class NotAStore(sqlite3.DatabaseError):
    """The file is a database, but no recorder made it."""


class Database(sqlite3.Connection):
    """A connection to a file that may be damaged."""

    def execute(self, sql: str, parameters: Any = (), /) -> sqlite3.Cursor:
        """Execute a statement. Raises `NotAStore` if SQLite's message quotes bytes of the file that
        Python cannot decode.
        """
        try:
            return super().execute(sql, parameters)
        except UnicodeDecodeError as error:
            raise NotAStore("malformed: SQLite's message quotes bytes that are not text") from error

    def has_tables(self, names: Collection[str]) -> bool:
        """Return True if these tables exist, False for an empty database. Raises `NotAStore` if
        there are only others, sqlite3.Error.
        """
        rows = self.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        there = {name for (name,) in rows}
        if not there:
            return False
        lacking = sorted({*names} - there)
        if lacking:
            raise NotAStore(f"it lacks the table {lacking[0]}")
        return True


def open_database(
    path: Path, *, only_reads: bool, busy_s: float, kind: Kind = Kind.STORE
) -> Database:
    """Open the database at `path`. Its log and index must be regular files too, and no file may
    exceed the limit of `kind`. Raises sqlite3.Error, OSError.
    """
    for file in (path, *(path.with_name(path.name + ending) for ending in ENDINGS)):
        if only_reads or file != path:  # SQLite may have to create the file itself
            _expect_regular(file, kind, must_be_there=file == path)
    address = f"file:{quote(str(path))}?mode={'ro' if only_reads else 'rwc'}"
    return sqlite3.connect(
        address,
        uri=True,
        timeout=busy_s,
        isolation_level=None,
        check_same_thread=only_reads,
        factory=Database,
    )


def _expect_regular(path: Path, kind: Kind, *, must_be_there: bool) -> None:
    try:
        expect_regular(path, kind)
    except FileNotFoundError:
        if must_be_there:
            raise sqlite3.OperationalError("unable to open database file") from None
    except OSError as error:
        raise NotAStore(f"{path.name} {error.strerror or error}") from error
