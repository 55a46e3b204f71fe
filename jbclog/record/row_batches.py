"""Rows of a table as frames of the journal: Arrow record batches, and the schemas that they need.

A frame of rows is a record batch message without its schema, which stands once in a segment; the
schema's metadata name the table. Columns that follow from the frame are not in it: `run`, and `seq`
except of events, whose chain is over it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final, NamedTuple

import pyarrow as pa

from jbclog.record.frames import Frame, FrameKind, TooLarge
from jbclog.record.schema import (
    INT,
    RUN,
    SCHEMAS,
    SEQ,
    constant,
    lacking_in,
    numbers_from,
    with_columns,
)

NUMBERED: Final = "events"
"""The table whose rows come with their numbers."""
BARE: Final = {
    table: pa.schema(
        [
            pa.field(f.name, f.type, f.nullable)
            for f in schema
            if f.name not in (RUN, SEQ) or (f.name == SEQ and table == NUMBERED)
        ],
        metadata={"table": table},
    )
    for table, schema in SCHEMAS.items()
}
"""Schemas of the tables as a segment has them."""
ROWS_A_FRAME: Final = 32_768
"""At most: more rows, which wait while the disk hangs, become several frames."""

COLUMNS_A_BREATH: Final = 10
MANY_ROWS: Final = 500
ROWS_AT_ONCE: Final = 65_536


class _Column(NamedTuple):
    """A field's properties that conversion needs."""

    name: str
    list_type: pa.ListType
    is_whole: bool
    nullable: bool


_COLUMNS: Final = {
    table: [_Column(f.name, pa.list_(f.type), f.type == INT, f.nullable) for f in schema]
    for table, schema in BARE.items()
}
_WHOLE: Final = (INT, pa.null())


class Damaged(Exception):
    """A whole frame holds what this jbclog's recorder does not write."""


class NotRows(Exception):
    """Rows do not fit their table's schema: a bug."""


def breathe() -> None:
    """Let other threads run: conversions hold the GIL, and a due tick must not wait."""
    time.sleep(0.0001)


def encode(
    table: str,
    values: Sequence[object],
    first: int,
    number: int = 0,
    breath: Callable[[], None] = breathe,
) -> Frame:
    """Encode `values`, rows end to end in the order of `BARE`, of the table that has `number` in
    its segment. `first` is the first row's `seq`. Raises NotRows.
    """
    columns = _COLUMNS[table]
    width = len(columns)
    rows = len(values) // width
    arrays = []
    for place, column in enumerate(columns):
        arrays.append(_array(values[place::width], column))
        if rows > MANY_ROWS and place % COLUMNS_A_BREATH == COLUMNS_A_BREATH - 1:
            breath()
    batch = pa.RecordBatch.from_arrays(arrays, schema=BARE[table])
    try:
        return Frame.of(FrameKind.ROWS, batch.serialize(), number, first, rows)
    except TooLarge as error:
        raise NotRows(f"{rows} rows take {error}") from error


def _array(values: Sequence[object], column: _Column) -> pa.Array:
    try:
        # a fraction would be truncated silently
        if column.is_whole and pa.infer_type(values) not in _WHOLE:
            raise NotRows(f"{column.name}: not whole numbers")
        array = pa.scalar(values, column.list_type).values
    except MemoryError:  # Arrow's errors include it, but the rows do not cause it
        raise
    except (pa.ArrowException, ValueError, TypeError, OverflowError) as error:
        raise NotRows(f"{column.name}: {error}") from error
    if not column.nullable and array.null_count:
        raise NotRows(f"{column.name} has no value")
    return array


def schema_frame(table: str, number: int) -> Frame:
    """Return the frame that gives a table its number in a segment."""
    return Frame.of(FrameKind.SCHEMA, BARE[table].serialize(), number)


def schema_of(frame: Frame) -> pa.Schema:
    """Return the schema that a frame holds; `table_of` names its table. Raises `Damaged`."""
    try:
        schema = pa.ipc.read_schema(pa.py_buffer(frame.payload()))
    except (pa.ArrowException, OSError, ValueError) as error:
        raise Damaged(str(error)) from error
    if table_of(schema) not in SCHEMAS:
        raise Damaged(f"no table is called {table_of(schema)!r}")
    return schema


def table_of(schema: pa.Schema) -> str:
    """Return the name of the table whose rows have a segment's schema."""
    metadata = schema.metadata or {}
    return bytes(metadata.get(b"table", b"")).decode(errors="replace")


def decode(frame: Frame, schema: pa.Schema, run: str) -> pa.Table:
    """Return the rows of a frame in its table's schema; `schema` is the segment's of that table.

    Columns that an older recorder did not have are null. Raises `Damaged`.
    """
    table = table_of(schema)
    try:
        batch = pa.ipc.read_record_batch(pa.py_buffer(frame.payload()), schema)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise Damaged(str(error)) from error
    if batch.num_rows != frame.rows:
        raise Damaged(f"it has {batch.num_rows} rows, not {frame.rows}")
    full = SCHEMAS[table]
    rows = pa.Table.from_batches([batch])
    if table != NUMBERED:
        numbers = numbers_from(frame.first, frame.rows)
        rows = rows.add_column(0, full.field(SEQ), numbers)
    if schema.equals(BARE[table]):
        columns = [constant(run, frame.rows), *rows.columns]
        return pa.Table.from_arrays(columns, schema=full)
    lacking = lacking_in(table, rows.column_names)
    try:
        return with_columns(rows, table, lacking, run).cast(full)
    except (pa.ArrowException, ValueError) as error:
        raise Damaged(str(error)) from error


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


def joined(pieces: Iterable[pa.Table]) -> Iterator[pa.Table]:
    """Yield small tables joined to some of at least `ROWS_AT_ONCE` rows."""
    waiting: list[pa.Table] = []
    rows = 0
    for piece in pieces:
        waiting.append(piece)
        rows += piece.num_rows
        if rows >= ROWS_AT_ONCE:
            yield pa.concat_tables(waiting).combine_chunks()
            waiting = []
            rows = 0
    if rows:
        yield pa.concat_tables(waiting).combine_chunks()
