"""Newest values, reasons, coverage and traces of each port, from the samples of a run."""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from jbclog.core.rows import SIGNAL_COLUMNS, PortKey
from jbclog.live.states import Trace
from jbclog.record.ledger import reasons_of

TRACE_S: Final = 60.0
HOUR_S: Final = 3600.0
MEAN_S: Final = 5.0
MOST_MEANS: Final = round(HOUR_S / MEAN_S)
MOST_POINTS: Final = 6_000  # points of a trace: a minute at 100 Hz
MAIN: Final = "temperature_c"
POWER: Final = "power_permille"
SAME: Final = 1e-9  # tolerance, as a share of an interval: ticks times a period are not exact


class Moment(NamedTuple):
    """Tick and time (UTC in µs) of a row. Ordered by tick."""

    tick: int
    time: int


class Last(NamedTuple):
    moment: Moment
    value: object


class Points:
    """The newest minute of points. Accepts them in any order."""

    def __init__(self) -> None:
        self._seconds: list[float] = []
        self._temperatures: list[float | None] = []
        self._powers: list[float | None] = []
        self._trace: Trace | None = Trace()

    def add(
        self, seconds: list[float], temperatures: list[float | None], powers: list[float | None]
    ) -> None:
        """Add points, which are in order."""
        newest_s = self._seconds[-1] if self._seconds else -np.inf
        if seconds[-1] < newest_s - TRACE_S:
            return
        self._seconds += seconds
        self._temperatures += temperatures
        self._powers += powers
        if seconds[0] <= newest_s:
            self._sort()
        first = bisect_left(self._seconds, self._seconds[-1] - TRACE_S)
        first = max(first, len(self._seconds) - MOST_POINTS)
        del self._seconds[:first], self._temperatures[:first], self._powers[:first]
        self._trace = None

    def _sort(self) -> None:
        order = sorted(range(len(self._seconds)), key=self._seconds.__getitem__)
        self._seconds = [self._seconds[at] for at in order]
        self._temperatures = [self._temperatures[at] for at in order]
        self._powers = [self._powers[at] for at in order]

    def trace(self) -> Trace:
        """Return the points. Without a new point this is the same object, which saves most of the
        work.
        """
        if self._trace is None:
            self._trace = Trace(
                tuple(self._seconds), tuple(self._temperatures), tuple(self._powers)
            )
        return self._trace


class Means:
    """Means of each `MEAN_S` seconds of the last hour. Accepts rows in any order."""

    def __init__(self) -> None:
        # interval number -> sum and count of temperature, sum and count of power
        self._sums: dict[int, NDArray[np.float64]] = {}
        self._last = 0
        self._trace: Trace | None = Trace()

    def add(self, interval: int, sums: NDArray[np.float64]) -> None:
        if self._sums and interval <= self._last - MOST_MEANS:
            return
        # the last interval is not shown before it is complete
        if not self._sums or interval != self._last:
            self._last = max(self._last, interval) if self._sums else interval
            self._trace = None
        known = self._sums.get(interval)
        self._sums[interval] = sums if known is None else known + sums
        if len(self._sums) > 2 * MOST_MEANS:
            oldest = self._last - MOST_MEANS
            self._sums = {number: kept for number, kept in self._sums.items() if number > oldest}

    def trace(self) -> Trace:
        """Return the complete intervals; one without rows has no value."""
        if self._trace is None:
            oldest = self._last - MOST_MEANS
            shown = [number for number in self._sums if oldest < number < self._last]
            intervals = range(min(shown), self._last) if shown else range(0)
            rows = [self._sums.get(number, _NOTHING).tolist() for number in intervals]
            self._trace = Trace(
                tuple((number + 0.5) * MEAN_S for number in intervals),
                tuple(total / count if count else None for total, count, _, _ in rows),
                tuple(total / count if count else None for _, _, total, count in rows),
            )
        return self._trace


_NOTHING: Final = np.zeros(4)


@dataclass(slots=True)
class PortHistory:
    """One port. `values` and `failures` (value: the reason) are the newest of each column."""

    newest: Last | None = None  # value: the row's quality
    values: dict[str, Last] = field(default_factory=dict)
    failures: dict[str, Last] = field(default_factory=dict)
    obtained: int = 0
    missing: int = 0
    points: Points = field(default_factory=Points)
    means: Means = field(default_factory=Means)


class SampleHistory:
    """Collects tables of samples, in any order."""

    def __init__(self) -> None:
        self.ports: defaultdict[PortKey, PortHistory] = defaultdict(PortHistory)

    def add(self, rows: pa.Table, periods: Mapping[str, float | None]) -> None:
        """Add rows. `periods`: seconds between ticks of each station, None: no grid."""
        by_port = _ByPort(rows, periods)
        for key, moment, quality in by_port.last("quality"):
            port = self.ports[key]
            port.newest = _newer(port.newest, Last(moment, quality))
        for column in SIGNAL_COLUMNS:
            for key, moment, value in by_port.last(column):
                known = self.ports[key].values
                known[column] = _newer(known.get(column), Last(moment, value))
        for key, obtained in by_port.count(MAIN):
            self.ports[key].obtained += obtained
        for key, moment, reasons, count in by_port.failures():
            port = self.ports[key]
            for column, reason in reasons_of(reasons):
                port.failures[column] = _newer(port.failures.get(column), Last(moment, reason))
                port.missing += count if column == MAIN else 0
        for key, points in by_port.points():
            self.ports[key].points.add(*points)
        for key, interval, sums in by_port.sums():
            self.ports[key].means.add(interval, sums)


def _newer(known: Last | None, new: Last) -> Last:
    return new if known is None or new.moment.tick >= known.moment.tick else known


class _ByPort:
    """Rows of samples, sorted by port and tick."""

    def __init__(self, rows: pa.Table, periods: Mapping[str, float | None]) -> None:
        stations = rows["station"].combine_chunks().dictionary_encode()
        names = stations.dictionary.to_pylist()
        station = np.asarray(stations.indices.to_numpy())
        port = np.asarray(rows["port"].to_numpy())
        ticks = np.asarray(rows["tick"].to_numpy())
        order = np.lexsort((ticks, port, station))
        if (order[1:] < order[:-1]).any():
            rows = rows.take(pa.array(order))
            station, port, ticks = station[order], port[order], ticks[order]
        is_first = np.ones(len(rows), dtype=bool)
        is_first[1:] = (station[1:] != station[:-1]) | (port[1:] != port[:-1])
        self._rows = rows
        self._ticks = ticks
        self._times = np.asarray(rows["time"].cast(pa.int64()).to_numpy())
        period_s = np.array([periods.get(name) or np.nan for name in names])[station]
        self._seconds = np.where(np.isnan(period_s), self._times / 1e6, ticks * period_s)
        self._starts = np.flatnonzero(is_first)
        self._ends = np.append(self._starts[1:], len(rows))
        places = zip(station[self._starts].tolist(), port[self._starts].tolist(), strict=True)
        self._keys: list[PortKey] = [(names[code], number) for code, number in places]

    def last(self, column: str) -> Iterator[tuple[PortKey, Moment, object]]:
        """Yield the last value of a column for each port that has one."""
        values = self._rows[column]
        if values.null_count == len(values):
            return
        at = self._ends - 1
        if values.null_count:
            with_value = np.where(self._is_valid(column), np.arange(len(values)), -1)
            at = np.maximum.reduceat(with_value, self._starts)
        ports = np.flatnonzero(at >= 0)
        at = at[ports]
        moments = zip(self._ticks[at].tolist(), self._times[at].tolist(), strict=True)
        taken = values.take(pa.array(at)).to_pylist()
        for port, moment, value in zip(ports.tolist(), moments, taken, strict=True):
            yield self._keys[port], Moment(*moment), value

    def count(self, column: str) -> Iterator[tuple[PortKey, int]]:
        """Yield the number of values in a column for each port."""
        counts = np.add.reduceat(self._is_valid(column), self._starts, dtype=np.int64)
        yield from zip(self._keys, counts.tolist(), strict=True)

    def failures(self) -> Iterator[tuple[PortKey, Moment, str, int]]:
        """Yield each port's different `reasons`, when they were last, and how often."""
        rows = self._rows
        if rows["reasons"].null_count == len(rows):
            return
        failed = rows.select(["station", "port", "reasons", "tick"])
        failed = failed.append_column("us", rows["time"].cast(pa.int64()))
        failed = failed.filter(pc.is_valid(failed["reasons"]))
        grouped = failed.group_by(["station", "port", "reasons"])
        for row in grouped.aggregate(
            [("tick", "max"), ("us", "max"), ([], "count_all")]
        ).to_pylist():
            moment = Moment(row["tick_max"], row["us_max"])
            yield (row["station"], row["port"]), moment, row["reasons"], row["count_all"]

    def points(self) -> Iterator[tuple[PortKey, list[list[Any]]]]:
        """Yield seconds, temperatures and powers of each port's last minute here."""
        oldest_s = self._seconds[self._ends - 1] - TRACE_S
        is_recent = self._seconds >= np.repeat(oldest_s, self._ends - self._starts)
        at = np.flatnonzero(is_recent)
        rows = self._rows.select([MAIN, POWER]).take(pa.array(at))
        columns = [self._seconds[at].tolist(), *(column.to_pylist() for column in rows.columns)]
        ends = np.searchsorted(at, self._ends).tolist()
        for key, start, end in zip(self._keys, [0, *ends[:-1]], ends, strict=True):
            yield key, [column[start:end] for column in columns]

    def sums(self) -> Iterator[tuple[PortKey, int, NDArray[np.float64]]]:
        """Yield sum and count of temperature and power for each port and interval."""
        intervals = np.floor(self._seconds / MEAN_S + SAME).astype(np.int64)
        is_first = np.ones(len(intervals), dtype=bool)
        is_first[1:] = intervals[1:] != intervals[:-1]
        is_first[self._starts] = True
        starts = np.flatnonzero(is_first)
        columns = []
        for column in (MAIN, POWER):
            values = self._rows[column].cast(pa.float64()).to_numpy()
            columns.append(np.add.reduceat(np.nan_to_num(values), starts))
            columns.append(np.add.reduceat(~np.isnan(values), starts, dtype=np.float64))
        sums = np.stack(columns, axis=1)
        ports = np.searchsorted(self._starts, starts, side="right") - 1
        for place, (port, interval) in enumerate(
            zip(ports.tolist(), intervals[starts].tolist(), strict=True)
        ):
            yield self._keys[port], interval, sums[place]

    def _is_valid(self, column: str) -> NDArray[np.bool_]:
        return np.asarray(pc.is_valid(self._rows[column]).to_numpy())
