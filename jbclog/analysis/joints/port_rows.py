"""Meaning of the columns of a port in a record: names and words, time on the run's grid, kind of
tool.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jbclog.analysis.clock_steps import Step, Unstepped
from jbclog.analysis.joints.series import Cycles
from jbclog.analysis.port_data import Counts, Floats, has_tip
from jbclog.core.rows import StationFacts

COLUMNS: Final = [
    *(
        "time",
        "tick",
        "station",
        "port",
        "late_us",
        "scan_us",
        "temperature_c",
        "power_permille",
        "status",
        "motor",
        "setpoint_c",
    ),
    *("tool", "port_error"),
]
PUSHING: Final = "forward"
CYCLES: Final = "dispensed_cycles"
STATES_FAMILIES: Final = ("omega",)


class Clock:
    """Seconds of a port's rows, piece by piece in order: on its grid, or without one UTC corrected
    for clock steps.
    """

    def __init__(self, period_s: float | None, steps: Sequence[Step], t0_us: int) -> None:
        self.period_s, self.steps, self.t0_us = period_s, steps, t0_us
        self._unstepped = Unstepped(steps)

    def seconds(self, ticks: Floats, utc_us: Counts) -> Floats:
        """Return the seconds of the next rows."""
        if self.period_s:
            return ticks * self.period_s
        return self._unstepped.of(utc_us / 1e6) - self.t0_us / 1e6

    def read_s(
        self, seconds: Floats, utc_us: Counts, late_us: Floats, scan_us: Floats
    ) -> Floats | None:
        """Return when these rows were read, in seconds of the grid, never falling; None without a
        grid. `seconds` are the times at which they were due.

        The wall clock may have been corrected, but each answer came between the first question of
        its row and the last answer to it, and these are by the monotonic clock. A row without a
        question keeps the time at which it was due.
        """
        if not self.period_s:
            return None
        earliest = np.nan_to_num(late_us) / 1e6
        latest = earliest + np.nan_to_num(scan_us) / 1e6
        later = np.clip((utc_us - self.t0_us) / 1e6 - seconds, earliest, latest)
        return np.asarray(np.maximum.accumulate(seconds + later), dtype=np.float64)

    def of(self, utc_us: Counts) -> Floats:
        """Return the seconds of records that have only a UTC time (counters, settings), to 1 s
        unless the wall clock was stepped.
        """
        return np.asarray((utc_us - self.t0_us) / 1e6, dtype=np.float64)


def kind_of(facts: StationFacts) -> str:
    """Return the kind of the station's tools for `measure_port`: ``tip``, ``air`` or ``omega``."""
    if has_tip(facts):
        return "tip"
    return "omega" if facts.family in STATES_FAMILIES else "air"


def cycles_of(counted_us: Counts, counted: Floats, rows_us: Counts, seconds: Floats) -> Cycles:
    """Return the feeder's counts, which have only a UTC time, in seconds on the grid of their
    port's rows.
    """
    if not len(seconds):
        return Cycles(np.empty(0), np.empty(0))
    rows_s, counted_s = np.maximum.accumulate(rows_us) / 1e6, counted_us / 1e6
    placed = np.interp(counted_s, rows_s, seconds)
    before, behind = np.minimum(counted_s - rows_s[0], 0.0), np.maximum(counted_s - rows_s[-1], 0.0)
    return Cycles(np.maximum.accumulate(placed + before + behind), counted)
