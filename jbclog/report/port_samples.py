"""The rows of a port as its report needs them, collected row group by row group.

A week at 10 Hz takes 19 bytes a row: its trace is made of some 33 000 rows at a time and joined. A
port without a grid, of hot air, or that reports states alone is taken as a whole.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd
import pyarrow as pa

from jbclog.analysis.figures.curves import EXACT_IN_16, quantile
from jbclog.analysis.figures.from_samples import AIR_COLUMNS as AIR
from jbclog.analysis.figures.from_samples import STATE_COLUMNS as STATES
from jbclog.analysis.figures.from_samples import has_air, trace
from jbclog.analysis.figures.joined import GrowingColumn, JoinedTrace
from jbclog.analysis.figures.trace import Grid, Trace
from jbclog.analysis.verdict import judged_signals
from jbclog.core.rows import StationFacts
from jbclog.record.parts import ROWS_A_GROUP
from jbclog.record.schema import SCHEMAS

TEXTS: Final = ("quality", "reasons", "status")
COUNTED: Final = {kind: pd.ArrowDtype(kind) for kind in (pa.int32(), pa.int64())}
READINGS: Final = ("temperature_c", "power_permille", "set_c")
COLUMNS: Final = (
    "tick",
    "quality",
    "reasons",
    "temperature_c",
    "power_permille",
    "status",
    "set_c",
)


class PortSamples:
    """The rows of a port: how many, how late, the last status, and their trace."""

    def __init__(self, facts: StationFacts, grid: Grid) -> None:
        self._grid = grid
        self._of_states = "temperature_c" not in judged_signals(facts)
        self._of_air = has_air(facts)
        self._columns = columns_of(facts)
        is_plain = bool(grid.period_s) and not self._of_states and not self._of_air
        self._at_once = ROWS_A_GROUP if is_plain else None
        self._held: list[pa.Table] = []
        self._held_rows = 0
        self._joined = JoinedTrace()
        self._late_us = GrowingColumn()
        self.rows = 0
        self.last_status: str | None = None

    def add(self, rows: pa.Table) -> None:
        """Add the next rows, oldest first."""
        self._late_us.add(_short(rows["late_us"].drop_null()).to_numpy())
        self._held.append(_narrow(rows.select(self._columns)))
        self._held_rows += len(rows)
        self.rows += len(rows)
        if self._at_once is not None and self._held_rows >= self._at_once:
            self._joined.add(self._trace_held())

    def trace(self) -> Trace:
        """Return the trace of all rows; they are given up."""
        if self._at_once is None or not self.rows:
            return self._trace_held()
        if self._held:
            self._joined.add(self._trace_held())
        return self._joined.trace()

    def late_us(self, share: float) -> float | None:
        """Return a quantile of how late the rows were; that is given up."""
        late_us, self._late_us = self._late_us.array(), GrowingColumn()
        return quantile(late_us, share) if len(late_us) else None

    def _trace_held(self) -> Trace:
        none = _narrow(SCHEMAS["samples"].empty_table().select(self._columns))
        pieces = [none, *self._held]
        rows = pa.concat_tables(pieces, promote_options="permissive").unify_dictionaries()
        self._held.clear()
        self._held_rows = 0
        columns = {
            name: rows[name].to_pandas(types_mapper=COUNTED.get) for name in rows.column_names
        }
        columns |= {name: _exact_in_16(columns[name]) for name in READINGS if name in columns}
        frame = pd.DataFrame(columns, copy=False)
        last = frame["status"].last_valid_index()
        self.last_status = self.last_status if last is None else str(frame["status"][last])
        return trace(frame, self._grid, of_states=self._of_states, of_air=self._of_air)


def columns_of(facts: StationFacts) -> list[str]:
    """Return the columns of a trace; on a grid of ticks the time of a row is not needed."""
    return [
        *(() if facts.period_s else ("time",)),
        *COLUMNS,
        *(() if "temperature_c" in judged_signals(facts) else STATES),
        *(AIR if has_air(facts) else ()),
    ]


def _narrow(rows: pa.Table) -> pa.Table:
    """Return rows with dictionaries for texts, 32 bits for counts, and readings (whole numbers of
    at most six digits) as floats.
    """
    narrow = {name: rows[name].dictionary_encode() for name in TEXTS if name in rows.column_names}
    narrow |= {
        name: rows[name].cast(pa.float32(), safe=False)
        for name in READINGS
        if name in rows.column_names
    }
    narrow["tick"] = _short(rows["tick"])
    return pa.table({name: narrow.get(name, rows[name]) for name in rows.column_names})


def _short(counts: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return counts in 32 bits if they fit."""
    try:
        return counts.cast(pa.int32())
    except pa.ArrowInvalid:
        return counts


def _exact_in_16(readings: pd.Series[float]) -> pd.Series[float]:
    """Return readings in 16 bits if these hold them exactly."""
    values = readings.to_numpy()
    return readings if (np.abs(values) > EXACT_IN_16).any() else readings.astype(np.float16)
