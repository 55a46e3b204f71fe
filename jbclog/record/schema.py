"""The tables of a run: columns, types, units, and their commands.

Times are UTC microseconds; integers are int64 (narrow ones overflow in squares and sums and take
the same space on disk). A null value was not due, or not answered.

Rows that lack columns that may be null are read with nulls there; rows with other columns are
refused (`parts.py`, `batches.py`). docs/how-to/change.md explains how to add a column.
"""

from __future__ import annotations

import json
from array import array
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

import pyarrow as pa

from jbclog.core.rows import SCHEMA_VERSION, TABLES
from jbclog.record.old_names import OLD_COLUMNS

TIME: Final = pa.timestamp("us", tz="UTC")
INT: Final = pa.int64()
FLOAT: Final = pa.float64()
FLAG: Final = pa.bool_()
TEXT: Final = pa.utf8()
BYTES: Final = pa.binary()

RUN: Final = "run"
"""Name of the run: a constant column, added when rows are read from the journal."""
SEQ: Final = "seq"
"""Number of a row within its table, from 0, in the order in which rows were handed to the record;
null in schema 1. A row that was numbered and lost leaves a hole.
"""

Column = tuple[str, pa.DataType, str, str]
"""Name (never null with a final ``!``), type, unit, command(s) of the manuals."""

SAMPLES: Final[Sequence[Column]] = (
    ("run!", TEXT, "", ""),
    ("seq", INT, "count", ""),
    ("time!", TIME, "UTC", ""),
    ("tick!", INT, "count", ""),
    ("station!", TEXT, "", ""),
    ("port!", INT, "", ""),
    ("late_us", INT, "µs", ""),
    ("scan_us", INT, "µs", ""),
    ("quality!", TEXT, "", ""),
    ("reasons", TEXT, "", ""),
    ("temperature_c", INT, "°C", "R-TTx R-ATx"),
    ("power_permille", INT, "‰", "R-PPx"),
    ("status", TEXT, "", "R-PSx"),
    ("cooling", FLAG, "", "R-PSx"),
    ("desoldering", FLAG, "", "R-PSx"),
    ("motor", TEXT, "", "R-PSx"),
    ("setpoint_c", INT, "°C", "R-STx"),
    ("tool", INT, "code", "R-CTx"),
    ("port_error", INT, "code", "R-PEx"),
    ("station_error", INT, "code", "R-SER"),
    ("alarm_high", FLAG, "", "R-TAx"),
    ("alarm_low", FLAG, "", "R-TAx"),
    ("transformer_c", INT, "°C", "R-TT"),
    ("transistor_c", INT, "°C", "R-QTx"),
    ("delay_s", INT, "s", "R-EDx"),
    ("external_c", INT, "°C", "R-ETx"),
    ("set_flow_permille", INT, "‰", "R-SFx"),
    ("feeding", FLAG, "", "R-FEE"),
    ("solder_shortage", FLAG, "", "A"),
    ("clogged", FLAG, "", "A"),
    ("preparing", FLAG, "", "B"),
    ("in_range", FLAG, "", "F"),
)
EVENTS: Final[Sequence[Column]] = (
    ("run!", TEXT, "", ""),
    ("seq!", INT, "count", ""),
    ("time!", TIME, "UTC", ""),
    ("earliest", TIME, "UTC", ""),
    ("station", TEXT, "", ""),
    ("port", INT, "", ""),
    ("kind!", TEXT, "", ""),
    ("severity!", TEXT, "", ""),
    ("code", INT, "code", ""),
    ("text!", TEXT, "", ""),
    ("value", FLOAT, "", ""),
    ("limit_value", FLOAT, "", ""),
    ("raw", TEXT, "", ""),
    ("prev_sha256!", TEXT, "", ""),
)
SETTINGS: Final[Sequence[Column]] = (
    ("run!", TEXT, "", ""),
    ("seq", INT, "count", ""),
    ("time!", TIME, "UTC", ""),
    ("station!", TEXT, "", ""),
    ("port", INT, "", ""),
    ("tool_name", TEXT, "", ""),
    ("setting!", TEXT, "", ""),
    ("uom!", TEXT, "", ""),
    ("requested", TEXT, "", ""),
    ("written", TEXT, "", ""),
    ("readback", TEXT, "", ""),
    ("nak", INT, "code", ""),
    ("outcome!", TEXT, "", ""),
)
COUNTERS: Final[Sequence[Column]] = (
    ("run!", TEXT, "", ""),
    ("seq", INT, "count", ""),
    ("time!", TIME, "UTC", ""),
    ("station!", TEXT, "", ""),
    ("port", INT, "", ""),
    ("counter!", TEXT, "", ""),
    ("value", FLOAT, "", ""),
    ("uom!", TEXT, "", ""),
    ("raw!", TEXT, "", ""),
)
WIRE: Final[Sequence[Column]] = (
    ("run!", TEXT, "", ""),
    ("seq!", INT, "count", ""),
    ("time!", TIME, "UTC", ""),
    ("at_s!", FLOAT, "s", ""),
    ("station!", TEXT, "", ""),
    ("what!", TEXT, "", ""),
    ("data", BYTES, "", ""),
    ("text", TEXT, "", ""),
    ("request", TEXT, "", ""),
    ("size", INT, "byte", ""),
    ("sent_s", FLOAT, "s", ""),
    ("late_s", FLOAT, "s", ""),
)

_PANDAS = {
    TIME: ("datetimetz", "datetime64[us, UTC]"),
    INT: ("Int64", "Int64"),
    FLAG: ("boolean", "boolean"),
}


def field_of(column: Column, of_text: str = "command") -> pa.Field:
    """Return the column as a field; its metadata have the unit and, as `of_text`, the last text."""
    name, kind, unit, last = column
    metadata = {key: text for key, text in (("uom", unit), (of_text, last)) if text}
    return pa.field(
        name.removesuffix("!"), kind, nullable=not name.endswith("!"), metadata=metadata or None
    )


def pandas_hint(fields: Sequence[pa.Field]) -> str:
    """Return the metadata that make pandas use Int64 and boolean, which have missing values,
    instead of float and object.
    """
    columns = [
        {
            "name": field.name,
            "field_name": field.name,
            "pandas_type": _PANDAS[field.type][0],
            "numpy_type": _PANDAS[field.type][1],
            "metadata": {"timezone": "UTC"} if field.type == TIME else None,
        }
        for field in fields
        if field.type == TIME or (field.nullable and field.type in (INT, FLAG))
    ]
    return json.dumps(
        {
            "index_columns": [],
            "column_indexes": [],
            "columns": columns,
            "creator": None,
            "pandas_version": None,
        }
    )


def _schema(columns: Sequence[Column]) -> pa.Schema:
    fields = [field_of(column) for column in columns]
    return pa.schema(
        fields, metadata={"jbclog.schema": str(SCHEMA_VERSION), "pandas": pandas_hint(fields)}
    )


CAPTURE: Final = "wire"
"""The table of the serial capture (`wire_recorder`), which only runs with ``--capture`` have."""

SCHEMAS: Final[Mapping[str, pa.Schema]] = MappingProxyType(
    {
        **dict(zip(TABLES, map(_schema, (SAMPLES, EVENTS, SETTINGS, COUNTERS)), strict=True)),
        CAPTURE: _schema(WIRE),
    }
)


def renamed(schema: pa.Schema, table: str) -> pa.Schema:
    """Return a schema with the names that the columns have now."""
    now = OLD_COLUMNS.get(table, {})
    return pa.schema([one.with_name(now.get(one.name, one.name)) for one in schema])


def named_now(rows: pa.Table, table: str) -> pa.Table:
    """Return rows of schema 1 with the names that columns and signals have now."""
    now = OLD_COLUMNS[table]
    rows = rows.rename_columns([now.get(name, name) for name in rows.column_names])
    for place, name in enumerate(rows.column_names):
        if name == "reasons":
            chunks = [_reasons_now(chunk) for chunk in rows[place].chunks]
            rows = rows.set_column(place, name, pa.chunked_array(chunks, rows[place].type))
    return rows


def _reasons_now(texts: pa.Array) -> pa.Array:
    if pa.types.is_dictionary(texts.type):
        return pa.DictionaryArray.from_arrays(texts.indices, _reasons_now(texts.dictionary))
    import pyarrow.compute as pc  # a recorder does without

    for signal, now in OLD_COLUMNS["samples"].items():
        texts = pc.replace_substring_regex(texts, f"(^|;){signal}=", f"\\1{now}=")
    return texts


def lacking_in(table: str, names: Sequence[str]) -> list[str]:
    """Return the columns that rows with the columns `names` lack, if these are all that differs and
    can be filled: `run`, and those that may be null. Else none. Events lack nothing but `run`,
    because their chain is over all other columns.
    """
    schema = SCHEMAS[table]
    lacking = [name for name in schema.names if name not in names]
    known = [name for name in schema.names if name in names]
    if [*names] != known or (table == "events" and lacking != [RUN]):
        return []
    can_be_filled = all(name == RUN or schema.field(name).nullable for name in lacking)
    return lacking if can_be_filled else []


def with_columns(rows: pa.Table, table: str, lacking: Sequence[str], run: str) -> pa.Table:
    """Return rows with the columns that they lack added, in schema order: null, or the name of the
    run.
    """
    schema = SCHEMAS[table]
    for name in lacking:
        field = schema.field(name)
        column = constant(run, rows.num_rows) if name == RUN else pa.nulls(len(rows), field.type)
        rows = rows.append_column(field, column)
    rows = rows.select([name for name in schema.names if name in rows.column_names])
    return rows.replace_schema_metadata(schema.metadata)


# These two are made from their bytes: a conversion of Python's values would import pandas.


def constant(text: str, rows: int) -> pa.Array:
    """Return a text `rows` times."""
    data = text.encode(errors="replace")
    ends = array("i", [len(data) * row for row in range(rows + 1)])
    return pa.Array.from_buffers(TEXT, rows, [None, pa.py_buffer(ends), pa.py_buffer(data * rows)])


def numbers_from(first: int, rows: int) -> pa.Array:
    """Return `rows` numbers in sequence."""
    numbers = array("q", range(first, first + rows))
    return pa.Array.from_buffers(INT, rows, [None, pa.py_buffer(numbers)])
