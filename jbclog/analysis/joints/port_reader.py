"""The rows of ports from the row groups of a run's samples: of many ports at once, each group split once among them.

What fits into memory is read once and kept; else each sweep of `features.sweeps` reads the row groups anew, and of each port no
more than a window is in memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.joints.joints import Found
from jbclog.analysis.joints.parameters import Asked
from jbclog.analysis.joints.port_rows import PUSHING, WORKING, Clock, PortRows, series_of
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.sweeps import PortSweeps
from jbclog.analysis.verdict.idle import Flags, Floats
from jbclog.analysis.verdict.rules import has_tip
from jbclog.analysis.verdict.samples import Counts
from jbclog.core.rows import StationFacts

T = TypeVar("T")
Key = tuple[str, int]
"""Station and port."""
Groups = Callable[[], Iterable[pa.Table]]
"""Reads the row groups with the columns `port_rows.COLUMNS`; the same ones each time it is called."""


def at_once(some: Sequence[T], size: Callable[[T], int], most: int) -> Iterator[list[T]]:
    """As many together as have no more than `most` of that size; one of them at the least."""
    held: list[T] = []
    for one in some:
        if held and sum(map(size, [*held, one])) > most:
            yield held
            held = []
        held.append(one)
    if held:
        yield held


class PortReader:
    """The ports of stations with a period, none with a feeder, swept together."""

    def __init__(self, stations: Sequence[StationFacts], groups: Groups, most_rows: int) -> None:
        self._facts: dict[Key, StationFacts] = {(facts.name, port): facts for facts in stations for port in facts.ports}
        self._clocks = {facts.name: Clock(facts.period_s, (), 0) for facts in stations}
        self._groups, self._most_rows = groups, most_rows
        self._rows = dict.fromkeys(self._facts, 0)
        self._kept: list[tuple[Key, Series]] | None = None

    def joints(self, asked: Mapping[str, Asked]) -> Iterator[tuple[Key, Found, float]]:
        """The joints of each port, and the seconds that its rows stand for; `asked` by station."""
        ports = {key: PortSweeps(asked[facts.name]) for key, facts in self._facts.items()}
        while taking := {key: windows for key, port in ports.items() if (windows := port.next_sweep()) is not None}:
            for key, piece in self._pieces():
                taking[key].take(piece)
            for windows in taking.values():
                windows.end()
        for key, port in ports.items():
            yield key, port.found, self._rows[key] * (self._facts[key].period_s or 0.0)

    def _pieces(self) -> Iterator[tuple[Key, Series]]:
        """The rows of all ports, kept for the next sweep where there are no more than `most_rows`."""
        if self._kept is not None:
            yield from self._kept
            return
        self._rows = dict.fromkeys(self._facts, 0)
        kept: list[tuple[Key, Series]] | None = []
        for group in self._groups():
            for key, piece in self._split(group):
                self._rows[key] += len(piece.seconds)
                if kept is not None:
                    kept.append((key, piece))
                yield key, piece
            if sum(self._rows.values()) > self._most_rows:
                kept = None
        self._kept = kept

    def _split(self, group: pa.Table) -> Iterator[tuple[Key, Series]]:
        """The rows of each port in a row group."""
        for name in dict.fromkeys(name for name, _ in self._facts):
            of_station = only(group, pc.equal(group["station"], name))
            if not of_station.num_rows:
                continue
            for key, facts in self._facts.items():
                if key[0] == name and (rows := only(of_station, pc.equal(of_station["port"], key[1]))).num_rows:
                    yield key, raw_series(facts, port_rows_of(rows, self._clocks[name]))


def only(rows: pa.Table, wanted: pa.ChunkedArray) -> pa.Table:
    """The rows that are wanted; the same where all of them are."""
    return rows if pc.all(wanted).as_py() else rows.filter(wanted)


def raw_series(facts: StationFacts, rows: PortRows) -> Series:
    """As `series_of`, but whether the tool was in its place is left to whoever sees the rows beside these."""
    read = replace(rows, tool=np.full(len(rows.seconds), np.nan), port_error=np.full(len(rows.seconds), np.nan))
    series = series_of(facts, read)
    errors = rows.port_error if has_tip(facts) else read.port_error
    return replace(series, rows=replace(series.rows, tool=rows.tool, port_error=errors))


def port_rows_of(rows: pa.Table, clock: Clock) -> PortRows:
    """The rows of a port as arrays."""
    status, motor = rows["status"], rows["motor"]
    return PortRows(
        clock.seconds(floats(rows["tick"]), micros(rows)),
        floats(rows["temperature_c"]),
        floats(rows["power_permille"]),
        floats(rows["set_c"]),
        _flags(pc.fill_null(reduce(pc.or_, (pc.equal(status, word) for word in WORKING)), False)),
        _flags(pc.is_valid(status)),
        floats(pc.equal(motor, PUSHING).cast(pa.int8())),
        floats(rows["tool"]),
        floats(rows["port_error"]),
    )


def micros(rows: pa.Table) -> Counts:
    """The times of these rows in UTC microseconds since 1970."""
    return np.asarray(rows["time"].cast(pa.int64()).to_numpy(), dtype=np.int64)


def floats(column: pa.ChunkedArray) -> Floats:
    """With NaN for what was not read."""
    return np.asarray(column.cast(pa.float64()).to_numpy(), dtype=np.float64)


def _flags(column: pa.ChunkedArray) -> Flags:
    return np.asarray(column.to_numpy(), dtype=np.bool_)
