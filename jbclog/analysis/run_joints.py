"""The joints of a run as objects, each with its slice of the samples and its unit, and as spans of
a figure.
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
"""The columns that `spans_of` takes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunJoint:
    """A joint. Its fields are the columns of `Run.joints` (docs/reference/tables.md), and its
    unit's serial; None: not known.
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
        """Return its port's rows of `Run.samples` from `before_s` before its start to `after_s`
        after its end, both included.

        Raises `UsageError` for a negative time or an unknown column, `RecordError` for a record
        that cannot be read.
        """
        if before_s < 0 or after_s < 0:
            raise UsageError(
                f"before_s is {before_s} s, after_s is {after_s} s; both must be 0 or more"
            )
        begin = self.start - pd.Timedelta(seconds=before_s)
        # `stop` itself is not included
        after_end = self.end + pd.Timedelta(seconds=after_s) + pd.Timedelta(microseconds=1)
        return self.run.samples(self.station, self.port, begin, after_end, columns)


def each_joint(
    run: RunTables, station: str | None = None, port: int | None = None
) -> list[RunJoint]:
    """Return the joints of a run in the order of `joints_of`. Raises `RecordError`."""
    table = joints_of(run, station)
    if port is not None:
        table = table.filter(pc.equal(table["port"], port))
    return [
        _joint(run, unit, row)
        for unit, row in zip(serials_of(run, table), table.to_pylist(), strict=True)
    ]


def joints_with_units(run: RunTables) -> pa.Table:
    """Return the joints of `joints_of` with a first column `unit`: the unit's serial, null where it
    is not known.
    """
    table = joints_of(run)
    return table.add_column(0, pa.field("unit", TEXT), pa.array(serials_of(run, table), TEXT))


def serials_of(run: RunTables, joints: pa.Table) -> list[str | None]:
    """Return the serial of the unit of each joint; None where it is not known."""
    serials = run.unit_at(pd.Series(joints["start"].to_pandas()))
    return [None if pd.isna(serial) else str(serial) for serial in serials]


def _joint(run: RunTables, unit: str | None, row: dict[str, object]) -> RunJoint:
    times = {name: pd.Timestamp(row[name]) for name in ("start", "end")}  # type: ignore[arg-type]  # of the table's time columns
    return RunJoint(run=run, unit=unit, **{**row, **times})  # type: ignore[arg-type]  # the table's columns are the fields


def joints_of_port(
    joints: pa.Table, station: str, port: int, columns: Sequence[str] | None = None
) -> pa.Table:
    """Return the joints of one port, or these columns of them: a copy."""
    own = pc.and_(pc.equal(joints["station"], station), pc.equal(joints["port"], port))
    return (joints if columns is None else joints.select([*columns])).filter(own)


def spans_of(joints: pa.Table) -> list[Span]:
    """Return the joints of one port in seconds of the run, each with the word for whether the tip
    was back before the next.
    """
    return [
        Span(
            start,
            end,
            JointEnd.BACK if back else JointEnd.CUT_OFF if back is None else JointEnd.LATE,
        )
        for start, end, back in zip(*(joints[name].to_pylist() for name in OF_SPANS), strict=True)
    ]
