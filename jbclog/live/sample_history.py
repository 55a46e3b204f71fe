"""What the samples of a run say of each port: newest values and reasons, coverage, the last minute."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.rows import SIGNAL_COLUMNS
from jbclog.live.states import Trace
from jbclog.record.ledger import reasons_of

TRACE_S: Final = 60.0
MOST_POINTS: Final = 6_000  # of a trace: a minute at 100 Hz
MAIN: Final = "temperature_c"

Key = tuple[str, int]
"""Station and port."""


class Moment(NamedTuple):
    """Tick and time (UTC in µs) of a row. Later ticks are later, whatever the clock was set to."""

    tick: int
    time: int


class Last(NamedTuple):
    moment: Moment
    value: object


@dataclass(slots=True)
class PortHistory:
    """One port. `values` and `failures` (value: the reason) are the newest by column."""

    newest: Last | None = None  # value: the row's quality
    values: dict[str, Last] = field(default_factory=dict)
    failures: dict[str, Last] = field(default_factory=dict)
    obtained: int = 0
    missing: int = 0
    points: deque[tuple[float, float | None, float | None]] = field(default_factory=deque)

    def add_point(self, seconds: float, temperature: float | None, power: float | None) -> None:
        points = self.points
        if points and seconds <= points[-1][0]:
            points.clear()  # the clock was set back, and there is no grid to go by
        points.append((seconds, temperature, power))
        while points[-1][0] - points[0][0] > TRACE_S or len(points) > MOST_POINTS:
            points.popleft()

    def trace(self) -> Trace:
        if not self.points:
            return Trace()
        seconds, temperatures, powers = zip(*self.points, strict=True)
        return Trace(seconds, temperatures, powers)


class SampleHistory:
    """Takes tables of samples. `add` is for the newest rows, in order; `add_earlier` for older ones, in any order."""

    def __init__(self) -> None:
        self.ports: dict[Key, PortHistory] = {}

    def add(self, rows: pa.Table, periods: Mapping[str, float | None]) -> None:
        """Add new rows. `periods`: seconds between the ticks of each station, None without a grid."""
        self.add_earlier(rows)
        times = rows["time"].cast(pa.int64()).to_pylist()
        columns = (rows[name].to_pylist() for name in ("station", "port", "tick", MAIN, "power_permille"))
        for station, port, tick, temperature, power, time in zip(*columns, times, strict=True):
            period = periods.get(station)
            self.ports[station, port].add_point(tick * period if period else time / 1e6, temperature, power)

    def add_earlier(self, rows: pa.Table) -> None:
        """Count rows, and take from them what is newer than what is known."""
        for key, moment, quality in _last_of(rows, "quality"):
            port = self.ports.setdefault(key, PortHistory())
            port.newest = _newer(port.newest, Last(moment, quality))
        for column in SIGNAL_COLUMNS:
            if rows[column].null_count < len(rows):
                read = rows.filter(pc.is_valid(rows[column]))
                for key, moment, value in _last_of(read, column):
                    known = self.ports[key].values
                    known[column] = _newer(known.get(column), Last(moment, value))
        self._count(rows)

    def _count(self, rows: pa.Table) -> None:
        for row in rows.group_by(["station", "port"]).aggregate([(MAIN, "count")]).to_pylist():
            self.ports[row["station"], row["port"]].obtained += row[f"{MAIN}_count"]
        failed = rows.filter(pc.is_valid(rows["reasons"])).select(["station", "port", "reasons", "tick", "time"])
        grouped = failed.set_column(4, "time", failed["time"].cast(pa.int64())).group_by(["station", "port", "reasons"])
        for row in grouped.aggregate([("tick", "max"), ("time", "max"), ([], "count_all")]).to_pylist():
            port, moment = self.ports[row["station"], row["port"]], Moment(row["tick_max"], row["time_max"])
            for column, reason in reasons_of(row["reasons"]):
                port.failures[column] = _newer(port.failures.get(column), Last(moment, reason))
                port.missing += row["count_all"] if column == MAIN else 0


def _newer(known: Last | None, new: Last) -> Last:
    return new if known is None or new.moment.tick >= known.moment.tick else known


def _last_of(rows: pa.Table, column: str) -> list[tuple[Key, Moment, object]]:
    """Return the last value of a column for each port."""
    plain = rows.select(["station", "port", "tick", "time", column])
    plain = plain.set_column(3, "time", plain["time"].cast(pa.int64()))
    grouped = plain.group_by(["station", "port"], use_threads=False)
    found = grouped.aggregate([("tick", "last"), ("time", "last"), (column, "last")]).to_pylist()
    return [((row["station"], row["port"]), Moment(row["tick_last"], row["time_last"]), row[f"{column}_last"]) for row in found]
