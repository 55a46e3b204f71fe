"""The four tables of a run: columns, types, units, and their commands.

Times are UTC microseconds; integers are int64 (narrow ones overflow in squares and sums and take
the same space on disk). A null value was not due, or not answered.

Rows that lack columns that may be null are read with nulls there; rows with other columns are
refused (`parts.py`, `batches.py`). docs/how-to/change.md explains how to add a column.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

import pyarrow as pa

from jbclog.core.rows import SCHEMA_VERSION, TABLES

TIME: Final = pa.timestamp("us", tz="UTC")
INT: Final = pa.int64()
FLOAT: Final = pa.float64()
FLAG: Final = pa.bool_()
TEXT: Final = pa.utf8()

Column = tuple[str, pa.DataType, str, str]
"""Name (never null with a final ``!``), type, unit, command(s) of the manuals."""

SAMPLES: Final[Sequence[Column]] = (
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
    ("set_c", INT, "°C", "R-STx"),
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
    ("limit", FLOAT, "", ""),
    ("raw", TEXT, "", ""),
    ("prev_sha256!", TEXT, "", ""),
)
SETTINGS: Final[Sequence[Column]] = (
    ("time!", TIME, "UTC", ""),
    ("station!", TEXT, "", ""),
    ("port", INT, "", ""),
    ("tool", TEXT, "", ""),
    ("setting!", TEXT, "", ""),
    ("unit!", TEXT, "", ""),
    ("requested", TEXT, "", ""),
    ("written", TEXT, "", ""),
    ("readback", TEXT, "", ""),
    ("nak", INT, "code", ""),
    ("outcome!", TEXT, "", ""),
)
COUNTERS: Final[Sequence[Column]] = (
    ("time!", TIME, "UTC", ""),
    ("station!", TEXT, "", ""),
    ("port", INT, "", ""),
    ("counter!", TEXT, "", ""),
    ("value", FLOAT, "", ""),
    ("unit!", TEXT, "", ""),
    ("raw!", TEXT, "", ""),
)

_PANDAS = {
    TIME: ("datetimetz", "datetime64[us, UTC]"),
    INT: ("Int64", "Int64"),
    FLAG: ("boolean", "boolean"),
}


def field_of(column: Column, of_text: str = "command") -> pa.Field:
    """Return the column as a field; its metadata have the unit and, as `of_text`, the last text."""
    name, kind, unit, last = column
    metadata = {key: text for key, text in (("unit", unit), (of_text, last)) if text}
    return pa.field(
        name.removesuffix("!"), kind, nullable=not name.endswith("!"), metadata=metadata or None
    )


def _pandas_hint(fields: Sequence[pa.Field]) -> str:
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
        fields, metadata={"jbclog.schema": str(SCHEMA_VERSION), "pandas": _pandas_hint(fields)}
    )


SCHEMAS: Final[Mapping[str, pa.Schema]] = MappingProxyType(
    dict(zip(TABLES, map(_schema, (SAMPLES, EVENTS, SETTINGS, COUNTERS)), strict=True))
)


def lacking_in(table: str, names: Sequence[str]) -> list[str]:
    """Return the columns that rows with the columns `names` lack, if these are all that differs and
    may be null; else none. Events lack none, because their chain is over all columns.
    """
    schema = SCHEMAS[table]
    lacking = [name for name in schema.names if name not in names]
    known = [name for name in schema.names if name in names]
    if table == "events" or [*names] != known:
        return []
    return lacking if all(schema.field(name).nullable for name in lacking) else []


def with_columns(rows: pa.Table, table: str, lacking: Sequence[str]) -> pa.Table:
    """Return rows with the columns that they lack added, null, in schema order."""
    schema = SCHEMAS[table]
    for name in lacking:
        field = schema.field(name)
        rows = rows.append_column(field, pa.nulls(rows.num_rows, field.type))
    rows = rows.select([name for name in schema.names if name in rows.column_names])
    return rows.replace_schema_metadata(schema.metadata)
