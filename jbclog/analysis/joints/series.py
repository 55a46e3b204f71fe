"""One port of one run as arrays, and windows of it that know their gaps.

Seconds are on the run's grid (tick × period); with ``--rate max`` they are UTC less the steps of the wall clock
(`judge.stepped`), the nominal period is the median distance of two rows, and a gap is what is longer than four of them and
than half a second, since such rows are as far apart as the station is slow. What was not read is NaN.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.joints.figure import GAP_PERIODS
from jbclog.analysis.verdict.idle import Block, Flags, Floats, setting_in_force

RESOLUTION_C, RESOLUTION_PERMILLE = 1.0, 1.0  # of R-TT and R-PP (manuals 000 and 002: whole °C, whole per mille)


@dataclass(frozen=True, slots=True)
class Cycles:
    """The feeder's counted cycles (R-DCx): when they were read, grid seconds, and how many they were."""

    seconds: Floats
    counted: Floats

    def __len__(self) -> int:
        return len(self.seconds)


@dataclass(frozen=True, slots=True)
class Series:
    """The rows of one port in their order.

    `rows` has seconds, °C, ‰, the setting in °C where it was read, and whether the tool works (hot air: is on); `known`
    tells where the state was read at all. `feeding` is 1 where the feeder's motor pushed wire, 0 where not, NaN where that
    was not read; None for a tool without a feeder. `cycles` are the feeder's, where they were read.
    `rated_w` is the power at 1000 ‰, where the line file declares it;
    `ordered_s` is when the run ordered the tool to work.
    """

    rows: Block
    known: Flags
    period_s: float
    feeding: Floats | None = None
    rated_w: float | None = None
    ordered_s: float | None = None
    on_grid: bool = True
    cycles: Cycles | None = None

    @property
    def seconds(self) -> Floats:
        return self.rows.seconds

    @property
    def gap_s(self) -> float:
        """Readings further apart than this have a gap between them."""
        return GAP_PERIODS * self.period_s if self.on_grid else max(2 * GAP_PERIODS * self.period_s, 0.5)

    def window(self, values: Floats, start_s: float, end_s: float) -> Window:
        """The readings of one column from `start_s` to `end_s`, both included."""
        first, last = np.searchsorted(self.seconds, [start_s - 1e-6, end_s + 1e-6])
        here = slice(int(first), int(last))
        there = ~np.isnan(values[here])
        return Window(start_s, end_s, self.period_s, self.gap_s, self.seconds[here][there], values[here][there])


class Extent(ABC):
    """How much of a column was read between two moments."""

    __slots__ = ()
    start_s: float
    end_s: float
    period_s: float
    gap_s: float

    @property
    @abstractmethod
    def n(self) -> int:
        """How many readings there are."""

    @property
    @abstractmethod
    def longest_gap_s(self) -> float:
        """The longest time from one reading to the next, from the beginning and to the end included."""

    @property
    def due(self) -> int:
        """How many readings a time of this length has."""
        return max(round((self.end_s - self.start_s) / self.period_s) + 1, 1) if self.period_s else self.n

    @property
    def coverage(self) -> float:
        """In per cent of those due, 100 at the most."""
        return round(min(100.0 * self.n / self.due, 100.0), 3) if self.due else 0.0

    @property
    def gap(self) -> str | None:
        """What is wrong with the record here, in a sentence; None where there is no gap."""
        longest = self.longest_gap_s
        if not self.n:
            return "Nothing was read in its window: it is one gap."
        if longest <= self.gap_s + 1e-6:
            return None
        return f"The record has a gap: no reading for {longest:.1f} s; {self.gap_s:g} s are allowed between two."


@dataclass(frozen=True, slots=True)
class Window(Extent):
    """The readings that are there between two moments."""

    start_s: float
    end_s: float
    period_s: float
    gap_s: float
    seconds: Floats
    values: Floats

    @property
    def n(self) -> int:
        return len(self.values)

    @property
    def longest_gap_s(self) -> float:
        if not self.n:
            return self.end_s - self.start_s + 2 * self.period_s
        edges = np.concatenate(([self.start_s - self.period_s], self.seconds, [self.end_s + self.period_s]))
        return float(np.diff(edges).max())


@dataclass(slots=True)
class Column(Extent):
    """How much of a column was read over all rows of a port, which are taken piece by piece in their order."""

    period_s: float
    gap_s: float
    start_s: float = 0.0
    end_s: float = 0.0
    _n: int = 0
    _rows: int = 0
    _last_s: float = 0.0
    _longest_s: float = 0.0

    def add(self, seconds: Floats, values: Floats) -> None:
        """The next rows."""
        if not len(seconds):
            return
        if not self._rows:
            self.start_s = float(seconds[0])
            self._last_s = self.start_s - self.period_s
        self._rows, self.end_s = self._rows + len(seconds), float(seconds[-1])
        read = seconds[~np.isnan(values)]
        if len(read):
            self._longest_s = max(self._longest_s, float(np.diff(read, prepend=self._last_s).max()))
            self._n, self._last_s = self._n + len(read), float(read[-1])

    @property
    def n(self) -> int:
        return self._n

    @property
    def longest_gap_s(self) -> float:
        if not self._n:
            return self.end_s - self.start_s + 2 * self.period_s
        return max(self._longest_s, self.end_s + self.period_s - self._last_s)


@dataclass(frozen=True, slots=True)
class Stretch:
    """Rows that follow each other without a gap while the tool works, on an even grid of `period_s`."""

    period_s: float
    seconds: Floats
    temperature: Floats
    power: Floats
    setting: Floats  # in force; NaN where it is not known

    def __len__(self) -> int:
        return len(self.seconds)

    def take(self, rows: slice) -> Stretch:
        columns = (self.seconds[rows], self.temperature[rows], self.power[rows], self.setting[rows])
        return Stretch(self.period_s, *columns)

    def power_later(self, rows: int) -> Stretch:
        """The same with its power so many rows later; before that it was what it was first."""
        if not rows or not len(self):
            return self
        power = np.concatenate([np.full(min(rows, len(self)), self.power[0]), self.power[:-rows]])
        return replace(self, power=power)

    def earlier(self, seconds: float) -> Stretch:
        """The same rows, so much earlier."""
        return replace(self, seconds=self.seconds - seconds) if seconds else self


BRIDGED_S = 0.5
"""A shorter time without readings is bridged where transients are looked at: a draw that spans it would be cut in two."""


RISE_C, RISE_K_PER_S = 25.0, 300.0
FALL_C, FALL_K_PER_S = 60.0, 400.0
"""No tip moves so far so fast: another tool, or none, is in its place."""


def stretches(series: Series, shortest_s: float = 3.0, begun: Sequence[Stretch] = ()) -> list[Stretch]:
    """The parts of the record that can be looked at for transients: working, both read, no gap beyond `BRIDGED_S`.

    Of a record that is looked at in windows, `begun` are those of the window before: what began in one of these stays on its grid.
    """
    rows = series.rows
    there = ~np.isnan(rows.temperature) & ~np.isnan(rows.power) & rows.working
    places = np.flatnonzero(there)
    if not len(places):
        return []
    apart = np.diff(rows.seconds[places]) > max(series.gap_s, BRIDGED_S) + 1e-6
    moved, took_s = np.diff(rows.temperature[places]), np.diff(rows.seconds[places])
    leaps = (moved > np.maximum(RISE_C, RISE_K_PER_S * took_s)) | (-moved > np.maximum(FALL_C, FALL_K_PER_S * took_s))
    rested = np.diff(np.cumsum(series.known & ~rows.working)[places]) > 0
    pieces = np.split(places, np.flatnonzero(apart | rested | leaps) + 1)
    setting = setting_in_force(rows.seconds, rows.setting)
    begins = [_grid_of(float(rows.seconds[places[0]]), begun), *(float(rows.seconds[piece[0]]) for piece in pieces[1:])]
    every = zip(pieces, begins, strict=True)
    found = [_even(rows, setting, piece, series.period_s, begin) for piece, begin in every if len(piece) > 1]
    return [stretch for stretch in found if len(stretch) * series.period_s >= shortest_s]


def unseen(series: Series, parts: Sequence[Stretch]) -> tuple[float, int]:
    """For how many seconds of work, and in how many pieces, nothing could be looked at: gaps, and what is too short between two.

    Where the state was not read the tool may have worked. Pieces of up to `BRIDGED_S` are none.
    """
    found = Unseen()
    found.add(series, parts, slice(0, len(series.seconds)))
    return found.total()


class Unseen:
    """The same of a record that is looked at in windows."""

    def __init__(self) -> None:
        self._seconds, self._pieces = 0.0, 0
        self._last_s: float | None = None
        self._since_s: float | None = None  # from when on nothing is seen, where that goes on
        self._period_s = 0.0

    def add(self, series: Series, parts: Sequence[Stretch], own: slice) -> None:
        """These rows, behind those before; the window may have others beside them."""
        at, period = series.seconds[own], series.period_s
        if not len(at) or not period:
            return
        self._period_s = period
        looked = np.zeros(len(at), dtype=np.bool_)
        for part in parts:
            first, last = np.searchsorted(at, [part.seconds[0] - period / 2, part.seconds[-1] + period / 2])
            looked[first:last] = True
        lost = (series.rows.working[own] | ~series.known[own]) & ~looked
        if self._last_s is not None:
            at, lost = np.concatenate(([self._last_s], at)), np.concatenate(([self._since_s is not None], lost))
        steps = np.diff(at)
        absent = steps[(steps > max(series.gap_s, BRIDGED_S)) & ~lost[:-1] & ~lost[1:]] - period
        self._count(absent)
        edges = np.flatnonzero(np.diff(lost.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
        begins, ends = at[edges[:, 0]], at[edges[:, 1] - 1]
        if len(edges) and edges[0, 0] == 0 and self._since_s is not None:
            begins[0] = self._since_s
        self._since_s, self._last_s = None, float(at[-1])
        if len(edges) and lost[-1]:
            self._since_s, begins, ends = float(begins[-1]), begins[:-1], ends[:-1]
        self._count(ends - begins + period)

    def total(self) -> tuple[float, int]:
        """Seconds and pieces."""
        open_s = 0.0 if self._since_s is None or self._last_s is None else self._last_s - self._since_s + self._period_s
        is_long = open_s > BRIDGED_S
        return self._seconds + open_s * is_long, self._pieces + is_long

    def _count(self, pieces: Floats) -> None:
        long = pieces[pieces > BRIDGED_S]
        self._seconds, self._pieces = self._seconds + float(long.sum()), self._pieces + len(long)


def _grid_of(first_s: float, begun: Sequence[Stretch]) -> float:
    """A moment of the grid that a stretch with a reading at `first_s` is on."""
    place = bisect_right(begun, first_s + 1e-6, key=lambda stretch: float(stretch.seconds[0])) - 1
    goes_on = place >= 0 and first_s <= begun[place].seconds[-1] + begun[place].period_s
    return float(begun[place].seconds[0]) if goes_on else first_s


def _even(rows: Block, setting: Floats, places: NDArray[np.int64], period_s: float, begin_s: float) -> Stretch:
    seconds = rows.seconds[places]
    first, last = ceil((seconds[0] - begin_s) / period_s - 1e-6), floor((seconds[-1] - begin_s) / period_s + 1e-6)
    grid = np.asarray(begin_s + np.arange(first, last + 1) * period_s, dtype=np.float64)
    last = np.clip(np.searchsorted(seconds, grid + 1e-6) - 1, 0, len(seconds) - 1)
    temperature, power = (np.interp(grid, seconds, column[places]) for column in (rows.temperature, rows.power))
    return Stretch(period_s, grid, temperature, power, setting[places][last])


def nominal_period(seconds: Floats) -> float:
    """The median distance of two rows: what stands for the period where there is no grid."""
    return float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0
