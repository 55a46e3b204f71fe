"""What alarm episodes are computed from: one pass over a run's samples, and the alarm events of each port."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, cast

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from jbclog.analysis.alarms import BEFORE_ALL, WATCHED, Change, FlagRead, Rows, change_of
from jbclog.analysis.run_tables import RunTables
from jbclog.analysis.verdict.samples import Step, Unstepped
from jbclog.core.rows import EventRow, Severity
from jbclog.record.parts import groups_of, part_paths
from jbclog.record.sealed_files import expect_unchanged

Place = tuple[str, int]
"""Station and port."""

COLUMNS: Final = ["time", "tick", "station", "port", "temperature_c", "status", "set_c", "alarm_high", "alarm_low"]
CLOCK_STEP: Final = "clock.step"


def pieces(run: RunTables) -> Iterator[pa.Table]:
    """The samples piece by piece, in order; of a sealed run only one is in memory at a time."""
    manifest = run.manifest
    if manifest.state != "sealed":
        yield from run.pieces("samples", COLUMNS)
        return
    parts = part_paths(run.folder, "samples")
    expect_unchanged(run.folder, manifest, "samples", parts)
    yield from groups_of(parts, COLUMNS)


@dataclass(slots=True)
class Told:
    """What the events and settings of a run say: of each port its alarm events and what changed; the steps of the clock.

    `changes` have their times less the steps before them.
    """

    events: dict[Place, list[EventRow]] = field(default_factory=dict)
    changes: dict[Place, list[Change]] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)


def told_by(run: RunTables) -> Told:
    """Read events and settings once."""
    told, stepped_us = Told(), 0
    events = [*_events(run.events())]
    for event in events:
        if event.kind == CLOCK_STEP and event.value:
            stepped_us += round(event.value * 1e6)
            told.steps.append(Step(event.time / 1e6, event.value))
        elif event.station is not None and event.port is not None:
            place = event.station, event.port
            told.events.setdefault(place, []).append(event)
            change = change_of(event.kind, event.time - stepped_us, event.raw)
            if change is not None:
                told.changes.setdefault(place, []).append(change)
    for place, changes in _settings(run.settings()).items():
        told.changes[place] = [*changes, *told.changes.get(place, ())]
    return told


def _events(frame: pd.DataFrame) -> Iterator[EventRow]:
    """Those that alarms are about, in their order."""
    kinds = frame["kind"]
    wanted = frame[kinds.str.startswith("alarm.") | kinds.isin(["setting.changed", "tool.changed", CLOCK_STEP])]
    times, earliest = micros(wanted["time"]), micros(wanted["earliest"])
    columns = (wanted[name] for name in ("kind", "severity", "text", "station", "port", "value", "limit", "raw"))
    for time, early, kind, severity, text, station, port, value, limit, raw in zip(times, earliest, *columns, strict=True):
        yield EventRow(
            cast(int, time),
            kind,
            Severity(severity),
            text,
            _or_none(station),
            None if pd.isna(port) else int(port),
            early,
            value=None if pd.isna(value) else float(value),
            limit=None if pd.isna(limit) else float(limit),
            raw=_or_none(raw),
        )


def _or_none(text: object) -> str | None:
    return text if isinstance(text, str) else None


def _settings(frame: pd.DataFrame) -> dict[Place, list[Change]]:
    """What each port held when its sampling began: these settings are told before its first row, and then only as events."""
    found: dict[Place, list[Change]] = {}
    wanted = frame[frame["setting"].isin([*WATCHED]) & frame["port"].notna() & frame["readback"].notna()]
    for station, port, name, text in zip(*(wanted[name] for name in ("station", "port", "setting", "readback")), strict=True):
        found.setdefault((str(station), int(port)), []).append(Change(BEFORE_ALL, str(name), str(text)))
    return found


def micros(times: pd.Series) -> list[int | None]:
    """UTC microseconds; None where there is no time."""
    numbers = times.astype("datetime64[us, UTC]").astype("int64").tolist()
    return [None if gone else number for number, gone in zip(numbers, times.isna(), strict=True)]


class Piece(NamedTuple):
    """The rows of one port in one piece of the samples."""

    place: Place
    rows: Rows
    flags: list[FlagRead]


class Ports:
    """Takes the samples apart by station and port, in their order. `flags_of`: the ports whose flags are wanted, too.

    `t0_utc` is the run's zero by the wall clock as it was then, `periods` the grids of the stations: a first row that lies off
    its grid by the size of a step came behind it.
    """

    def __init__(
        self, steps: Sequence[Step], flags_of: frozenset[Place], t0_utc: float | None, periods: Mapping[str, float | None]
    ) -> None:
        self._steps = steps
        self._t0_utc = t0_utc
        self._periods = periods
        self._flags_of = flags_of
        self._unstepped: dict[Place, Unstepped] = {}
        self._stepped_us: dict[Place, int] = {}
        self._before_us: dict[Place, int] = {}

    def of(self, piece: pa.Table) -> Iterator[Piece]:
        """The ports that have rows in this piece."""
        names = piece["station"].cast(pa.string()).combine_chunks().dictionary_encode()
        ports = piece["port"].to_numpy().astype(np.int64)
        keys = np.asarray(names.indices.to_numpy(zero_copy_only=False)).astype(np.int64) * 16 + ports
        for key in np.unique(keys):
            mine = piece.take(pa.array(np.flatnonzero(keys == key)))
            place = names.dictionary[int(key) // 16].as_py(), int(key) % 16
            yield Piece(place, self._rows(place, mine), self._flags(mine) if place in self._flags_of else [])

    def _rows(self, place: Place, mine: pa.Table) -> Rows:
        times = mine["time"].cast(pa.int64()).to_numpy()
        columns = (values(mine[name]) for name in ("temperature_c", "status", "set_c"))
        temperature, status, setting = columns
        steps = self._steps_in(place, times, mine["tick"][0].as_py()) if self._steps else {}
        return Rows(times.tolist(), mine["tick"].to_numpy().tolist(), temperature, status, setting, steps)  # type: ignore[arg-type]

    def _steps_in(self, place: Place, times: NDArray[np.int64], tick: int) -> dict[int, int]:
        """By how much the clock was stepped just before which of these rows."""
        seconds = times.astype(np.float64) / 1e6
        if place not in self._unstepped:
            number = self._steps_before(place[0], float(seconds[0]), tick)
            self._unstepped[place] = Unstepped(self._steps[number:])
            self._before_us[place] = round(sum(step.size_s for step in self._steps[:number]) * 1e6)
        stepped = np.rint((seconds - self._unstepped[place].of(seconds)) * 1e6).astype(np.int64) + self._before_us[place]
        sizes = np.diff(stepped, prepend=self._stepped_us.get(place, 0))
        self._stepped_us[place] = int(stepped[-1])
        return {int(row): int(sizes[row]) for row in np.flatnonzero(np.abs(sizes) > 1000)}

    def _steps_before(self, station: str, first_s: float, tick: int) -> int:
        """How many steps came before the first row of a port: as many as bring it nearest to its grid."""
        period_s = self._periods.get(station)
        if period_s is None or self._t0_utc is None:
            return 0
        sums = np.concatenate([[0.0], np.cumsum([step.size_s for step in self._steps])])
        return int(np.argmin(np.abs(first_s - (self._t0_utc + tick * period_s) - sums)))

    @staticmethod
    def _flags(mine: pa.Table) -> list[FlagRead]:
        read = mine.select(["time", "alarm_high", "alarm_low"]).filter(mine["alarm_high"].is_valid())
        times = read["time"].cast(pa.int64()).to_pylist()
        return [*map(FlagRead, times, read["alarm_high"].to_pylist(), read["alarm_low"].to_pylist())]


def values(column: pa.ChunkedArray) -> list[object]:
    """The column as a list with None for what was not read; quick where it is long."""
    array = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    if isinstance(array, pa.ChunkedArray):
        array = pa.concat_arrays(array.chunks)
    if pa.types.is_string(array.type) or pa.types.is_large_string(array.type):
        array = array.dictionary_encode()
    if pa.types.is_dictionary(array.type):
        words = array.dictionary.to_pylist()
        return [None if code is None else words[code] for code in values(array.indices)]
    if not array.null_count:
        return cast(list[object], array.to_numpy(zero_copy_only=False).tolist())
    found: list[object] = [None] * len(array)
    there = np.flatnonzero(array.is_valid().to_numpy(zero_copy_only=False))
    for place, value in zip(there.tolist(), array.drop_null().to_numpy(zero_copy_only=False).tolist(), strict=True):
        found[place] = value
    return found
