"""The units of a run as a table: when each was on the bench, and what the stations did meanwhile.

Joints belong to the unit in which they begin, alarms to every unit in which they were on. Energy is
the integral of the power (trapezoids) between the first and the last reading of each port, divided
where a unit comes or goes. What a gap of more than one reading may hide is null, not too small, and
so is what a crash may have cut off after the last reading.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from jbclog.analysis.alarms.match import Incident
from jbclog.analysis.alarms.state_machine import Detector
from jbclog.analysis.derived_schemas import UNITS_SCHEMA
from jbclog.analysis.run_alarms import Alarms
from jbclog.analysis.run_metrics import Measures
from jbclog.analysis.run_tables import RunTables
from jbclog.record.schema import TIME

READINGS: Final = ("temperature_c", "power_permille")
COLUMNS: Final = ["time", "tick", "reasons", *READINGS]
FOREVER: Final = np.iinfo(np.int64).max

Micros = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(slots=True)
class _Stays:
    """Units with known times: begin and end of each, UTC in µs, in order and without overlap, and
    the sums over the ports.
    """

    start_us: Micros
    stop_us: Micros
    due: Micros = field(init=False)
    obtained: Micros = field(init=False)
    energy_j: Floats = field(init=False)
    has_gap: NDArray[np.bool_] = field(init=False)
    has_power: NDArray[np.bool_] = field(init=False)
    is_rated: bool = True

    def __post_init__(self) -> None:
        number = len(self.start_us)
        self.due, self.obtained = np.zeros((2, number), dtype=np.int64)
        self.energy_j = np.zeros(number)
        self.has_gap, self.has_power = np.zeros((2, number), dtype=np.bool_)

    def counts(self, times_us: Micros, weights: Micros | None = None) -> Micros:
        """Return how many of these moments are in each unit, or the sums of their weights."""
        if not len(self.start_us):
            return np.zeros(0, dtype=np.int64)
        place = np.searchsorted(self.start_us, times_us, side="right") - 1
        inside = (place >= 0) & (times_us < self.stop_us[place])
        own = None if weights is None else weights[inside]
        counts = np.bincount(place[inside], own, minlength=len(self.start_us))
        return counts.astype(np.int64)

    def overlapping(self, first_us: int, last_us: int) -> slice:
        """Return the units that have some of this time."""
        begin = int(np.searchsorted(self.stop_us, first_us, side="right"))
        return slice(begin, int(np.searchsorted(self.start_us, last_us, side="right")))


class _Signal:
    """One signal of a port: its readings due and obtained, and its integral, piece by piece."""

    def __init__(self, stays: _Stays, name: str, rated_w: float | None) -> None:
        self._stays, self._name, self._rated_w = stays, name, rated_w
        self._is_power = name == READINGS[1]
        self._before: tuple[Micros, Floats] = np.empty(0, np.int64), np.empty(0)

    def take(self, rows: pa.Table, times_us: Micros, ticks: Micros) -> None:
        """Add the next rows with their times, and the ticks since the row before: those without a
        row were due, too.
        """
        stays = self._stays
        read = rows[self._name].is_valid().to_numpy()
        named = pc.match_substring(rows["reasons"], f"{self._name}=")
        due = read | pc.fill_null(named, False).to_numpy()
        in_each = stays.counts(times_us[read])
        stays.due += stays.counts(times_us[due], ticks[due])
        stays.obtained += in_each
        if self._is_power and read.any():
            stays.has_power |= in_each > 0
            stays.is_rated &= self._rated_w is not None
            values = rows[self._name].drop_null().cast(pa.float64()).to_numpy()
            self._integrate(times_us[read], values)

    def _integrate(self, times_us: Micros, values: Floats) -> None:
        times = np.concatenate([self._before[0], times_us])
        powers = np.concatenate([self._before[1], values])
        self._before = times[-1:], powers[-1:]
        if len(times) < 2 or self._rated_w is None:
            return
        watts = powers * self._rated_w / 1000
        steps_j = (watts[1:] + watts[:-1]) / 2 * np.diff(times) / 1e6
        total_j = np.concatenate([[0.0], np.cumsum(steps_j)])
        some = self._stays.overlapping(int(times[0]), int(times[-1]))
        edges = (self._stays.start_us[some], self._stays.stop_us[some])
        begin, end = (
            np.interp(np.clip(edge, times[0], times[-1]) - times[0], times - times[0], total_j)
            for edge in edges
        )
        self._stays.energy_j[some] += end - begin


def units_of(run: RunTables, measures: Measures, alarms: Alarms, gaps: pa.Table) -> pa.Table:
    """Return a row for each unit, in the order of `RunTables.unit_times`, with what was done in
    its time; all of it null for a unit whose start or stop is not known. Raises `RecordError`.
    """
    times = run.unit_times()
    is_timed = times["start"].notna() & times["stop"].notna()
    timed = times[is_timed]
    start_us = np.asarray(timed["start"].astype("int64"), dtype=np.int64)
    stop_us = np.asarray(timed["stop"].astype("int64"), dtype=np.int64)
    stays = _Stays(start_us, stop_us)
    if len(start_us):
        last_us = _add_samples(run, stays)
        if run.manifest.lost is not None and last_us is not None:
            stays.has_gap[stays.overlapping(last_us, FOREVER)] = True
        for begin_us, end_us in _hiding(gaps):
            stays.has_gap[stays.overlapping(begin_us, end_us)] = True
    is_known = bool(measures.with_joints) and not measures.doubtful
    joints_us = measures.joints["start"].cast(pa.int64()).to_numpy()
    on = np.zeros(len(start_us), dtype=np.int64)
    for begin_us, end_us in _times_on(alarms.incidents):
        on[stays.overlapping(begin_us, end_us)] += 1
    with np.errstate(invalid="ignore"):
        coverage = np.round(100.0 * stays.obtained / stays.due, 3)
    columns = {
        "joints": _masked(stays.counts(joints_us), stays.has_gap | (not is_known)),
        "energy_j": _masked(
            np.round(stays.energy_j, 3), stays.has_gap | ~stays.has_power | (not stays.is_rated)
        ),
        "coverage": _masked(coverage, stays.due == 0),
        "alarms": _masked(on, np.zeros(len(on), dtype=np.bool_)),
    }
    places = pd.Series(np.arange(len(timed)), index=timed.index).reindex(times.index)
    rows = pa.array(places.astype("Int64"), pa.int64())
    return pa.table(
        [
            pa.array([run.manifest.run] * len(times), pa.utf8()),
            pa.array(times["unit"], pa.utf8()),
            *(pa.array(times[name], TIME) for name in ("start", "stop")),
            *(columns[name].take(rows) for name in UNITS_SCHEMA.names[4:]),
        ],
        schema=UNITS_SCHEMA,
    )


def _add_samples(run: RunTables, stays: _Stays) -> int | None:
    """Add the readings of all ports. Return the time of the last row of the port whose rows end
    first, in µs; None without rows.
    """
    rated = {facts.name: facts.rated_power_w for facts in run.stations}
    lasts_us: list[int] = []
    samples = run.samples_by_port(COLUMNS)
    for key in samples.ports:
        signals = [_Signal(stays, name, rated.get(key[0])) for name in READINGS]
        last_us: int | None = None
        last_tick: int | None = None
        for rows in samples.rows(key):
            times_us = rows["time"].cast(pa.int64()).to_numpy()
            ticks = np.asarray(rows["tick"].to_numpy(), dtype=np.int64)
            before = int(ticks[0]) - 1 if last_tick is None else last_tick
            last_tick = int(ticks[-1])
            last_us = int(times_us[-1])
            for signal in signals:
                signal.take(rows, times_us, np.diff(ticks, prepend=before))
        if last_us is not None:
            lasts_us.append(last_us)
    return min(lasts_us, default=None)


def _hiding(gaps: pa.Table) -> Iterator[tuple[int, int]]:
    """Yield from when to when each gap is that can hide something, UTC in µs: a single missing
    reading cannot.
    """
    is_of_these = pc.is_in(gaps["signal"], pa.array(READINGS))
    hiding = gaps.filter(pc.and_(is_of_these, pc.not_equal(gaps["missing"], 1)))
    starts, stops = (hiding[name].cast(pa.int64()).to_pylist() for name in ("start", "stop"))
    yield from zip(starts, stops, strict=True)


def _times_on(incidents: Iterable[Incident]) -> Iterator[tuple[int, int]]:
    """Yield from when to when each alarm was on, UTC in µs; excursions are none."""
    for incident in incidents:
        those = [one for one in incident.episodes if one.detector is not Detector.AFTERWARDS]
        begins = [one.onset_us for one in those if one.onset_us is not None]
        if begins:
            ends = [FOREVER if one.end_us is None else one.end_us for one in those]
            yield min(begins), max(ends)


def _masked(values: NDArray[np.int64] | Floats, is_null: NDArray[np.bool_]) -> pa.Array:
    return pa.array(values, mask=is_null)
