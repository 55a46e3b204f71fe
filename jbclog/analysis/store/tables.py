"""Read untrusted Parquet, one row group at a time, after checking what it declares.

A file of 150 kB can declare or contain rows that take gigabytes. Checks: the footer's length before
parsing; rows for the file's size and in a row group; the bytes that each column declares; each
page's size in its header, which pyarrow allocates; and the length of a dictionary's texts in full.

A recorder's row groups have some 33 000 rows and 9 MB; the limits are eight to sixteen times that.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO, Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from jbclog.analysis.store.parquet_footer import (
    MOST_ITEMS,
    TEXTS,
    ColumnChunk,
    RowGroup,
    groups_in,
)
from jbclog.analysis.store.parquet_pages import (
    CODES,
    COLUMNS,
    FREE_ROWS,
    IN_FULL,
    ROWS_A_BYTE,
    Page,
    PageReader,
    footer_of,
)
from jbclog.analysis.store.values import expect_values
from jbclog.core.files import MIB, Kind, NotReadable, expect_opened, open_regular

GROUP_ROWS: Final = 262_144
FREE_GROUPS: Final = 64  # row groups of a file,
ROWS_FOR_A_GROUP: Final = 512  # and one for so many rows: each takes a millisecond, however small
THREADED_ROWS: Final = 4096  # threads are slower for fewer
GROUP_BYTES: Final = 128 * MIB  # of the columns read, uncompressed
PLAIN_TEXTS: Final = (
    pa.types.is_string,
    pa.types.is_large_string,
    pa.types.is_binary,
    pa.types.is_large_binary,
)


@contextmanager
def open_table(
    path: Path, coded: Sequence[str] = (), most_bytes: int = GROUP_BYTES
) -> Iterator[ParquetTable]:
    """Open the Parquet file at `path` and check its footer. Reading fails for a row group above
    `most_bytes`. Raises OSError (`NotReadable`) or pa.ArrowException.

    Texts in the columns `coded` are read as dictionaries, in a fifth of the time.
    """
    with open_regular(path, Kind.PART) as data, ExitStack() as opened:
        groups = groups_in(footer_of(data))
        try:
            file = _parquet(  # by descriptor: another file may have its name by now
                Path(f"/proc/self/fd/{data.fileno()}"),
                coded,
                page_checksum_verification=True,
                thrift_container_size_limit=MOST_ITEMS,
            )
            table = ParquetTable(opened.enter_context(file), groups, data, most_bytes)
        except UnicodeDecodeError as error:
            raise NotReadable("has a column whose name is no text") from error
        _expect_plausible(file.metadata, groups, expect_opened(data.fileno(), Kind.PART))
        yield table


def _parquet(
    source: Path | pa.NativeFile, coded: Sequence[str], **options: object
) -> pq.ParquetFile:
    try:
        return pq.ParquetFile(source, read_dictionary=list(coded) or None, **options)
    except KeyError as error:  # missing, or a structure or a list
        name = error.args[0].decode(errors="replace")
        raise NotReadable(f"has no column {name} of plain values") from error


def metadata_of(path: Path) -> pq.FileMetaData:
    """Return the footer of a Parquet file. Raises OSError (`NotReadable`) or pa.ArrowException."""
    with open_table(path) as table:
        return table.metadata


def bounds_of(path: Path, column: str) -> list[tuple[bytes, bytes] | None]:
    """Return a column's minimum and maximum in each row group; None if the footer has none. Raises
    as `metadata_of` does.
    """
    with open_table(path) as table:
        chunks = [
            next((chunk for chunk in group.chunks if chunk.name == column), None)
            for group in table.row_groups
        ]
    bounds = [(None, None) if one is None else one.bounds for one in chunks]
    return [None if least is None or most is None else (least, most) for least, most in bounds]


def read_small(
    path: Path, columns: Sequence[str] | None = None, *, most_bytes: int = GROUP_BYTES
) -> pa.Table:
    """Read a whole file of at most one row group's rows. Raises OSError (`NotReadable`) or
    pa.ArrowException.
    """
    with open_table(path, most_bytes=most_bytes) as table:
        if table.metadata.num_rows > GROUP_ROWS:
            raise NotReadable(f"has {table.metadata.num_rows} rows; at most {GROUP_ROWS} are read")
        groups = [*table.groups(columns)]
        return pa.concat_tables(groups) if groups else table.empty(columns)


def batches_in(
    source: pa.NativeFile,
    groups: Sequence[int],
    columns: Sequence[str],
    rows: int,
    coded: Sequence[str] = (),
) -> Iterator[pa.RecordBatch]:
    """Yield the existing ones of these columns from some row groups of an open file, in batches of
    `rows`; texts of the columns `coded` as dictionaries. Check the file with `sizes_of` first.
    """
    with _parquet(source, coded) as file:
        there = [name for name in columns if name in file.schema_arrow.names]
        for group in groups:  # one call for all groups would read ahead
            yield from file.iter_batches(rows, [group], there, use_threads=False)


class ParquetTable:
    """An open Parquet file: its footer, and its row groups, each checked before reading."""

    def __init__(
        self, file: pq.ParquetFile, groups: Sequence[RowGroup], data: BinaryIO, most_bytes: int
    ) -> None:
        self._file = file
        self._most_bytes = most_bytes
        self._data = data
        self.row_groups = groups
        self.metadata: pq.FileMetaData = file.metadata
        self._pages = PageReader(data, groups)
        # as stored; `file.schema_arrow` has the types after reading
        self.schema: pa.Schema = self.metadata.schema.to_arrow_schema()

    @property
    def num_row_groups(self) -> int:
        return int(self.metadata.num_row_groups)

    def empty(self, columns: Sequence[str] | None = None) -> pa.Table:
        table = self.schema.empty_table()
        return table if columns is None else table.select(list(columns))

    def groups(self, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
        """Read all rows, one row group at a time."""
        return (self.group(index, columns) for index in range(self.num_row_groups))

    def group(self, index: int, columns: Sequence[str] | None = None) -> pa.Table:
        """Read one row group. Raises `NotReadable` if it exceeds a limit."""
        self._expect_sound(index, columns)
        is_large = self.row_groups[index].rows > THREADED_ROWS
        rows = self._file.read_row_group(
            index, None if columns is None else list(columns), use_threads=is_large
        )
        expect_values(rows, f"row group {index}: ")
        return rows

    def batches(self, rows: int, columns: Sequence[str] | None = None) -> Iterator[pa.RecordBatch]:
        """Read all rows in batches. Raises as `group` does."""
        for index in range(self.num_row_groups):  # one call for all groups would read ahead
            self._expect_sound(index, columns)
            for batch in self._file.iter_batches(
                rows, [index], None if columns is None else list(columns), use_threads=False
            ):
                expect_values(batch, f"row group {index}: ")
                yield batch

    def _expect_sound(self, index: int, columns: Sequence[str] | None) -> None:
        group = self.row_groups[index]
        unpacked = 0
        for chunk in group.chunks:
            if columns is not None and chunk.name.partition(".")[0] not in columns:
                continue
            if chunk.values > GROUP_ROWS or chunk.values != group.rows:
                raise NotReadable(f"row group {index}: {chunk.name} has {chunk.values} values")
            pages = self._pages_in(index, chunk)
            unpacked += max(chunk.unpacked, sum(page.unpacked for page in pages))
            if unpacked > self._most_bytes:
                raise NotReadable(f"row group {index} has more than {self._most_bytes // MIB} MiB")
            self._expect_short_texts(index, chunk, pages)

    def _pages_in(self, index: int, chunk: ColumnChunk) -> list[Page]:
        try:
            return self._pages.of(chunk)
        except NotReadable as error:
            raise NotReadable(f"row group {index}: {error}") from error

    def _expect_short_texts(self, index: int, chunk: ColumnChunk, pages: Sequence[Page]) -> None:
        """Check the size of a column's texts in full. A text that a page has once may belong to
        many rows: in a dictionary, or as the beginning of others.
        """
        if chunk.kind not in TEXTS:
            return
        if sum(page.unpacked for page in pages) * chunk.values <= self._most_bytes:
            return
        longest, written_once, is_known = _texts_in(pages)
        kind = self.schema.field(chunk.name).type if chunk.name in self.schema.names else None
        # not nested, and no decimals
        is_plain = kind is not None and any(fits(kind) for fits in PLAIN_TEXTS)
        if longest * chunk.values + written_once <= self._most_bytes:
            return
        written = (
            sum(written_out(batch.column(0)) for batch in self._as_dictionary(index, chunk.name))
            if is_known and is_plain
            else longest * chunk.values
        )
        if written > self._most_bytes:
            most = self._most_bytes // MIB
            raise NotReadable(f"row group {index}: {chunk.name} has more than {most} MiB of text")

    def _as_dictionary(self, index: int, name: str) -> Iterator[pa.RecordBatch]:
        with _own(self._data) as own, pq.ParquetFile(own, read_dictionary=[name]) as file:
            yield from file.iter_batches(GROUP_ROWS, [index], [name], use_threads=False)


def _own(data: BinaryIO) -> BinaryIO:
    """Duplicate the descriptor, to be closed separately."""
    return os.fdopen(os.dup(data.fileno()), "rb")


def written_out(column: pa.Array) -> int:
    """Return the bytes of a column's texts, those of a dictionary in full at each use."""
    if not pa.types.is_dictionary(column.type):
        return int(column.nbytes)
    lengths = pc.binary_length(column.dictionary)
    return int(pc.sum(lengths.take(column.indices).cast(pa.int64())).as_py() or 0)


def _expect_plausible(metadata: pq.FileMetaData, groups: Sequence[RowGroup], size: int) -> None:
    if metadata.num_columns > COLUMNS:
        raise NotReadable(f"has {metadata.num_columns} columns; at most {COLUMNS} are read")
    if not 0 <= metadata.num_rows <= max(FREE_ROWS, size * ROWS_A_BYTE):
        raise NotReadable(f"declares {metadata.num_rows} rows in {size} bytes")
    most = max((group.rows for group in groups), default=0)
    if most > GROUP_ROWS:
        raise NotReadable(f"has a row group of {most} rows; at most {GROUP_ROWS} are read")
    most = FREE_GROUPS + metadata.num_rows // ROWS_FOR_A_GROUP
    if len(groups) > most:
        raise NotReadable(
            f"has {len(groups)} row groups for {metadata.num_rows} rows; at most {most} are read"
        )
    if sum(group.rows for group in groups) != metadata.num_rows or any(
        group.rows < 0 for group in groups
    ):
        raise NotReadable(
            f"declares {metadata.num_rows} rows, but its row groups have a different number"
        )
    if len(groups) != metadata.num_row_groups or any(
        len(group.chunks) != metadata.num_columns for group in groups
    ):
        raise NotReadable("has a footer that contradicts itself")


def _texts_in(pages: Sequence[Page]) -> tuple[int, int, bool]:
    """Return upper bounds for the length of a text that several rows may use and for the total of
    all others; and whether the pages have all texts in full.
    """
    others = [page for page in pages if page.encoding not in (*IN_FULL, *CODES)]
    return (
        max((page.unpacked for page in others), default=0),
        sum(page.unpacked for page in pages if page.encoding in IN_FULL),
        all(page.encoding is None for page in others),
    )
