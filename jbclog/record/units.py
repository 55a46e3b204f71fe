"""The units of a run, from its events.

A unit lasts from its `unit.begin` to its `unit.end`, or to the beginning of the next; after a crash
it has no end. A serial added after sealing is an annotation `unit.late`. A joint belongs to the
unit at its time. If no serial was read during a run, all joints belong to the one unit named at its
start or later; if several were named, their unit is unknown.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.record.manifest import Unit, iso
from jbclog.record.parts import row_groups

BEGIN, END = "unit.begin", "unit.end"
COLUMNS: Final = ["time", "kind", "raw"]


def units_of(folder: Path) -> list[Unit]:
    """Return the units of a run, from its sealed events."""
    return units_in(row_groups(folder, "events", COLUMNS))


def units_in(events: Iterable[pa.Table]) -> list[Unit]:
    """Return the units in `events`, which have `COLUMNS`, oldest first."""
    found: list[Unit] = []
    for group in events:
        marks = group.filter(pc.is_in(group["kind"], pa.array([BEGIN, END])))
        for micros, kind, raw in zip(
            *(column.to_pylist() for column in _plain(marks)), strict=True
        ):
            if found and found[-1].stop is None:
                found[-1] = replace(found[-1], stop=iso(micros))
            if kind == BEGIN:
                found.append(Unit(raw or "", iso(micros)))
    return found


def only_unit(named: Sequence[str], late: Sequence[str]) -> str | None:
    """Return the unit of a run without serials read: the one named; None if none or several."""
    serials = {*named, *late}
    return serials.pop() if len(serials) == 1 else None


def _plain(marks: pa.Table) -> list[pa.ChunkedArray]:
    return [marks["time"].cast(pa.int64()), marks["kind"], marks["raw"]]
