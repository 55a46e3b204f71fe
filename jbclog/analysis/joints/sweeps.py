"""The joints of a port whose rows are read piece by piece: a record of any length in the memory of
one window.

There are three sweeps over the rows, each in windows (`windows`) whose edges do not depend on how
the rows are read:

1. *Stretches*: where each begins, how long it is, and which tool it belongs to. This determines the
   pieces that a model comes from.
2. *Tips*: keep those pieces, 20 minutes of each tool at most, and identify the models on them
   (`identify`). Then *draws*: find each in the window in which it begins, and count the
   temperatures at rest.
3. *Joints*: effect of each draw on the tip, against the levels that are now known.

The second sweep has two halves, so the rows are read four times; of a long record the first half
needs the windows with those pieces alone. Memory holds a table of stretches, of draws and of
joints, and a count of readings by temperature. A draw longer than `windows.MOST_WINDOWS` windows is
cut off. A port with a feeder is analysed as a whole (`joints`), because counts and pushes far apart
explain each other.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from jbclog.analysis.joints.contacts import flow_into_work
from jbclog.analysis.joints.doubt import Doubt, doubt_of
from jbclog.analysis.joints.draws import Draw, find_draws, is_joint
from jbclog.analysis.joints.heat_up_end import ReadyStretch
from jbclog.analysis.joints.identify import NEVER_READ, identify_each, pieces_for_model
from jbclog.analysis.joints.joints import ByHeat, FoundJoints, concluded, sort_draws
from jbclog.analysis.joints.levels import Levels, resting
from jbclog.analysis.joints.packed import ROWS_AT_ONCE, Packed
from jbclog.analysis.joints.parameters import JointOptions, settings_for
from jbclog.analysis.joints.recovery import MOST_RECOVERY_S, Joint, joints_of
from jbclog.analysis.joints.series import Series, Stretch, Unseen
from jbclog.analysis.joints.thermal import ThermalModel
from jbclog.analysis.joints.tools import UNKNOWN_CODE, Tool, code_at, merged_by_code
from jbclog.analysis.joints.windows import WINDOW_S, Seen, SeenWindows, TakesRows, View, Windows

# a draw that ends this long before the last row does not depend on later rows
SETTLED_S: Final = 30.0
NEAR_S: Final = 10.0
SAME_S: Final = 1e-6


@dataclass(slots=True)
class KnownStretch:
    """A stretch of the record, and the model of its tool if known."""

    start_s: float
    period_s: float
    rows: int
    model: ThermalModel | None = None

    @property
    def length_s(self) -> float:
        return self.rows * self.period_s


@dataclass(frozen=True, slots=True)
class Identified:
    """Begin and model of each stretch of a port, in order; why a model is not known, and the doubt
    about the number.

    `last_tool` is the tool of the last stretch: its code, and a number for each exchange.
    """

    starts: list[float]
    models: list[ThermalModel | None]
    last_tool: tuple[float, int]
    why: str | None
    doubt: Doubt | None

    def stretch_like(self, start_s: float, tool: tuple[float, int]) -> int | None:
        """Return the number of the stretch that begins at this time, or of the last one if this one
        continues it with its tool; None: the tool is another one.
        """
        place = bisect_right(self.starts, start_s + SAME_S) - 1
        if place >= 0 and start_s - self.starts[place] <= SAME_S:
            return place
        return len(self.starts) - 1 if self.starts and tool == self.last_tool else None


@dataclass(slots=True)
class _ModelPiece:
    """A piece of the record that a model comes from: its first and last moment, and its rows as
    they are read.
    """

    first_s: float
    last_s: float
    parts: list[ReadyStretch] = field(default_factory=list)

    def whole(self) -> ReadyStretch:
        """Return the rows of the piece as one stretch."""
        stretches = [part.stretch for part in self.parts]
        names = ("seconds", "temperature", "power", "setting")
        seconds, temperature, power, setting = (
            np.concatenate([getattr(stretch, name) for stretch in stretches]) for name in names
        )
        return ReadyStretch(
            Stretch(stretches[0].period_s, seconds, temperature, power, setting),
            np.concatenate([part.ready for part in self.parts]),
        )


class PortSweeps:
    """The sweeps over one port: `next_sweep` returns the object that takes the rows, and None once
    the joints are `found`.
    """

    def __init__(
        self,
        options: JointOptions,
        window_s: float = WINDOW_S,
        observe: Callable[[View], None] | None = None,
    ) -> None:
        """`observe` is called with the windows of the first sweep too."""
        self._options, self._window_s, self._done, self._observe = options, window_s, 0, observe
        self._period_s = 0.0
        self._seen = Seen()
        self._stretches: list[KnownStretch] = []
        self._groups: list[tuple[float, list[KnownStretch]]] = []
        self._absent, self._last_tool = 0, (UNKNOWN_CODE, -1)
        self._unseen = Unseen()
        self._kept: list[list[_ModelPiece]] = []
        self._models: list[ThermalModel] = []
        self._why: str | None = None
        self._doubt: Doubt | None = None
        self._draws = Packed(Draw)
        self._levels = Levels()
        self._joints = Packed(Joint)
        self._found: FoundJoints | None = None

    @property
    def found(self) -> FoundJoints:
        """The joints. Raises `ValueError` before the end of the last sweep."""
        if self._found is None:
            raise ValueError("the sweeps over the port's rows have not ended")
        return self._found

    @property
    def identified(self) -> Identified:
        """The models, for the rows that follow; valid after the last sweep."""
        return Identified(
            [known.start_s for known in self._stretches],
            [known.model for known in self._stretches],
            self._last_tool,
            self._why,
            self._doubt,
        )

    def next_sweep(self) -> TakesRows | None:
        """Return the object that takes the rows of the next sweep; call again when these have
        ended.
        """
        number, self._done = self._done, self._done + 1
        if number == 0:
            return Windows(self._look_at_stretches, self._window_s, seen=self._seen)
        if number == 1:
            self._choose_pieces()
            return SeenWindows(self._keep_pieces, self._seen, self._has_piece)
        if number == 2:
            self._identify_tools()
            return Windows(self._find_draws, self._window_s)
        if number == 3:
            self._sort_draws()
            return Windows(self._measure_joints, self._window_s, with_parts=False)
        self._conclude()
        return None

    def _look_at_stretches(self, view: View) -> None:
        """Record the stretches that begin in this window, and the rows of those that continue."""
        if self._observe is not None:
            self._observe(view)
        series = view.series
        self._period_s = series.period_s
        self._unseen.add(series, [part.stretch for part in view.parts], view.own(series.seconds))
        own = view.own(series.seconds)
        absent = np.concatenate(([0], np.cumsum(~series.rows.in_place)))
        for part in view.parts:
            rows = view.own(part.stretch.seconds)
            if rows.stop <= rows.start:
                continue
            if part.start_s >= view.begin_s or not self._stretches:
                row = int(np.searchsorted(series.moments, part.start_s - 1e-6))
                self._begin(
                    KnownStretch(part.start_s, series.period_s, 0),
                    series,
                    row,
                    int(absent[row] - absent[own.start]),
                )
            self._stretches[-1].rows += rows.stop - rows.start
        self._absent += int(absent[own.stop] - absent[own.start])

    def _begin(self, known: KnownStretch, series: Series, row: int, absent: int) -> None:
        """Record a new stretch; another tool, or one that was out of its port, begins a new
        group.
        """
        tool = self._tool_at(series, row, absent)
        if tool != self._last_tool or not self._groups:
            self._groups.append((tool[0], []))
        self._last_tool = tool
        self._groups[-1][1].append(known)
        self._stretches.append(known)

    def _tool_at(self, series: Series, row: int, absent: int) -> tuple[float, int]:
        return code_at(series.rows.tool, row), self._absent + absent

    def _choose_pieces(self) -> None:
        """Choose the pieces of the record that the model of each tool comes from."""
        self._stretches_by_tool = merged_by_code(self._groups)
        for tool in self._stretches_by_tool:
            rows_of_model = pieces_for_model([part.rows for part in tool], self._period_s)
            kept = [
                _ModelPiece(
                    tool[part].start_s + rows.start * self._period_s,
                    tool[part].start_s + (rows.stop - 1) * self._period_s,
                )
                for part, rows in rows_of_model
            ]
            self._kept.append(kept)
        self._pieces = sorted(
            (piece for kept in self._kept for piece in kept), key=lambda piece: piece.first_s
        )

    def _has_piece(self, begin_s: float, end_s: float) -> bool:
        """Whether a model needs rows between these moments."""
        half = self._period_s / 2
        return any(
            piece.first_s - half <= end_s and piece.last_s + half >= begin_s
            for piece in self._pieces
        )

    def _keep_pieces(self, view: View) -> None:
        """Keep the rows of this window that a model needs."""
        half = self._period_s / 2
        for part in view.parts:
            own = view.own(part.stretch.seconds)
            seconds = part.stretch.seconds[own]
            if not len(seconds):
                continue
            place = max(
                bisect_right(self._pieces, float(seconds[0]), key=lambda piece: piece.first_s) - 1,
                0,
            )
            while place < len(self._pieces) and self._pieces[place].first_s <= seconds[-1] + half:
                piece, place = self._pieces[place], place + 1
                first, last = np.searchsorted(seconds, [piece.first_s - half, piece.last_s + half])
                rows = slice(own.start + int(first), own.start + int(last))
                if last > first:
                    piece.parts.append(
                        ReadyStretch(_copy(part.stretch.take(rows)), part.ready[rows].copy())
                    )

    def _identify_tools(self) -> None:
        pieces = [[piece.whole() for piece in kept] for kept in self._kept]
        models, self._why = identify_each(pieces)
        self._models = [model for model in models if model is not None]
        tools = [
            Tool(parts, model)
            for parts, model in zip(pieces, models, strict=True)
            if model is not None
        ]
        for tool, model in zip(self._stretches_by_tool, models, strict=True):
            for part in tool:
                part.model = model
        if not self._stretches:
            self._why = NEVER_READ
        self._kept.clear()
        self._pieces.clear()
        self._seen = Seen()
        self._settings = settings_for(self._options, self._period_s, False)
        self._doubt = doubt_of(tools, self._settings) if tools else None

    def _find_draws(self, view: View) -> float | None:
        """Find the draws that begin in this window and count its readings at rest; return the time
        from which it must be shown again.
        """
        near = [
            part
            for part in view.parts
            if part.stretch.seconds[-1] >= view.begin_s - NEAR_S and part.start_s < view.end_s
        ]
        modelled = [
            (part, model)
            for part in near
            if (model := self._model_at(float(part.stretch.seconds[-1]))) is not None
        ]
        flows = [
            (flow_into_work(part.stretch, model, part.ready), model) for part, model in modelled
        ]
        found = [
            draw for flow, model in flows for draw in find_draws([flow], model, self._settings)
        ]
        again_s = _seen_again_from(view, found, SETTLED_S)
        first, last = view.own(
            np.array([draw.start_s for draw in found]), until_s=_or_never(again_s)
        ).indices(len(found))[:2]
        self._draws.extend(found[first:last])
        for flow, _ in flows:
            rest, own = resting(flow, found), view.own(flow.stretch.seconds, _or_never(again_s))
            rest[: own.start] = rest[own.stop :] = False
            self._levels.add(flow, rest)
        return again_s

    def _model_at(self, second: float) -> ThermalModel | None:
        place = bisect_right(self._stretches, second + 1e-6, key=lambda known: known.start_s) - 1
        return self._stretches[place].model if place >= 0 else None

    def _sort_draws(self) -> None:
        self._resting_levels = self._levels.levels(self._period_s)
        if (self._draws.floats("dwell_s") >= self._settings.least_dwell_s).all():  # all are joints
            self._joint_draws, self._others = self._draws, Packed(Draw)
            return
        self._joint_draws, self._others = Packed(Draw), Packed(Draw)
        for first in range(0, len(self._draws), ROWS_AT_ONCE):
            joints, others = sort_draws(self._draws[first : first + ROWS_AT_ONCE], self._settings)
            self._joint_draws.extend(joints)
            self._others.extend(others)

    def _measure_joints(self, view: View) -> float | None:
        """Measure the joints that begin in this window; return the time from which it must be shown
        again.
        """
        near = _between(self._draws, view.begin_s, view.last_s)
        own = [
            draw for draw in near if draw.start_s < view.end_s and is_joint(draw, self._settings)
        ]
        again_s = _seen_again_from(view, own, MOST_RECOVERY_S + self._period_s)
        if again_s is not None:
            own = own[: bisect_left(own, again_s, key=lambda draw: draw.start_s)]
        within_c = self._settings.recovered_within_c
        self._joints.extend(joints_of(view.series, own, near, self._resting_levels, within_c))
        return again_s

    def _conclude(self) -> None:
        heat = ByHeat(self._models, self._why, self._joint_draws, self._doubt)
        self._found = concluded(
            self._joints,
            self._others,
            self._resting_levels,
            self._settings,
            heat,
            self._unseen.total(),
            self._period_s,
        )


def _seen_again_from(view: View, draws: Sequence[Draw], behind_s: float) -> float | None:
    """Return the time from which a window must be shown again because a draw in it may continue
    beyond its rows; None if not.
    """
    late = [
        draw.start_s
        for draw in draws
        if view.begin_s <= draw.start_s < view.end_s and draw.end_s > view.last_s - behind_s
    ]
    return None if view.is_final or not late else late[0]


def _or_never(moment: float | None) -> float:
    return np.inf if moment is None else moment


def _between(draws: Packed[Draw], begin_s: float, end_s: float) -> list[Draw]:
    return draws[draws.place("start_s", begin_s) : draws.place("start_s", end_s)]


def _copy(stretch: Stretch) -> Stretch:
    """Copy a stretch, so that the memory of the window's rows is freed."""
    columns = (stretch.seconds, stretch.temperature, stretch.power, stretch.setting)
    seconds, temperature, power, setting = (column.copy() for column in columns)
    return Stretch(stretch.period_s, seconds, temperature, power, setting)
