"""Which units were on the bench when, as the events of a run tell it, and whose joints are whose.

A unit lasts from its `unit.begin` to its `unit.end`, or to the begin of the next. One that a crash cut off has no end. A serial
that is told after sealing is an annotation of the kind `unit.late`.

A joint belongs to the unit that was on the bench then. Where no serial was read while the run went on, all of it belongs to the
unit that was named at the start or later, if that is one; to none that is known, if they are several.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import read
from jbclog.record.manifest import Unit, iso
from jbclog.record.parts import row_groups

BEGIN, END, LATE = "unit.begin", "unit.end", "unit.late"
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


def late_serials(folder: Path) -> list[str]:
    """The serials that were told of the sealed run in `folder` later. Raises `RecordError`."""
    if not (folder / ANNOTATIONS).exists():
        return []
    return [said.what for said in read(folder).said if said.kind == LATE]


def only_unit(named: Sequence[str], late: Sequence[str]) -> str | None:
    """The unit of a run in which no serial was read: the one that people named, None where they named none, or several."""
    serials = {*named, *late}
    return serials.pop() if len(serials) == 1 else None


def _plain(told: pa.Table) -> list[pa.ChunkedArray]:
    return [told["time"].cast(pa.int64()), told["kind"], told["raw"]]
