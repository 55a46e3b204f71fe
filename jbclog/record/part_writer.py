"""Write the parts of a run's tables.

A segment's rows of one table become one Parquet file. It is written aside, synced, read back and
compared row by row, and only then gets its name.

- Samples are sorted by station, port and tick, so a port's rows are one contiguous read. A port has
  a row group of its own, above `MOST_A_GROUP` rows several; ports of less than `LEAST_A_GROUP` rows
  share one. The statistics of the columns `station` and `port` locate a port's row groups.
- Events, settings and counters stay in the order of `seq`, which the chain of events needs.
- Every page has a checksum. Texts and what repeats are stored by dictionary, times and noisy
  integers as differences (`DIFFERENCES`), with zstd 3.

The rows are in memory once, texts of samples as dictionaries; sorted rows are made one row group at
a time. A million samples take some 200 MB.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from jbclog.core.errors import RecordError
from jbclog.core.operating_system import sync_file, sync_folder
from jbclog.record.part_file import open_part
from jbclog.record.parts import (
    PREPARING,
    ROWS_A_GROUP,
    SORTED,
    groups_of,
    path_of_part,
    read_through,
)
from jbclog.record.row_batches import joined
from jbclog.record.schema import SCHEMAS, SEQ, TEXT

LEAST_A_GROUP: Final = 4_000
MOST_A_GROUP: Final = 131_072  # some 30 MB in memory
BYTES_A_GROUP: Final = 32 << 20  # of long texts
DIFFERENCES: Final = ("time", "tick", "seq", "scan_us", "temperature_c", "power_permille")


@dataclass(frozen=True, slots=True)
class WrittenPart:
    """A part as the list of parts has it. `first_seq` and `last_seq` are the least and the greatest
    number of its rows, None without rows.
    """

    path: Path
    rows: int
    first_seq: int | None
    last_seq: int | None
    bytes: int
    sha256: str
    footer_bytes: int
    footer_sha256: str


def write_part(folder: Path, table: str, rows: pa.Table, number: int) -> WrittenPart:
    """Write part `number` of `table` with these rows, which have its schema; `collected` makes them
    of pieces in the least memory. Raises OSError, RecordError.
    """
    home = folder / table
    home.mkdir(exist_ok=True)
    path = path_of_part(folder, table, number)
    aside = home / f"{PREPARING}{path.name}"
    if table == SORTED and not _is_collected(rows):
        rows = collected(table, [rows])
    order, spans = _groups(table, rows)
    try:
        _write(aside, table, _rows_of_groups(table, rows, order, spans))
        sync_file(aside)
        _compare(aside, _rows_of_groups(table, rows, order, spans))
        part = _described(aside, path, rows)
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)
    sync_folder(home)
    sync_folder(folder)
    return part


def describe_part(path: Path) -> WrittenPart:
    """Read a part that is there to its end, and describe it. Raises OSError, RecordError."""
    read_through(path)
    none = _no_rows(path.parent.name).select([SEQ])
    return _described(path, path, pa.concat_tables([none, *groups_of([path], [SEQ])]))


def _no_rows(table: str) -> pa.Table:
    return pa.Table.from_batches([], SCHEMAS[table])  # `empty_table` would import pandas


def collected(table: str, pieces: Iterable[pa.Table]) -> pa.Table:
    """Return the rows of `pieces`, which have the schema of `table` and are taken one at a time.

    Samples get a single chunk a column, from which rows can be taken group by group, and
    dictionaries for texts. They are in memory once.
    """
    tables = joined(pieces)
    if table != SORTED:
        return pa.concat_tables([_no_rows(table), *tables])
    chunks: dict[str, list[pa.Array]] = {name: [] for name in SCHEMAS[table].names}
    for rows in tables:
        for name, arrays in chunks.items():
            arrays.extend(_with_dictionary(rows[name]).chunks)
    columns: dict[str, pa.Array] = {}
    for field in SCHEMAS[table]:
        kind = pa.dictionary(pa.int32(), TEXT) if field.type == TEXT else field.type
        column = pa.chunked_array(chunks.pop(field.name), kind)
        columns[field.name] = column.unify_dictionaries().combine_chunks()
    return pa.table(columns)


def _is_collected(rows: pa.Table) -> bool:
    return rows["station"].type != TEXT and all(column.num_chunks <= 1 for column in rows.columns)


def _with_dictionary(column: pa.ChunkedArray) -> pa.ChunkedArray:
    return column.dictionary_encode() if column.type == TEXT else column


def _groups(table: str, rows: pa.Table) -> tuple[pa.Array | None, list[tuple[int, int]]]:
    """Return the order of the rows (None: as they are), and first row and length of each group."""
    if table != SORTED:
        bytes_a_row = rows.nbytes // max(rows.num_rows, 1) + 1
        most = min(ROWS_A_GROUP, BYTES_A_GROUP // bytes_a_row + 1)
        return None, list(_spans_of(0, rows.num_rows, most))
    keys = _sort_keys(rows)
    order = pc.sort_indices(keys, [(name, "ascending") for name in keys.column_names])  # stable
    return order, list(_port_spans(_rows_of_ports(keys.take(order))))


def _sort_keys(rows: pa.Table) -> pa.Table:
    """Return station, port and tick of samples, the station as the rank of its name."""
    stations = rows["station"].combine_chunks()
    rank_of_name = pc.rank(stations.dictionary, tiebreaker="dense")
    return pa.table(
        {
            "station": rank_of_name.take(stations.indices),
            "port": rows["port"],
            "tick": rows["tick"],
        }
    )


def _rows_of_ports(keys: pa.Table) -> Iterator[int]:
    """Yield the number of rows of each port in sorted keys. (`group_by` would import pandas.)"""
    if not keys.num_rows:
        return
    stations, ports = keys["station"], keys["port"]
    is_other_port = pc.or_(
        pc.not_equal(stations[1:], stations[:-1]), pc.not_equal(ports[1:], ports[:-1])
    )
    lasts = pc.indices_nonzero(is_other_port).to_pylist()
    for before, last in pairwise([-1, *lasts, keys.num_rows - 1]):
        yield last - before


def _port_spans(rows_of_ports: Iterable[int]) -> Iterator[tuple[int, int]]:
    """Yield first row and length of each row group of ports with so many rows, one after the
    other.
    """
    first = 0
    length = 0
    for rows in rows_of_ports:
        if length and (length >= LEAST_A_GROUP or rows >= LEAST_A_GROUP):
            yield from _spans_of(first, length, MOST_A_GROUP)
            first += length
            length = 0
        length += rows
    yield from _spans_of(first, length, MOST_A_GROUP)


def _spans_of(first: int, length: int, most: int) -> Iterator[tuple[int, int]]:
    """Divide rows into spans of at most `most`; yield the first row and the length of each."""
    for start in range(0, length, most):
        yield first + start, min(most, length - start)


def _rows_of_groups(
    table: str, rows: pa.Table, order: pa.Array | None, spans: list[tuple[int, int]]
) -> Iterator[pa.Table]:
    """Yield the rows of each row group, in the table's schema."""
    for first, length in spans:
        if order is None:
            group = rows.slice(first, length)
        else:
            group = rows.take(order.slice(first, length))
        yield group.cast(SCHEMAS[table])


def _write(path: Path, table: str, groups: Iterable[pa.Table]) -> None:
    schema = SCHEMAS[table]
    encodings = {name: "DELTA_BINARY_PACKED" for name in DIFFERENCES if name in schema.names}
    with pq.ParquetWriter(
        path,
        schema,
        compression="zstd",
        compression_level=3,
        use_dictionary=[name for name in schema.names if name not in encodings],
        column_encoding=encodings,
        write_page_checksum=True,
    ) as writer:
        for group in groups:
            writer.write_table(group, row_group_size=group.num_rows)


def _compare(path: Path, groups: Iterable[pa.Table]) -> None:
    """Raise RecordError unless the file, as read back, has these groups: jbclog must be able to
    read what it writes.
    """
    with open_part(path) as part:
        written = 0
        for group in groups:
            if written >= part.num_row_groups or not part.group(written).equals(group):
                raise RecordError(f"{path}: row group {written} is not what was written")
            written += 1
        if written != part.num_row_groups:
            raise RecordError(f"{path}: {part.num_row_groups} row groups instead of {written}")


def _described(aside: Path, path: Path, rows: pa.Table) -> WrittenPart:
    """Return what the list of parts says of the file `aside`, which will be called `path`."""
    numbers = pc.min_max(rows[SEQ])
    with open_part(aside) as part:
        footer = part.footer
    with aside.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return WrittenPart(
        path,
        rows.num_rows,
        numbers["min"].as_py(),
        numbers["max"].as_py(),
        aside.stat().st_size,
        digest,
        len(footer),
        hashlib.sha256(footer).hexdigest(),
    )
