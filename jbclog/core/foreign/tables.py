"""Read untrusted Parquet, one row group at a time, after checking what it declares.

A file of 150 kB can declare or contain rows that take gigabytes. Checked are: the footer's length
before it is parsed; rows per file size and per row group; the bytes that each column declares; each
page's size in its header, which is what the library allocates; and the length of a dictionary's
texts when written out.

A recorder's row groups have some 33 000 rows and 9 MB; the limits are eight to sixteen times that.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO, Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from jbclog.core.foreign.files import MIB, Kind, NotReadable, expect_regular, open_foreign
from jbclog.core.foreign.parquet_footer import (
    STRUCT,
    ColumnChunk,
    RowGroup,
    ThriftReader,
    groups_in,
)
from jbclog.core.foreign.values import expect_values

MAGIC: Final = b"PAR1"
TAIL: Final = struct.Struct("<I4s")
FOOTER_BYTES: Final = 4 * MIB  # an hour of 256 ports at 10 Hz takes 1.4 MB
FOOTER_LIST: Final = 8192  # entries of one of its lists
GROUP_ROWS: Final = 262_144
THREADED_ROWS: Final = 4096  # threads take longer for fewer
GROUP_BYTES: Final = 128 * MIB  # of the columns read, uncompressed
ROWS_A_BYTE: Final = 16  # rows without any reading take a quarter of a byte each
FREE_ROWS: Final = 1_000_000  # whatever the file's size
COLUMNS: Final = 200
PAGES: Final = 4096  # of one column of a row group
TEXTS: Final = (
    pa.types.is_string,
    pa.types.is_large_string,
    pa.types.is_binary,
    pa.types.is_large_binary,
)


@contextmanager
def open_table(
    path: Path, coded: Sequence[str] = (), most_bytes: int = GROUP_BYTES
) -> Iterator[ParquetTable]:
    """Open the Parquet file at `path` and check its footer; a row group that is read has at most
    `most_bytes`. Raises OSError (`NotReadable`) or pa.ArrowException.

    The texts in the columns `coded` are read as dictionaries, in a fifth of the time.
    """
    with open_foreign(path, Kind.PART) as data, ExitStack() as opened:
        groups = groups_in(_footer(data))
        try:
            file = pq.ParquetFile(
                path,
                read_dictionary=list(coded) or None,
                page_checksum_verification=True,
                thrift_container_size_limit=FOOTER_LIST,
            )
            table = ParquetTable(opened.enter_context(file), groups, data, most_bytes)
        except UnicodeDecodeError as error:
            raise NotReadable("has a column whose name is no text") from error
        _expect_plausible(file.metadata, groups, expect_regular(path, Kind.PART))
        yield table


def metadata_of(path: Path) -> pq.FileMetaData:
    """Return the footer of a Parquet file. Raises OSError (`NotReadable`) or pa.ArrowException."""
    with open_table(path) as table:
        return table.metadata


def bounds_of(path: Path, column: str) -> list[tuple[bytes, bytes] | None]:
    """Return a column's minimum and maximum in each row group; None where the footer has none.
    Raises as `metadata_of`.
    """
    with open_table(path) as table:
        chunks = [
            next((chunk for chunk in group.chunks if chunk.name == column), None)
            for group in table.row_groups
        ]
    return [
        (
            (one.least, one.greatest)
            if one is not None and one.least is not None and one.greatest is not None
            else None
        )
        for one in chunks
    ]


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


class ParquetTable:
    """An open Parquet file: its footer, and its row groups, each checked before it is read."""

    def __init__(
        self, file: pq.ParquetFile, groups: Sequence[RowGroup], data: BinaryIO, most_bytes: int
    ) -> None:
        self._file = file
        self._most_bytes = most_bytes
        self._data = data
        self.row_groups = groups
        self.metadata: pq.FileMetaData = file.metadata
        # as stored: `file.schema_arrow` has the types that are read
        self.schema: pa.Schema = self.metadata.schema.to_arrow_schema()

    @property
    def num_row_groups(self) -> int:
        return int(self.metadata.num_row_groups)

    def empty(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Return a table with these columns and no rows."""
        table = self.schema.empty_table()
        return table if columns is None else table.select(list(columns))

    def groups(self, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
        """Read all rows, one row group at a time."""
        return (self.group(index, columns) for index in range(self.num_row_groups))

    def group(self, index: int, columns: Sequence[str] | None = None) -> pa.Table:
        """Read one row group. Raises `NotReadable` where it exceeds a limit."""
        self._expect_sound(index, columns)
        is_large = self.row_groups[index].rows > THREADED_ROWS
        rows = self._file.read_row_group(
            index, None if columns is None else list(columns), use_threads=is_large
        )
        expect_values(rows, f"row group {index}: ")
        return rows

    def batches(self, rows: int, columns: Sequence[str] | None = None) -> Iterator[pa.RecordBatch]:
        """Read all rows in batches. Raises as `group` does."""
        for index in range(self.num_row_groups):  # over all at once the library reads ahead
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
            unpacked += max(chunk.unpacked, _unpacked(self._data, chunk))
            if unpacked > self._most_bytes:
                raise NotReadable(f"row group {index} has more than {self._most_bytes // MIB} MiB")
            self._expect_short_texts(index, chunk)

    def _expect_short_texts(self, index: int, chunk: ColumnChunk) -> None:
        """A text that a page has once may stand in many rows: that of a dictionary, or one of which
        others are said to have the beginning. Written out, they may be far longer.
        """
        kind = self.schema.field(chunk.name).type if chunk.name in self.schema.names else None
        if kind is None or not any(fits(kind) for fits in TEXTS):
            return
        if chunk.unpacked * chunk.values <= self._most_bytes:
            return
        longest, written_once, is_known = _texts_in(self._data, chunk)
        if longest * chunk.values + written_once <= self._most_bytes:
            return
        written = (
            sum(_written_out(batch.column(0)) for batch in self._as_dictionary(index, chunk.name))
            if is_known
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


def _written_out(column: pa.Array) -> int:
    if not pa.types.is_dictionary(column.type):
        return int(column.nbytes)
    lengths = pc.binary_length(column.dictionary)
    return int(pc.sum(lengths.take(column.indices).cast(pa.int64())).as_py() or 0)


def _footer(data: BinaryIO) -> bytes:
    """Return the footer's bytes. Raises `NotReadable` where it is missing or too long."""
    size = data.seek(0, 2)
    if size < TAIL.size + len(MAGIC):
        raise NotReadable("is not a Parquet file: it is too short")
    data.seek(size - TAIL.size)
    length, magic = TAIL.unpack(data.read(TAIL.size))
    if magic != MAGIC:
        raise NotReadable("is not a Parquet file: its end is wrong")
    if length > FOOTER_BYTES:
        raise NotReadable(f"has a footer of {length} bytes; at most {FOOTER_BYTES} are read")
    if length > size - TAIL.size - len(MAGIC):
        raise NotReadable("is not a Parquet file: its footer is longer than the file")
    data.seek(size - TAIL.size - length)
    return data.read(length)


def _expect_plausible(metadata: pq.FileMetaData, groups: Sequence[RowGroup], size: int) -> None:
    if metadata.num_columns > COLUMNS:
        raise NotReadable(f"has {metadata.num_columns} columns; at most {COLUMNS} are read")
    if not 0 <= metadata.num_rows <= max(FREE_ROWS, size * ROWS_A_BYTE):
        raise NotReadable(f"declares {metadata.num_rows} rows in {size} bytes")
    most = max((group.rows for group in groups), default=0)
    if most > GROUP_ROWS:
        raise NotReadable(f"has a row group of {most} rows; at most {GROUP_ROWS} are read")
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


# Page headers: struct PageHeader of
# https://github.com/apache/parquet-format/blob/master/src/main/thrift/parquet.thrift.
HEAD_BYTES: Final = 16 << 10
USUAL_HEAD_BYTES: Final = 256
KEPT_HEADS: Final = 4096  # cached page headers: those of a week's samples of a few columns
# fields of a page header: what it is, its sizes, and the encoding in either kind of data page
PAGE, UNPACKED, PACKED = 1, 2, 3
# kind of data page -> its struct, and the field in it
ENCODINGS: Final[dict[int | None, tuple[int, int]]] = {0: (5, 2), 3: (8, 4)}
ENCODING: Final = -1  # of the data page, among its fields
PLAIN: Final = 0  # each text in full
CODES: Final = (2, 8)  # places in the dictionary
UNKNOWN: Final = -1


def _unpacked(data: BinaryIO, chunk: ColumnChunk) -> int:
    """Sum the uncompressed sizes that a column's pages declare. Raises `NotReadable`."""
    return sum(size for size, _ in _pages(data, chunk))


def _texts_in(data: BinaryIO, chunk: ColumnChunk) -> tuple[int, int, bool]:
    """Return upper bounds for the length of a text that may stand in several rows, and for that of
    all others together; and whether all of them are in full in the pages.
    """
    longest, written_once, is_known = 0, 0, True
    for size, encoding in _pages(data, chunk):
        if encoding == PLAIN:
            written_once += size
        elif encoding not in CODES:
            longest, is_known = max(longest, size), is_known and encoding is None
    return longest, written_once, is_known


def _pages(data: BinaryIO, chunk: ColumnChunk) -> Iterator[tuple[int, int | None]]:
    """Return each page's uncompressed size, and the encoding of one with data."""
    if not chunk.packed:
        return
    at = min((start for start in (chunk.data_at, chunk.dictionary_at) if start), default=0)
    end = at + chunk.packed
    if not len(MAGIC) <= at <= end <= data.seek(0, 2):
        raise NotReadable(f"{chunk.name} lies outside the file")
    for _ in range(PAGES):
        if at >= end:
            return
        data.seek(at)
        fields, length = _head(data.read(min(HEAD_BYTES, end - at)))
        packed, unpacked = fields.get(PACKED), fields.get(UNPACKED)
        if packed is None or unpacked is None or packed < 0 or unpacked < 0:
            raise NotReadable(f"{chunk.name} has a page without a size")
        yield unpacked, fields.get(ENCODING)
        at += length + packed
    raise NotReadable(f"{chunk.name} has more than {PAGES} pages")


def _head(data: bytes) -> tuple[dict[int, int | None], int]:
    """Parse a page header; return its sizes, the encoding of a data page, and its own length in
    bytes.

    A run's pages are read several times by whatever looks at it. A header that ends within its
    first bytes is the same whatever follows.
    """
    try:
        return _usual_head(data[:USUAL_HEAD_BYTES])
    except NotReadable:
        return _parsed_head(data)


def _parsed_head(data: bytes) -> tuple[dict[int, int | None], int]:
    reader = ThriftReader(data)
    found: dict[int, int | None] = {}
    encodings: dict[int, int | None] = {}
    of_struct = dict(ENCODINGS.values())
    try:
        for number, kind in reader.fields():
            if number in (PAGE, UNPACKED, PACKED):
                found[number] = reader.integer(kind)
            elif number in of_struct and kind == STRUCT:
                encodings[number] = _integer_in(reader, of_struct[number])
            else:
                reader.skip(kind)
    except (IndexError, ValueError):
        raise NotReadable("has an unreadable page header") from None
    kind_of_page = found.get(PAGE)
    if kind_of_page in ENCODINGS:
        place, _ = ENCODINGS[kind_of_page]
        encoding = encodings.get(place)
        found[ENCODING] = UNKNOWN if encoding is None else encoding
    return found, reader.at


def _integer_in(reader: ThriftReader, wanted: int) -> int | None:
    """Read a struct; return the whole number in one of its fields."""
    value = None
    for number, kind in reader.fields():
        if number == wanted:
            value = reader.integer(kind)
        else:
            reader.skip(kind)
    return value


_usual_head = lru_cache(maxsize=KEPT_HEADS)(_parsed_head)
