"""What the columns of a port in a record mean: their names and words, their time on the run's grid,
the kind of tool.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np
import pyarrow as pa

from jbclog.analysis.coded_texts import coded
from jbclog.analysis.joints.series import Cycles
from jbclog.analysis.verdict.clock_steps import Step, Unstepped
from jbclog.analysis.verdict.idle import Floats
from jbclog.analysis.verdict.rules import has_tip
from jbclog.analysis.verdict.samples import Counts
from jbclog.core.rows import StationFacts

Key = tuple[str, int]
"""Station and port."""
COLUMNS: Final = [
    *(
        "time",
        "tick",
        "station",
        "port",
        "temperature_c",
        "power_permille",
        "status",
        "motor",
        "set_c",
    ),
    *("tool", "port_error"),
]
WORKING: Final = ("working", "on")
PUSHING: Final = "forward"
CYCLES: Final = "dispensed_cycles"
STATES_FAMILIES: Final = ("omega",)


def by_port(rows: pa.Table) -> Iterator[tuple[Key, pa.Table]]:
    """Yield the rows of each port of each station in their order; without a copy where there is
    only one.
    """
    if not rows.num_rows:
        return
    names, ports = coded(rows["station"]), rows["port"].to_numpy()
    stations = names.indices.to_numpy()
    if (stations == stations[0]).all() and (ports == ports[0]).all():
        yield (names.dictionary[int(stations[0])].as_py(), int(ports[0])), rows
        return
    order = np.lexsort((ports, stations))
    sorted_rows, stations, ports = rows.take(pa.array(order)), stations[order], ports[order]
    edges = np.flatnonzero((np.diff(stations) != 0) | (np.diff(ports) != 0)) + 1
    for first, stop in pairwise([0, *edges.tolist(), len(order)]):
        yield (
            (
                names.dictionary[int(stations[first])].as_py(),
                int(ports[first]),
            ),
            sorted_rows.slice(first, stop - first),
        )


class Clock:
    """Seconds of a port's rows, piece by piece in order: on its grid, or UTC less the clock's steps
    if it has none.
    """

    def __init__(self, period_s: float | None, steps: Sequence[Step], t0_us: int) -> None:
        self.period_s, self.steps, self.t0_us = period_s, steps, t0_us
        self._unstepped = Unstepped(steps)

    def seconds(self, ticks: Floats, utc_us: Counts) -> Floats:
        """Return the seconds of the next rows."""
        if self.period_s:
            return ticks * self.period_s
        return self._unstepped.of(utc_us / 1e6) - self.t0_us / 1e6

    def of(self, utc_us: Counts) -> Floats:
        """Return the seconds of anything that has only a time (counters, settings), to 1 s unless
        the wall clock was stepped.
        """
        return np.asarray((utc_us - self.t0_us) / 1e6, dtype=np.float64)


def kind_of(facts: StationFacts) -> str:
    """Return what `measure_port` calls the station's tools: ``tip``, ``air`` or ``omega``."""
    if has_tip(facts):
        return "tip"
    return "omega" if facts.family in STATES_FAMILIES else "air"


def cycles_of(counted_us: Counts, counted: Floats, rows_us: Counts, seconds: Floats) -> Cycles:
    """Return the feeder's counts, which have only a time in UTC, in seconds on the grid of their
    port's rows.
    """
    if not len(seconds):
        return Cycles(np.empty(0), np.empty(0))
    rows_s, counted_s = np.maximum.accumulate(rows_us) / 1e6, counted_us / 1e6
    placed = np.interp(counted_s, rows_s, seconds)
    before, behind = np.minimum(counted_s - rows_s[0], 0.0), np.maximum(counted_s - rows_s[-1], 0.0)
    return Cycles(np.maximum.accumulate(placed + before + behind), counted)
