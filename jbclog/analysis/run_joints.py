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

OF_SPANS: Final = ("start_s", "stop_s", "recovered")
"""Columns that `spans_of` needs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunJoint:
    """A joint. Its fields are the columns of `Run.joints` (docs/reference/tables.md); `run` is the
    run itself.
    """

    run: RunTables = field(repr=False, compare=False)
    station: str
    port: int
    joint: int
    start: pd.Timestamp
    stop: pd.Timestamp
    start_s: float
    stop_s: float
    unit: str | None
    tip: str | None
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
    stop_c: float | None
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
        after_end = self.stop + pd.Timedelta(seconds=after_s) + pd.Timedelta(microseconds=1)
        return self.run.samples(self.station, self.port, begin, after_end, columns)


def each_joint(
    run: RunTables, station: str | None = None, port: int | None = None
) -> list[RunJoint]:
    """Return the joints of a run as objects, in the order of `joints_of`. Raises `RecordError`."""
    table = joints_of(run, station)
    if port is not None:
        table = table.filter(pc.equal(table["port"], port))
    return [_joint(run, row) for row in table.to_pylist()]


def _joint(run: RunTables, row: dict[str, object]) -> RunJoint:
    times = {name: pd.Timestamp(row[name]) for name in ("start", "stop")}  # type: ignore[arg-type]  # of the table's time columns
    return RunJoint(**{**row, **times, "run": run})  # type: ignore[arg-type]  # the table's columns are the fields


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
