"""Open untrusted SQLite files: check the schema and limit the time of every statement."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from jbclog.core.files import Kind, expect_regular

ENDINGS: Final = ("-wal", "-shm", "-journal")
# for one statement; an hour of 250 stations takes less than one second
STATEMENT_S: Final = 60.0
STEPS: Final = 100_000  # instructions of SQLite's virtual machine between two checks of the time
LIMITS: Final[Mapping[int, int]] = {
    sqlite3.SQLITE_LIMIT_LENGTH: 96 << 20,
    sqlite3.SQLITE_LIMIT_SQL_LENGTH: 100_000,
    sqlite3.SQLITE_LIMIT_COLUMN: 100,
    sqlite3.SQLITE_LIMIT_EXPR_DEPTH: 100,
    sqlite3.SQLITE_LIMIT_COMPOUND_SELECT: 10,
    sqlite3.SQLITE_LIMIT_ATTACHED: 0,
    sqlite3.SQLITE_LIMIT_TRIGGER_DEPTH: 1,
    sqlite3.SQLITE_LIMIT_FUNCTION_ARG: 10,
    sqlite3.SQLITE_LIMIT_WORKER_THREADS: 0,
}
DEFENSIVE: Final = (
    "PRAGMA trusted_schema = OFF",
    "PRAGMA cell_size_check = ON",
    "PRAGMA mmap_size = 0",
)


class NotAStore(sqlite3.DatabaseError):
    """The file is a database, but no recorder made it."""


def open_database(
    path: Path, *, only_reads: bool, busy_s: float, kind: Kind = Kind.STORE
) -> Database:
    """Open the database at `path`. Its log and index must be regular files too, and no file may
    exceed the limit of `kind`. Raises sqlite3.Error, OSError.
    """
    for one in (path, *(path.with_name(path.name + ending) for ending in ENDINGS)):
        if only_reads or one != path:  # SQLite may have to create the file itself
            _expect_regular(one, kind, must_be_there=one == path)
    address = f"file:{quote(str(path))}?mode={'ro' if only_reads else 'rwc'}"
    connection = sqlite3.connect(
        address,
        uri=True,
        timeout=busy_s,
        isolation_level=None,
        check_same_thread=only_reads,
        factory=Database,
    )
    try:
        for limit, value in LIMITS.items():
            connection.setlimit(limit, value)
        for pragma in (*DEFENSIVE, "PRAGMA query_only = ON") if only_reads else DEFENSIVE:
            connection.execute(pragma)
    except BaseException:
        connection.close()
        raise
    return connection


def _expect_regular(path: Path, kind: Kind, *, must_be_there: bool) -> None:
    try:
        expect_regular(path, kind)
    except FileNotFoundError:
        if must_be_there:
            raise sqlite3.OperationalError("unable to open database file") from None
    except OSError as error:
        raise NotAStore(f"{path.name} {error.strerror or error}") from error


class Database(sqlite3.Connection):
    """A connection that interrupts slow statements (sqlite3.OperationalError)."""

    def execute(self, sql: str, parameters: Any = (), /) -> sqlite3.Cursor:
        """Execute a statement. Raises `NotAStore` if SQLite's message quotes bytes of the file that
        Python cannot decode.
        """
        try:
            return super().execute(sql, parameters)
        except UnicodeDecodeError as error:
            raise NotAStore("malformed: SQLite's message quotes bytes that are not text") from error

    def rows(
        self, sql: str, parameters: Any = (), *, most_rows: int, most_bytes: int
    ) -> list[tuple[Any, ...]]:
        """Return the rows of a query. Raises `NotAStore` for more rows, or more bytes in their
        texts: rows of a forged file can name the same page many times.
        """
        found: list[tuple[Any, ...]] = []
        taken = 0
        for row in self.execute(sql, parameters):
            taken += sum(len(one) for one in row if isinstance(one, bytes | str))
            if len(found) == most_rows or taken > most_bytes:
                raise NotAStore(f"more than {most_rows} rows, or {most_bytes} bytes in them")
            found.append(row)
        return found

    def within(self, seconds: float = STATEMENT_S) -> None:
        """Limit the time of the following statements."""
        until = time.monotonic() + seconds
        self.set_progress_handler(lambda: time.monotonic() > until, STEPS)

    def expect_tables(self, columns: Mapping[str, tuple[str, ...]]) -> bool:
        """Return True if exactly these tables exist and nothing else, False for an empty database.

        Raises `NotAStore`, sqlite3.Error.
        """
        self.within()
        found = self.execute(
            "SELECT type, name, substr(sql, 1, 20) FROM sqlite_master LIMIT 20"
        ).fetchall()
        if not found:
            return False
        strange = [
            f"{kind} {name}" for kind, name, sql in found if not _is_known(kind, name, sql, columns)
        ]
        if strange:
            raise NotAStore(f"it contains something that no recorder makes: {strange[0]!r:.80}")
        if {name for kind, name, _ in found if kind == "table"} != {*columns}:
            raise NotAStore("it lacks a table of a live store")
        for table, names in columns.items():
            there = self.execute(
                "SELECT name, hidden FROM pragma_table_xinfo(?)", (table,)
            ).fetchall()
            if there != [(name, 0) for name in names]:
                raise NotAStore(f"its table {table} has other columns")
        return True


def _is_known(
    kind: object, name: object, sql: object, columns: Mapping[str, tuple[str, ...]]
) -> bool:
    if kind == "table":
        return name in columns and isinstance(sql, str) and sql.upper().startswith("CREATE TABLE")
    return (
        kind == "index"
        and isinstance(name, str)
        and name.startswith("sqlite_autoindex_")
        and sql is None
    )
