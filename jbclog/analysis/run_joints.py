"""The joints of a run as objects, each with its unit and its slice of the samples, and as spans for
figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.figures.curves import Span
from jbclog.analysis.figures.trace import JointEnd
from jbclog.analysis.run_metrics import joints_of
from jbclog.analysis.run_tables import RunTables
from jbclog.core.errors import UsageError
from jbclog.record.schema import TEXT

OF_SPANS: Final = ("start_s", "end_s", "recovered")
"""Columns that `spans_of` needs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunJoint:
    """A joint. Its fields are the columns of `Run.joints` (docs/reference/tables.md) and the serial
    of its unit, None if not known.
    """

    run: RunTables = field(repr=False, compare=False)
    unit: str | None
    station: str
    port: int
    joint: int
    start: pd.Timestamp
    end: pd.Timestamp
    start_s: float
    end_s: float
    touches: int
    dwell_s: float | None
    depth_c: float | None
    recovery_s: float | None
    peak_permille: float | None
    heat_permille_s: float | None
    energy_permille_s: float | None
    energy_j: float | None
    fed: bool | None
    confidence: float
    why: str | None
    kind: str
    heat_j: float | None
    setpoint_c: float | None
    deficit_c: float | None
    resting_below_c: float | None
    lowest_c: float | None
    end_c: float | None
    recovered: bool | None
    had_s: float | None

    def samples(
        self, before_s: float = 0.0, after_s: float = 0.0, columns: Sequence[str] | None = None
    ) -> pd.DataFrame:
        """Return the port's rows of `Run.samples` from `before_s` before the joint to `after_s`
        after it, both included.

        Raises `UsageError` for a negative time or an unknown column, `RecordError` for a record
        that cannot be read.
        """
        if before_s < 0 or after_s < 0:
            raise UsageError(
                f"before_s is {before_s} s, after_s is {after_s} s; both must be 0 or more"
            )
        begin = self.start - pd.Timedelta(seconds=before_s)
        # `stop` is exclusive
        after_end = self.end + pd.Timedelta(seconds=after_s) + pd.Timedelta(microseconds=1)
        return self.run.samples(self.station, self.port, begin, after_end, columns)


def each_joint(
    run: RunTables, station: str | None = None, port: int | None = None
) -> list[RunJoint]:
    """Return the joints of a run as objects, in the order of `joints_of`. Raises `RecordError`."""
    table = joints_of(run, station)
    if port is not None:
        table = table.filter(pc.equal(table["port"], port))
    return [
        _joint(run, unit, row)
        for unit, row in zip(serials_of(run, table), table.to_pylist(), strict=True)
    ]


def joints_with_units(run: RunTables) -> pa.Table:
    """Return the joints with a first column `unit`: the unit's serial, null if not known."""
    table = joints_of(run)
    return table.add_column(0, pa.field("unit", TEXT), pa.array(serials_of(run, table), TEXT))


def serials_of(run: RunTables, joints: pa.Table) -> list[str | None]:
    """Return the unit's serial for each joint; None if not known."""
    serials = run.unit_at(pd.Series(joints["start"].to_pandas()))
    return [None if pd.isna(serial) else str(serial) for serial in serials]


def _joint(run: RunTables, unit: str | None, row: dict[str, object]) -> RunJoint:
    times = {name: pd.Timestamp(row[name]) for name in ("start", "end")}  # type: ignore[arg-type]  # of the table's time columns
    return RunJoint(run=run, unit=unit, **{**row, **times})  # type: ignore[arg-type]  # the table's columns are the fields


def joints_of_port(
    joints: pa.Table, station: str, port: int, columns: Sequence[str] | None = None
) -> pa.Table:
    """Return a copy of the joints of one port, with all or with these columns."""
    own = pc.and_(pc.equal(joints["station"], station), pc.equal(joints["port"], port))
    return (joints if columns is None else joints.select([*columns])).filter(own)


def spans_of(joints: pa.Table) -> list[Span]:
    """Return the joints of one port in seconds of the run, with the word for whether the tip
    recovered before the next.
    """
    return [
        Span(
            start,
            end,
            JointEnd.BACK if back else JointEnd.CUT_OFF if back is None else JointEnd.LATE,
        )
        for start, end, back in zip(*(joints[name].to_pylist() for name in OF_SPANS), strict=True)
    ]
