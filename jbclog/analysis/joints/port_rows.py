"""The columns of one port, as a record holds them, made into its `Series`; the same for every reader of a record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jbclog.analysis.joints.series import Cycles, Series, nominal_period
from jbclog.analysis.verdict.idle import Block, Flags, Floats
from jbclog.analysis.verdict.rules import has_feeder, has_tip
from jbclog.analysis.verdict.samples import Counts, Step, Unstepped
from jbclog.core.rows import StationFacts

COLUMNS: Final = [
    *("time", "tick", "station", "port", "temperature_c", "power_permille", "status", "motor", "set_c"),
    *("tool", "port_error"),
]
WORKING: Final = ("working", "on")
PUSHING: Final = "forward"
CYCLES: Final = "dispensed_cycles"
STATES_FAMILIES: Final = ("omega",)


@dataclass(frozen=True, slots=True)
class PortRows:
    """The rows of one port in order of time: s, °C, ‰, setpoint in °C as read, and its state. NaN: not read.

    `working`: the tool works. `known`: its state was read. `feeding`: 1 where the feeder's motor pushed. `tool` and `port_error`
    are codes.
    """

    seconds: Floats
    temperature: Floats
    power: Floats
    setting: Floats
    working: Flags
    known: Flags
    feeding: Floats
    tool: Floats
    port_error: Floats


class Clock:
    """Seconds of a port's rows, piece by piece in order: on its grid, or UTC less the clock's steps if it has none."""

    def __init__(self, period_s: float | None, steps: Sequence[Step], t0_us: int) -> None:
        self.period_s, self.steps, self.t0_us = period_s, steps, t0_us
        self._unstepped = Unstepped(steps)

    def seconds(self, ticks: Floats, utc_us: Counts) -> Floats:
        """Return the seconds of the next rows."""
        if self.period_s:
            return ticks * self.period_s
        return self._unstepped.of(utc_us / 1e6) - self.t0_us / 1e6

    def of(self, utc_us: Counts) -> Floats:
        """Return the seconds of anything that has only a time (counters, settings), to 1 s unless the wall clock was stepped."""
        return np.asarray((utc_us - self.t0_us) / 1e6, dtype=np.float64)


def kind_of(facts: StationFacts) -> str:
    """Return what `measure_port` calls the station's tools: ``tip``, ``air`` or ``omega``."""
    if has_tip(facts):
        return "tip"
    return "omega" if facts.family in STATES_FAMILIES else "air"


def cycles_of(counted_us: Counts, counted: Floats, rows_us: Counts, seconds: Floats) -> Cycles:
    """Return the feeder's counts, which have only a time in UTC, in seconds on the grid of their port's rows."""
    if not len(seconds):
        return Cycles(np.empty(0), np.empty(0))
    rows_s, counted_s = np.maximum.accumulate(rows_us) / 1e6, counted_us / 1e6
    placed = np.interp(counted_s, rows_s, seconds)
    before, behind = np.minimum(counted_s - rows_s[0], 0.0), np.maximum(counted_s - rows_s[-1], 0.0)
    return Cycles(np.maximum.accumulate(placed + before + behind), counted)


def series_of(
    facts: StationFacts,
    rows: PortRows,
    ordered_s: float | None = None,
    cycles: Cycles | None = None,
    period_s: float | None = None,
) -> Series:
    """Return the port's rows with what is known of its station.

    `period_s` is the period of a port without a grid; without it, the median distance of these rows.
    """
    errors = rows.port_error if has_tip(facts) else np.full(len(rows.seconds), np.nan)
    block = Block(rows.seconds, rows.temperature, rows.power, rows.setting, rows.working, rows.tool, errors)
    block = replace(block, working=block.working & block.in_place)
    period = facts.period_s or period_s or nominal_period(rows.seconds)
    fed = rows.feeding if has_feeder(facts) else None
    return Series(block, rows.known, period, fed, facts.rated_power_w, ordered_s, bool(facts.period_s), cycles)
