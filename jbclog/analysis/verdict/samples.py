"""Measures each port of a run in one pass over its sealed samples.

Definitions. *Due*: the ticks at which the port's tip temperature was to be read, with those that a
stopped host skipped (`ledger` in the manifest). *Coverage*: readings obtained / readings due.
*Longest gap*: the longest time without a temperature on the monotonic grid, missing ticks × period,
including start and end of the run; *gap of others*: the same as if the readings that the computer
skipped had been obtained. With ``--rate max`` there is no grid: then it is the longest time between
two temperatures, in UTC less the steps of the wall clock (`clock_steps.py`). For a station without
a temperature, all its signals count (`judged_signals`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from jbclog.analysis.coded_texts import is_one_of
from jbclog.analysis.port_split import gathered, sorted_by_port
from jbclog.analysis.verdict.clock_steps import (
    Step,
    Unstepped,
    nominal_period,
    steps_in,
    steps_of,
)
from jbclog.analysis.verdict.idle import Block, Flags, Floats, IdleError, by_block, idle_readings
from jbclog.analysis.verdict.reached import WITHIN_C, Heat
from jbclog.core.rows import StationFacts
from jbclog.record.part_file import open_part

TEMPERATURE = "temperature_c"
COLUMNS = [
    "time",
    "tick",
    "station",
    "port",
    "quality",
    "temperature_c",
    "power_permille",
    "status",
    "cooling",
    "set_c",
    "tool",
    "port_error",
]
Counts = NDArray[np.int64]
WORKING = ("working", "on")
SKIPPED = "skipped"
WITHOUT_TIP = ("jtse", "omega")  # families
BATCH_ROWS = 16_384


def judged_signals(facts: StationFacts) -> list[str]:
    """Return the signals of coverage and gaps: the temperature, or all if a station has none."""
    return [TEMPERATURE] if not facts.signals or TEMPERATURE in facts.signals else facts.signals


@dataclass(slots=True)
class Gap:
    """Longest time between two readings, minus the period; `widest_s` is None before the first
    reading.

    `start_s`: from when the time counts, known with the first row.
    """

    period_s: float
    start_s: float | None = None
    last_s: float | None = None
    widest_s: float | None = None

    def take(self, seconds: Floats) -> None:
        """Add the times of the next readings, oldest first."""
        if not len(seconds):
            return
        before = self.last_s if self.last_s is not None else self.start_s
        steps = (
            np.diff(np.append(seconds[0] if before is None else before, seconds)) - self.period_s
        )
        self.widest_s = round(max(self.widest_s or 0.0, float(steps.max())), 6)
        self.last_s = float(seconds[-1])

    def end(self, end_s: float) -> None:
        """Add the last time at which a reading was due."""
        if self.last_s is not None:
            self.take(np.array([end_s + self.period_s]))


@dataclass(slots=True)
class PortMeasure:
    """The measures of one port. `gap_s` is None before the first reading."""

    period_s: float | None
    heat: Heat = field(default_factory=lambda: Heat(None))
    start_s: float | None = None
    end_s: float | None = None
    rows: int = 0
    readings: int = 0  # number of readings of the judged signals
    idle: IdleError = field(default_factory=IdleError)
    host_skips: bool = False  # the computer skipped readings, or may have
    no_rows: bool = False  # ticks without rows are the computer's too
    _gap: Gap = field(default_factory=lambda: Gap(0.0))
    _of_others: Gap = field(default_factory=lambda: Gap(0.0))
    _block: int = 0
    _held: list[Block] = field(default_factory=list)
    unstepped: Unstepped = field(default_factory=lambda: Unstepped([]))

    @property
    def gap_s(self) -> float | None:
        return self._gap.widest_s

    @property
    def gap_of_others_s(self) -> float | None:
        return self._of_others.widest_s

    def feed(self, rows: Block, read: Counts, marks: Marks) -> None:
        """Add the next rows of this port, oldest first, with their numbers of judged readings."""
        if self.period_s is None:
            rows = replace(rows, seconds=self.unstepped.of(rows.seconds))
        if self.start_s is None:
            self.start_s = float(rows.seconds[0]) - (self.period_s or 0.0)
        for gap in (self._gap, self._of_others):
            gap.period_s, gap.start_s = self.period_s or 0.0, self.start_s
        self._gap.take(rows.seconds[read > 0])
        self._of_others.take(
            self._without_host(rows.seconds, (read > 0) | (marks.skipped & self.host_skips))
        )
        self.end_s = float(rows.seconds[-1])
        self.rows += len(rows.seconds)
        self.readings += int(read.sum())
        self.heat.feed(replace(rows, working=marks.at_work), marks.status)
        self._into_blocks(rows)

    def _without_host(self, seconds: Floats, is_read: Flags) -> Floats:
        """Return the times of readings as if the ticks without a row had been read too."""
        if not self.no_rows or not self.period_s:
            return seconds[is_read]
        before = self.end_s if self.end_s is not None else (self.start_s or 0.0)
        missing = np.rint(np.diff(np.append(before, seconds)) / self.period_s).astype(np.int64) - 1
        places = np.flatnonzero(missing > 0)
        added = [
            seconds[place] - np.arange(missing[place], 0, -1) * self.period_s for place in places
        ]
        return np.asarray(
            np.union1d(seconds[is_read], np.concatenate([*added, np.empty(0)])), dtype=np.float64
        )

    def finish(self, last_due_s: float | None) -> None:
        """End the rows: close the open block, and count the time up to the last due tick."""
        self._close_block()
        self.heat.finish(last_due_s)
        end = max(
            (moment for moment in (self.end_s, last_due_s) if moment is not None), default=None
        )
        if end is not None:
            self._gap.end(end)
            self._of_others.end(self.end_s if self.no_rows and self.end_s is not None else end)

    def _into_blocks(self, rows: Block) -> None:
        for number, own in by_block(rows.seconds):
            if number != self._block:
                self._close_block()
                self._block = number
            self._held.append(rows.take(own))

    def _close_block(self) -> None:
        if self._held:
            block = _joined(self._held)
            step = self.period_s or nominal_period(block.seconds)
            self.idle.add(*idle_readings(block, step), step)
            self._held.clear()


def _joined(blocks: list[Block]) -> Block:
    return Block(
        np.concatenate([block.seconds for block in blocks]),
        np.concatenate([block.temperature for block in blocks]),
        np.concatenate([block.power for block in blocks]),
        np.concatenate([block.setting for block in blocks]),
        np.concatenate([block.working for block in blocks]),
        np.concatenate([block.tool for block in blocks if block.tool is not None]),
        np.concatenate([block.port_error for block in blocks if block.port_error is not None]),
    )


Measures = dict[tuple[str, int], PortMeasure]
Measuring = Callable[[Path, dict[str, StationFacts], Mapping[str, float]], Measures]
"""Measures the ports of stations as `measure` does."""
Groups = Callable[[str, list[str]], Iterable[pa.Table]]


def measure(
    folder: Path,
    stations: dict[str, StationFacts],
    within_c: Mapping[str, float] = MappingProxyType({}),
    groups: Groups | None = None,
) -> Measures:
    """Return the measures of every port of `stations` that has rows in ``folder/samples``.

    `groups` reads the rows of a run that is not in a folder. `within_c`: how close to their
    setpoints a station's tools have to come, if not the default.
    """
    measures: Measures = {}
    on_grid = all(facts.period_s for facts in stations.values())
    steps = [] if on_grid else _steps(folder, groups)
    signals = {name: judged_signals(facts) for name, facts in stations.items()}
    columns = [
        *COLUMNS,
        *sorted({name for names in signals.values() for name in names} - set(COLUMNS)),
    ]
    batches = _batches(folder, columns) if groups is None else _cut(groups("samples", columns))
    if on_grid:  # else each batch has its own period
        batches = gathered(batches, sum(len(facts.ports) for facts in stations.values()))
    for batch in batches:
        for station, port, rows, read, marks in _ports(batch, stations, signals):
            if (station, port) not in measures:
                measures[station, port] = _new(
                    stations[station], steps, within_c.get(station, WITHIN_C)
                )
            measures[station, port].feed(rows, read, marks)
    for (station, _), port_measure in measures.items():
        facts = stations[station]
        last = (
            None
            if facts.last_tick is None or not facts.period_s
            else facts.last_tick * facts.period_s
        )
        port_measure.finish(last)
    return measures


class KeptMeasures:
    """Caches what `measure` returns for the stations of a sealed run, with the same limit."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, float], Measures] = {}

    def __call__(
        self,
        folder: Path,
        stations: dict[str, StationFacts],
        within_c: Mapping[str, float],
    ) -> Measures:
        """Return the measures of every port of `stations`, computing only those of new stations."""
        keys = {name: (name, within_c.get(name, WITHIN_C)) for name in stations}
        lacking = {name: facts for name, facts in stations.items() if keys[name] not in self._kept}
        found = measure(folder, lacking, within_c) if lacking else {}
        for name in lacking:
            self._kept[keys[name]] = {
                place: one for place, one in found.items() if place[0] == name
            }
        return {place: one for key in keys.values() for place, one in self._kept[key].items()}


def _new(facts: StationFacts, steps: Sequence[Step], within_c: float) -> PortMeasure:
    heat = Heat(facts.period_s or None, within_c)
    if not facts.period_s:
        return PortMeasure(None, heat, unstepped=Unstepped(steps))
    start = None if facts.first_tick is None else (facts.first_tick - 1) * facts.period_s
    skips = facts.skipped_by_host is None or facts.skipped_by_host > 0
    return PortMeasure(facts.period_s, heat, start, host_skips=skips, no_rows=facts.skipped > 0)


def _steps(folder: Path, groups: Groups | None) -> list[Step]:
    if groups is None:
        return steps_of(folder)
    return [
        step for events in groups("events", ["time", "kind", "value"]) for step in steps_in(events)
    ]


def _cut(pieces: Iterable[pa.Table]) -> Iterator[pa.Table]:
    return (
        pa.Table.from_batches([batch])
        for piece in pieces
        for batch in piece.to_batches(max_chunksize=BATCH_ROWS)
    )


def _batches(folder: Path, columns: list[str]) -> Iterator[pa.Table]:
    for part in sorted((folder / "samples").glob("part-*.parquet")):
        with open_part(part, coded=["station", "quality", "status"]) as table:
            for batch in table.batches(BATCH_ROWS, columns):
                yield pa.Table.from_batches([batch])


def _ports(
    batch: pa.Table, stations: dict[str, StationFacts], signals: dict[str, list[str]]
) -> Iterator[tuple[str, int, Block, Counts, Marks]]:
    """Yield the rows of each known station and port in a batch, with the number of judged readings
    in each row.
    """
    found, places = sorted_by_port(batch)
    columns = _columns(found) if places else None
    valid = {name: _valid(found, name) for names in signals.values() for name in names}
    for (station, port), rows in places:
        if columns is not None and station in stations:
            read = sum(
                (valid[name][rows] for name in signals[station]),
                np.zeros(rows.stop - rows.start, dtype=np.int64),
            )
            has_tip = stations[station].family not in WITHOUT_TIP
            block = columns.block(rows, stations[station].period_s, has_tip=has_tip)
            yield station, port, block, read, columns.marks(rows, has_tip=has_tip)


@dataclass(frozen=True, slots=True)
class Marks:
    """For each row: whether its tick was skipped, its status was read, the tool was at work."""

    skipped: Flags
    status: Flags
    at_work: Flags


@dataclass(frozen=True, slots=True)
class _Columns:
    utc_s: Floats
    tick: Floats
    temperature: Floats
    power: Floats
    setting: Floats
    working: NDArray[np.bool_]
    tool: Floats
    port_error: Floats
    skipped: Flags
    status: Flags
    cooling: Flags  # a tip is in its extractor

    def marks(self, rows: slice, *, has_tip: bool) -> Marks:
        in_extractor = self.cooling[rows] & has_tip  # hot air that cools has another status
        return Marks(self.skipped[rows], self.status[rows], self.working[rows] & ~in_extractor)

    def block(self, rows: slice, period_s: float | None, *, has_tip: bool) -> Block:
        seconds = self.tick[rows] * period_s if period_s else self.utc_s[rows]
        read = (self.temperature[rows], self.power[rows], self.setting[rows], self.working[rows])
        return Block(
            seconds,
            *read,
            self.tool[rows],
            self.port_error[rows] if has_tip else np.full(len(seconds), np.nan),
        )


def _columns(batch: pa.Table) -> _Columns:
    status = batch.column("status")
    return _Columns(
        batch.column("time").cast(pa.int64()).to_numpy().astype(np.float64) / 1e6,
        _floats(batch, "tick"),
        _floats(batch, "temperature_c"),
        _floats(batch, "power_permille"),
        _floats(batch, "set_c"),
        is_one_of(status, WORKING),
        _floats(batch, "tool"),
        _floats(batch, "port_error"),
        is_one_of(batch.column("quality"), (SKIPPED,)),
        pc.is_valid(status).to_numpy(),
        pc.fill_null(batch.column("cooling"), False).to_numpy(),
    )


def _valid(batch: pa.Table, name: str) -> Counts:
    """Return 1 for each row with a value in this column, 0 for a null."""
    return np.asarray(pc.is_valid(batch.column(name)).to_numpy(), dtype=np.int64)


def _floats(batch: pa.Table, name: str) -> Floats:
    return np.asarray(batch.column(name).cast(pa.float64()).to_numpy())
