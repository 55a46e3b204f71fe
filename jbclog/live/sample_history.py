"""Newest values, reasons, coverage and traces of each port, from the samples of a run."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

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

WIDEST: Final = 1 << 32  # above every port number


class Moment(NamedTuple):
    """Tick and time (UTC in µs) of a row. Ordered by tick, because the clock may be set."""

    tick: int
    time: int


class Last(NamedTuple):
    moment: Moment
    value: object


class Points:
    """The points of a trace, the newest `span_s` seconds of them."""

    def __init__(self, span_s: float) -> None:
        self._span_s = span_s
        self._seconds: deque[float] = deque()
        self._temperatures: deque[float | None] = deque()
        self._powers: deque[float | None] = deque()
        self._trace: Trace | None = Trace()

    def add(self, seconds: float, temperature: float | None, power: float | None) -> None:
        times = self._seconds
        if times and seconds <= times[-1]:
            times.clear()  # the clock was set back, and there is no grid to order by
            self._temperatures.clear()
            self._powers.clear()
        times.append(seconds)
        self._temperatures.append(temperature)
        self._powers.append(power)
        while times[-1] - times[0] > self._span_s or len(times) > MOST_POINTS:
            times.popleft()
            self._temperatures.popleft()
            self._powers.popleft()
        self._trace = None

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
        self._sums: dict[int, list[float]] = {}
        self._last = 0
        self._trace: Trace | None = Trace()

    def add(self, stretch: int, sums: Sequence[float]) -> None:
        if self._sums and stretch <= self._last - MOST_MEANS:
            return
        # the last interval is not shown before it is complete
        if not self._sums or stretch != self._last:
            self._last = max(self._last, stretch) if self._sums else stretch
            self._trace = None
        self._sums[stretch] = [
            one + more for one, more in zip(self._sums.get(stretch, (0.0,) * 4), sums, strict=True)
        ]
        if len(self._sums) > 2 * MOST_MEANS:
            self._sums = {
                one: values for one, values in self._sums.items() if one > self._last - MOST_MEANS
            }

    def trace(self) -> Trace:
        """Return the complete intervals; one without rows has no value."""
        if self._trace is None:
            known = [one for one in self._sums if self._last - MOST_MEANS < one < self._last]
            stretches = range(min(known), self._last) if known else range(0)
            sums = [self._sums.get(one, (0.0,) * 4) for one in stretches]
            self._trace = Trace(
                tuple((one + 0.5) * MEAN_S for one in stretches),
                tuple(temperature / count if count else None for temperature, count, _, _ in sums),
                tuple(power / count if count else None for _, _, power, count in sums),
            )
        return self._trace


@dataclass(slots=True)
class PortHistory:
    """One port. `values` and `failures` (value: the reason) are the newest of each column."""

    newest: Last | None = None  # value: the row's quality
    values: dict[str, Last] = field(default_factory=dict)
    failures: dict[str, Last] = field(default_factory=dict)
    obtained: int = 0
    missing: int = 0
    points: Points = field(default_factory=lambda: Points(TRACE_S))
    means: Means = field(default_factory=Means)


class SampleHistory:
    """Collects tables of samples: `add` takes the newest rows in order, `add_earlier` older ones in
    any order.
    """

    def __init__(self) -> None:
        self.ports: defaultdict[PortKey, PortHistory] = defaultdict(PortHistory)

    def add(self, rows: pa.Table, periods: Mapping[str, float | None]) -> None:
        """Add new rows. `periods`: seconds between ticks of each station, None: no grid."""
        table = _Rows(rows, periods)
        self._add(table)
        columns = (rows[name].to_pylist() for name in ("station", "port", MAIN, POWER))
        for station, port, temperature, power, second in zip(
            *columns, table.seconds.tolist(), strict=True
        ):
            self.ports[station, port].points.add(second, temperature, power)

    def add_earlier(self, rows: pa.Table, periods: Mapping[str, float | None]) -> None:
        """Add older rows: count them, and keep their values where nothing newer is known."""
        self._add(_Rows(rows, periods))

    def _add(self, table: _Rows) -> None:
        rows = table.rows
        for key, moment, quality in table.last("quality"):
            port = self.ports[key]
            port.newest = _newer(port.newest, Last(moment, quality))
        for column in SIGNAL_COLUMNS:
            if rows[column].null_count < len(rows):
                for key, moment, value in table.last(column):
                    known = self.ports[key].values
                    known[column] = _newer(known.get(column), Last(moment, value))
        self._count(table)
        for key, stretch, sums in table.sums(MEAN_S):
            self.ports[key].means.add(stretch, sums)

    def _count(self, table: _Rows) -> None:
        for key, count in table.count(MAIN):
            self.ports[key].obtained += count
        rows = table.rows
        if rows["reasons"].null_count == len(rows):
            return
        failed = rows.filter(pc.is_valid(rows["reasons"])).select(
            ["station", "port", "reasons", "tick", "time"]
        )
        grouped = failed.set_column(4, "time", failed["time"].cast(pa.int64())).group_by(
            ["station", "port", "reasons"]
        )
        for row in grouped.aggregate(
            [("tick", "max"), ("time", "max"), ([], "count_all")]
        ).to_pylist():
            port, moment = (
                self.ports[row["station"], row["port"]],
                Moment(row["tick_max"], row["time_max"]),
            )
            for column, reason in reasons_of(row["reasons"]):
                port.failures[column] = _newer(port.failures.get(column), Last(moment, reason))
                port.missing += row["count_all"] if column == MAIN else 0


def _newer(known: Last | None, new: Last) -> Last:
    return new if known is None or new.moment.tick >= known.moment.tick else known


class _Rows:
    """Rows of samples, grouped by port."""

    def __init__(self, rows: pa.Table, periods: Mapping[str, float | None]) -> None:
        self.rows = rows
        stations = rows["station"].combine_chunks().dictionary_encode()
        self._names = stations.dictionary.to_pylist()
        ports = np.asarray(rows["port"].to_numpy(), dtype=np.int64)
        self._codes = np.asarray(stations.indices.to_numpy(), dtype=np.int64) * WIDEST + ports
        self._moments = [rows["tick"].to_numpy(), rows["time"].cast(pa.int64()).to_numpy()]
        period = np.array([periods.get(name) or np.nan for name in self._names])[
            stations.indices.to_numpy()
        ]
        ticks, times = self._moments
        self.seconds = np.where(np.isnan(period), times / 1e6, ticks * period)

    def last(self, column: str) -> Iterator[tuple[PortKey, Moment, object]]:
        """Yield the last value of a column for each port that has one."""
        values, places = self.rows[column], self._read(column)
        codes, from_end = np.unique(self._codes[places][::-1], return_index=True)
        rows = places[::-1][from_end]
        ticks, times = (moments[rows].tolist() for moments in self._moments)
        for code, tick, time, value in zip(
            codes.tolist(), ticks, times, values.take(pa.array(rows)).to_pylist(), strict=True
        ):
            yield self._key(code), Moment(tick, time), value

    def count(self, column: str) -> Iterator[tuple[PortKey, int]]:
        """Yield the number of values in a column for each port."""
        codes, counts = np.unique(self._codes[self._read(column)], return_counts=True)
        for code, count in zip(codes.tolist(), counts.tolist(), strict=True):
            yield self._key(code), count

    def sums(self, stretch_s: float) -> Iterator[tuple[PortKey, int, tuple[float, ...]]]:
        """Yield sum and count of temperature and power for each port and interval."""
        if not len(self.rows):
            return
        ports, of_port = np.unique(self._codes, return_inverse=True)
        stretches = np.floor(self.seconds / stretch_s + SAME).astype(np.int64)
        first, last = int(stretches.min()), int(stretches.max())
        width = last - first + 1
        pairs, of_pair = np.unique(of_port * width + stretches - first, return_inverse=True)
        columns = []
        for column in (MAIN, POWER):
            values = np.asarray(self.rows[column].cast(pa.float64()).to_numpy(), dtype=np.float64)
            columns += [
                np.bincount(of_pair, np.nan_to_num(values)),
                np.bincount(of_pair, ~np.isnan(values)),
            ]
        for pair, *sums in zip(
            pairs.tolist(), *(column.tolist() for column in columns), strict=True
        ):
            port, stretch = divmod(pair, width)
            yield self._key(int(ports[port])), stretch + first, tuple(sums)

    def _read(self, column: str) -> NDArray[np.int64]:
        """Return the rows in which a column has a value."""
        values = self.rows[column]
        return (
            np.flatnonzero(np.asarray(pc.is_valid(values).to_numpy()))
            if values.null_count
            else np.arange(len(values))
        )

    def _key(self, code: int) -> PortKey:
        station, port = divmod(code, WIDEST)
        return self._names[station], port
