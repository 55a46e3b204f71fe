"""The joints of a port whose rows are read piece by piece: a record of any length in the memory of a window.

Three sweeps over the rows, each of them in windows (`windows`), whose edges do not depend on how the rows are read:

1. *Stretches*: where each begins and how long it is, and of which tool; then the pieces are known that a model is taken from.
2. *Tips*: those pieces are kept, 20 minutes of each tool at the most, and the models identified on them (`identify`).
   Then *draws* of heat, each found in the window in which it begins, and how often which temperature was read at rest.
3. *Joints*: what each draw did to the tip, against the levels that are known now.

The second has two halves, so that the rows are read four times; the first half takes only what the model needs. What is kept of a
record is a table of stretches, of draws and of joints, and a count of readings by temperature. A draw longer than
`windows.MOST_WINDOWS` windows is cut off. With a feeder a port is looked at as a whole (`joints`): counts and pushes far apart
tell of each other.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from jbclog.analysis.joints.contacts import flows
from jbclog.analysis.joints.doubt import Doubt, doubt_of
from jbclog.analysis.joints.draws import Draw, draws_of
from jbclog.analysis.joints.heat_up_end import Readied
from jbclog.analysis.joints.identify import identify_each, pieces_taken
from jbclog.analysis.joints.joints import NEVER_READ, ByHeat, Found, concluded, sort_draws
from jbclog.analysis.joints.levels import Levels, resting
from jbclog.analysis.joints.parameters import Asked, taken
from jbclog.analysis.joints.recovery import LOOK_S, Joint, joints_of
from jbclog.analysis.joints.series import Series, Stretch, Unseen
from jbclog.analysis.joints.thermal import ThermalModel
from jbclog.analysis.joints.tools import UNKNOWN_CODE, Tool, code_at, large_enough
from jbclog.analysis.joints.windows import WINDOW_S, View, Windows

Sweep = Callable[[], Iterable[Series]]
"""Reads the rows of a port, in pieces of any size; the same ones each time it is called."""

SETTLED_S: Final = 30.0  # so far before the end of what is seen, nothing behind it matters to a draw
NEAR_S: Final = 10.0


def joints_in(sweep: Sweep, asked: Asked | None = None, window_s: float = WINDOW_S) -> Found:
    """The joints of a port without a feeder, as `find_joints` gives them of all its rows at once."""
    port = PortSweeps(asked or Asked(), window_s)
    while (windows := port.next_sweep()) is not None:
        for piece in sweep():
            windows.take(piece)
        windows.end()
    return port.found


@dataclass(slots=True)
class _Known:
    """A stretch of the record: its tool's code, and its model where that is known."""

    start_s: float
    period_s: float
    rows: int
    model: ThermalModel | None = None

    @property
    def length_s(self) -> float:
        return self.rows * self.period_s


@dataclass(slots=True)
class _Kept:
    """A piece of the record that is kept: from its first to its last moment, and its rows as they come."""

    first_s: float
    last_s: float
    parts: list[Readied] = field(default_factory=list)

    def whole(self) -> Readied:
        stretches = [part.stretch for part in self.parts]
        names = ("seconds", "temperature", "power", "setting")
        columns = [np.concatenate([getattr(stretch, name) for stretch in stretches]) for name in names]
        return Readied(Stretch(stretches[0].period_s, *columns), np.concatenate([part.ready for part in self.parts]))


class PortSweeps:
    """A port in its sweeps: `next_sweep` gives what takes the rows, and None when its joints are `found`."""

    def __init__(self, asked: Asked, window_s: float = WINDOW_S, beside: Callable[[View], None] | None = None) -> None:
        """`beside` sees the windows of the first sweep, too."""
        self._asked, self._window_s, self._done, self._beside = asked, window_s, 0, beside
        self._period_s = 0.0
        self._known: list[_Known] = []
        self._groups: list[tuple[float, list[_Known]]] = []
        self._absent, self._last_tool = 0, (UNKNOWN_CODE, -1)
        self._unseen = Unseen()
        self._kept: list[list[_Kept]] = []
        self._models: list[ThermalModel] = []
        self._why: str | None = None
        self._doubt: Doubt | None = None
        self._draws: list[Draw] = []
        self._levels = Levels()
        self._joints: list[Joint] = []
        self._found: Found | None = None

    @property
    def found(self) -> Found:
        """The joints. Raises `ValueError` while there are sweeps to come."""
        if self._found is None:
            raise ValueError("not every sweep over the port's rows is done")
        return self._found

    def next_sweep(self) -> Windows | None:
        """What takes the rows next; call it again when they have ended."""
        steps = (
            (None, self._look_at_stretches),
            (self._tools, self._keep),
            (self._identify, self._find),
            (self._sort, self._measure),
            (self._conclude, None),
        )
        before, look = steps[self._done]
        if before is not None:
            before()
        self._done += 1
        return None if look is None else Windows(look, self._window_s)

    def _look_at_stretches(self, view: View) -> None:
        if self._beside is not None:
            self._beside(view)
        series = view.series
        self._period_s = series.period_s
        self._unseen.add(series, [part.stretch for part in view.parts], view.own(series.seconds))
        own = view.own(series.seconds)
        absent = np.concatenate(([0], np.cumsum(~series.rows.in_place)))
        for part in view.parts:
            rows = view.own(part.stretch.seconds)
            if rows.stop <= rows.start:
                continue
            if part.start_s >= view.begin_s or not self._known:
                row = int(np.searchsorted(series.seconds, part.start_s - 1e-6))
                self._begin(_Known(part.start_s, series.period_s, 0), series, row, int(absent[row] - absent[own.start]))
            self._known[-1].rows += rows.stop - rows.start
        self._absent += int(absent[own.stop] - absent[own.start])

    def _begin(self, known: _Known, series: Series, row: int, absent: int) -> None:
        """A stretch begins; with another tool, or one that was out of its port, a group of stretches does."""
        code = code_at(series.rows.tool, row)
        tool = (code, self._absent + absent)
        if tool != self._last_tool or not self._groups:
            self._groups.append((code, []))
        self._last_tool = tool
        self._groups[-1][1].append(known)
        self._known.append(known)

    def _tools(self) -> None:
        """Which pieces of the record the model of each tool is taken from."""
        self._tools_known = large_enough(self._groups)
        for tool in self._tools_known:
            taken_rows = pieces_taken([part.rows for part in tool], self._period_s)
            kept = [
                _Kept(tool[part].start_s + rows.start * self._period_s, tool[part].start_s + (rows.stop - 1) * self._period_s)
                for part, rows in taken_rows
            ]
            self._kept.append(kept)
        self._wanted = sorted((piece for kept in self._kept for piece in kept), key=lambda piece: piece.first_s)

    def _keep(self, view: View) -> None:
        half = self._period_s / 2
        for part in view.parts:
            own = view.own(part.stretch.seconds)
            seconds = part.stretch.seconds[own]
            if not len(seconds):
                continue
            place = max(bisect_right(self._wanted, float(seconds[0]), key=lambda piece: piece.first_s) - 1, 0)
            while place < len(self._wanted) and self._wanted[place].first_s <= seconds[-1] + half:
                piece, place = self._wanted[place], place + 1
                first, last = np.searchsorted(seconds, [piece.first_s - half, piece.last_s + half])
                rows = slice(own.start + int(first), own.start + int(last))
                if last > first:
                    piece.parts.append(Readied(_copy(part.stretch.take(rows)), part.ready[rows].copy()))

    def _identify(self) -> None:
        pieces = [[piece.whole() for piece in kept] for kept in self._kept]
        models, self._why = identify_each(pieces)
        self._models = [model for model in models if model is not None]
        tools = [Tool(parts, model) for parts, model in zip(pieces, models, strict=True) if model is not None]
        for tool, model in zip(self._tools_known, models, strict=True):
            for part in tool:
                part.model = model
        if not self._known:
            self._why = NEVER_READ
        self._kept.clear()
        self._wanted.clear()
        self._settings = taken(self._asked, self._period_s, False)
        self._doubt = doubt_of(tools, self._settings) if tools else None

    def _find(self, view: View) -> float | None:
        near = [part for part in view.parts if part.stretch.seconds[-1] >= view.begin_s - NEAR_S and part.start_s < view.end_s]
        modelled = [(part, model) for part in near if (model := self._model_at(float(part.stretch.seconds[-1]))) is not None]
        looked = [(flows(part.stretch, model, part.ready), model) for part, model in modelled]
        found = [draw for flow, model in looked for draw in draws_of(flow, model, self._settings)]
        again_s = _again(view, found, SETTLED_S)
        first, last = view.own(np.array([draw.start_s for draw in found]), until_s=_or_never(again_s)).indices(len(found))[:2]
        self._draws += found[first:last]
        for flow, _ in looked:
            rest, own = resting(flow, found), view.own(flow.stretch.seconds, _or_never(again_s))
            rest[: own.start] = rest[own.stop :] = False
            self._levels.add(flow, rest)
        return again_s

    def _model_at(self, second: float) -> ThermalModel | None:
        place = bisect_right(self._known, second + 1e-6, key=lambda known: known.start_s) - 1
        return self._known[place].model if place >= 0 else None

    def _sort(self) -> None:
        self._own, self._others = sort_draws(self._draws, self._settings)
        self._every = self._draws
        self._level = self._levels.levels(self._period_s)

    def _measure(self, view: View) -> float | None:
        own = _between(self._own, view.begin_s, view.end_s)
        again_s = _again(view, own, LOOK_S + self._period_s)
        own = _between(own, view.begin_s, _or_never(again_s))
        near = _between(self._every, view.begin_s, view.last_s)
        self._joints += joints_of(view.series, own, near, self._level, self._settings.recovered_within_c)
        return again_s

    def _conclude(self) -> None:
        heat = ByHeat(self._models, self._why, self._own, self._doubt)
        lost = self._unseen.total()
        self._found = concluded(self._joints, self._others, self._level, self._settings, heat, lost, self._period_s)


def _again(view: View, draws: Sequence[Draw], behind_s: float) -> float | None:
    """From when on a window is to be seen again: since a draw that begins in it goes on, or may, beyond what is seen of it."""
    late = [draw.start_s for draw in draws if view.begin_s <= draw.start_s < view.end_s and draw.end_s > view.last_s - behind_s]
    return None if view.must or not late else late[0]


def _or_never(moment: float | None) -> float:
    return np.inf if moment is None else moment


def _between(draws: Sequence[Draw], begin_s: float, end_s: float) -> Sequence[Draw]:
    first, last = (bisect_left(draws, moment, key=lambda draw: draw.start_s) for moment in (begin_s, end_s))
    return draws[first:last]


def _copy(stretch: Stretch) -> Stretch:
    columns = (stretch.seconds, stretch.temperature, stretch.power, stretch.setting)
    return Stretch(stretch.period_s, *(column.copy() for column in columns))
