"""The rule `reached`: the tool arrives at the temperature that its recipe sets, and stays at work.

A tool is *at work* while its status is working, not extractor (hot air: on). It *arrives* with the
first reading at work within `reached_within_c` of the setpoint, or with the first one past the
setpoint. A change of tool or setpoint requires a new arrival, unless the tool is at work for less
than `ENOUGH_S` after it. *At work since* is the percentage of rows at work among those due from the
first arrival to the end of the run; a row without a status counts as neither.

A tool that was ordered to work and did not arrive breaks the rule, unless it was read for less than
`ENOUGH_S` or was still approaching when the record ended (`APPROACH_C` nearer than `APPROACH_S`
before). A tool that was never ordered to work is missing evidence; with `at_work_percent = 0` it is
not judged.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.clock_steps import nominal_period
from jbclog.analysis.port_data import Flags, Floats, setting_in_force
from jbclog.analysis.verdict.idle import Block
from jbclog.analysis.verdict.rule import Judged, Result, allowed_misses, floored, shown

RULE: Final = "reached"
WITHIN_C, AT_WORK_PERCENT = 10.0, 80.0
"""Defaults of `[acceptance]`."""
ENOUGH_S: Final = 10.0
APPROACH_S, APPROACH_C = 5.0, 1.0
ORDERS_WORK: Final = ("working", "on")


@dataclass(frozen=True, slots=True)
class Targets:
    """What a recipe requires of a station's tools: `heated` ports have a setpoint; `status` is
    ordered at the start, None: none.
    """

    heated: frozenset[int] = frozenset()
    status: str | None = None


@dataclass(slots=True)
class Stretch:
    """A time with one tool and setpoint: seconds at work, arrival, and smallest distance from the
    setpoint.
    """

    tool: float
    setting: float
    at_work_s: float = 0.0
    arrived_s: float | None = None
    nearest_c: float | None = None
    last_s: float | None = None  # time of the last reading at work
    last_away_c: float = 0.0  # its temperature minus the setpoint
    # times and distances in the last `APPROACH_S`
    _recent: list[tuple[float, float]] = field(default_factory=list)

    def take(self, seconds: Floats, away: Floats, step_s: float, within_c: float) -> None:
        """Add readings at work: their times in s, and temperature minus setpoint in °C."""
        distance = np.abs(away)
        before = np.concatenate(
            ([self.last_away_c if self.last_s is not None else away[0]], away[:-1])
        )
        arrived = np.flatnonzero((distance <= within_c) | (before * away < 0))
        if self.arrived_s is None and len(arrived):
            self.arrived_s = float(seconds[arrived[0]])
        nearest = float(away[int(np.argmin(distance))])
        if self.nearest_c is None or abs(nearest) < abs(self.nearest_c):
            self.nearest_c = nearest
        self.at_work_s += len(seconds) * step_s
        self.last_s, self.last_away_c = float(seconds[-1]), float(away[-1])
        tail = seconds >= self.last_s - APPROACH_S - 1e-6
        kept = [one for one in self._recent if one[0] >= self.last_s - APPROACH_S - 1e-6]
        self._recent = [*kept, *zip(seconds[tail].tolist(), distance[tail].tolist(), strict=True)]

    @property
    def is_approaching(self) -> bool:
        """Whether its last readings still came closer to the setpoint."""
        return len(self._recent) > 1 and self._recent[0][1] - self._recent[-1][1] >= APPROACH_C


@dataclass(slots=True)
class Heat:
    """The heat of one port, from its rows in order of time: stretches with one tool and setpoint,
    and the rows since the arrival.
    """

    step_s: float | None  # None: no grid; then measured
    within_c: float = WITHIN_C
    stretches: list[Stretch] = field(default_factory=list)
    known: int = 0  # rows whose status was read
    rows_since: int = 0  # rows from the first arrival on; of these, with a status, and at work
    known_since: int = 0
    working_since: int = 0
    first_s: float | None = None
    known_s: float = 0.0
    greatest_c: float | None = None
    _setting: tuple[float, float] = float("nan"), float("nan")  # last read at, and its value
    _tool: float = float("nan")
    _last_s: float | None = None

    def feed(self, rows: Block, known: Flags) -> None:
        """Add the next rows, and which of them have a status."""
        if self.first_s is None:
            self.first_s = float(rows.seconds[0])
        step = self._step(rows.seconds)
        setting, tool = self._settings(rows), self._tools(rows)
        usable = rows.working & ~np.isnan(rows.temperature) & ~np.isnan(setting)
        self.known += int(known.sum())
        self.known_s += float(known.sum()) * step
        read = rows.temperature[~np.isnan(rows.temperature)]
        if len(read):
            self.greatest_c = max(
                float(read.max()), self.greatest_c if self.greatest_c is not None else -np.inf
            )
        before = self.arrived_s
        for part in _alike(tool, setting, usable):
            stretch = self._stretch(float(tool[part[0]]), float(setting[part[0]]))
            stretch.take(
                rows.seconds[part], rows.temperature[part] - setting[part], step, self.within_c
            )
        arrived = self.arrived_s
        if arrived is not None:
            since = (
                np.ones(len(known), dtype=np.bool_)
                if before is not None
                else rows.seconds >= arrived - 1e-9
            )
            self.rows_since += int(since.sum())
            self.known_since += int((since & known).sum())
            self.working_since += int((since & known & rows.working).sum())
        self._last_s = float(rows.seconds[-1])

    def _stretch(self, tool: float, setting: float) -> Stretch:
        last = self.stretches[-1] if self.stretches else None
        is_same = (
            last is not None
            and last.setting == setting
            and (last.tool == tool or np.isnan(last.tool) or np.isnan(tool))
        )
        if last is None or not is_same:
            last = Stretch(tool, setting)
            self.stretches.append(last)
        if np.isnan(last.tool):
            last.tool = tool
        return last

    def _step(self, seconds: Floats) -> float:
        if self.step_s is not None:
            return self.step_s
        times = seconds if self._last_s is None else np.concatenate(([self._last_s], seconds))
        return nominal_period(times)

    def _settings(self, rows: Block) -> Floats:
        """Return the setpoint in force in each row, also from the rows before."""
        seconds, setting = (
            np.append(before, these)
            for before, these in zip(self._setting, (rows.seconds, rows.setting), strict=True)
        )
        read = np.flatnonzero(~np.isnan(setting))
        if len(read):
            self._setting = float(seconds[read[-1]]), float(setting[read[-1]])
        return setting_in_force(seconds, setting)[1:]

    def _tools(self, rows: Block) -> Floats:
        """Return the tool last read in each row; NaN before the first reading."""
        if rows.tool is None:
            return np.full(len(rows.seconds), np.nan)
        tool = np.concatenate(([self._tool], rows.tool))
        last = np.maximum.accumulate(np.where(np.isnan(tool), 0, np.arange(len(tool))))
        self._tool = float(tool[last[-1]])
        return np.asarray(tool[last][1:], dtype=np.float64)

    @property
    def arrived_s(self) -> float | None:
        """The first arrival."""
        return next((one.arrived_s for one in self.stretches if one.arrived_s is not None), None)

    @property
    def at_work_s(self) -> float:
        return sum(one.at_work_s for one in self.stretches)

    @property
    def is_on_its_way(self) -> bool:
        """Whether the tool was approaching its setpoint when the record ended."""
        if not self.stretches or self._last_s is None:
            return False
        last = self.stretches[-1]
        return (
            last.is_approaching
            and last.last_s is not None
            and self._last_s - last.last_s <= APPROACH_S
        )

    def finish(self, last_due_s: float | None) -> None:
        """End the rows; ticks without rows up to the last due one count as due too."""
        if self.step_s and self.arrived_s is not None and self._last_s is not None:
            end = max(self._last_s, self._last_s if last_due_s is None else last_due_s)
            self.rows_since = max(self.rows_since, round((end - self.arrived_s) / self.step_s) + 1)


def _alike(tool: Floats, setting: Floats, usable: Flags) -> list[NDArray[np.int64]]:
    """Return the usable rows, split where tool or setpoint changes."""
    rows = np.flatnonzero(usable)
    if not len(rows):
        return []
    tools, settings = tool[rows], setting[rows]
    is_other = (np.diff(tools) != 0) & ~np.isnan(tools[1:]) & ~np.isnan(tools[:-1]) | (
        np.diff(settings) != 0
    )
    return [np.asarray(part) for part in np.split(rows, np.flatnonzero(is_other) + 1)]


@dataclass(frozen=True, slots=True)
class Limit:
    """The limits in °C and per cent, and whether the recipe ordered the tool to work."""

    within_c: float
    percent: float
    is_ordered: bool


def judge_heat(limit: Limit, targets: Targets, heat: Heat | None) -> Judged:
    """Judge the heat of one port."""
    if heat is None or not heat.known:
        return Judged(None, Result.MISSING, "The tool's status was never read.")
    if heat.arrived_s is None:
        return _not_arrived(limit, targets, heat)
    for stretch in heat.stretches:
        if (
            stretch.arrived_s is None
            and stretch.at_work_s >= ENOUGH_S
            and not stretch.is_approaching
        ):
            text = (
                f"Tool or setpoint changed; in {stretch.at_work_s:.0f} s at work since then, the"
                f" tool {_nearest(limit, stretch)}"
            )
            return Judged("not reached", Result.FAIL, text)
    return _share(limit, heat)


def _not_arrived(limit: Limit, targets: Targets, heat: Heat) -> Judged:
    warmest = "" if heat.greatest_c is None else f"; maximum {heat.greatest_c:.0f} °C"
    if not heat.stretches and not limit.is_ordered:
        if limit.percent == 0:
            text = f"Never at work, as the recipe allows{warmest}."
            return Judged(None, Result.NOT_APPLICABLE, text)
        ordered = (
            "has no [run] status" if targets.status is None else f'has status = "{targets.status}"'
        )
        text = (
            f"The recipe sets a temperature but {ordered}: the tool was not ordered to work and was"
            f" not at work{warmest}."
        )
        return Judged("not at work", Result.MISSING, text)
    if not heat.stretches:
        if heat.known_s < ENOUGH_S:
            text = f"Ordered to work, but read for only {heat.known_s:.1f} s{warmest}."
            return Judged("not at work", Result.MISSING, text)
        text = f"Ordered to work, but never at work with a known temperature{warmest}."
        return Judged("not at work", Result.FAIL, text)
    text = f"In {heat.at_work_s:.1f} s at work, the tool {_nearest(limit, heat.stretches[-1])}"
    if heat.is_on_its_way:
        text += " It was still approaching when its record ended."
        return Judged("not reached", Result.MISSING, text)
    if (heat.known_s if limit.is_ordered else heat.at_work_s) < ENOUGH_S:
        text += f" That is too short; {ENOUGH_S:g} s are needed."
        return Judged("not reached", Result.MISSING, text)
    return Judged("not reached", Result.FAIL, text)


def _nearest(limit: Limit, stretch: Stretch) -> str:
    nearest = (
        ""
        if stretch.nearest_c is None
        else f"; nearest {stretch.setting + stretch.nearest_c:.0f} °C"
    )
    return f"did not come within {shown(limit.within_c)} °C of {stretch.setting:.0f} °C{nearest}."


def _share(limit: Limit, heat: Heat) -> Judged:
    assert heat.arrived_s is not None
    setting = next(one.setting for one in heat.stretches if one.arrived_s is not None)
    due, away = heat.rows_since, heat.known_since - heat.working_since
    percent = 100 * heat.working_since / due
    after = heat.arrived_s - (heat.first_s or 0.0)
    text = (
        f"Reached {setting:.0f} °C after {after:.1f} s; at work for {shown(floored(percent))} % of"
        f" the time since, required {shown(limit.percent)} %."
    )
    allowed = allowed_misses(due, limit.percent)
    if due - heat.working_since <= allowed:
        return Judged(percent, Result.PASS, text)
    if away <= allowed:
        unknown = shown(floored(100 * (due - heat.known_since) / due))
        text = f"{text} Not known for {unknown} % of it."
        return Judged(percent, Result.MISSING, text)
    if not limit.is_ordered:
        text = f"{text} The recipe did not order it to work."
        return Judged(percent, Result.MISSING, text)
    return Judged(percent, Result.FAIL, text)
