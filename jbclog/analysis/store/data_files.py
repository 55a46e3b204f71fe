"""Limits of a store's data files, checked before a library reads them: by what the rows of each
table can take, and by the number of rows that the table's log declares.

A few kilobytes of Parquet can unpack to gigabytes. Each row that a publisher writes takes a minimum
of bytes, so the limits grow with the size of the files. Each file is measured once in a process,
because files of a store never change.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from math import inf
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple
from urllib.parse import unquote

from jbclog.analysis.store.parquet_sizes import GroupSize, sizes_of
from jbclog.analysis.store.place import Place
from jbclog.analysis.store.schema import DATA, RUNS
from jbclog.core.errors import StoreError
from jbclog.core.files import MIB, Kind, NotReadable, open_regular

FILES: Final = "files"  # column of `runs` with the small files, read for one run at a time
AT_ONCE: Final = 256 * MIB
FILES_AT_ONCE: Final = 384 * MIB
MOST_FILES: Final = 1100  # small files of a run, which has at most 1024 recipes
KEPT: Final = 20_000  # files whose sizes are remembered: a day of 1000 publishers


class Limits(NamedTuple):
    """Limits of a table's files: rows and unpacked bytes that are always allowed, and how many more
    for each byte of the files. `bytes_a_byte` is infinite if the table's rows are never all in
    memory.
    """

    free_rows: int
    rows_a_byte: float
    free_bytes: int
    bytes_a_byte: float = 200.0


LIMITS: Final[Mapping[str, Limits]] = MappingProxyType(
    {name: Limits(262_144, 2.0, 64 * MIB) for name in DATA}
    | {
        "samples": Limits(1_000_000, 16.0, 0, inf),
        RUNS: Limits(1000, 1 / 32, 16 * MIB, 64.0),  # a hash of 32 bytes in each, incompressible
    }
)


class Measured(NamedTuple):
    """Size of a file in bytes, its number of rows, and its unpacked bytes."""

    size: int
    rows: int
    written: int


class DataFiles:
    """Checks the data files of a table. `declared`: the number of rows of each file by the table's
    log, by path; None or missing if the log does not declare it.
    """

    def __init__(self, place: Place, table: str, declared: Mapping[str, int | None]) -> None:
        self._place, self._table, self._declared = place, table, declared

    def expect_bounded(self, paths: Iterable[str]) -> None:
        """Raise `StoreError` if one of the files, or all together, exceed the table's limits;
        FileNotFoundError if one is missing. Does not check files in S3.
        """
        if self._place.is_remote:
            return
        size = rows = written = 0
        for path in paths:
            found = self._measured(path)
            size, rows, written = size + found.size, rows + found.rows, written + found.written
            self._expect_within(path, size, rows, written)

    def _measured(self, path: str) -> Measured:
        try:
            found = measured(self._table, Path(self._place.of(self._table), path))
        except FileNotFoundError:
            raise
        except OSError as error:
            raise self._error(path, str(error.strerror or error)) from error
        declared = self._declared.get(unquote(path))
        if declared is not None and declared != found.rows:
            raise self._error(path, f"has {found.rows} rows, its log says {declared}")
        return found

    def _expect_within(self, path: str, size: int, rows: int, written: int) -> None:
        limits = LIMITS[self._table]
        most = limits.free_rows + size * limits.rows_a_byte
        if rows > most:
            raise self._error(path, f"more than {most:.0f} rows in {size} bytes")
        most_bytes = limits.free_bytes + size * limits.bytes_a_byte
        if written > most_bytes:
            raise self._error(
                path, f"unpacks to more than {most_bytes / MIB:.0f} MiB from {size} bytes"
            )

    def _error(self, path: str, why: str) -> StoreError:
        return StoreError(
            f"{self._place}: {self._table}/{path}: {why}; no publisher writes such a file. Publish"
            " the runs into a new store"
        )


def measured(table: str, path: Path) -> Measured:
    """Return size, rows and unpacked bytes of a data file. Raises OSError (`NotReadable`), also if
    reading it would take too much memory at once.
    """
    there = path.lstat()
    return _measure_once(
        table, path, there.st_ino, there.st_size, there.st_mtime_ns, there.st_ctime_ns
    )


@lru_cache(maxsize=KEPT)
def _measure_once(table: str, path: Path, *_: int) -> Measured:
    """Measure a file, once for each of its states."""
    with open_regular(path, Kind.PART) as data:
        found = sizes_of(data)
    written = 0
    for number, group in enumerate(found.groups):
        if table == RUNS:
            _expect_kept_files(group)
        own = [name for name in group.columns if table != RUNS or name != FILES]
        if group.at_once(own) > AT_ONCE:
            raise NotReadable(f"row group {number} needs more than {AT_ONCE // MIB} MiB at once")
        written += group.written(own)
    return Measured(found.size, found.rows, written)


def _expect_kept_files(group: GroupSize) -> None:
    """Limit the small files of the runs by their largest page: `Store.files_of` reads them as a
    dictionary, and writes out only those of one run.
    """
    kept = group.columns.get(FILES)
    if kept is None:
        return
    if kept.page > FILES_AT_ONCE:
        raise NotReadable(f"its small files need more than {FILES_AT_ONCE // MIB} MiB at once")
    if kept.values > MOST_FILES * group.rows:
        raise NotReadable(f"it has more than {MOST_FILES} small files of a run")
