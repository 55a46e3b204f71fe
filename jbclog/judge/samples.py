"""Measures each port of a run in one pass over its sealed samples, holding ten minutes of each port at most.

Definitions. *Due*: the ticks at which the port's tip temperature was to be read, those that a stopped host
skipped included (`ledger`). *Coverage*: readings that are there, in per cent of those due. *Longest gap*: the
longest time without a temperature on the monotonic grid, missing ticks × period, beginning and end of the run
included. With ``--rate max`` there is no grid: then it is the longest time between two temperatures, in UTC less the
steps of the wall clock (`stepped`).
Of a station that tells no temperature the same holds of all that it tells (`judged_signals`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from jbclog.judge.idle import BLOCK_S, Block, Floats, IdleError, idle_readings
from jbclog.judge.stepped import Step, Unstepped, steps_of
from jbclog.rows import StationFacts

TEMPERATURE = "temperature_c"
COLUMNS = ["time", "tick", "station", "port", "temperature_c", "power_permille", "status", "set_c", "tool", "port_error"]
Counts = NDArray[np.int64]
WORKING = ("working", "on")
WITHOUT_TIP = ("jtse", "omega")  # families
BATCH_ROWS = 16_384


def judged_signals(facts: StationFacts) -> list[str]:
    """The signals that coverage and gaps are about: the temperature, or where there is none all that the station tells."""
    return [TEMPERATURE] if not facts.signals or TEMPERATURE in facts.signals else facts.signals


@dataclass(slots=True)
class PortMeasure:
    """What the samples of one port show. `gap_s` is None while nothing was read at all."""

    period_s: float | None
    start_s: float | None = None
    end_s: float | None = None
    rows: int = 0
    readings: int = 0  # of the signals that are judged
    idle: IdleError = field(default_factory=IdleError)
    gap_s: float | None = None
    _last_s: float | None = None
    _block: int = 0
    _held: list[Block] = field(default_factory=list)
    unstepped: Unstepped = field(default_factory=lambda: Unstepped([]))

    def feed(self, rows: Block, read: Counts) -> None:
        """Take the next rows of this port, in the order of their ticks, and how many readings each has."""
        if self.period_s is None:
            rows = replace(rows, seconds=self.unstepped.of(rows.seconds))
        if self.start_s is None:
            self.start_s = float(rows.seconds[0]) - (self.period_s or 0.0)
        self.end_s = float(rows.seconds[-1])
        self.rows += len(rows.seconds)
        self.readings += int(read.sum())
        self._widest(rows.seconds[read > 0])
        self._into_blocks(rows)

    def finish(self, last_due_s: float | None) -> None:
        """No more rows: count the end up to the last due tick, and the block that is still open."""
        self._close_block()
        end = max((moment for moment in (self.end_s, last_due_s) if moment is not None), default=None)
        if end is not None and self._last_s is not None:
            self._widest(np.array([end + (self.period_s or 0.0)]))

    def _widest(self, there: Floats) -> None:
        if not len(there):
            return
        before = self._last_s if self._last_s is not None else self.start_s
        steps = np.diff(np.append(there[0] if before is None else before, there)) - (self.period_s or 0.0)
        self.gap_s = round(max(self.gap_s or 0.0, float(steps.max())), 6)
        self._last_s = float(there[-1])

    def _into_blocks(self, rows: Block) -> None:
        numbers = np.floor_divide(rows.seconds + 1e-6, BLOCK_S).astype(np.int64)
        for number in np.unique(numbers):
            if int(number) != self._block:
                self._close_block()
                self._block = int(number)
            self._held.append(rows.take(numbers == number))

    def _close_block(self) -> None:
        if self._held:
            block = _joined(self._held)
            step = self.period_s or _typical_step(block.seconds)
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


def _typical_step(seconds: Floats) -> float:
    return float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0


Measures = dict[tuple[str, int], PortMeasure]


def measure(folder: Path, stations: dict[str, StationFacts]) -> Measures:
    """Measure every port of `stations` from ``folder/samples``. A port without any row is not in the answer."""
    measures: Measures = {}
    steps = [] if all(facts.period_s for facts in stations.values()) else steps_of(folder)
    signals = {name: judged_signals(facts) for name, facts in stations.items()}
    columns = [*COLUMNS, *sorted({name for names in signals.values() for name in names} - set(COLUMNS))]
    for batch in _batches(folder, columns):
        for station, port, rows, read in _ports(batch, stations, signals):
            if (station, port) not in measures:
                measures[station, port] = _new(stations[station], steps)
            measures[station, port].feed(rows, read)
    for (station, _), port_measure in measures.items():
        facts = stations[station]
        last = None if facts.last_tick is None or not facts.period_s else facts.last_tick * facts.period_s
        port_measure.finish(last)
    return measures


def _new(facts: StationFacts, steps: Sequence[Step]) -> PortMeasure:
    if not facts.period_s:
        return PortMeasure(None, unstepped=Unstepped(steps))
    start = None if facts.first_tick is None else (facts.first_tick - 1) * facts.period_s
    return PortMeasure(facts.period_s, start)


def _batches(folder: Path, columns: list[str]) -> Iterator[pa.RecordBatch]:
    for part in sorted((folder / "samples").glob("part-*.parquet")):
        with pq.ParquetFile(part) as file:
            for group in range(file.num_row_groups):  # over all of them at once it reads ahead
                yield from file.iter_batches(BATCH_ROWS, [group], columns, use_threads=False)


def _ports(
    batch: pa.RecordBatch, stations: dict[str, StationFacts], signals: dict[str, list[str]]
) -> Iterator[tuple[str, int, Block, Counts]]:
    """The rows of each known station and port in the batch, kept in their order, and how many judged readings each has."""
    names = batch.column("station").cast(pa.string()).dictionary_encode()
    ports = batch.column("port").to_numpy(zero_copy_only=False).astype(np.int64)
    keys = names.indices.to_numpy(zero_copy_only=False).astype(np.int64) * 16 + ports
    order = np.argsort(keys, kind="stable")
    columns = _columns(batch)
    for rows in np.split(order, np.flatnonzero(np.diff(keys[order])) + 1):
        if not len(rows):
            continue
        station = names.dictionary[int(keys[rows[0]]) // 16].as_py()
        if station in stations:
            there = sum((_is_there(batch, name)[rows] for name in signals[station]), np.zeros(len(rows), dtype=np.int64))
            block = columns.block(rows, stations[station].period_s, has_tip=stations[station].family not in WITHOUT_TIP)
            yield station, int(ports[rows[0]]), block, there


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

    def block(self, rows: NDArray[np.int64], period_s: float | None, *, has_tip: bool) -> Block:
        seconds = self.tick[rows] * period_s if period_s else self.utc_s[rows]
        read = (self.temperature[rows], self.power[rows], self.setting[rows], self.working[rows])
        return Block(seconds, *read, self.tool[rows], self.port_error[rows] if has_tip else np.full(len(rows), np.nan))


def _columns(batch: pa.RecordBatch) -> _Columns:
    status = batch.column("status").cast(pa.string())
    working = pc.fill_null(pc.is_in(status, value_set=pa.array(WORKING)), False)
    return _Columns(
        batch.column("time").cast(pa.int64()).to_numpy(zero_copy_only=False).astype(np.float64) / 1e6,
        _floats(batch, "tick"),
        _floats(batch, "temperature_c"),
        _floats(batch, "power_permille"),
        _floats(batch, "set_c"),
        working.to_numpy(zero_copy_only=False),
        _floats(batch, "tool"),
        _floats(batch, "port_error"),
    )


def _is_there(batch: pa.RecordBatch, name: str) -> Counts:
    """1 where the column has a value, 0 where it has none."""
    return np.asarray(pc.is_valid(batch.column(name)).to_numpy(zero_copy_only=False), dtype=np.int64)


def _floats(batch: pa.RecordBatch, name: str) -> Floats:
    """The column with NaN for what was not read."""
    return np.asarray(batch.column(name).cast(pa.float64()).to_numpy(zero_copy_only=False))
