"""Measures each port of a run from its samples.

Definitions. *Due*: the ticks at which the port's tip temperature was to be read, with those that a
stopped host skipped (`ledger` in the manifest). *Coverage*: readings obtained / readings due.
*Longest gap*: that of the temperature's gaps (`analysis/gaps.py`); *gap of others*: the same as if
the readings that the computer skipped had been obtained. For a station without a temperature, all
its signals count (`judged_signals`): a row with one of them is a reading.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.clock_steps import (
    Step,
    Unstepped,
    nominal_period,
    steps_of,
)
from jbclog.analysis.gaps import (
    NOTHING,
    Missing,
    PortClock,
    SignalGaps,
    Why,
    in_order,
    why,
)
from jbclog.analysis.port_data import TEMPERATURE, WORKING, Counts, Flags, Floats, has_tip
from jbclog.analysis.verdict.idle import Block, IdleError, by_block, idle_readings
from jbclog.analysis.verdict.reached import WITHIN_C, Heat
from jbclog.core.rows import PortKey, StationFacts
from jbclog.record.samples_by_port import SamplesByPort, samples_by_port

COLUMNS = [
    "time",
    "tick",
    "station",
    "port",
    "quality",
    "reasons",
    "temperature_c",
    "power_permille",
    "status",
    "cooling",
    "setpoint_c",
    "tool",
    "port_error",
]
SKIPPED = "skipped"
NONE_CLOSER: Mapping[str, float] = MappingProxyType({})


def judged_signals(facts: StationFacts) -> list[str]:
    """Return the signals of coverage and gaps: the temperature, or all if a station has none."""
    return [TEMPERATURE] if not facts.signals or TEMPERATURE in facts.signals else facts.signals


@dataclass(slots=True)
class PortMeasure:
    """The measures of one port.

    `gaps`: of the judged signals; `gaps_of_others`: as if what the computer skipped was read.
    """

    period_s: float | None
    heat: Heat = field(default_factory=lambda: Heat(None))
    clock: PortClock = field(default_factory=lambda: PortClock(0.0), compare=False)
    rows: int = 0
    readings: int = 0  # number of readings of the judged signals
    idle: IdleError = field(default_factory=IdleError)
    host_skips: bool = False  # the computer skipped readings, or may have
    no_rows: bool = False  # ticks without rows are the computer's too
    gaps: SignalGaps = field(default_factory=SignalGaps, compare=False)
    gaps_of_others: SignalGaps = field(default_factory=SignalGaps, compare=False)
    _block: int = 0
    _held: list[Block] = field(default_factory=list)
    unstepped: Unstepped = field(default_factory=lambda: Unstepped([]))

    @property
    def gap_s(self) -> float | None:
        """Seconds of the longest gap; 0 without one, None before the first reading."""
        return self.gaps.longest_s if self.readings else None

    @property
    def lost_s(self) -> float | None:
        """Time of the most readings missing in one gap: what a gap has beyond the period that is
        between any two readings. Without a grid `gap_s`. None before the first reading.
        """
        return self._lost_s(self.gaps)

    @property
    def lost_of_others_s(self) -> float | None:
        """The same of `gaps_of_others`."""
        return self._lost_s(self.gaps_of_others)

    def _lost_s(self, gaps: SignalGaps) -> float | None:
        if not self.readings:
            return None
        return round(gaps.most_missing * self.period_s, 6) if self.period_s else gaps.longest_s

    @property
    def gap_of_others_s(self) -> float | None:
        """The same of `gaps_of_others`."""
        return self.gaps_of_others.longest_s if self.readings else None

    def feed(self, rows: pa.Table, facts: StationFacts) -> None:
        """Add the next rows of this port, oldest first."""
        marks = _marks(rows, facts)
        block = _block(rows, facts)
        read = np.zeros(len(rows), dtype=np.int64)
        for signal in judged_signals(facts):
            read += _valid(rows, signal)
        times_us = marks.times_us
        if self.unstepped.steps:
            times_us = np.rint(self.unstepped.of(times_us / 1e6) * 1e6).astype(np.int64)
        if self.period_s is None:
            block = replace(block, seconds=times_us / 1e6)
        self._add_gaps(times_us, read > 0, marks)
        self.rows += len(rows)
        self.readings += int(read.sum())
        self.heat.feed(replace(block, working=marks.at_work), marks.status)
        self._into_blocks(block)

    def _add_gaps(self, times_us: Counts, is_read: Flags, marks: Marks) -> None:
        times_us = self.clock.never_back(times_us)
        places, without_rows = self.clock.without_rows(times_us, marks.ticks)
        self.gaps.add(times_us, is_read, marks.missing(times_us, ~is_read, places, without_rows))
        is_read = is_read | (marks.skipped & self.host_skips)
        if not self.no_rows or not self.period_s:
            missing = marks.missing(times_us, ~is_read, places, without_rows)
            self.gaps_of_others.add(times_us, is_read, missing)
            return
        missing = marks.missing(times_us, ~is_read, places[:0], NOTHING)
        # as if the first and the last tick of each standstill had been read
        last_us = times_us[places] - round(self.period_s * 1e6)
        last_us = np.maximum(last_us, without_rows.due_us)
        added = np.stack([without_rows.due_us, last_us], axis=1).ravel()
        before = np.repeat(places, 2)
        times_us = np.insert(times_us, before, added)
        self.gaps_of_others.add(times_us, np.insert(is_read, before, True), missing)

    def finish(self, last_tick: int | None) -> None:
        """End the rows: close the open block, and count the time up to the last due tick."""
        self._close_block()
        last_due_s = None
        if last_tick is not None and self.period_s:
            last_due_s = last_tick * self.period_s
        self.heat.finish(last_due_s)
        after = self.clock.after(last_tick)
        self.gaps.end(after)
        self.gaps_of_others.end(NOTHING if self.no_rows else after)

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


Measures = dict[PortKey, PortMeasure]
Measuring = Callable[[Path, dict[str, StationFacts], Mapping[str, float]], Measures]
"""Measures the ports of stations as `measure` does."""


def measure(
    folder: Path, stations: dict[str, StationFacts], within_c: Mapping[str, float] = NONE_CLOSER
) -> Measures:
    """Return the measures of every port of `stations` that has rows in ``folder/samples``.

    `within_c`: how close to their setpoints a station's tools have to come, if not the default.
    """
    samples = samples_by_port(folder, columns_for(stations))
    return measures_of(samples, stations, steps_of(folder), within_c)


def columns_for(stations: Mapping[str, StationFacts]) -> list[str]:
    """Return the columns of samples that `measures_of` needs."""
    judged = [name for facts in stations.values() for name in judged_signals(facts)]
    return list(dict.fromkeys([*COLUMNS, *judged]))


def measures_of(
    samples: SamplesByPort,
    stations: Mapping[str, StationFacts],
    steps: Sequence[Step],
    within_c: Mapping[str, float] = NONE_CLOSER,
) -> Measures:
    """Return the measures of every port of `stations` that has rows, as `measure`; `steps` are
    those that the rows' times follow.
    """
    measures: Measures = {}
    for key in samples.ports:
        station, _ = key
        if station not in stations:
            continue
        facts = stations[station]
        port = _new(facts, steps, within_c.get(station, WITHIN_C))
        for rows in samples.rows(key):
            port.feed(rows, facts)
        if port.rows:
            port.finish(facts.last_tick)
            measures[key] = port
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
    return PortMeasure(
        facts.period_s,
        heat,
        PortClock(facts.period_s * 1e6, facts.first_tick),
        host_skips=facts.skipped_by_host is None or facts.skipped_by_host > 0,
        no_rows=facts.skipped > 0,
        unstepped=Unstepped(steps),
    )


@dataclass(frozen=True, slots=True)
class Marks:
    """For each row: its time and tick, why its judged signals were not read if they were not;
    whether its tick was skipped, its status was read, the tool was at work.
    """

    times_us: Counts
    ticks: Counts
    why: Why
    skipped: Flags
    status: Flags
    at_work: Flags

    def missing(
        self, times_us: Counts, is_missing: Flags, places: Counts, without_rows: Missing
    ) -> Missing:
        """Return the readings missing in these rows and before them, in order."""
        rows = np.flatnonzero(is_missing)
        return in_order(rows, self.why.missing(times_us, rows), places, without_rows)


def _marks(rows: pa.Table, facts: StationFacts) -> Marks:
    is_working = _is_one_of(rows["status"], WORKING)
    if has_tip(facts):  # hot air that cools has another status
        is_working = is_working & ~pc.fill_null(rows["cooling"], False).to_numpy()
    return Marks(
        rows["time"].cast(pa.int64()).to_numpy(),
        rows["tick"].to_numpy(),
        _why(rows, judged_signals(facts)),
        _is_one_of(rows["quality"], (SKIPPED,)),
        pc.is_valid(rows["status"]).to_numpy(),
        is_working,
    )


def _why(rows: pa.Table, signals: Sequence[str]) -> Why:
    """Return why each row has none of these signals: by its reasons, else by its quality."""
    named = why(_as_codes(rows["reasons"]), signals)
    quality = _as_codes(rows["quality"])
    words = [*named.words, *quality.dictionary.to_pylist()]
    codes = quality.indices.to_numpy().astype(np.int64) + len(named.words)
    return Why(np.where(named.codes >= 0, named.codes, codes), words)


def _as_codes(texts: pa.ChunkedArray) -> pa.DictionaryArray:
    return texts.combine_chunks().dictionary_encode()


def _is_one_of(texts: pa.ChunkedArray, words: Sequence[str]) -> Flags:
    return np.asarray(pc.is_in(texts, pa.array(words)).to_numpy(), dtype=np.bool_)


def _block(rows: pa.Table, facts: StationFacts) -> Block:
    if facts.period_s:
        seconds = rows["tick"].to_numpy() * facts.period_s
    else:
        seconds = rows["time"].cast(pa.int64()).to_numpy() / 1e6
    no_errors = np.full(len(rows), np.nan)
    return Block(
        np.asarray(seconds, dtype=np.float64),
        _floats(rows, "temperature_c"),
        _floats(rows, "power_permille"),
        _floats(rows, "setpoint_c"),
        _is_one_of(rows["status"], WORKING),
        _floats(rows, "tool"),
        _floats(rows, "port_error") if has_tip(facts) else no_errors,
    )


def _valid(batch: pa.Table, name: str) -> Counts:
    """Return 1 for each row with a value in this column, 0 for a null."""
    return np.asarray(pc.is_valid(batch.column(name)).to_numpy(), dtype=np.int64)


def _floats(batch: pa.Table, name: str) -> Floats:
    return np.asarray(batch.column(name).cast(pa.float64()).to_numpy())
