"""The rows of ports, read for many ports at once from the row groups of a run's samples.

A run that fits into memory is read once and kept; otherwise each sweep reads the row groups again
and memory holds one window of each port. The verdict's joints, the metrics, the table of joints and
the live count read a run this way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Final, NamedTuple, Protocol, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.coded_texts import is_one_of
from jbclog.analysis.joints.port_rows import COLUMNS, PUSHING, Clock
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.values import Values
from jbclog.analysis.joints.windows import SeenWindows, TakesRows, joined, placed
from jbclog.analysis.port_split import by_port, gathered, sorted_by_port
from jbclog.analysis.verdict.clock_steps import Step, nominal_period
from jbclog.analysis.verdict.idle import Block, Flags, Floats
from jbclog.analysis.verdict.rules import has_feeder, has_tip
from jbclog.analysis.verdict.samples import WORKING, Counts
from jbclog.core.rows import PortKey, StationFacts
from jbclog.record.schema import SCHEMAS

T = TypeVar("T")
Groups = Callable[[list[str]], Iterable[pa.Table]]
"""Reads these columns, station and port among them, of the row groups of a run's samples, in
order.
"""
SomeGroups = Callable[[list[str], Callable[[int], bool]], Iterable[pa.Table]]
"""The same; may leave out row groups, by number, that are not wanted."""
MOST_ROWS: Final = 1_000_000  # rows in memory at once, some 100 MB
MOST_PORTS: Final = 48  # read together in windows, some 3 MB each
TIMES: Final = ["time", "tick", "station", "port", "late_us", "scan_us"]
MOTOR: Final = "motor"  # a sweep reads it only for a tool with a feeder
SAME_S: Final = 1e-6
# decimals of a second: times since 1970 as floats are multiples of 0.24 µs, so there are few steps
STEP_DECIMALS: Final = 12


def at_once(some: Sequence[T], size: Callable[[T], float], most: float) -> Iterator[list[T]]:
    """Yield batches of at most this total size, with at least one element each."""
    held: list[T] = []
    for one in some:
        if held and sum(map(size, [*held, one])) > most:
            yield held
            held = []
        held.append(one)
    if held:
        yield held


def rows_due(facts: StationFacts) -> float:
    """Return the number of rows of all ports of a station, infinite if not known."""
    if facts.first_tick is None or facts.last_tick is None:
        return inf
    return (facts.last_tick - facts.first_tick + 1) * len(facts.ports)


class Sweeps(Protocol):
    """Sweeps several times over the rows of a port, such as `PortSweeps`."""

    def next_sweep(self) -> TakesRows | None:
        """Return the object that takes the rows of the next sweep, or None at the end; called again
        after each sweep.
        """


class PortReader:
    """The ports of stations, read together.

    `steps` are those of the wall clock, `t0_us` is the zero of the run's time. `some` reads some
    row groups of a run that does not change.
    """

    def __init__(
        self,
        stations: Sequence[StationFacts],
        groups: Groups,
        steps: Sequence[Step],
        t0_us: int,
        most_rows: int,
        some: SomeGroups | None = None,
    ) -> None:
        self._facts: dict[PortKey, StationFacts] = {
            (facts.name, port): facts for facts in stations for port in facts.ports
        }
        self._groups, self._steps, self._t0_us, self._most_rows = groups, steps, t0_us, most_rows
        self._rows: dict[PortKey, int] | None = None
        # of a run that is known to be longer not even the first `most_rows` are kept
        self._is_long = most_rows < sum(map(rows_due, stations)) < inf
        self._kept: list[tuple[PortKey, Series]] | None = None
        self._some = some
        # only for a port alone: the times of its first and last row in each row group
        self._spans: list[tuple[float, float] | None] = []
        self._last_s: dict[PortKey, float] = {}
        self._periods = self._read_periods()
        feeds = any(map(has_feeder, self._facts.values()))
        self._swept = [name for name in COLUMNS if feeds or name != MOTOR]

    def clock(self, key: PortKey) -> Clock:
        """Return the clock that gives the seconds of a port's rows, from the first row on."""
        return Clock(self._facts[key].period_s, self._steps, self._t0_us)

    def period_s(self, key: PortKey) -> float:
        """Return the period of the grid in s, or the median interval between rows."""
        return self._periods[key]

    def last_s(self, key: PortKey) -> float:
        """Return the time of a port's last row in s; valid after the first sweep."""
        return self._last_s.get(key, 0.0)

    def rows(self, key: PortKey) -> int:
        """Return the number of rows of a port; valid after the first sweep."""
        return (self._rows or {}).get(key, 0)

    def like(self, key: PortKey) -> Series:
        """Return a series without rows, with everything else that the port's rows have in
        common.
        """
        rows = SCHEMAS["samples"].empty_table().select(COLUMNS)
        return raw_series(self._facts[key], rows, self.clock(key), self._periods[key])

    def whole(self) -> dict[PortKey, tuple[Series, Counts]]:
        """Return all rows of each port, and their UTC in microseconds, for what needs the whole
        record.
        """
        clocks = {key: self.clock(key) for key in self._facts}
        pieces = {key: [self.like(key)] for key in self._facts}
        times = {key: [np.empty(0, dtype=np.int64)] for key in self._facts}
        for group in self._groups(COLUMNS):
            for key, rows in self._split(group):
                pieces[key].append(
                    raw_series(self._facts[key], rows, clocks[key], self._periods[key])
                )
                times[key].append(micros(rows))
        return {
            key: (
                self._complete(key, placed(joined(pieces.pop(key)))),
                np.concatenate(times.pop(key)),
            )
            for key in self._facts
        }

    def _complete(self, key: PortKey, series: Series) -> Series:
        return replace(series, period_s=self._facts[key].period_s or nominal_period(series.seconds))

    def sweep(self, ports: Mapping[PortKey, Sweeps]) -> None:
        """Show the rows of these ports as often as each of them needs."""
        while taking := {
            key: windows
            for key, port in ports.items()
            if (windows := port.next_sweep()) is not None
        }:
            for key, piece in self._some_pieces(taking) or self._pieces():
                if key in taking:
                    taking[key].take(piece)
            for windows in taking.values():
                windows.end()

    def utc_us(self, moments: Mapping[PortKey, Floats]) -> dict[PortKey, Counts]:
        """Return the UTC in microseconds of the rows at or next after these moments, else of the
        last row.
        """
        wanted = {key: np.unique(some, return_inverse=True) for key, some in moments.items()}
        found = {key: np.zeros(len(some), dtype=np.int64) for key, (some, _) in wanted.items()}
        known = dict.fromkeys(wanted, 0)
        for key, seconds, times in self._times() if any(map(len, found.values())) else ():
            if key not in wanted or not len(seconds):
                continue
            some, first = wanted[key][0], known[key]
            stop = max(int(np.searchsorted(some, seconds[-1] + SAME_S, side="right")), first)
            places = np.searchsorted(seconds, some[first:stop] - SAME_S)
            # until there is a later one
            found[key][first:stop], found[key][stop:], known[key] = times[places], times[-1], stop
        return {key: found[key][place] for key, (_, place) in wanted.items()}

    def _read_periods(self) -> dict[PortKey, float]:
        """Return the period of each port; without a grid, from the times of its rows."""
        periods = {key: facts.period_s or 0.0 for key, facts in self._facts.items()}
        steps = {key: Values(STEP_DECIMALS) for key, period in periods.items() if not period}
        last: dict[PortKey, Floats] = {}
        for key, seconds, _ in self._times() if steps else ():
            if key in steps and len(seconds):
                steps[key].add(np.diff(np.concatenate([last.get(key, np.empty(0)), seconds])))
                last[key] = seconds[-1:]
        return {**periods, **{key: some.median if some.n else 0.0 for key, some in steps.items()}}

    def _times(self) -> Iterator[tuple[PortKey, Floats, Counts]]:
        """Yield when the rows of each port were read, in s, and their UTC in microseconds."""
        clocks = {key: self.clock(key) for key in self._facts}
        for group in self._groups(TIMES):
            for key, rows in self._split(group):
                clock, times = clocks[key], micros(rows)
                seconds = clock.seconds(floats(rows["tick"]), times)
                late_us, scan_us = floats(rows["late_us"]), floats(rows["scan_us"])
                read_s = clock.read_s(seconds, times, late_us, scan_us)
                yield key, seconds if read_s is None else read_s, times

    def _pieces(self) -> Iterator[tuple[PortKey, Series]]:
        """Yield the rows of all ports; keep them for the next sweep if there are at most
        `most_rows`.

        In a run that grows, all sweeps see the rows of the first one.
        """
        if self._kept is not None:
            yield from self._kept
            return
        clocks = {key: self.clock(key) for key in self._facts}
        limits = self._rows
        rows, spans = dict.fromkeys(self._facts, 0), list[tuple[float, float] | None]()
        kept: list[tuple[PortKey, Series]] | None = None if self._is_long else []
        for group in gathered(self._groups(self._swept), len(self._facts)):
            found, places = sorted_by_port(group, self._facts)
            columns = _Columns.of(found, has_feeder=any(map(has_feeder, self._facts.values())))
            spans.append(None)
            for key, place in places:
                some = columns.rows(
                    place
                    if limits is None
                    else slice(place.start, min(place.stop, place.start + limits[key] - rows[key]))
                )
                rows[key] += len(some.ticks)
                piece = _series(self._facts[key], some, clocks[key], self._periods[key])
                if len(some.ticks):
                    self._last_s[key] = float(piece.seconds[-1])
                    spans[-1] = float(piece.seconds[0]), self._last_s[key]
                if kept is not None:
                    kept.append((key, piece))
                yield key, piece
            if sum(rows.values()) > self._most_rows:
                kept = None
        self._rows, self._kept, self._spans = rows, kept, spans

    def _some_pieces(
        self, taking: Mapping[PortKey, TakesRows]
    ) -> Iterator[tuple[PortKey, Series]] | None:
        """Return the needed rows of a single port on a grid that was read before; None if all rows
        must be read.
        """
        windows, *others = taking.values()
        on_grid = all(facts.period_s for facts in self._facts.values())
        is_alone = len(self._facts) == 1 and not others and on_grid
        if self._some is None or self._kept is not None or not is_alone:
            return None
        return self._needed(self._some, windows) if isinstance(windows, SeenWindows) else None

    def _needed(self, some: SomeGroups, windows: SeenWindows) -> Iterator[tuple[PortKey, Series]]:
        ((key, facts),) = self._facts.items()
        clock = self.clock(key)

        def is_needed(number: int) -> bool:
            span = self._spans[number] if number < len(self._spans) else None
            return span is not None and windows.needs(*span)

        for group in some(self._swept, is_needed):
            found, places = sorted_by_port(group, self._facts)
            columns = _Columns.of(found, has_feeder=has_feeder(facts))
            for _, place in places:
                yield key, _series(facts, columns.rows(place), clock, self._periods[key])

    def _split(self, group: pa.Table) -> Iterator[tuple[PortKey, pa.Table]]:
        """Yield the rows of each of these ports in a row group."""
        return ((key, rows) for key, rows in by_port(group) if key in self._facts)


class _Columns(NamedTuple):
    """Columns of rows sorted by port, made for all ports at once, because each step costs the same
    for few rows. Columns that were not read are empty.
    """

    utc_us: Counts
    ticks: Floats
    late_us: Floats
    scan_us: Floats
    temperature: Floats
    power: Floats
    setting: Floats
    working: Flags
    tool: Floats
    port_error: Floats
    known: Flags
    feeding: Floats

    @classmethod
    def of(cls, rows: pa.Table, *, has_feeder: bool) -> _Columns:
        names = ("temperature_c", "power_permille", "set_c", "tool", "port_error")
        temperature, power, setting, tool, port_error = (floats(rows[one]) for one in names)
        status = rows["status"]
        return cls(
            micros(rows),
            floats(rows["tick"]),
            floats(rows["late_us"]),
            floats(rows["scan_us"]),
            temperature,
            power,
            setting,
            is_one_of(status, WORKING),
            tool,
            port_error,
            _flags(pc.is_valid(status)),
            (floats(pc.equal(rows[MOTOR], PUSHING).cast(pa.int8())) if has_feeder else np.empty(0)),
        )

    def rows(self, place: slice) -> _Columns:
        return _Columns._make(column[place] for column in self)


def raw_series(facts: StationFacts, rows: pa.Table, clock: Clock, period_s: float = 0.0) -> Series:
    """Return rows of a port as a series; whether its tool was in its place needs the rows on both
    sides (`windows.placed`).

    `period_s` is the period of a port without a grid; 0: the median interval of these rows.
    """
    return _series(facts, _Columns.of(rows, has_feeder=has_feeder(facts)), clock, period_s)


def _series(facts: StationFacts, rows: _Columns, clock: Clock, period_s: float) -> Series:
    seconds = clock.seconds(rows.ticks, rows.utc_us)
    block = Block(
        seconds,
        rows.temperature,
        rows.power,
        rows.setting,
        rows.working,
        rows.tool,
        rows.port_error if has_tip(facts) else np.full(len(seconds), np.nan),
    )
    return Series(
        block,
        rows.known,
        facts.period_s or period_s or nominal_period(seconds),
        rows.feeding if has_feeder(facts) else None,
        facts.rated_power_w,
        on_grid=bool(facts.period_s),
        read_s=clock.read_s(seconds, rows.utc_us, rows.late_us, rows.scan_us),
    )


def micros(rows: pa.Table) -> Counts:
    """Return the times of these rows in UTC microseconds since 1970."""
    return np.asarray(rows["time"].cast(pa.int64()).to_numpy(), dtype=np.int64)


def floats(column: pa.ChunkedArray) -> Floats:
    """Return the column as floats, NaN where not read."""
    return np.asarray(column.cast(pa.float64()).to_numpy(), dtype=np.float64)


def _flags(column: pa.ChunkedArray) -> Flags:
    return np.asarray(column.to_numpy(), dtype=np.bool_)
