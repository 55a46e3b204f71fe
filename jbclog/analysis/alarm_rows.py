"""Input of the alarm detectors from a run's tables: the samples in one pass, and the alarm events
of each port.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, cast

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from jbclog.analysis.alarms.from_record import FlagRead, Rows
from jbclog.analysis.alarms.live import change_of
from jbclog.analysis.alarms.port_watch import BEFORE_ALL, WORKING, Change
from jbclog.analysis.alarms.state_machine import WATCHED
from jbclog.analysis.coded_texts import is_one_of
from jbclog.analysis.port_split import by_port
from jbclog.analysis.run_tables import RunTables
from jbclog.analysis.verdict.clock_steps import Step, Unstepped
from jbclog.core.rows import EventRow, PortKey, severity_of
from jbclog.record.clock_steps import KIND as STEP
from jbclog.record.clock_steps import is_inside

COLUMNS: Final = [
    "time",
    "tick",
    "station",
    "port",
    "temperature_c",
    "status",
    "set_c",
]
FLAGS: Final = ["alarm_high", "alarm_low"]  # read if flags of any port are needed


@dataclass(slots=True)
class RunEvents:
    """Alarm events and changes of each port, and the clock steps, from a run's events and settings.

    `changes` are ordered by time, corrected for the clock steps before them.
    """

    alarms: dict[PortKey, list[EventRow]] = field(default_factory=dict)
    changes: dict[PortKey, list[Change]] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)


def read_events(run: RunTables) -> RunEvents:
    """Return the alarm events, changes and clock steps of a run."""
    found, stepped_us = RunEvents(), 0
    for event in _event_rows(run.events()):
        if is_inside(event) and event.value:
            stepped_us += round(event.value * 1e6)
            found.steps.append(Step(event.time / 1e6, event.value))
        elif event.station is not None and event.port is not None:
            place = event.station, event.port
            found.alarms.setdefault(place, []).append(event)
            change = change_of(event.kind, event.time - stepped_us, event.raw)
            if change is not None:
                found.changes.setdefault(place, []).append(change)
    for place, changes in _initial_settings(run.settings()).items():
        found.changes[place] = [*changes, *found.changes.get(place, ())]
    return found


def _event_rows(frame: pd.DataFrame) -> Iterator[EventRow]:
    """Yield the events that concern alarms, oldest first."""
    kinds = frame["kind"]
    rows = frame[
        kinds.str.startswith("alarm.") | kinds.isin(["setting.changed", "tool.changed", STEP])
    ]
    times, earliest = _micros(rows["time"]), _micros(rows["earliest"])
    columns = (
        rows[name]
        for name in ("kind", "severity", "text", "station", "port", "value", "limit", "raw")
    )
    for time, early, kind, severity, text, station, port, value, limit, raw in zip(
        times, earliest, *columns, strict=True
    ):
        yield EventRow(
            cast(int, time),
            kind,
            severity_of(severity),
            text,
            _text_or_none(station),
            None if pd.isna(port) else int(port),
            early,
            value=None if pd.isna(value) else float(value),
            limit=None if pd.isna(limit) else float(limit),
            raw=_text_or_none(raw),
        )


def _text_or_none(text: object) -> str | None:
    return text if isinstance(text, str) else None


def _initial_settings(frame: pd.DataFrame) -> dict[PortKey, list[Change]]:
    """Return the watched settings of each port as read before sampling began; later changes are
    events.
    """
    found: dict[PortKey, list[Change]] = {}
    rows = frame[
        frame["setting"].isin([*WATCHED]) & frame["port"].notna() & frame["readback"].notna()
    ]
    for station, port, name, text in zip(
        *(rows[name] for name in ("station", "port", "setting", "readback")), strict=True
    ):
        found.setdefault((str(station), int(port)), []).append(
            Change(BEFORE_ALL, str(name), str(text))
        )
    return found


def _micros(times: pd.Series) -> list[int | None]:
    """Return times in UTC microseconds since 1970; None for a missing one."""
    numbers = times.astype("datetime64[us, UTC]").astype("int64").tolist()
    return [
        None if is_missing else number
        for number, is_missing in zip(numbers, times.isna(), strict=True)
    ]


class PortRows(NamedTuple):
    """Rows of one port in a piece of the samples; `flags` only if requested."""

    place: PortKey
    rows: Rows
    flags: list[FlagRead]


class PortSplitter:
    """Splits the samples by station and port, piece by piece in order, and finds the clock steps
    between the rows.

    `flags_of`: ports whose flags are needed. `t0_utc`: start of the run, s since 1970. `periods`:
    seconds between ticks of each station, None without a grid; they show which steps came before a
    port's first row.
    """

    def __init__(
        self,
        steps: Sequence[Step],
        flags_of: frozenset[PortKey],
        t0_utc: float | None,
        periods: Mapping[str, float | None],
    ) -> None:
        self._steps = steps
        self._t0_utc = t0_utc
        self._periods = periods
        self._flags_of = flags_of
        self._unstepped: dict[PortKey, Unstepped] = {}
        self._stepped_us: dict[PortKey, int] = {}
        self._before_us: dict[PortKey, int] = {}

    def split(self, piece: pa.Table) -> Iterator[PortRows]:
        """Yield the rows of each port that has any in this piece."""
        for place, own in by_port(piece):
            yield PortRows(
                place, self._rows(place, own), _flags(own) if place in self._flags_of else []
            )

    def _rows(self, place: PortKey, own: pa.Table) -> Rows:
        times, status = own["time"].cast(pa.int64()).to_numpy(), own["status"]
        steps = self._steps_between(place, times, own["tick"][0].as_py()) if self._steps else {}
        read = pc.and_(pc.is_valid(status), pc.is_valid(own["temperature_c"]))
        return Rows(
            times,
            own["tick"].to_numpy(),
            pc.fill_null(own["temperature_c"], 0).to_numpy(),
            read.to_numpy(),
            is_one_of(status, WORKING),
            own["set_c"].cast(pa.float64()).to_numpy(),
            steps,
        )

    def _steps_between(self, place: PortKey, times: NDArray[np.int64], tick: int) -> dict[int, int]:
        """Return row -> size in µs of the clock step just before it."""
        seconds = times.astype(np.float64) / 1e6
        if place not in self._unstepped:
            number = self._steps_before(place[0], float(seconds[0]), tick)
            self._unstepped[place] = Unstepped(self._steps[number:])
            self._before_us[place] = round(sum(step.size_s for step in self._steps[:number]) * 1e6)
        stepped = (
            np.rint((seconds - self._unstepped[place].of(seconds)) * 1e6).astype(np.int64)
            + self._before_us[place]
        )
        sizes = np.diff(stepped, prepend=self._stepped_us.get(place, 0))
        self._stepped_us[place] = int(stepped[-1])
        return {int(row): int(sizes[row]) for row in np.flatnonzero(np.abs(sizes) > 1000)}

    def _steps_before(self, station: str, first_s: float, tick: int) -> int:
        """Return how many steps came before a port's first row: the number that brings it closest
        to its grid.
        """
        period_s = self._periods.get(station)
        if period_s is None or self._t0_utc is None:
            return 0
        sums = np.concatenate([[0.0], np.cumsum([step.size_s for step in self._steps])])
        return int(np.argmin(np.abs(first_s - (self._t0_utc + tick * period_s) - sums)))


def _flags(rows: pa.Table) -> list[FlagRead]:
    read = rows.select(["time", "alarm_high", "alarm_low"]).filter(rows["alarm_high"].is_valid())
    times = read["time"].cast(pa.int64()).to_pylist()
    return [*map(FlagRead, times, read["alarm_high"].to_pylist(), read["alarm_low"].to_pylist())]
