"""What a joint does to the tip: how far below its level it begins, how low it falls, and whether it is back before the next one.

Definitions. The *level* is where the tip rests at this setpoint (`levels`), or the setpoint where no rest was seen. At the start
of a joint the tip is `deficit_c` below its setpoint and `resting_below_c` below the level at which it rests. *Depth* is the
temperature at the start minus the lowest from then until the tip is back.

The tip is *back* at the first moment after its lowest at which it is no more than the band (`recovered_within_c`) below the
level, and stays so for `BACK_FOR_S`; it is back at once where it never left the band. *Recovery* is the time from the joint's
start until then. A joint that is followed by the next draw of heat before that is *not recovered*: its recovery is longer
than the time that it had. A joint that the end of the record, a gap, a stand or another setpoint cuts off is censored: it is
neither.

*Energy* is the power above what holds the tip, from the start until it is back, ‰·s (trapezoids).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jbclog.features.drawn import Draw
from jbclog.features.series import Series, Window
from jbclog.features.thermal import AIR_C
from jbclog.judge.idle import Floats, setting_in_force

BEFORE_S: Final = 0.3
BACK_FOR_S: Final = 0.3
LOOK_S: Final = 60.0  # a tip that is not back by then is cut off: the window of one joint stays small
NEXT_CAME: Final = "The next joint began before the tip was back."


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint: a draw of heat, and what it did to the tip. °C and s; None where it is not known, and `why`.

    `recovered` is None where the joint was cut off; `had_s` is how long the tip had until the next draw or until it was cut off.
    """

    draw: Draw
    heat_j: float | None = None
    setpoint_c: float | None = None
    deficit_c: float | None = None
    resting_below_c: float | None = None
    depth_c: float | None = None
    lowest_c: float | None = None
    end_c: float | None = None
    recovered: bool | None = None
    recovery_s: float | None = None
    had_s: float | None = None
    energy: float | None = None
    why: str | None = None

    @property
    def start_s(self) -> float:
        return self.draw.start_s

    @property
    def end_s(self) -> float:
        return self.draw.end_s

    @property
    def dwell_s(self) -> float:
        return self.draw.dwell_s

    @property
    def heat(self) -> float | None:
        return self.draw.heat

    @property
    def peak(self) -> float | None:
        return self.draw.peak

    @property
    def fed(self) -> bool | None:
        return self.draw.fed

    @property
    def kind(self) -> str:
        return self.draw.kind

    @property
    def confidence(self) -> float:
        return self.draw.confidence


def joints_of(
    series: Series, draws: Sequence[Draw], every: Sequence[Draw], levels: Mapping[float, float], within_c: float
) -> list[Joint]:
    """The joints that these draws are; `every` draw, also of those that are none, can come before the tip is back."""
    setpoints = setting_in_force(series.seconds, series.rows.setting)
    starts = sorted({draw.start_s for draw in (*draws, *every)})
    tip = _Tip(series, setpoints, _changes(series), _stands(series), levels, within_c)
    return [_joint(tip, draw, _following(starts, draw.start_s)) for draw in draws]


@dataclass(frozen=True, slots=True)
class _Tip:
    series: Series
    setpoints: Floats
    changes: list[tuple[float, float]]
    stands: list[float]
    levels: Mapping[float, float]
    within_c: float


def _following(starts: list[float], start_s: float) -> float | None:
    place = bisect_right(starts, start_s)
    return starts[place] if place < len(starts) else None


def _changes(series: Series) -> list[tuple[float, float]]:
    """Between which readings the setpoint changed: when the one before was read last, and when the new one first."""
    read = ~np.isnan(series.rows.setting)
    at, values = series.seconds[read], series.rows.setting[read]
    places = np.flatnonzero(np.diff(values) != 0)
    return [(float(at[place]), float(at[place + 1])) for place in places]


def _changed(changes: list[tuple[float, float]], start_s: float) -> list[float]:
    """From when on the setpoint in force at `start_s` may be another."""
    place = bisect_right(changes, start_s, key=lambda change: change[1])
    return [max(before, start_s) for before, _ in changes[place : place + 1]]


def _stands(series: Series) -> list[float]:
    """When the tool stopped working."""
    working = series.rows.working | ~series.known
    return [float(moment) for moment in series.seconds[1:][working[:-1] & ~working[1:]]]


def _joint(tip: _Tip, draw: Draw, next_s: float | None) -> Joint:
    series, temperature = tip.series, tip.series.rows.temperature
    rated_w = series.rated_w
    heat_j = None if draw.heat is None or rated_w is None else draw.heat * rated_w / 1000
    stop_s, cut = _stop(tip, draw, next_s)
    before = series.window(temperature, draw.start_s - max(BEFORE_S, series.period_s), draw.start_s)
    after = series.window(temperature, draw.start_s, stop_s)
    touched = series.window(temperature, draw.start_s, draw.end_s)
    if not before.n or not touched.n or touched.gap:
        return Joint(draw, heat_j, why=touched.gap or "Nothing was read at its start.")
    begin, setpoint = float(before.values[-1]), _setpoint(tip, draw.start_s)
    level = None if setpoint is None else tip.levels.get(setpoint)
    told = Joint(
        draw,
        heat_j,
        setpoint,
        None if setpoint is None else setpoint - begin,
        None if level is None else level - begin,
        end_c=float(touched.values[-1]) if touched.n else None,
    )
    if setpoint is None:
        return _with(told, begin, touched, why="The setpoint is not known.")
    if not after.n or stop_s <= draw.start_s:
        return _with(told, begin, touched, had_s=0.0, why=cut or NEXT_CAME)
    back_s = _back_s(after, (setpoint if level is None else level) - tip.within_c)
    return _recovered(tip, told, begin, after, back_s, stop_s, cut)


def _stop(tip: _Tip, draw: Draw, next_s: float | None) -> tuple[float, str | None]:
    """Until when the tip can be watched, and what cuts it off then; None: the next draw."""
    ends = [
        (float(tip.series.seconds[-1]), "The record ended before the tip was back."),
        (draw.end_s + LOOK_S, f"The tip was not back {LOOK_S:g} s after it."),
        *((moment, "The setpoint changed before the tip was back.") for moment in _changed(tip.changes, draw.start_s)),
        *((moment, "The tool stopped working before the tip was back.") for moment in _first(tip.stands, draw.start_s)),
    ]
    stop, why = min(ends)
    if next_s is not None and next_s <= stop:
        return next_s - tip.series.period_s / 2, None
    return stop, why


def _first(moments: list[float], after_s: float) -> list[float]:
    place = bisect_right(moments, after_s)
    return moments[place : place + 1]


def _setpoint(tip: _Tip, moment: float) -> float | None:
    row = int(np.searchsorted(tip.series.seconds, moment + 1e-6)) - 1
    value = float(tip.setpoints[max(row, 0)])
    return None if np.isnan(value) else value


def _recovered(tip: _Tip, told: Joint, begin: float, after: Window, back_s: float | None, stop_s: float, cut: str | None) -> Joint:
    series, draw = tip.series, told.draw
    seen = series.window(series.rows.temperature, draw.start_s, stop_s if back_s is None else back_s)
    if seen.gap:
        return _with(told, begin, after, why=seen.gap)
    had = max(stop_s - draw.start_s, 0.0)
    if back_s is None:
        why = NEXT_CAME if cut is None else cut
        return _with(told, begin, seen, recovered=False if cut is None else None, had_s=had, why=why)
    never_left = not bool((after.values[after.seconds <= back_s + 1e-6] < _floor(tip, told)).any())
    recovery = 0.0 if never_left else back_s - draw.start_s
    energy = _energy(series, draw, max(back_s, draw.end_s))
    return _with(told, begin, seen, recovered=True, recovery_s=recovery, had_s=had, energy=energy)


def _floor(tip: _Tip, told: Joint) -> float:
    assert told.setpoint_c is not None
    return tip.levels.get(told.setpoint_c, told.setpoint_c) - tip.within_c


def _with(
    told: Joint,
    begin: float,
    seen: Window,
    recovered: bool | None = None,
    recovery_s: float | None = None,
    had_s: float | None = None,
    energy: float | None = None,
    why: str | None = None,
) -> Joint:
    lowest = float(seen.values.min()) if seen.n else None
    depth = None if lowest is None else max(begin - lowest, 0.0)
    known = (told.heat_j, told.setpoint_c, told.deficit_c, told.resting_below_c)
    return Joint(told.draw, *known, depth, lowest, told.end_c, recovered, recovery_s, had_s, energy, why)


def _back_s(after: Window, floor: float) -> float | None:
    """When the temperature is back after its lowest; None where it is not."""
    lowest = int(np.argmin(after.values))
    low = after.values < floor
    for place in np.flatnonzero(~low[lowest:]) + lowest:
        left = after.seconds[place:][low[place:]]
        until = left[0] if len(left) else after.end_s + after.period_s
        if until - after.seconds[place] >= BACK_FOR_S - 1e-6:
            return float(after.seconds[place])
    return None


def _energy(series: Series, draw: Draw, until_s: float) -> float | None:
    """Power above holding power from the joint's start on, ‰·s (trapezoid)."""
    power = series.window(series.rows.power, draw.start_s, until_s)
    temperature = series.window(series.rows.temperature, draw.start_s, until_s)
    if draw.loss is None or power.gap or temperature.gap or power.n < 2:
        return None
    holding = draw.loss * (np.interp(power.seconds, temperature.seconds, temperature.values) - AIR_C)
    above = power.values - holding
    return float(np.sum(np.diff(power.seconds) * (above[1:] + above[:-1]) / 2.0))
