"""The rows of a port, as the verdict's joints, the metrics, the table of joints and the live count
read them.

A port that fits into memory is read once and kept; otherwise each sweep reads its rows again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.clock_steps import Step, nominal_period
from jbclog.analysis.joints.port_rows import COLUMNS, PUSHING, Clock
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.values import Values
from jbclog.analysis.joints.windows import TakesRows, joined, placed
from jbclog.analysis.port_data import WORKING, Counts, Floats, has_tip
from jbclog.analysis.verdict.idle import Block
from jbclog.analysis.verdict.rules import has_feeder
from jbclog.core.rows import StationFacts
from jbclog.record.samples_by_port import SamplesByPort
from jbclog.record.schema import SCHEMAS

MOST_ROWS: Final = 1_000_000  # rows in memory at once, some 100 MB
TIMES: Final = ["time", "tick", "late_us", "scan_us"]
MOTOR: Final = "motor"  # a sweep reads it only for a tool with a feeder
SAME_S: Final = 1e-6
# decimals of a second: times since 1970 as floats are multiples of 0.24 µs, so there are few steps
STEP_DECIMALS: Final = 12


class Sweeps(Protocol):
    """Sweeps several times over the rows of a port, such as `PortSweeps`."""

    def next_sweep(self) -> TakesRows | None:
        """Return the object that takes the rows of the next sweep, or None at the end; called again
        after each sweep.
        """


class PortReader:
    """One port of a station.

    `samples` have `COLUMNS`, `steps` are those of the wall clock, `t0_us` is the zero of the run's
    time. `rows` and `last_s`, the time of the last row in s, are known after a sweep; `period_s` is
    that of the grid, or the median interval between rows.
    """

    def __init__(
        self,
        facts: StationFacts,
        port: int,
        samples: SamplesByPort,
        steps: Sequence[Step],
        t0_us: int,
    ) -> None:
        self._facts = facts
        self._key = facts.name, port
        self._samples = samples
        self._steps = steps
        self._t0_us = t0_us
        self._swept = [name for name in COLUMNS if has_feeder(facts) or name != MOTOR]
        self._kept: list[Series] | None = None
        self.rows = 0
        self.last_s = 0.0
        self.period_s = facts.period_s or self._median_interval_s()

    def clock(self) -> Clock:
        """Return the clock that gives the seconds of the rows, from the first row on."""
        return Clock(self._facts.period_s, self._steps, self._t0_us)

    def like(self) -> Series:
        """Return a series without rows, with everything else that the port's rows have in
        common.
        """
        rows = SCHEMAS["samples"].empty_table().select(COLUMNS)
        return raw_series(self._facts, rows, self.clock(), self.period_s)

    def whole(self) -> tuple[Series, Counts]:
        """Return all rows, and their UTC in microseconds, for what needs the whole record."""
        clock = self.clock()
        pieces = [self.like()]
        times_us = [np.empty(0, dtype=np.int64)]
        for rows in self._samples.rows(self._key, COLUMNS):
            pieces.append(raw_series(self._facts, rows, clock, self.period_s))
            times_us.append(micros(rows))
        series = placed(joined(pieces))
        period_s = self._facts.period_s or nominal_period(series.seconds)
        return replace(series, period_s=period_s), np.concatenate(times_us)

    def sweep(self, port: Sweeps) -> None:
        """Show the rows as often as `port` needs."""
        while (windows := port.next_sweep()) is not None:
            for piece in self._pieces():
                windows.take(piece)
            windows.end()

    def utc_us(self, moments: Floats) -> Counts:
        """Return the UTC in microseconds of the rows at or next after these moments, else of the
        last row.
        """
        sorted_s, places_of_moments = np.unique(moments, return_inverse=True)
        found = np.zeros(len(sorted_s), dtype=np.int64)
        if not len(found):
            return found
        first = 0
        for seconds, times_us in self._times():
            stop = int(np.searchsorted(sorted_s, seconds[-1] + SAME_S, side="right"))
            stop = max(stop, first)
            rows = np.searchsorted(seconds, sorted_s[first:stop] - SAME_S)
            found[first:stop] = times_us[rows]
            found[stop:] = times_us[-1]  # until there is a later one
            first = stop
        return found[places_of_moments]

    def _median_interval_s(self) -> float:
        """Return the median interval of the rows by their times."""
        intervals = Values(STEP_DECIMALS)
        last = np.empty(0)
        for seconds, _ in self._times():
            intervals.add(np.diff(np.concatenate([last, seconds])))
            last = seconds[-1:]
        return intervals.median if intervals.n else 0.0

    def _times(self) -> Iterator[tuple[Floats, Counts]]:
        """Yield when the rows were read, in s, and their UTC in microseconds."""
        clock = self.clock()
        for rows in self._samples.rows(self._key, TIMES):
            times_us = micros(rows)
            seconds = clock.seconds(floats(rows["tick"]), times_us)
            late_us, scan_us = floats(rows["late_us"]), floats(rows["scan_us"])
            read_s = clock.read_s(seconds, times_us, late_us, scan_us)
            yield seconds if read_s is None else read_s, times_us

    def _pieces(self) -> Iterator[Series]:
        """Yield all rows; keep them for the next sweep if there are at most `MOST_ROWS`."""
        if self._kept is not None:
            yield from self._kept
            return
        clock = self.clock()
        kept: list[Series] | None = []
        self.rows = 0
        for rows in self._samples.rows(self._key, self._swept):
            piece = raw_series(self._facts, rows, clock, self.period_s)
            self.rows += len(rows)
            self.last_s = float(piece.seconds[-1])
            if self.rows > MOST_ROWS:
                kept = None
            if kept is not None:
                kept.append(piece)
            yield piece
        self._kept = kept


def raw_series(facts: StationFacts, rows: pa.Table, clock: Clock, period_s: float = 0.0) -> Series:
    """Return rows of a port as a series; whether its tool was in its place needs the rows on both
    sides (`windows.placed`).

    `period_s` is the period of a port without a grid; 0: the median interval of these rows.
    """
    utc_us = micros(rows)
    seconds = clock.seconds(floats(rows["tick"]), utc_us)
    status = rows["status"]
    block = Block(
        seconds,
        floats(rows["temperature_c"]),
        floats(rows["power_permille"]),
        floats(rows["setpoint_c"]),
        pc.is_in(status, pa.array(WORKING)).to_numpy(),
        floats(rows["tool"]),
        floats(rows["port_error"]) if has_tip(facts) else np.full(len(seconds), np.nan),
    )
    feeding = None
    if has_feeder(facts):
        feeding = floats(pc.equal(rows[MOTOR], PUSHING).cast(pa.int8()))
    return Series(
        block,
        pc.is_valid(status).to_numpy(),
        facts.period_s or period_s or nominal_period(seconds),
        feeding,
        facts.rated_power_w,
        on_grid=bool(facts.period_s),
        read_s=clock.read_s(seconds, utc_us, floats(rows["late_us"]), floats(rows["scan_us"])),
    )


def micros(rows: pa.Table) -> Counts:
    """Return the times of these rows in UTC microseconds since 1970."""
    return np.asarray(rows["time"].cast(pa.int64()).to_numpy(), dtype=np.int64)


def floats(column: pa.ChunkedArray) -> Floats:
    """Return the column as floats, NaN where not read."""
    return np.asarray(column.cast(pa.float64()).to_numpy(), dtype=np.float64)
