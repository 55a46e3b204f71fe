"""Parquet that may be anybody's: read a row group at a time, and each only after what it declares was looked at.

A file of 150 kB can declare, or really hold, rows that take gigabytes. Looked at are: the footer's length before it is parsed; rows
by the file's size and by row group; the bytes that each column declares; the length of each page in its own head, which is what
the library reserves before it unpacks; and how long the texts of a dictionary become, written out.

A recorder's groups have some 33 000 rows and 9 MB; the limits are eight to sixteen times that.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from jbclog.foreign.files import MIB, Kind, NotReadable, expect_regular, open_foreign

MAGIC: Final = b"PAR1"
TAIL: Final = struct.Struct("<I4s")
FOOTER_BYTES: Final = 4 * MIB  # an hour of 256 ports at 10 Hz takes 1.4 MB
FOOTER_LIST: Final = 8192  # entries of one of its lists
GROUP_ROWS: Final = 262_144
GROUP_BYTES: Final = 128 * MIB  # of the columns that are read, unpacked
ROWS_A_BYTE: Final = 16  # rows in which nothing was read take a quarter of a byte each
FREE_ROWS: Final = 1_000_000  # whatever the file's size
COLUMNS: Final = 200
PAGES: Final = 4096  # of one column of a row group
TEXTS: Final = (pa.types.is_string, pa.types.is_large_string, pa.types.is_binary, pa.types.is_large_binary)


@contextmanager
def open_table(path: Path) -> Iterator[Table]:
    """The Parquet file at `path`, its footer looked at. Raises OSError (`NotReadable`) or pa.ArrowException."""
    with open_foreign(path, Kind.PART) as data:
        _expect_footer(data)
        with pq.ParquetFile(path, page_checksum_verification=True, thrift_container_size_limit=FOOTER_LIST) as file:
            _expect_plausible(file.metadata, expect_regular(path, Kind.PART))
            yield Table(file, data)


def metadata_of(path: Path) -> pq.FileMetaData:
    """The footer of a Parquet file. Raises OSError (`NotReadable`) or pa.ArrowException."""
    with open_table(path) as table:
        return table.metadata


def read_small(path: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """A whole file that is a small table, one group of rows at the most. Raises OSError (`NotReadable`) or pa.ArrowException."""
    with open_table(path) as table:
        if table.metadata.num_rows > GROUP_ROWS:
            raise NotReadable(f"has {table.metadata.num_rows} rows; at most {GROUP_ROWS} are read")
        groups = [*table.groups(columns)]
        return pa.concat_tables(groups) if groups else table.empty(columns)


class Table:
    """An open Parquet file: its footer, and its row groups, each looked at before it is read."""

    def __init__(self, file: pq.ParquetFile, data: BinaryIO) -> None:
        self._file = file
        self._data = data
        self.metadata: pq.FileMetaData = file.metadata
        self.schema: pa.Schema = file.schema_arrow
        self._looked_at: set[tuple[int, int]] = set()

    @property
    def num_row_groups(self) -> int:
        return int(self.metadata.num_row_groups)

    def empty(self, columns: Sequence[str] | None = None) -> pa.Table:
        """No rows, with these columns."""
        table = self.schema.empty_table()
        return table if columns is None else table.select(list(columns))

    def groups(self, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
        """All rows, a row group at a time."""
        return (self.group(index, columns) for index in range(self.num_row_groups))

    def group(self, index: int, columns: Sequence[str] | None = None) -> pa.Table:
        """The rows of one group. Raises `NotReadable` where it is larger than one that a recorder writes."""
        self._expect_sound(index, columns)
        return self._file.read_row_group(index, columns=None if columns is None else list(columns))

    def batches(self, rows: int, columns: Sequence[str] | None = None) -> Iterator[pa.RecordBatch]:
        """All rows, some at a time. Raises as `group` does."""
        for index in range(self.num_row_groups):  # over all of them at once it reads ahead
            self._expect_sound(index, columns)
            yield from self._file.iter_batches(rows, [index], None if columns is None else list(columns), use_threads=False)

    def _expect_sound(self, index: int, columns: Sequence[str] | None) -> None:
        group = self.metadata.row_group(index)
        unpacked = 0
        for place in range(group.num_columns):
            column = group.column(place)
            if columns is not None and column.path_in_schema.partition(".")[0] not in columns:
                continue
            if column.num_values > GROUP_ROWS or column.num_values != group.num_rows:
                raise NotReadable(f"row group {index}: {column.path_in_schema} has {column.num_values} values")
            unpacked += max(column.total_uncompressed_size, _unpacked(self._data, column))
            if unpacked > GROUP_BYTES:
                raise NotReadable(f"row group {index} has more than {GROUP_BYTES // MIB} MiB")
            self._expect_short_texts(index, column)

    def _expect_short_texts(self, index: int, column: pq.ColumnChunkMetaData) -> None:
        """A dictionary has each text once, however often it stands: written out, the texts may be far longer."""
        kind = self.schema.field(column.path_in_schema).type if column.path_in_schema in self.schema.names else None
        if kind is None or not any(fits(kind) for fits in TEXTS):
            return
        if column.total_uncompressed_size * column.num_values <= GROUP_BYTES or not column.has_dictionary_page:
            return
        longest = _longest_text(self._data, column)
        if longest * column.num_values <= GROUP_BYTES:
            return
        written = sum(_written_out(batch.column(0)) for batch in self._as_dictionary(index, column.path_in_schema))
        if written > GROUP_BYTES:
            raise NotReadable(f"row group {index}: {column.path_in_schema} has more than {GROUP_BYTES // MIB} MiB of text")

    def _as_dictionary(self, index: int, name: str) -> Iterator[pa.RecordBatch]:
        with _own(self._data) as own, pq.ParquetFile(own, read_dictionary=[name]) as file:
            yield from file.iter_batches(GROUP_ROWS, [index], [name], use_threads=False)


def _own(data: BinaryIO) -> BinaryIO:
    """The same file once more, to be closed apart."""
    return os.fdopen(os.dup(data.fileno()), "rb")


def _written_out(column: pa.Array) -> int:
    if not pa.types.is_dictionary(column.type):
        return int(column.nbytes)
    lengths = pc.binary_length(column.dictionary)
    return int(pc.sum(lengths.take(column.indices).cast(pa.int64())).as_py() or 0)


# -- the footer -------------------------------------------------------------------------------------------------------------


def _expect_footer(data: BinaryIO) -> None:
    size = data.seek(0, 2)
    if size < TAIL.size + len(MAGIC):
        raise NotReadable("is no Parquet file: it is too short")
    data.seek(size - TAIL.size)
    length, magic = TAIL.unpack(data.read(TAIL.size))
    if magic != MAGIC:
        raise NotReadable("is no Parquet file: it does not end as one")
    if length > FOOTER_BYTES:
        raise NotReadable(f"has a footer of {length} bytes; at most {FOOTER_BYTES} are read")


def _expect_plausible(metadata: pq.FileMetaData, size: int) -> None:
    if metadata.num_columns > COLUMNS:
        raise NotReadable(f"has {metadata.num_columns} columns; at most {COLUMNS} are read")
    if not 0 <= metadata.num_rows <= max(FREE_ROWS, size * ROWS_A_BYTE):
        raise NotReadable(f"declares {metadata.num_rows} rows in {size} bytes")
    groups = [metadata.row_group(index) for index in range(metadata.num_row_groups)]
    most = max((group.num_rows for group in groups), default=0)
    if most > GROUP_ROWS:
        raise NotReadable(f"has a row group of {most} rows; at most {GROUP_ROWS} are read")
    if sum(group.num_rows for group in groups) != metadata.num_rows or any(group.num_rows < 0 for group in groups):
        raise NotReadable(f"declares {metadata.num_rows} rows, and its row groups have others")


# -- pages: their heads are Thrift's compact protocol, as Parquet's format says (parquet.thrift, PageHeader) -----------------

HEAD_BYTES: Final = 16 << 10
UNPACKED, PACKED, DICTIONARY = 2, 3, 7  # fields of a page's head
SIGN: Final = 1
DEPTH: Final = 8


def _unpacked(data: BinaryIO, column: pq.ColumnChunkMetaData) -> int:
    """What the pages of a column say that they take, unpacked. Raises `NotReadable`."""
    return sum(unpacked for _, _, unpacked, _ in _pages(data, column))


def _pages(data: BinaryIO, column: pq.ColumnChunkMetaData) -> Iterator[tuple[int, int, int, bool]]:
    """Each page of a column: where its contents begin, their bytes packed and unpacked, whether it is the dictionary."""
    if not column.total_compressed_size:
        return
    starts = (column.data_page_offset, column.dictionary_page_offset if column.has_dictionary_page else None)
    at = min((start for start in starts if start), default=0)
    end = at + column.total_compressed_size
    if not len(MAGIC) <= at <= end <= data.seek(0, 2):
        raise NotReadable(f"{column.path_in_schema} lies outside the file")
    for _ in range(PAGES):
        if at >= end:
            return
        data.seek(at)
        fields, length = _head(data.read(min(HEAD_BYTES, end - at)))
        packed, unpacked = fields.get(PACKED, -1), fields.get(UNPACKED, -1)
        if packed < 0 or unpacked < 0:
            raise NotReadable(f"{column.path_in_schema} has a page without a length")
        yield at + length, packed, unpacked, DICTIONARY in fields
        at += length + packed
    raise NotReadable(f"{column.path_in_schema} has more than {PAGES} pages")


def _longest_text(data: BinaryIO, column: pq.ColumnChunkMetaData) -> int:
    """No text of the column is longer: the dictionary's, and all of the pages that have texts themselves."""
    return max((unpacked for _, _, unpacked, _ in _pages(data, column)), default=0)


def _head(data: bytes) -> tuple[dict[int, int], int]:
    """The numbers among the fields of a page's head (1 for a field that is none), and its length in bytes."""
    try:
        reader = _Compact(data)
        return reader.fields(), reader.at
    except (IndexError, ValueError):
        raise NotReadable("has a page whose head cannot be read") from None


class _Compact:
    """So much of Thrift's compact protocol as leads through a page's head. Raises IndexError or ValueError."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.at = 0

    def fields(self, depth: int = 0) -> dict[int, int]:
        if depth > DEPTH:
            raise ValueError("nested too deeply")
        found: dict[int, int] = {}
        number = 0
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._signed()
            found[number] = self._value(head & 0xF, depth)
        return found

    def _value(self, kind: int, depth: int) -> int:
        if kind in (1, 2):  # a flag, in its kind
            return kind
        if kind in (4, 5, 6):
            return self._signed()
        if kind == 12:
            self.fields(depth + 1)
        elif kind in (9, 10):
            self._list(depth)
        else:
            length = {3: 1, 7: 8}.get(kind) or self._length(kind)
            self.at += length
        return 1

    def _list(self, depth: int) -> None:
        head = self._byte()
        for _ in range(head >> 4 if head >> 4 < 15 else self._varint()):
            self._value(head & 0xF, depth + 1)

    def _length(self, kind: int) -> int:
        if kind != 8:
            raise ValueError(f"a value of kind {kind}")
        return self._varint()

    def _byte(self) -> int:
        self.at += 1
        return self._data[self.at - 1]

    def _varint(self) -> int:
        value = shift = 0
        while True:
            one = self._byte()
            value |= (one & 0x7F) << shift
            shift += 7
            if not one & 0x80:
                return value
            if shift > 63:
                raise ValueError("too large a number")

    def _signed(self) -> int:
        value = self._varint()
        return (value >> SIGN) ^ -(value & SIGN)
