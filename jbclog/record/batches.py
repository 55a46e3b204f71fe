"""Rows become batches: Arrow record batches as bytes, each with its number and a check sum over both.

A batch is what one commit stores of one table: four bytes that give its length unpacked, then an Arrow IPC stream,
packed with zstd as a whole (packing each of its hundred buffers by itself costs five times as much to read). It can be
read without anything else of the store.
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

from jbclog.record.schema import INT, SCHEMAS

BARE: Final = {table: pa.schema([pa.field(f.name, f.type, f.nullable) for f in schema]) for table, schema in SCHEMAS.items()}
MOST_ROWS: Final = 1 << 20  # a second of 256 ports at 10 Hz has 2560; rows wait where the disk stands still
MOST_BYTES: Final = 128 << 20
SCHEMA_HEAD, ROWS_HEAD = 1, 3  # kinds of a message
_U16, _U32 = struct.Struct("<H"), struct.Struct("<I")
_CODEC: Final = pa.Codec("zstd", compression_level=1)

COLUMNS_A_BREATH: Final = 10
MANY_ROWS: Final = 500


class _Column(NamedTuple):
    """What a conversion needs of a field, looked up once."""

    name: str
    list_type: pa.ListType
    whole: bool
    nullable: bool


_COLUMNS: Final = {
    table: [_Column(f.name, pa.list_(f.type), f.type == INT, f.nullable) for f in schema] for table, schema in BARE.items()
}
_WHOLE: Final = (INT, pa.null())


class Damaged(Exception):
    """A stored batch that is not what was stored."""


class NotRows(Exception):
    """Rows that do not fit their table's schema: a mistake of whoever made them."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Some rows of one table as they are stored. `number` counts the batches of a run, all tables together, from 1."""

    number: int
    table: str
    rows: int
    data: bytes

    @property
    def crc(self) -> int:
        return zlib.crc32(self.data, zlib.crc32(f"{self.number} {self.table} {self.rows}".encode()))


def breathe() -> None:
    """Let other threads run: conversions hold the interpreter's lock, and a due tick must not wait for all of them."""
    time.sleep(0.0001)


def encode(number: int, table: str, values: Sequence[object], breath: Callable[[], None] = breathe) -> Batch:
    """The batch of `values`: rows laid end to end, in the columns' order. Raises `NotRows`."""
    columns = _COLUMNS[table]
    width = len(columns)
    rows = len(values) // width
    arrays = []
    for place, column in enumerate(columns):
        arrays.append(_array(values[place::width], column))
        if rows > MANY_ROWS and place % COLUMNS_A_BREATH == COLUMNS_A_BREATH - 1:
            breath()
    return Batch(number, table, rows, _bytes(pa.RecordBatch.from_arrays(arrays, schema=BARE[table])))


def _array(values: Sequence[object], column: _Column) -> pa.Array:
    try:
        if column.whole and pa.infer_type(values) not in _WHOLE:  # a fraction would be cut off without a word
            raise NotRows(f"{column.name}: not whole numbers")
        array = pa.scalar(values, column.list_type).values
    except MemoryError:  # one of Arrow's errors is one: no fault of the rows
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
    return struct.pack("<I", stream.size) + bytes(_CODEC.compress(stream, asbytes=True))


def decode(batch: Batch, crc: int) -> pa.Table:
    """The rows of a stored batch, in its table's schema. Raises `Damaged`."""
    if crc != batch.crc:
        raise Damaged("its check sum does not match")
    schema = SCHEMAS.get(batch.table)
    if schema is None:
        raise Damaged(f"no table is called {batch.table!r}")
    if not 0 <= batch.rows <= MOST_ROWS:
        raise Damaged(f"it has {batch.rows} rows; a recorder's have at most {MOST_ROWS}")
    try:
        size = struct.unpack_from("<I", batch.data)[0]
        if size > MOST_BYTES:
            raise Damaged(f"it has {size} bytes, unpacked; a recorder's have at most {MOST_BYTES}")
        stream = _CODEC.decompress(batch.data[4:], decompressed_size=size)
        _expect_plain(stream)
        table = pa.ipc.open_stream(stream).read_all()
        if table.num_rows != batch.rows:
            raise Damaged(f"it has {table.num_rows} rows, not {batch.rows}")
        return pa.Table.from_arrays(table.columns, schema=schema) if table.schema == BARE[batch.table] else table.cast(schema)
    except (pa.ArrowException, OSError, ValueError, IndexError, struct.error) as error:
        raise Damaged(str(error)) from error


def _expect_plain(stream: pa.Buffer) -> None:
    """Raise `Damaged` where a message of the stream is packed once more, or is no schema and no rows: it could unpack to anything.

    What is looked at is the message's head, a table of FlatBuffers (Arrow's Message.fbs): its second field is the kind of what
    it holds, its third that itself, and rows that are packed have a fourth field.
    """
    for message in pa.ipc.MessageReader.open_stream(stream):
        head = message.metadata.to_pybytes()
        root = _U32.unpack_from(head)[0]
        kind, rows = _field(head, root, 1), _field(head, root, 2)
        if kind is None or rows is None or head[kind] not in (SCHEMA_HEAD, ROWS_HEAD):
            raise Damaged("it holds what no recorder writes")
        if head[kind] == ROWS_HEAD and _field(head, rows + _U32.unpack_from(head, rows)[0], 3) is not None:
            raise Damaged("its rows are packed twice")


def _field(head: bytes, table: int, number: int) -> int | None:
    """Where a field of a table of FlatBuffers lies; None where it has none."""
    kinds = table - struct.unpack_from("<i", head, table)[0]
    length = _U16.unpack_from(head, kinds)[0]
    place = kinds + 4 + 2 * number
    offset = _U16.unpack_from(head, place)[0] if 4 + 2 * number < length else 0
    return table + offset if offset else None


def keep_pandas_out() -> None:
    """Settle pyarrow's question whether there is pandas with no.

    Its first conversion of Python values imports pandas, half a second and 50 MB that a recorder does not need.
    What needs pandas later in the same process still finds it.
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
