"""docs/reference/store-tables.md: the columns of a store's tables, from their schemas."""

from __future__ import annotations

from collections.abc import Mapping

import pyarrow as pa

from jbclog.analysis.store.schema import DATA, RUNS, schema_of
from support.pages.md_table import MADE, code, table

INTRODUCTION = """
Delta Lake tables of a [store](../how-to/plant-store.md), each partitioned by `line` and `month`. A row counts if `runs` names its
`publication` in the newest version of its run. Columns are only ever added; rows of older releases have null in a new one.
"""
TEXTS: Mapping[str, str] = {
    "runs": "A row for each version of a run.",
    "metrics": "`run.metrics()`: a row for each metric of each port.",
    "units": (
        "`run.units()`: a row for each time that a unit was on the bench, and for each unit that"
        " was only named."
    ),
    "alarms": "`run.alarms()`: a row for each episode of each detector.",
}
MEANINGS: Mapping[str, str] = {
    "run": "name of the run",
    "publication": "who wrote the row",
    "row": "number of the row in the run's table, from 0",
    "line": "line; null where the manifest names none",
    "month": "month in which the run started, UTC: `2026-11`",
    "version": "version, from 1; each annotation that is published adds one",
    "record": "publication of its samples, events, settings and counters",
    "findings": "publication of its joints, metrics, units and alarms",
    "published": "when, by the publisher's clock",
    "publisher": "the publisher's host",
    "periods": "sampling period of each station; null: without pause",
    "manifest_sha256": "the run's fingerprint",
    "annotations": "SHA-256 of each annotation, oldest first",
    "rules": "version of the rules of its figures",
    "jbclog": "version of the publisher",
    "files": "manifest, annotations, line file and recipes, byte for byte",
}


def page() -> str:
    """The whole page."""
    sections = [_section(name) for name in (RUNS, *DATA)]
    return f"{MADE}\n\n# Tables of a store\n{INTRODUCTION}\n" + "\n\n".join(sections) + "\n"


def _section(name: str) -> str:
    text = TEXTS.get(
        name, f"The columns of [{name}](tables.md#{name}), between those of every table."
    )
    schema = schema_of(name)
    fields = [field for field in schema if name in TEXTS or field.name in MEANINGS]
    return f"## {name}\n\n{text}\n\n{table(('column', 'meaning', 'unit', 'type', 'may be null'), map(_row, fields))}"


def _row(field: pa.Field) -> tuple[str, ...]:
    rows = field.name.removesuffix("_rows")
    holds = (
        f"number of its rows in `{rows}`"
        if rows in DATA and rows != field.name
        else MEANINGS.get(field.name, "")
    )
    unit = (field.metadata or {}).get(b"unit", b"").decode()
    return code(field.name), holds, unit, str(field.type), "yes" if field.nullable else "no"
