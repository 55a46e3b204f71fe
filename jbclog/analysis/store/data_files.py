"""Limits of a store's data files, before a library reads them: by what the rows of each table can
be, and by what its log says of the file.

A few kilobytes of Parquet can hold rows that take gigabytes. A row has a least size in a file that
a publisher wrote, so that what a store takes grows with its bytes. Each file is looked at once in a
process: files of a store never change.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from math import inf
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple
from urllib.parse import unquote

from jbclog.analysis.store.place import Place
from jbclog.analysis.store.schema import DATA, RUNS
from jbclog.core.errors import StoreError
from jbclog.core.foreign.files import MIB, Kind, NotReadable, open_foreign
from jbclog.core.foreign.parquet_sizes import GroupSize, sizes_of

FILES: Final = "files"  # the column of `runs` with whole files, read for one run at a time
AT_ONCE: Final = 256 * MIB
FILES_AT_ONCE: Final = 384 * MIB
MOST_FILES: Final = 1100  # kept of a run: it has at most 1024 recipes
KEPT: Final = 20_000  # files; a day of 1000 publishers


class Limits(NamedTuple):
    """What a table's files can hold: rows and unpacked bytes that need no reason, and those for
    each byte of the files; no limit of bytes for rows that are never all in memory.
    """

    free_rows: int
    rows_a_byte: float
    free_bytes: int
    bytes_a_byte: float = 200.0


LIMITS: Final[Mapping[str, Limits]] = MappingProxyType(
    {name: Limits(262_144, 2.0, 64 * MIB) for name in DATA}
    | {
        "samples": Limits(1_000_000, 16.0, 0, inf),
        RUNS: Limits(1000, 1 / 32, 16 * MIB, 64.0),  # a hash of 32 bytes in each, which never packs
    }
)


class Measured(NamedTuple):
    """A file's bytes, rows, and what it takes unpacked."""

    size: int
    rows: int
    written: int


class DataFiles:
    """Looks at the data files of a table; `declared` are the numbers of rows that its log has for
    some of them, by path.
    """

    def __init__(self, place: Place, table: str, declared: Mapping[str, int | None]) -> None:
        self._place, self._table, self._declared = place, table, declared

    def expect_bounded(self, paths: Iterable[str]) -> None:
        """Raise `StoreError` if one of the files, or all together, hold more than such files can;
        FileNotFoundError if one is missing. Files in S3 are not looked at.
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
            raise self._refused(path, str(error.strerror or error)) from error
        declared = self._declared.get(unquote(path))
        if declared is not None and declared != found.rows:
            raise self._refused(path, f"has {found.rows} rows, its log says {declared}")
        return found

    def _expect_within(self, path: str, size: int, rows: int, written: int) -> None:
        limits = LIMITS[self._table]
        most = limits.free_rows + size * limits.rows_a_byte
        if rows > most:
            raise self._refused(path, f"more than {most:.0f} rows in {size} bytes")
        most_bytes = limits.free_bytes + size * limits.bytes_a_byte
        if written > most_bytes:
            raise self._refused(
                path, f"unpacks to more than {most_bytes / MIB:.0f} MiB from {size} bytes"
            )

    def _refused(self, path: str, why: str) -> StoreError:
        return StoreError(
            f"{self._place}: {self._table}/{path}: {why}; no publisher wrote it so. Publish the"
            " runs into a new store"
        )


def measured(table: str, path: Path) -> Measured:
    """Return what a data file holds. Raises OSError (`NotReadable`), also where reading it would
    take too much at once.
    """
    there = path.lstat()
    return _kept(table, path, there.st_ino, there.st_size, there.st_mtime_ns, there.st_ctime_ns)


@lru_cache(maxsize=KEPT)
def _kept(table: str, path: Path, *_: int) -> Measured:
    with open_foreign(path, Kind.PART) as data:
        found = sizes_of(data)
    written = 0
    for number, group in enumerate(found.groups):
        if table == RUNS:
            _expect_kept_files(group)
        own = [name for name in group.columns if table != RUNS or name != FILES]
        if group.at_once(own) > AT_ONCE:
            raise NotReadable(f"row group {number} takes more than {AT_ONCE // MIB} MiB at once")
        written += group.written(own)
    return Measured(found.size, found.rows, written)


def _expect_kept_files(group: GroupSize) -> None:
    """The dictionary of what is kept is not written out, see `Store.files_of`."""
    kept = group.columns.get(FILES)
    if kept is None:
        return
    if kept.page > FILES_AT_ONCE:
        raise NotReadable(f"its files take more than {FILES_AT_ONCE // MIB} MiB at once")
    if kept.values > MOST_FILES * group.rows:
        raise NotReadable(f"it holds more than {MOST_FILES} files of a run")
