"""Heat-up: duration, overshoot, and settling time.

A *heat-up* begins when the tool starts to work (or the record begins with it working), or when its
setting is raised by `LEAST_RISE_C` or more, with a tip more than `BAND_C` below its setting. If the
record begins with a working tool, it begins when the tool was ordered to work, if that was at most
`ORDER_S` before the first row; otherwise its begin is not known and it is left out.

*Heat-up time* is from that moment until the tip first enters its setting ± `BAND_C` and stays there
for `HOLD_S`. *Overshoot* is the highest temperature minus the setting in the `AFTER_S` after that
entry, or until setting or state change. *Settling time* is from the same begin until the last
moment of that time at which the tip is further than `CALM_C` from its setting; it has no value if
the tip still is in the last `HOLD_S`. Each is the median over the heat-ups whose window has no gap,
without a value if all have one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Final

import numpy as np

from jbclog.analysis.joints.series import RESOLUTION_C, Series, Window
from jbclog.analysis.joints.windows import View
from jbclog.analysis.metrics.metric import Basis, Value, metric, not_known
from jbclog.analysis.port_data import Flags, Floats, setting_in_force

BAND_C, HOLD_S = 10.0, 1.0
LEAST_RISE_C = 5.0
AFTER_S = 10.0
CALM_C = 3.0
PATIENCE_S = 60.0
ORDER_S = 10.0
NOT_REACHED: Final = "The tip did not reach its setting."
NOT_SETTLED: Final = "The tip did not settle while it was looked at."


@dataclass(frozen=True, slots=True)
class HeatUp:
    """One heat-up: its figures (None: not known), its readings' coverage, and its gap, if any."""

    time_s: float | None
    overshoot_c: float | None
    settling_s: float | None
    coverage: float
    gap: str | None


class Heating:
    """Heat-ups of a port, from rows added window by window."""

    def __init__(self, ordered_s: float | None) -> None:
        self.heat_ups: list[HeatUp] = []
        self._ordered_s = ordered_s  # for the record's first row; None after it

    def take(self, view: View) -> None:
        """Add the heat-ups that begin in a window; each needs up to `PATIENCE_S` and `AFTER_S`,
        which windows have after them.
        """
        self.heat_ups += _heat_ups(replace(view.series, ordered_s=self._ordered_s), view)
        self._ordered_s = None


@metric(
    "heat_up_time_s",
    "s",
    f"From the order to work, or from a setting raised by {LEAST_RISE_C:g} °C or more, with a"
    f" tip more than {BAND_C:g} °C below its setting, until it first enters setting ±"
    f" {BAND_C:g} °C and stays there for {HOLD_S:g} s. Median over the heat-ups.",
)
def heat_up_time_s(port: Basis) -> Value:
    times_s = [heat_up.time_s for heat_up in _without_gap(port)]
    return _median(port, times_s, port.totals.period_s, NOT_REACHED)


@metric(
    "overshoot_c",
    "°C",
    f"Highest temperature minus setting in the {AFTER_S:g} s after that entry, or until setting"
    " or state change. Median.",
)
def overshoot_c(port: Basis) -> Value:
    overshoots = [heat_up.overshoot_c for heat_up in _without_gap(port)]
    return _median(port, overshoots, RESOLUTION_C, NOT_REACHED)


@metric(
    "settling_time_s",
    "s",
    f"From the same beginning until the last moment in these {AFTER_S:g} s at which the tip is"
    f" further than {CALM_C:g} °C from its setting. Median.",
)
def settling_time_s(port: Basis) -> Value:
    times_s = [heat_up.settling_s for heat_up in _without_gap(port)]
    return _median(port, times_s, port.totals.period_s, NOT_SETTLED)


def _without_gap(port: Basis) -> list[HeatUp]:
    return [heat_up for heat_up in port.heat_ups if heat_up.gap is None]


def _median(port: Basis, of_each: Sequence[float | None], resolution: float, none: str) -> Value:
    """Return the median over the heat-ups without a gap that have a value; `none`: why if none
    has.
    """
    values = [value for value in of_each if value is not None]
    if values:
        coverage = round(float(np.mean([heat_up.coverage for heat_up in _without_gap(port)])), 3)
        return Value(float(np.median(values)), len(values), coverage, resolution)
    if of_each:
        return not_known(none)
    gaps = [heat_up.gap for heat_up in port.heat_ups if heat_up.gap]
    return not_known(gaps[0] if gaps else "No heat-up whose beginning was recorded.")


def _heat_ups(series: Series, view: View) -> Iterator[HeatUp]:
    """Yield the heat-ups of a window whose begin is known."""
    rows = series.rows
    setting = setting_in_force(series.seconds, series.rows.setting)
    own = view.own(series.seconds)
    begins = _heat_up_starts(series, setting)
    for start in (np.flatnonzero(begins[own]) + own.start).tolist():
        aim = _aim(setting, start)
        if aim is None or not rows.temperature[start] < aim - BAND_C:
            continue
        end = _change_after(
            series, setting, start, float(rows.seconds[-1]) if view.end_s == inf else inf
        )
        yield _heat_up(series, _beginning_s(series, start), float(rows.seconds[start]), end, aim)


def _beginning_s(series: Series, start: int) -> float:
    """Return when the heat-up began: at the row, or when work was ordered before the first row."""
    return (
        series.ordered_s
        if start == 0 and series.ordered_s is not None
        else float(series.seconds[start])
    )


def _heat_up_starts(series: Series, setting: Floats) -> Flags:
    """Return the rows at which the tool starts to work, or its setting rises while it works."""
    working, known = series.rows.working, series.known
    begins = np.zeros(len(working), dtype=np.bool_)
    first = series.seconds[0] if len(working) else 0.0
    if len(working) and series.ordered_s is not None:
        begins[0] = working[0] and 0.0 <= first - series.ordered_s <= ORDER_S
    begins[1:] = working[1:] & known[:-1] & ~working[:-1]
    with np.errstate(invalid="ignore"):
        begins[1:] |= working[1:] & (np.diff(setting) >= LEAST_RISE_C)
    return begins


def _aim(setting: Floats, start: int) -> float | None:
    """Return the setting at `start`, or the first one read after it."""
    known = setting[start:][~np.isnan(setting[start:])]
    return float(known[0]) if len(known) else None


def _change_after(series: Series, setting: Floats, start: int, never_s: float) -> float:
    """Return when the tool next rests or its setting changes; `never_s` if neither is seen."""
    resting = series.known[start + 1 :] & ~series.rows.working[start + 1 :]
    before, after = setting[start:-1], setting[start + 1 :]
    other = ~np.isnan(before) & ~np.isnan(after) & (before != after)
    changed = np.flatnonzero(resting | other)
    return float(series.seconds[start + changed[0]]) if len(changed) else never_s


def _heat_up(series: Series, start_s: float, first_s: float, end_s: float, aim: float) -> HeatUp:
    temperature = series.rows.temperature
    searched = series.window(temperature, first_s, min(end_s, start_s + PATIENCE_S))
    entry = _entry(searched, aim)
    if entry is None:
        return HeatUp(None, None, None, searched.coverage, searched.gap)
    window = series.window(temperature, first_s, min(entry + HOLD_S, end_s))
    after = series.window(temperature, entry, min(entry + AFTER_S, end_s))
    overshoot = float(after.values.max() - aim) if after.n else None
    return HeatUp(
        entry - start_s,
        overshoot,
        _settling_s(after, aim, start_s, entry),
        window.coverage,
        window.gap or after.gap,
    )


def _settling_s(after: Window, aim: float, start_s: float, entry_s: float) -> float | None:
    if not after.n:
        return None
    outside = after.seconds[np.abs(after.values - aim) > CALM_C]
    if not len(outside):
        return entry_s - start_s
    return None if outside[-1] > after.end_s - HOLD_S else float(outside[-1] - start_s)


def _entry(window: Window, aim: float) -> float | None:
    """Return the first moment from which the tip stays in the band for `HOLD_S`."""
    outside = np.abs(window.values - aim) > BAND_C
    inside = np.flatnonzero(~outside)
    for first in inside[np.concatenate(([True], np.diff(inside) > 1))] if len(inside) else ():
        left = window.seconds[first:][outside[first:]]
        until = left[0] if len(left) else window.end_s
        if until - window.seconds[first] >= HOLD_S - 1e-6:
            return float(window.seconds[first])
    return None
