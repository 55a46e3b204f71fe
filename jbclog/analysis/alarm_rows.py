"""Input of the alarm detectors from a run's tables: the samples and alarm events of each port."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, cast

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from jbclog.analysis.alarms.from_record import FlagRead, Rows
from jbclog.analysis.alarms.live import change_of
from jbclog.analysis.alarms.port_watch import BEFORE_ALL, WORKING, Change
from jbclog.analysis.alarms.state_machine import WATCHED
from jbclog.analysis.clock_steps import Step, Unstepped
from jbclog.analysis.run_tables import RunTables
from jbclog.core.rows import EventRow, PortKey, severity_of
from jbclog.record.clock_steps import KIND as STEP
from jbclog.record.clock_steps import is_inside

COLUMNS: Final = [
    "time",
    "tick",
    "temperature_c",
    "status",
    "setpoint_c",
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
        for name in ("kind", "severity", "text", "station", "port", "value", "limit_value", "raw")
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
            limit_value=None if pd.isna(limit) else float(limit),
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


class PortRows:
    """Turns the samples of a port, in order, into the rows of the detectors, and finds the clock
    steps between them.

    `t0_utc`: start of the run, s since 1970. `period_s`: seconds between ticks, None without a
    grid; it shows which steps came before the port's first row.
    """

    def __init__(self, steps: Sequence[Step], t0_utc: float | None, period_s: float | None) -> None:
        self._steps = steps
        self._t0_utc = t0_utc
        self._period_s = period_s
        self._unstepped: Unstepped | None = None
        self._before_us = 0
        self._stepped_us = 0

    def of(self, samples: pa.Table) -> Rows:
        """Return the next rows."""
        times_us = samples["time"].cast(pa.int64()).to_numpy()
        status = samples["status"]
        steps: dict[int, int] = {}
        if self._steps:
            steps = self._steps_between(times_us, samples["tick"][0].as_py())
        is_read = pc.and_(pc.is_valid(status), pc.is_valid(samples["temperature_c"]))
        return Rows(
            times_us,
            samples["tick"].to_numpy(),
            pc.fill_null(samples["temperature_c"], 0).to_numpy(),
            is_read.to_numpy(),
            pc.is_in(status, pa.array(WORKING)).to_numpy(),
            samples["setpoint_c"].cast(pa.float64()).to_numpy(),
            steps,
        )

    def _steps_between(self, times_us: NDArray[np.int64], tick: int) -> dict[int, int]:
        """Return row -> size in µs of the clock step just before it."""
        seconds = times_us.astype(np.float64) / 1e6
        if self._unstepped is None:
            number = self._steps_before(float(seconds[0]), tick)
            self._unstepped = Unstepped(self._steps[number:])
            self._before_us = round(sum(step.size_s for step in self._steps[:number]) * 1e6)
        stepped_us = np.rint((seconds - self._unstepped.of(seconds)) * 1e6).astype(np.int64)
        stepped_us = stepped_us + self._before_us
        sizes = np.diff(stepped_us, prepend=self._stepped_us)
        self._stepped_us = int(stepped_us[-1])
        return {int(row): int(sizes[row]) for row in np.flatnonzero(np.abs(sizes) > 1000)}

    def _steps_before(self, first_s: float, tick: int) -> int:
        """Return how many steps came before a port's first row: the number that brings it closest
        to its grid.
        """
        if self._period_s is None or self._t0_utc is None:
            return 0
        sums = np.concatenate([[0.0], np.cumsum([step.size_s for step in self._steps])])
        due_s = self._t0_utc + tick * self._period_s
        return int(np.argmin(np.abs(first_s - due_s - sums)))


def flags_in(samples: pa.Table) -> list[FlagRead]:
    """Return the flags read in these samples of a port."""
    read = samples.select(["time", *FLAGS]).filter(samples["alarm_high"].is_valid())
    times_us = read["time"].cast(pa.int64()).to_pylist()
    return [*map(FlagRead, times_us, *(read[name].to_pylist() for name in FLAGS))]
