"""Batches: rows as Arrow record batches in bytes, each with a number and a checksum over both.

A commit stores one batch for each table: four bytes with its uncompressed length, then an Arrow IPC
stream compressed by zstd as a whole (compressing each of its hundred buffers separately would take
five times as long to read). It is readable without the rest of the store.
"""

from __future__ import annotations

import struct
import sys
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import pyarrow as pa

from jbclog.record.schema import INT, SCHEMAS, lacking_in, with_columns

BARE: Final = {
    table: pa.schema([pa.field(f.name, f.type, f.nullable) for f in schema])
    for table, schema in SCHEMAS.items()
}
# stored at most: more rows, which wait while the disk hangs, become several batches
ROWS_A_BATCH: Final = 32_768
# accepted when reading: an earlier recorder of 256 ports at 10 Hz had so many after 100 s of
# waiting
MOST_ROWS: Final = 262_144
MOST_BYTES: Final = 64 << 20  # uncompressed; stored and read
MOST_PACKED: Final = MOST_BYTES + (1 << 16)
SCHEMA_HEAD, ROWS_HEAD = 1, 3  # kinds of a message
_U16, _U32 = struct.Struct("<H"), struct.Struct("<I")
_CODEC: Final = pa.Codec("zstd", compression_level=1)

COLUMNS_A_BREATH: Final = 10
MANY_ROWS: Final = 500


class _Column(NamedTuple):
    """A field's properties that conversion needs."""

    name: str
    list_type: pa.ListType
    whole: bool
    nullable: bool


_COLUMNS: Final = {
    table: [_Column(f.name, pa.list_(f.type), f.type == INT, f.nullable) for f in schema]
    for table, schema in BARE.items()
}
_WHOLE: Final = (INT, pa.null())


class Damaged(Exception):
    """A stored batch has changed."""


class NotRows(Exception):
    """Rows do not fit their table's schema: a bug."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Rows of one table as stored. `number` counts the run's batches over all tables, from 1."""

    number: int
    table: str
    rows: int
    data: bytes

    @property
    def crc(self) -> int:
        return zlib.crc32(self.data, zlib.crc32(f"{self.number} {self.table} {self.rows}".encode()))


def breathe() -> None:
    """Let other threads run: conversions hold the GIL, and a due tick must not wait."""
    time.sleep(0.0001)


def encode(
    number: int, table: str, values: Sequence[object], breath: Callable[[], None] = breathe
) -> Batch:
    """Encode `values`, rows end to end in the columns' order. Raises NotRows, also for rows that
    `decode` would reject.
    """
    columns = _COLUMNS[table]
    width = len(columns)
    rows = len(values) // width
    arrays = []
    for place, column in enumerate(columns):
        arrays.append(_array(values[place::width], column))
        if rows > MANY_ROWS and place % COLUMNS_A_BREATH == COLUMNS_A_BREATH - 1:
            breath()
    return Batch(
        number, table, rows, _bytes(pa.RecordBatch.from_arrays(arrays, schema=BARE[table]))
    )


def _array(values: Sequence[object], column: _Column) -> pa.Array:
    try:
        # a fraction would be truncated silently
        if column.whole and pa.infer_type(values) not in _WHOLE:
            raise NotRows(f"{column.name}: not whole numbers")
        array = pa.scalar(values, column.list_type).values
    except MemoryError:  # Arrow's errors include it, but the rows do not cause it
        raise
    except (pa.ArrowException, ValueError, TypeError, OverflowError) as error:
        raise NotRows(f"{column.name}: {error}") from error
    if not column.nullable and array.null_count:
        raise NotRows(f"{column.name} has no value")
    return array


def _bytes(batch: pa.RecordBatch) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        writer.write_batch(batch)
    stream = sink.getvalue()
    if stream.size > MOST_BYTES:
        raise NotRows(
            f"{batch.num_rows} rows take {stream.size} bytes; a batch has at most {MOST_BYTES}"
        )
    return struct.pack("<I", stream.size) + bytes(_CODEC.compress(stream, asbytes=True))


def decode(batch: Batch, crc: int) -> pa.Table:
    """Decode a stored batch into its table's schema. Raises Damaged."""
    if crc != batch.crc:
        raise Damaged("its check sum does not match")
    schema = SCHEMAS.get(batch.table)
    if schema is None:
        raise Damaged(f"no table is called {batch.table!r}")
    if not 0 <= batch.rows <= MOST_ROWS:
        raise Damaged(f"too many rows; a recorder's batches have at most {MOST_ROWS}")
    if len(batch.data) > MOST_PACKED:
        raise Damaged(
            f"it has {len(batch.data)} bytes; a recorder's batches have at most {MOST_PACKED}"
        )
    try:
        size = struct.unpack_from("<I", batch.data)[0]
        if size > MOST_BYTES:
            raise Damaged(
                f"it has {size} bytes, unpacked; a recorder's batches have at most {MOST_BYTES}"
            )
        stream = _CODEC.decompress(batch.data[4:], decompressed_size=size)
        _expect_plain(stream)
        table = pa.ipc.open_stream(stream).read_all()
        if table.num_rows != batch.rows:
            raise Damaged(f"it has {table.num_rows} rows, not {batch.rows}")
        lacking = lacking_in(batch.table, table.column_names)
        if lacking:
            table = with_columns(table, batch.table, lacking)
        table = (
            pa.Table.from_arrays(table.columns, schema=schema)
            if table.schema == BARE[batch.table]
            else table.cast(schema)
        )
        _expect_whole(table)
        return table
    except (pa.ArrowException, OSError, ValueError, IndexError, struct.error) as error:
        raise Damaged(str(error)) from error


def _expect_whole(table: pa.Table) -> None:
    """Raise Damaged for missing values that no part may hold."""
    for field, column in zip(table.schema, table.columns, strict=True):
        if column.null_count and not field.nullable:
            raise Damaged(f"{field.name} has no value in {column.null_count} rows")


def _expect_plain(stream: pa.Buffer) -> None:
    """Raise Damaged if a message is compressed again, or neither schema nor rows: it could expand
    without limit.

    A message's head is a FlatBuffers table (Arrow's Message.fbs): its second field is the kind of
    the content, its third the content; compressed rows have a fourth field.
    """
    for message in pa.ipc.MessageReader.open_stream(stream):
        head = message.metadata.to_pybytes()
        root = _U32.unpack_from(head)[0]
        kind, rows = _field(head, root, 1), _field(head, root, 2)
        if kind is None or rows is None or head[kind] not in (SCHEMA_HEAD, ROWS_HEAD):
            raise Damaged("it holds what no recorder writes")
        if (
            head[kind] == ROWS_HEAD
            and _field(head, rows + _U32.unpack_from(head, rows)[0], 3) is not None
        ):
            raise Damaged("its rows are packed twice")


def _field(head: bytes, table: int, number: int) -> int | None:
    """Return the offset of a field in a FlatBuffers table; None if it is absent."""
    kinds = table - struct.unpack_from("<i", head, table)[0]
    length = _U16.unpack_from(head, kinds)[0]
    place = kinds + 4 + 2 * number
    offset = _U16.unpack_from(head, place)[0] if 4 + 2 * number < length else 0
    return table + offset if offset else None


def prepare_arrow() -> None:
    """Make Arrow allocate from the system, which gets freed memory back (Arrow's pool keeps 4 MB),
    and keep pandas out.
    """
    pa.set_memory_pool(pa.system_memory_pool())
    keep_pandas_out()


def keep_pandas_out() -> None:
    """Keep pyarrow from importing pandas at its first conversion: half a second and 50 MB that a
    recorder does not need.

    Later imports of pandas in the same process work.
    """
    if "pandas" not in sys.modules:
        sys.meta_path.insert(0, _NoPandas)
        try:
            pa.array([0])
        finally:
            sys.meta_path.remove(_NoPandas)


class _NoPandas:
    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        if name == "pandas":
            raise ImportError("not in the recorder's process")
