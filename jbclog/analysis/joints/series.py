"""One port of a run as arrays, and its stretches without a gap.

Each row has two times in s. It was *due* on the run's grid (tick × period): gaps and coverage count
these. It was *read* when its answer came: heat balance and edges use these, because a hot tip
moves by a degree in 10 ms. With ``--rate max`` there is no grid: both are UTC corrected for clock
steps, the period is the median interval of rows, and a gap is longer than four periods and than
half a second, because the interval then depends on the station's speed. A value that was not read
is NaN.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, floor
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.joints.figure import GAP_PERIODS
from jbclog.analysis.port_data import Flags, Floats, setting_in_force
from jbclog.analysis.verdict.idle import Block

# resolution of R-TT and R-PP: whole °C and whole ‰ (manuals 000 and 002)
RESOLUTION_C, RESOLUTION_PERMILLE = 1.0, 1.0


@dataclass(frozen=True, slots=True)
class Cycles:
    """The feeder's counted dispensing cycles (R-DCx): time of each reading in seconds of the run's
    grid, and the count.
    """

    seconds: Floats
    counted: Floats

    def __len__(self) -> int:
        return len(self.seconds)


@dataclass(frozen=True, slots=True)
class Series:
    """The rows of one port in order of time.

    - `rows`: seconds when due, °C, ‰, the setpoint in °C where it was read, and whether the tool
      works (hot air: is on)
    - `known`: whether the state was read
    - `feeding`: 1 where the feeder's motor pushed wire, 0 where not, NaN where not read; None for a
      tool without a feeder
    - `cycles`: the feeder's counts, if read
    - `rated_w`: power at 1000 ‰, if the line file declares it
    - `ordered_s`: when the run ordered the tool to work
    - `read_s`: seconds when each row was read, never falling; None: when it was due
    """

    rows: Block
    known: Flags
    period_s: float
    feeding: Floats | None = None
    rated_w: float | None = None
    ordered_s: float | None = None
    on_grid: bool = True
    cycles: Cycles | None = None
    read_s: Floats | None = None

    @property
    def seconds(self) -> Floats:
        return self.rows.seconds

    @property
    def moments(self) -> Floats:
        """When each row was read, in s."""
        return self.seconds if self.read_s is None else self.read_s

    @property
    def gap_s(self) -> float:
        """Interval in s between two readings above which there is a gap."""
        return (
            GAP_PERIODS * self.period_s
            if self.on_grid
            else max(2 * GAP_PERIODS * self.period_s, 0.5)
        )

    @property
    def cut_s(self) -> float:
        """Interval in s between two readings above which a stretch ends."""
        return max(self.gap_s, BRIDGED_S) + 1e-6

    def window(self, values: Floats, start_s: float, end_s: float) -> Window:
        """Return the readings of one column from `start_s` to `end_s`, both included."""
        first, last = np.searchsorted(self.seconds, [start_s - 1e-6, end_s + 1e-6])
        here = slice(int(first), int(last))
        is_read = ~np.isnan(values[here])
        return Window(
            start_s,
            end_s,
            self.period_s,
            self.gap_s,
            self.seconds[here][is_read],
            values[here][is_read],
            self.moments[here][is_read],
        )


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
        """The number of readings."""

    @property
    @abstractmethod
    def longest_gap_s(self) -> float:
        """Longest interval in s between moments at which readings were due that were made, and a
        period more to the start and to the end: whether there is a gap.
        """

    @property
    @abstractmethod
    def longest_unread_s(self) -> float:
        """Longest time in s from one reading to the next, from the start to the first and from the
        last to the end: how long the gap is (`analysis/gaps.py`).
        """

    @property
    def due(self) -> int:
        """Number of readings due in this time."""
        return (
            max(round((self.end_s - self.start_s) / self.period_s) + 1, 1)
            if self.period_s
            else self.n
        )

    @property
    def coverage(self) -> float:
        """Share of readings due that were obtained, in per cent, at most 100."""
        return round(min(100.0 * self.n / self.due, 100.0), 3) if self.due else 0.0

    @property
    def gap(self) -> str | None:
        """A sentence about the gap in the record here; None without a gap."""
        longest = self.longest_gap_s
        if not self.n:
            return "Nothing was read in its window: it is one gap."
        if longest <= self.gap_s + 1e-6:
            return None
        return (
            f"The record has a gap: no reading for {self.longest_unread_s:.1f} s; {self.gap_s:g} s"
            " are allowed between two."
        )


@dataclass(frozen=True, slots=True)
class Window(Extent):
    """The readings of a column between two moments."""

    start_s: float
    end_s: float
    period_s: float
    gap_s: float
    seconds: Floats
    values: Floats
    moments: Floats  # when each was read

    @property
    def n(self) -> int:
        return len(self.values)

    @property
    def longest_gap_s(self) -> float:
        if not self.n:
            return self.end_s - self.start_s + 2 * self.period_s
        edges = np.concatenate(
            ([self.start_s - self.period_s], self.seconds, [self.end_s + self.period_s])
        )
        return float(np.diff(edges).max())

    @property
    def longest_unread_s(self) -> float:
        edges = np.concatenate(([self.start_s], self.moments, [self.end_s]))
        return float(np.diff(edges).max())


@dataclass(slots=True)
class Column(Extent):
    """How much of a column was read over all rows of a port, which are added piece by piece in
    order of time.
    """

    period_s: float
    gap_s: float
    start_s: float = 0.0
    end_s: float = 0.0
    _n: int = 0
    _rows: int = 0
    _last_s: float = 0.0
    _longest_s: float = 0.0
    _last_read_s: float = 0.0
    _last_moment_s: float = 0.0
    _longest_unread_s: float = 0.0

    def add(self, seconds: Floats, values: Floats, moments: Floats) -> None:
        """Add the next rows: when they were due, their values, and when they were read."""
        if not len(seconds):
            return
        if not self._rows:
            self.start_s = float(seconds[0])
            self._last_s = self.start_s - self.period_s
            self._last_read_s = float(moments[0])
        self._rows, self.end_s = self._rows + len(seconds), float(seconds[-1])
        self._last_moment_s = float(moments[-1])
        is_read = ~np.isnan(values)
        read, made = seconds[is_read], moments[is_read]
        if len(read):
            unread_s = np.diff(made, prepend=self._last_read_s)
            self._longest_unread_s = max(self._longest_unread_s, float(unread_s.max()))
            self._last_read_s = float(made[-1])
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

    @property
    def longest_unread_s(self) -> float:
        return max(self._longest_unread_s, self._last_moment_s - self._last_read_s)


@dataclass(frozen=True, slots=True)
class Stretch:
    """Rows without a gap while the tool works, on an even grid of `period_s`."""

    period_s: float
    seconds: Floats
    temperature: Floats
    power: Floats
    setting: Floats  # in force; NaN where not known
    # where its grid begins, and the number of its first row on it; None: not known
    origin: tuple[float, int] | None = None

    def __len__(self) -> int:
        return len(self.seconds)

    def take(self, rows: slice) -> Stretch:
        columns = (self.seconds[rows], self.temperature[rows], self.power[rows], self.setting[rows])
        return Stretch(self.period_s, *columns)

    def power_later(self, rows: int) -> Stretch:
        """Return the stretch with its power delayed by this many rows; rows before the first
        reading get its value.
        """
        if not rows or not len(self):
            return self
        power = np.concatenate([np.full(min(rows, len(self)), self.power[0]), self.power[:-rows]])
        return replace(self, power=power)

    def earlier(self, seconds: float) -> Stretch:
        """Return the stretch moved this many seconds earlier."""
        return replace(self, seconds=self.seconds - seconds, origin=None) if seconds else self


SHORTEST_S = 3.0
MOST_BEYOND: Final = 0.5  # periods by which the last row of a stretch may be later than its reading
BRIDGED_S = 0.5
"""Shorter times without readings are interpolated: a gap would cut a draw across it in two."""
MOST_LATE_S: Final = 0.5
"""The time before a late reading may be longer by this, because no row is absent in it."""

RISE_C, RISE_K_PER_S = 25.0, 300.0
FALL_C, FALL_K_PER_S = 60.0, 400.0
"""A tip cannot move so far so fast: another tool, or none, is in its place."""


def stretches(series: Series, begun: Sequence[Stretch] = ()) -> list[Stretch]:
    """Return the stretches of the record: the tool works, temperature and power were read, no gap
    beyond `BRIDGED_S`.

    Stretches shorter than `SHORTEST_S` are left out. In a record that is analysed in windows,
    `begun` are the stretches of the window before: one that began there stays on its grid.
    """
    rows = series.rows
    is_read = ~np.isnan(rows.temperature) & ~np.isnan(rows.power) & rows.working
    places = np.flatnonzero(is_read)
    if not len(places):
        return []
    moments = series.moments
    moved, took_s = np.diff(rows.temperature[places]), np.diff(moments[places])
    apart = _is_gap(series, np.diff(rows.seconds[places]), took_s)
    leaps = (moved > np.maximum(RISE_C, RISE_K_PER_S * took_s)) | (
        -moved > np.maximum(FALL_C, FALL_K_PER_S * took_s)
    )
    rested = np.diff(np.cumsum(series.known & ~rows.working)[places]) > 0
    pieces = np.split(places, np.flatnonzero(apart | rested | leaps) + 1)
    setting = setting_in_force(rows.seconds, rows.setting)
    begins = [
        _grid_start(float(moments[places[0]]), begun, _begin(series, pieces[0])),
        *(_begin(series, piece) for piece in pieces[1:]),
    ]
    every = zip(pieces, begins, strict=True)
    found = [
        _on_even_grid(series, setting, piece, begin) for piece, begin in every if len(piece) > 1
    ]
    return [stretch for stretch in found if len(stretch) * series.period_s >= SHORTEST_S]


def _is_gap(series: Series, due_s: Floats, took_s: Floats) -> Flags:
    """Return whether readings that were due so far apart, and made so far apart, have a gap between
    them that cuts a stretch.

    The rows after a late reading are skipped, but the time without a reading lies before it. So
    rows without readings are no gap if the readings on both sides came close together, and a
    reading that came very late has a gap before it.
    """
    is_absent = (due_s > series.cut_s) & (took_s > series.cut_s)
    return is_absent | (took_s > series.cut_s + MOST_LATE_S)


def unseen(series: Series, parts: Sequence[Stretch]) -> tuple[float, int]:
    """Return how long the tool may have worked while nothing could be analysed, in s, and in how
    many pieces.

    These are gaps, and pieces between two gaps that are too short. Where the state was not read the
    tool may have worked. Pieces of up to `BRIDGED_S` do not count.
    """
    found = Unseen()
    found.add(series, parts, slice(0, len(series.seconds)))
    return found.total()


class Unseen:
    """The time that `unseen` returns, added up window by window."""

    def __init__(self) -> None:
        self._seconds, self._pieces = 0.0, 0
        self._last_s: float | None = None
        self._last_read_s = 0.0
        self._since_s: float | None = None  # since when nothing is seen, if that continues
        self._period_s = 0.0

    def add(self, series: Series, parts: Sequence[Stretch], own: slice) -> None:
        """Add the rows `own` of a window, in order of time; the window may have other rows before
        and after them.
        """
        at, moments, period = series.seconds[own], series.moments[own], series.period_s
        if not len(at) or not period:
            return
        self._period_s = period
        analysed = np.zeros(len(at), dtype=np.bool_)
        for part in parts:
            first, last = np.searchsorted(
                moments, [part.seconds[0] - period / 2, part.seconds[-1] + period / 2]
            )
            analysed[first:last] = True
        lost = (series.rows.working[own] | ~series.known[own]) & ~analysed
        if self._last_s is not None:
            at = np.concatenate(([self._last_s], at))
            moments = np.concatenate(([self._last_read_s], moments))
            lost = np.concatenate(([self._since_s is not None], lost))
            analysed = np.concatenate(([False], analysed))
        due_s, took_s = np.diff(at), np.diff(moments)
        # rows skipped for a late reading have its moment; if it is not analysed, they are lost
        counts = analysed[1:] | (due_s > series.cut_s)
        absent = _is_gap(series, due_s, took_s) & counts & ~lost[:-1] & ~lost[1:]
        self._count(np.maximum(due_s, took_s)[absent] - period)
        edges = np.flatnonzero(np.diff(lost.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
        begins, ends = at[edges[:, 0]], at[edges[:, 1] - 1]
        if len(edges) and edges[0, 0] == 0 and self._since_s is not None:
            begins[0] = self._since_s
        self._since_s, self._last_s = None, float(at[-1])
        self._last_read_s = float(moments[-1])
        if len(edges) and lost[-1]:
            self._since_s, begins, ends = float(begins[-1]), begins[:-1], ends[:-1]
        self._count(ends - begins + period)

    def total(self) -> tuple[float, int]:
        """Return seconds and number of pieces."""
        open_s = (
            0.0
            if self._since_s is None or self._last_s is None
            else self._last_s - self._since_s + self._period_s
        )
        is_long = open_s > BRIDGED_S
        return self._seconds + open_s * is_long, self._pieces + is_long

    def _count(self, pieces: Floats) -> None:
        long = pieces[pieces > BRIDGED_S]
        self._seconds, self._pieces = self._seconds + float(long.sum()), self._pieces + len(long)


def _begin(series: Series, places: NDArray[np.int64]) -> float:
    """Return a moment of the grid of these rows: when the second was read, because the first one
    of a run is later than the rest.
    """
    second = min(1, len(places) - 1) if series.read_s is not None else 0
    return float(series.moments[places[second]])


def _grid_start(first_s: float, begun: Sequence[Stretch], begin_s: float) -> float:
    """Return a moment of the grid of the stretch that has a reading at `first_s`; `begin_s` if it
    was not begun in the window before.
    """
    place = bisect_right(begun, first_s + 1e-6, key=lambda stretch: float(stretch.seconds[0])) - 1
    continues = place >= 0 and first_s <= begun[place].seconds[-1] + begun[place].period_s
    return float(begun[place].seconds[0]) if continues else begin_s


def _on_even_grid(
    series: Series, setting: Floats, places: NDArray[np.int64], begin_s: float
) -> Stretch:
    """Interpolate these rows, from when they were read, on an even grid through `begin_s`; the
    setpoint is the last one before.

    A last reading that came a little before its moment on the grid has a row, too: its values
    continue their slope, but nothing ends later than it was read.
    """
    rows, period_s = series.rows, series.period_s
    seconds = series.moments[places]
    beyond = 1e-6 if series.read_s is None else MOST_BEYOND
    first = ceil((seconds[0] - begin_s) / period_s - 1e-6)
    last = floor((seconds[-1] - begin_s) / period_s + beyond)
    grid = moments_of_grid((begin_s, first), last + 1 - first, period_s)
    origin = begin_s, first
    last = np.clip(np.searchsorted(seconds, grid + 1e-6) - 1, 0, len(seconds) - 1)
    temperature, power = (
        np.interp(grid, seconds, column[places]) for column in (rows.temperature, rows.power)
    )
    beyond_s = grid[-1] - seconds[-1]
    if series.read_s is not None and beyond_s > 0:
        before, final = places[-2:]
        took_s = seconds[-1] - seconds[-2]
        for values, column in ((temperature, rows.temperature), (power, rows.power)):
            values[-1] += (column[final] - column[before]) / took_s * beyond_s
        grid[-1] = seconds[-1]
    return Stretch(period_s, grid, temperature, power, setting[places][last], origin)


def moments_of_grid(origin: tuple[float, int], rows: int, period_s: float) -> Floats:
    """Return the moments of this many rows of a grid."""
    begin_s, first = origin
    return np.asarray(begin_s + np.arange(first, first + rows) * period_s, dtype=np.float64)
