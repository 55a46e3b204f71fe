"""Parquet parts of a run's tables; `part_writer` writes them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Final

import pyarrow as pa

from jbclog.core.errors import RecordError
from jbclog.core.files import is_plain_folder
from jbclog.record.manifest import SealedFile
from jbclog.record.part_file import PartFile, open_part
from jbclog.record.schema import SCHEMAS, lacking_in, with_columns

SORTED: Final = "samples"
"""The table whose parts are sorted by station, port and tick; those of 0.1.0 are as recorded."""
ROWS_A_GROUP: Final = 32_768  # of live rows in a piece, and of tables that are not sorted
PART: Final = re.compile(r"part-[0-9]{1,9}\.parquet")
PROBE: Final = "probe"  # file name for testing a new folder
HALF_A_LEASE: Final = "lease.json.new"
PREPARING: Final = "."  # readers of Parquet folders ignore names that begin with a dot

Seals = Mapping[Path, SealedFile]
"""Entries of parts in the manifest of a sealed run."""
NO_SEALS: Final[Seals] = MappingProxyType({})


def part_paths(folder: Path, table: str) -> list[Path]:
    """Return the existing parts of a table, in order."""
    if not is_plain_folder(folder / table):
        return []
    return sorted(
        (path for path in (folder / table).glob("part-*.parquet") if PART.fullmatch(path.name)),
        key=part_number,
    )


def path_of_part(folder: Path, table: str, number: int) -> Path:
    """Return the path of part `number` of a table."""
    return folder / table / f"part-{number:04d}.parquet"


def part_number(part: Path) -> int:
    """Return the number in a part's name."""
    return int(part.stem.removeprefix("part-"))


def row_groups(folder: Path, table: str, columns: list[str] | None = None) -> Iterator[pa.Table]:
    """Yield the sealed rows of a table by row groups."""
    return groups_of(part_paths(folder, table), columns)


def groups_of(
    parts: Iterable[Path],
    columns: Sequence[str] | None = None,
    *,
    station: str | None = None,
    port: int | None = None,
    seals: Seals = NO_SEALS,
    on_damage: Callable[[str], None] | None = None,
) -> Iterator[pa.Table]:
    """Yield the rows of these parts by row groups. A part with an entry in `seals` must agree with
    it, and its row groups without any row of `station` and `port` are left out.

    A damaged row group is left out and reported to `on_damage`; without that it is an error.
    """
    for path in parts:
        seal = seals.get(path)
        with opened_part(path, seal) as part:
            for index in range(part.num_row_groups):
                # a footer that nothing vouches for is not asked: pyarrow may abort
                if seal is not None and not part.may_have(index, station, port):
                    continue
                try:
                    group = group_of(part, path.parent.name, index, columns)
                except RecordError as error:
                    if on_damage is None:
                        raise
                    on_damage(str(error))
                    continue
                yield group


def group_of(
    file: PartFile, table: str, index: int, columns: Sequence[str] | None = None
) -> pa.Table:
    """Return a row group of a part; columns that the part lacks are null, or the run's name."""
    lacking = lacking_in(table, file.schema.names)
    if not lacking:
        return file.group(index, columns)
    asked = SCHEMAS[table].names if columns is None else columns
    # without any column a file returns no rows
    there = [name for name in asked if name not in lacking] or file.schema.names[:1]
    filled = [one for one in lacking if one in asked]
    rows = with_columns(file.group(index, there), table, filled, file.run)
    return rows.select([name for name in rows.column_names if name in asked])


@contextmanager
def opened_part(path: Path, seal: SealedFile | None = None) -> Iterator[PartFile]:
    """Open a part and check that it has the columns of its table. Raises RecordError."""
    table = path.parent.name
    schema = SCHEMAS[table]
    with open_part(path, seal) as part:
        lacking = lacking_in(table, part.schema.names)
        if not part.schema.equals(pa.schema([one for one in schema if one.name not in lacking])):
            raise RecordError(f"{path} is no part of {table}: its columns are others")
        yield part


def remove_leavings(folder: Path) -> None:
    """Remove half-written files of a crash from the tables' folders."""
    for table in SCHEMAS:
        for path in (folder / table).glob(f"{PREPARING}part-*.parquet"):
            path.unlink()


def remove_unfinished(folder: Path) -> None:
    """Remove temporary files of a crash: those of small files, of the guard's lease, and of the
    folder's test.
    """
    for path in [
        *folder.glob(".*.tmp"),
        *folder.glob("recipes/.*.tmp"),
        folder / PROBE,
        folder / HALF_A_LEASE,
    ]:
        path.unlink(missing_ok=True)


def read_through(path: Path) -> None:
    """Read a part to its end, verifying the checksums of its pages. Raises `RecordError`."""
    with open_part(path) as part:
        declared = part.num_rows
    rows = sum(len(group) for group in groups_of([path]))
    if rows != declared:
        raise RecordError(f"{path} holds {rows} rows, its footer says {declared}")
