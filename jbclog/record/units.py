"""Which units were on the bench when, as the events of a run tell it.

A unit lasts from its `unit.begin` to its `unit.end`, or to the begin of the next. One that a crash cut off has no end.
"""

from __future__ import annotations

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
    """The units of the run in `folder`, from its sealed events."""
    found: list[Unit] = []
    for group in row_groups(folder, "events", COLUMNS):
        told = group.filter(pc.is_in(group["kind"], pa.array([BEGIN, END])))
        for micros, kind, raw in zip(*(column.to_pylist() for column in _plain(told)), strict=True):
            if found and found[-1].end is None:
                found[-1] = replace(found[-1], end=iso(micros))
            if kind == BEGIN:
                found.append(Unit(raw or "", iso(micros)))
    return found


def _plain(told: pa.Table) -> list[pa.ChunkedArray]:
    return [told["time"].cast(pa.int64()), told["kind"], told["raw"]]
