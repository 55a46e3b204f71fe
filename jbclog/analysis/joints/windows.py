"""The rows of a port in windows, independent of the pieces in which they are read.

A window has its own rows, `WINDOW_S` of them, and `BESIDE_S` more on both sides for filters,
contacts and recoveries. Its edges are whole multiples of `WINDOW_S` in seconds of the run, so the
same record gives the same windows whether it is read in row groups of a hundred rows or at once.
Only one window is in memory.

A `Look` may ask to see the last rows of its window again if something in them continues beyond it:
the next window then begins there. After `MOST_WINDOWS` it must do without.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from math import floor, inf
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.joints.heat_up_end import ReadyStretch, ready_stretches_of_window
from jbclog.analysis.joints.series import Series, Stretch, moments_of_grid, stretches
from jbclog.analysis.port_data import Flags, Floats
from jbclog.analysis.verdict.idle import Block

WINDOW_S, BESIDE_S = 1200.0, 90.0
MOST_WINDOWS: Final = 6
SAME_S: Final = 1e-4  # closer moments are the same: an edge lies this far before a row, never on it
EARLIER_S: Final = 1.2  # a draw may begin before the first row if the temperature is reported late
COLUMNS: Final = ("seconds", "temperature", "power", "setting", "working")
CODES: Final = ("tool", "port_error")


@dataclass(frozen=True, slots=True)
class View:
    """A window: its own rows, from `begin_s` to before `end_s`, with those on both sides.

    `parts` are the stretches in it, as they are in the whole record. `is_final`: its rows are not
    shown again.
    """

    series: Series
    parts: Sequence[ReadyStretch]
    begin_s: float
    end_s: float
    is_final: bool

    @property
    def last_s(self) -> float:
        """Time until which there are rows; infinite if the record ends in the window."""
        return self.end_s + BESIDE_S

    def own(self, seconds: Floats, until_s: float = inf) -> slice:
        """Return the slice of these sorted moments that lies in the window itself."""
        first, last = np.searchsorted(seconds, [self.begin_s, min(self.end_s, until_s)])
        return slice(int(first), int(last))

    @property
    def own_rows(self) -> Series:
        """The window's own rows, without those on both sides."""
        return rows_of(self.series, self.own(self.series.seconds))


def whole(series: Series) -> View:
    """Return all rows of a port as one window, without stretches."""
    return View(series, (), -inf, inf, True)


@dataclass(frozen=True, slots=True)
class _PartBefore:
    """A stretch in the window before, as the next window needs it: its moments, and where the tip
    was ready.
    """

    origin: tuple[float, int]
    rows: int
    period_s: float
    ready: NDArray[np.uint8]  # bits

    @classmethod
    def of(cls, part: ReadyStretch) -> _PartBefore:
        stretch = part.stretch
        assert stretch.origin is not None
        return cls(stretch.origin, len(stretch), stretch.period_s, np.packbits(part.ready))

    def restored(self) -> ReadyStretch:
        """Return the stretch without its readings."""
        none = np.empty(0)
        seconds = moments_of_grid(self.origin, self.rows, self.period_s)
        ready = np.unpackbits(self.ready, count=self.rows).astype(np.bool_)
        return ReadyStretch(Stretch(self.period_s, seconds, none, none, none), ready)


class _Edges(NamedTuple):
    """Edges of a window of a sweep, the moments of its first and last row, and the codes of the
    first.
    """

    begin_s: float
    end_s: float
    is_final: bool
    first_s: float
    last_s: float
    codes: tuple[float | None, ...]

    @classmethod
    def of(cls, rows: Series, begin_s: float, end_s: float, *, is_final: bool) -> _Edges:
        columns = [getattr(rows.rows, name) for name in CODES]
        codes = (None if column is None else float(column[0]) for column in columns)
        first_s, last_s = float(rows.seconds[0]), float(rows.seconds[-1])
        return cls(begin_s, end_s, is_final, first_s, last_s, tuple(codes))


class Seen:
    """Every window of a sweep that sees each once, with its stretches, as some bits per row: a
    later sweep can then read some windows alone (`SeenWindows`).
    """

    def __init__(self) -> None:
        self.edges: list[_Edges] = []
        self._parts: list[list[_PartBefore]] = []

    def add(self, edges: _Edges, parts: Sequence[ReadyStretch]) -> None:
        """Add the next window."""
        self.edges.append(edges)
        self._parts.append([*map(_PartBefore.of, parts)])

    def before(self, window: int) -> list[ReadyStretch]:
        """Return the stretches of the window before this one; the first window is 0."""
        return [part.restored() for part in self._parts[window - 1]] if window else []


Look = Callable[[View], float | None]
"""Takes a window and returns the time from which it wants to see that window's own rows again, or
None.
"""


class TakesRows(Protocol):
    """Takes the rows of a port piece by piece, in order."""

    def take(self, piece: Series) -> None: ...

    def end(self) -> None:
        """End: there are no more rows."""


class Windows:
    """Cuts the rows of a port into windows and shows them to `look`.

    `seen` collects each window. Without `with_parts` a view has no stretches.
    """

    def __init__(
        self,
        look: Look,
        window_s: float = WINDOW_S,
        *,
        seen: Seen | None = None,
        with_parts: bool = True,
    ) -> None:
        self._look, self._window_s = look, window_s
        self._seen, self._with_parts = seen, with_parts
        self._pieces: list[Series] = []
        self._begin_s = self._end_s = -inf
        self._before: Sequence[ReadyStretch] = ()

    def take(self, piece: Series) -> None:
        if not len(piece.seconds):
            return
        if self._end_s == -inf:
            first_s = float(piece.seconds[0])
            self._begin_s, self._end_s = first_s - EARLIER_S, self._edge(first_s)
        self._pieces.append(piece)
        if float(piece.seconds[-1]) > self._end_s + BESIDE_S:
            held = joined(self._pieces)
            while float(held.seconds[-1]) > self._end_s + BESIDE_S:
                held = self._show(held)
            self._pieces = [_copied(held)]

    def end(self) -> None:
        """Show the last window: there are no more rows."""
        if self._pieces:
            self._look_at(joined(self._pieces), inf, is_final=True)
            self._pieces.clear()

    def copied(self, look: Look) -> Windows:
        """Return windows that continue from here with another `look`; these stay as they are."""
        other = copy(self)
        other._look, other._pieces = look, [*self._pieces]
        return other

    def _edge(self, second: float) -> float:
        """Return the first edge of a window after this moment."""
        return (floor((second + SAME_S) / self._window_s) + 1) * self._window_s - SAME_S

    def _show(self, held: Series) -> Series:
        """Show the next window and return the rows that the one after it needs."""
        last = int(np.searchsorted(held.seconds, self._end_s + BESIDE_S, side="right"))
        is_final = self._end_s - self._begin_s > (MOST_WINDOWS - 0.5) * self._window_s
        again_s = self._look_at(rows_of(held, slice(0, last)), self._end_s, is_final=is_final)
        self._begin_s = self._end_s if again_s is None or is_final else again_s
        # there is one, because rows follow this window
        following = held.seconds[np.searchsorted(held.seconds, self._begin_s)]
        self._end_s = max(self._end_s + self._window_s, self._edge(float(following)))
        return _rows_from(held, self._begin_s - BESIDE_S)

    def _look_at(self, rows: Series, end_s: float, *, is_final: bool) -> float | None:
        series = placed(rows)
        if self._with_parts:
            self._before = _parts_of(series, self._before)
        if self._seen is not None:
            edges = _Edges.of(rows, self._begin_s, end_s, is_final=is_final)
            self._seen.add(edges, self._before)
        return self._look(View(series, self._before, self._begin_s, end_s, is_final))


class SeenWindows:
    """Shows `look` the windows of an earlier sweep again that are `wanted`, by begin and end."""

    def __init__(self, look: Look, seen: Seen, wanted: Callable[[float, float], bool]) -> None:
        self._look, self._seen = look, seen
        self._left = deque(
            (number, edges)
            for number, edges in enumerate(seen.edges)
            if wanted(edges.begin_s, edges.end_s)
        )
        self._pieces: list[Series] = []

    def take(self, piece: Series) -> None:
        if not len(piece.seconds):
            return
        self._pieces.append(piece)
        while self._left and self._left[0][1].last_s <= piece.seconds[-1]:
            self._show(*self._left.popleft())
        first_s = self._left[0][1].first_s if self._left else inf
        self._pieces = [one for one in self._pieces if one.seconds[-1] >= first_s]

    def end(self) -> None:
        """Do nothing: each window was shown with its last row."""

    def _show(self, number: int, edges: _Edges) -> None:
        there = [_between(one, edges.first_s, edges.last_s) for one in self._pieces]
        held = joined([one for one in there if len(one.seconds)])
        tool, port_error = (
            _begun_with(getattr(held.rows, name), code)
            for name, code in zip(CODES, edges.codes, strict=True)
        )
        rows = replace(held.rows, tool=tool, port_error=port_error)
        series = placed(replace(held, rows=rows))
        parts = _parts_of(series, self._seen.before(number))
        self._look(View(series, parts, edges.begin_s, edges.end_s, edges.is_final))


def _parts_of(series: Series, before: Sequence[ReadyStretch]) -> list[ReadyStretch]:
    """Return the stretches of a window; `before` are those of the window before it."""
    begun = [part.stretch for part in before]
    return ready_stretches_of_window(stretches(series, begun=begun), before)


def _between(series: Series, first_s: float, last_s: float) -> Series:
    first = np.searchsorted(series.seconds, first_s)
    stop = np.searchsorted(series.seconds, last_s, side="right")
    return rows_of(series, slice(int(first), int(stop)))


def _begun_with(codes: Floats | None, first: float | None) -> Floats | None:
    """Return the codes of a window, the first of them the one last read before it."""
    if codes is None or first is None:
        return codes
    return np.concatenate([[first], codes[1:]])


def joined(pieces: Sequence[Series]) -> Series:
    if len(pieces) == 1:
        return pieces[0]
    rows = [piece.rows for piece in pieces]
    columns = [_joined_column([getattr(one, name) for one in rows]) for name in (*COLUMNS, *CODES)]
    known = np.concatenate([piece.known for piece in pieces])
    read_s = _joined_column([piece.read_s for piece in pieces])
    return replace(
        pieces[0],
        rows=Block(*columns),
        known=known,
        feeding=_joined_column([piece.feeding for piece in pieces]),
        read_s=None if read_s is None else np.maximum.accumulate(read_s),
    )


def _joined_column(columns: Sequence[Any]) -> Any:
    return None if any(column is None for column in columns) else np.concatenate(columns)


def rows_of(series: Series, rows: Flags | slice) -> Series:
    feeding = None if series.feeding is None else series.feeding[rows]
    read_s = None if series.read_s is None else series.read_s[rows]
    return replace(
        series,
        rows=series.rows.take(rows),
        known=series.known[rows],
        feeding=feeding,
        read_s=read_s,
    )


def _rows_from(series: Series, begin_s: float) -> Series:
    """Return the rows from a moment on; the first row has the codes last read."""
    first = int(np.searchsorted(series.seconds, begin_s))
    kept = rows_of(series, slice(first, None))
    tool, port_error = (_codes_from(getattr(series.rows, name), first) for name in CODES)
    return replace(kept, rows=replace(kept.rows, tool=tool, port_error=port_error))


def _copied(series: Series) -> Series:
    """Copy the rows, so that the memory of those before them is freed."""
    columns = [_copied_column(getattr(series.rows, name)) for name in (*COLUMNS, *CODES)]
    return replace(
        series,
        rows=Block(*columns),
        known=series.known.copy(),
        feeding=_copied_column(series.feeding),
        read_s=_copied_column(series.read_s),
    )


def _copied_column(column: Any) -> Any:
    return None if column is None else column.copy()


def placed(series: Series) -> Series:
    """Return the rows with a tool that is out of its place as not working; the codes on both sides
    decide where it was.
    """
    return replace(
        series, rows=replace(series.rows, working=series.rows.working & series.rows.in_place)
    )


def _codes_from(codes: Floats | None, first: int) -> Floats | None:
    """Return the codes from this row on, the first of them the one last read."""
    if codes is None:
        return None
    kept, read = codes[first:].copy(), np.flatnonzero(~np.isnan(codes[: first + 1]))
    if len(read) and len(kept):
        kept[0] = codes[read[-1]]
    return kept
