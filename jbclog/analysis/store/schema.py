"""The tables of a store: columns, types, units.

Each table but `runs` begins with the run, the publication that wrote the row, and the number of the
row in the run's table. All end with line and month, by which they are partitioned. A row counts
only if `runs` names its publication: as `record` for the tables of `RECORD`, as `findings` for
those of `FINDINGS`.

Changes only add columns: a new one is nullable, and null in rows of older releases. `SCHEMA`
increases only if an older jbclog would misread the store.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

import pyarrow as pa

from jbclog.analysis.run_alarms import ARROW_TYPES
from jbclog.analysis.run_alarms import TABLE as ALARMS
from jbclog.analysis.stored_tables import JOINTS_SCHEMA, METRICS
from jbclog.core.rows import TABLES as OF_A_RUN
from jbclog.record.schema import FLOAT, INT, SCHEMAS, TEXT, TIME

SCHEMA: Final = 1
PROPERTY: Final = "jbclog.schema"
RUNS: Final = "runs"
RECORD: Final = OF_A_RUN
"""Tables of a sealed run, which never change."""
FINDINGS: Final = ("joints", "metrics", "units", "alarms")
"""Tables that are computed, or that annotations change."""
DATA: Final = RECORD + FINDINGS
PARTITIONS: Final = ("line", "month")

_UNITS: Final = {"seconds": "s", "_s": "s", "_c": "°C", "coverage": "%"}
_UNIT_AT_END: Final = re.compile(r"(?:^seconds|^coverage|_s|_c)$")

FILE: Final = pa.struct([pa.field("path", TEXT), pa.field("data", pa.binary())])
RUN_COLUMNS: Final[Sequence[tuple[str, pa.DataType, str]]] = (
    ("run!", TEXT, ""),
    ("version!", INT, "count"),
    ("record!", TEXT, ""),
    ("findings!", TEXT, ""),
    ("published!", TIME, "UTC"),
    ("publisher!", TEXT, ""),
    ("started", TIME, "UTC"),
    ("ended", TIME, "UTC"),
    ("verdict", TEXT, ""),
    ("exit_status", TEXT, ""),
    ("exit_code", INT, "code"),
    ("operator", TEXT, ""),
    ("order", TEXT, ""),
    ("product", TEXT, ""),
    ("stations", pa.list_(TEXT), ""),
    ("recipes", pa.list_(TEXT), ""),
    ("units", pa.list_(TEXT), ""),
    ("wire_lots", pa.list_(TEXT), ""),
    ("flux_lots", pa.list_(TEXT), ""),
    ("tips", pa.list_(TEXT), ""),
    ("tags", pa.map_(TEXT, TEXT), ""),
    ("periods", pa.map_(TEXT, FLOAT), "s"),
    ("lost", TEXT, ""),
    ("manifest_sha256!", TEXT, ""),
    ("annotations", pa.list_(TEXT), ""),
    ("rules!", INT, "count"),
    ("jbclog!", TEXT, ""),
    *((f"{table}_rows", INT, "count") for table in DATA),
    ("files", pa.list_(FILE), ""),
)


def _field(name: str, kind: pa.DataType, unit: str = "") -> pa.Field:
    metadata = {"unit": unit} if unit else None
    return pa.field(
        name.removesuffix("!"), kind, nullable=not name.endswith("!"), metadata=metadata
    )


def _computed(kinds: Mapping[str, str]) -> list[pa.Field]:
    return [
        _field(name, ARROW_TYPES[kind], "UTC" if kind == "time" else _unit_of(name))
        for name, kind in kinds.items()
    ]


def _unit_of(name: str) -> str:
    found = _UNIT_AT_END.search(name)
    return _UNITS[found[0]] if found else ""


OWN: Final[Mapping[str, pa.Schema]] = MappingProxyType(
    {
        **SCHEMAS,
        "joints": JOINTS_SCHEMA,
        "metrics": pa.schema(_computed(METRICS)),
        "units": pa.schema(_computed({"unit": "str", "begin": "time", "end": "time"})),
        "alarms": pa.schema(_computed(ALARMS)),
    }
)
"""Columns of each table but `runs`, as in a run's folder."""

_BEFORE: Final = [_field("run!", TEXT), _field("publication!", TEXT), _field("row!", INT, "count")]
_AFTER: Final = [_field(name, TEXT) for name in PARTITIONS]


def schema_of(table: str) -> pa.Schema:
    """Return all columns of a table of a store."""
    if table == RUNS:
        return pa.schema([*(_field(*column) for column in RUN_COLUMNS), *_AFTER])
    return pa.schema([*_BEFORE, *OWN[table], *_AFTER])


TABLES: Final = (*DATA, RUNS)
"""All tables, in the order in which they are written: `runs` is last."""
