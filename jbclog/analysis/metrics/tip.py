"""Metrics of a tip: heating up, holding, drift, power and energy."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import inf, sqrt
from typing import Final

import numpy as np

from jbclog.analysis.joints.figure import Figure, no_figure
from jbclog.analysis.joints.recovery import Joint
from jbclog.analysis.joints.series import RESOLUTION_C, RESOLUTION_PERMILLE, Column, Series, Window
from jbclog.analysis.joints.values import Values
from jbclog.analysis.joints.windows import View, joined, rows_of
from jbclog.analysis.verdict.idle import (
    BLOCK_S,
    ENOUGH_ROWS,
    ENOUGH_S,
    NOT_IDLE,
    Block,
    Flags,
    Floats,
    idle_readings,
    setting_in_force,
)

# -- heating ------------------------------------------------------------------------------------------------------------------
# Heating up: how long it takes, how far it goes beyond, when it has settled.
#
# Definitions. A *heat-up* begins when the tool goes to work (or the record begins with it working), or when its setting is
# raised by `LEAST_RISE_C` or more, with a tip that is more than `BAND_C` below its setting. Where the record begins with a
# working tool, it begins when the tool was ordered to work, if that was at most `ORDER_S` before the first row; else its
# beginning is not known, and it is left out.
#
# *Heat-up time*: from that moment until the tip first enters its setting ± `BAND_C` and stays within for `HOLD_S`.
# *Overshoot*: the highest temperature minus the setting in the `AFTER_S` after that entry, or until the setting or the state
# changes. *Settling time*: from the same beginning until the last moment of that time at which the tip is further than `CALM_C`
# from its setting; without a value where it still is in the last `HOLD_S`.
# Each is the median over the heat-ups whose window has no gap; where all of them have one there is no value.

BAND_C, HOLD_S = 10.0, 1.0
LEAST_RISE_C = 5.0
AFTER_S = 10.0
CALM_C = 3.0
PATIENCE_S = 60.0
ORDER_S = 10.0


@dataclass(frozen=True, slots=True)
class HeatUp:
    """One heat-up: its figures (None: not known), how much of it was read, and its gap, where it has one."""

    time_s: float | None
    overshoot_c: float | None
    settling_s: float | None
    coverage: float
    gap: str | None


class Heating:
    """Heat-up time, overshoot and settling time of a port whose rows are taken window by window."""

    def __init__(self, period_s: float, ordered_s: float | None) -> None:
        self._period_s, self._found = period_s, list[HeatUp]()
        self._ordered_s = ordered_s  # of the record's first row; None behind it

    def take(self, view: View) -> None:
        """The heat-ups that begin in a window; each is looked at for `PATIENCE_S` and `AFTER_S`, which windows have beside them."""
        self._found += _heat_ups(replace(view.series, ordered_s=self._ordered_s), view)
        self._ordered_s = None

    def figures(self) -> list[Figure]:
        """The medians."""
        time, found = self._period_s, self._found
        not_reached, not_settled = "The tip did not reach its setting.", "The tip did not settle while it was looked at."
        return [
            _median("heat_up_time_s", "s", time, found, lambda one: one.time_s, not_reached),
            _median("overshoot_c", "°C", RESOLUTION_C, found, lambda one: one.overshoot_c, not_reached),
            _median("settling_time_s", "s", time, found, lambda one: one.settling_s, not_settled),
        ]


def _heat_ups(series: Series, view: View) -> Iterator[HeatUp]:
    """The heat-ups of a window whose beginning was seen."""
    rows, setting, own = series.rows, setting_in_force(series.seconds, series.rows.setting), view.own(series.seconds)
    begins = _begins(series, setting)
    for start in (np.flatnonzero(begins[own]) + own.start).tolist():
        aim = _aim(setting, start)
        if aim is None or not rows.temperature[start] < aim - BAND_C:
            continue
        end = _change_after(series, setting, start, float(rows.seconds[-1]) if view.end_s == inf else inf)
        yield _heat_up(series, _moment(series, start), float(rows.seconds[start]), end, aim)


def _moment(series: Series, start: int) -> float:
    """When it began: at the row, or when the tool was ordered to work before the first row."""
    return series.ordered_s if start == 0 and series.ordered_s is not None else float(series.seconds[start])


def _begins(series: Series, setting: Floats) -> Flags:
    """Rows at which the tool goes to work, or works with a higher setting than the row before."""
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
    """The setting at `start`, or the first that is read after it."""
    known = setting[start:][~np.isnan(setting[start:])]
    return float(known[0]) if len(known) else None


def _change_after(series: Series, setting: Floats, start: int, never_s: float) -> float:
    """When the tool is next seen resting or its setting changes; `never_s` where neither is seen."""
    resting = series.known[start + 1 :] & ~series.rows.working[start + 1 :]
    before, after = setting[start:-1], setting[start + 1 :]
    other = ~np.isnan(before) & ~np.isnan(after) & (before != after)
    changed = np.flatnonzero(resting | other)
    return float(series.seconds[start + changed[0]]) if len(changed) else never_s


def _heat_up(series: Series, start_s: float, first_s: float, end_s: float, aim: float) -> HeatUp:
    temperature = series.rows.temperature
    looked = series.window(temperature, first_s, min(end_s, start_s + PATIENCE_S))
    entry = _entry(looked, aim)
    if entry is None:
        return HeatUp(None, None, None, looked.coverage, looked.gap)
    window = series.window(temperature, first_s, min(entry + HOLD_S, end_s))
    after = series.window(temperature, entry, min(entry + AFTER_S, end_s))
    overshoot = float(after.values.max() - aim) if after.n else None
    return HeatUp(entry - start_s, overshoot, _settling_s(after, aim, start_s, entry), window.coverage, window.gap or after.gap)


def _settling_s(after: Window, aim: float, start_s: float, entry_s: float) -> float | None:
    if not after.n:
        return None
    away = after.seconds[np.abs(after.values - aim) > CALM_C]
    if not len(away):
        return entry_s - start_s
    return None if away[-1] > after.end_s - HOLD_S else float(away[-1] - start_s)


def _entry(window: Window, aim: float) -> float | None:
    """The first moment from which the tip stays in the band for `HOLD_S`."""
    away = np.abs(window.values - aim) > BAND_C
    inside = np.flatnonzero(~away)
    for first in inside[np.concatenate(([True], np.diff(inside) > 1))] if len(inside) else ():
        left = window.seconds[first:][away[first:]]
        until = left[0] if len(left) else window.end_s
        if until - window.seconds[first] >= HOLD_S - 1e-6:
            return float(window.seconds[first])
    return None


def _median(
    name: str, unit: str, resolution: float, found: list[HeatUp], value: Callable[[HeatUp], float | None], none: str
) -> Figure:
    whole = [one for one in found if one.gap is None]
    values = [known for one in whole if (known := value(one)) is not None]
    if values:
        coverage = round(float(np.mean([one.coverage for one in whole])), 3)
        return Figure(name, float(np.median(values)), unit, len(values), coverage, resolution)
    if whole:
        return no_figure(name, unit, none)
    gaps = [one.gap for one in found if one.gap]
    return no_figure(name, unit, gaps[0] if gaps else "No heat-up whose beginning was recorded.")


# -- idle ---------------------------------------------------------------------------------------------------------------------
# The idle tip: its error, its spread, its drift.
#
# Definitions. Which readings are idle is the verdict's definition (`judge.idle`), in the same blocks of ten minutes, so that these
# figures and the verdict's are the same. *Idle error*: mean of temperature minus setting. *Idle spread*: its standard deviation;
# *range*: its highest minus its lowest. *Drift*: the Theil-Sen slope (the median of the slopes between all pairs; H. Theil 1950,
# P. K. Sen 1968) of the means of the idle readings of each `MEAN_S`, over an hour; it takes `LEAST_MEANS` of them, `LEAST_DRIFT_S`
# apart.
#
# Idle readings have no one window: they are taken from stretches without a gap, each of which has to settle anew. `coverage` is
# the share of the run's rows whose temperature was read. A spread below the resolution divided by √12 is the resolution's, not
# the tip's; then there is no value, since the true one may be anything up to it.

MEAN_S, LEAST_MEANS, LEAST_DRIFT_S, MOST_MEANS = 10.0, 6, 300.0, 500
FLOOR_C = RESOLUTION_C / sqrt(12)
DECIMALS: Final = 3


class Idling:
    """Idle error, spread, range and drift of a port whose rows are taken window by window."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._rows: list[Series] = []  # those of a block that is not complete
        self._errors = Values(DECIMALS)
        self._cells: list[_Cells] = []

    def take(self, series: Series) -> None:
        """The next rows."""
        if not len(series.seconds):
            return
        held = joined([*self._rows, series])
        numbers = np.floor_divide(held.seconds + 1e-6, BLOCK_S)
        *complete, last = np.unique(numbers).tolist()
        for number in complete:
            self._add(held.rows.take(numbers == number))
        self._rows = [rows_of(held, slice(int(np.flatnonzero(numbers == last)[0]), None))]

    def _add(self, block: Block) -> None:
        seconds, errors = idle_readings(block, self._period_s)
        if len(errors):
            self._errors.add(errors)
            self._cells.append(_cells(seconds, errors))

    def figures(self, coverage: float) -> list[Figure]:
        """Its figures when all rows were taken."""
        for held in self._rows:
            self._add(held.rows)
        self._rows.clear()
        errors = self._errors
        if errors.n < ENOUGH_ROWS or errors.n * self._period_s < ENOUGH_S:
            names = (("idle_error_c", "°C"), ("idle_sd_c", "°C"), ("idle_range_c", "°C"), ("drift_c_per_h", "°C/h"))
            return [no_figure(name, unit, NOT_IDLE, errors.n, coverage) for name, unit in names]
        return [
            Figure("idle_error_c", errors.mean, "°C", errors.n, coverage, RESOLUTION_C),
            _spread(errors.sd, errors.n, coverage),
            Figure("idle_range_c", errors.range, "°C", errors.n, coverage, RESOLUTION_C),
            _drift(self._cells, coverage),
        ]


def _spread(spread: float, n: int, coverage: float) -> Figure:
    if spread < FLOOR_C:
        why = f"The readings come in whole degrees: a spread below {FLOOR_C:.2f} °C cannot be told from none."
        return no_figure("idle_sd_c", "°C", why, n, coverage)
    return Figure("idle_sd_c", spread, "°C", n, coverage, RESOLUTION_C)


def _drift(cells: Sequence[_Cells], coverage: float) -> Figure:
    at, means = _means(cells)
    if len(means) < LEAST_MEANS or at[-1] - at[0] < LEAST_DRIFT_S:
        why = f"A drift takes {LEAST_MEANS} means of {MEAN_S:g} s over {LEAST_DRIFT_S:g} s or more; there are {len(means)}."
        return no_figure("drift_c_per_h", "°C/h", why, len(means), coverage)
    every = max(len(means) // MOST_MEANS, 1)
    slope = _theil_sen(at[::every], means[::every]) * 3600.0
    return Figure("drift_c_per_h", slope, "°C/h", len(means), coverage, FLOOR_C * 3600.0 / float(at[-1] - at[0]))


def _theil_sen(x: Floats, y: Floats) -> float:
    """The median of the slopes between all pairs, by numpy: scipy.stats takes most of a second to load."""
    one, other = np.triu_indices(len(x), 1)
    return float(np.median((y[other] - y[one]) / (x[other] - x[one])))


@dataclass(frozen=True, slots=True)
class _Cells:
    """Of each `MEAN_S` that has idle readings: its number, the sums of their seconds and errors, and how many they are."""

    number: Floats
    seconds: Floats
    errors: Floats
    count: Floats


def _cells(seconds: Floats, errors: Floats) -> _Cells:
    number, place, count = np.unique(np.floor_divide(seconds, MEAN_S), return_inverse=True, return_counts=True)
    columns = (np.asarray(one, dtype=np.float64) for one in (np.bincount(place, seconds), np.bincount(place, errors), count))
    return _Cells(number, *columns)


def _means(cells: Sequence[_Cells]) -> tuple[Floats, Floats]:
    """The mean moment and error of each."""
    columns = ([getattr(one, name) for one in cells] for name in ("number", "seconds", "errors", "count"))
    numbers, *sums = (np.concatenate(column) for column in columns)
    first = np.flatnonzero(np.diff(numbers, prepend=-np.inf))  # one on the edge of two blocks is in both
    seconds, errors, count = (np.add.reduceat(column, first) for column in sums)
    return seconds / count, errors / count


# -- energy -------------------------------------------------------------------------------------------------------------------
# Power and energy: what the heater was told to give.
#
# Definitions. Power is in per mille of the station's theoretical maximum (R-PP). *Energy* is its integral over the whole record
# by the trapezoid rule on the run's own grid, in ‰·s; without a value where the record has a gap. *Recorded energy* is the same
# over the stretches without a gap, and so a lower bound. In joules, ‰·s × the full-scale power / 1000, only where the line file
# declares that power. *Mean power*: the mean of the readings while the tool works. *Duty*: the time at `AT_LEAST_PERMILLE` or
# more as a share of the working readings. *Utilisation*: readings of the state in which the tool works, as a share of all
# readings of the state. *Joint share*: the time in joints as a share of the working time.

AT_LEAST_PERMILLE = 500.0


@dataclass(slots=True)
class Totals:
    """What is summed over all rows of a port, taken window by window."""

    period_s: float
    gap_s: float
    rated_w: float | None
    temperature: Column = field(init=False)
    power: Column = field(init=False)
    state: Column = field(init=False)
    working: int = 0  # rows in which the tool works
    power_n: int = 0  # readings of the power in these
    power_sum: float = 0.0
    power_high: int = 0
    recorded: float = 0.0
    _before: Floats = field(default_factory=lambda: np.empty((2, 0)))  # the last reading of the power: its second and value

    def __post_init__(self) -> None:
        self.temperature, self.power, self.state = (Column(self.period_s, self.gap_s) for _ in range(3))

    def take(self, series: Series) -> None:
        """The next rows."""
        seconds, rows = series.seconds, series.rows
        self.temperature.add(seconds, rows.temperature)
        self.power.add(seconds, rows.power)
        self.state.add(seconds, np.where(series.known, 1.0, np.nan))
        self.working += int(rows.working.sum())
        there = ~np.isnan(rows.power)
        working = rows.power[there & rows.working]
        self.power_n, self.power_sum = self.power_n + len(working), self.power_sum + float(working.sum())
        self.power_high += int((working >= AT_LEAST_PERMILLE).sum())
        at, values = np.concatenate([self._before, [seconds[there], rows.power[there]]], axis=1)
        steps = np.diff(at)
        pieces = (values[1:] + values[:-1]) / 2 * steps
        self.recorded += float(pieces[steps <= self.gap_s + 1e-6].sum())
        self._before = np.array([at[-1:], values[-1:]])


def totals_of(series: Series) -> Totals:
    """Those of a port of which no rows were taken yet."""
    return Totals(series.period_s, series.gap_s, series.rated_w)


def energy(port: Totals, joints: Sequence[Joint] | None) -> list[Figure]:
    """Power, energy, duty and utilisation; `joints` is None for tools in which joints are not looked for."""
    return [
        _mean(port),
        *_energies(port),
        _duty(port),
        _utilisation(port),
        *([] if joints is None else [_joint_share(port, joints)]),
    ]


def _mean(port: Totals) -> Figure:
    if not port.power_n:
        return no_figure("power_mean_permille", "‰", "No power was read while the tool worked.")
    mean = port.power_sum / port.power_n
    return Figure("power_mean_permille", mean, "‰", port.power_n, port.power.coverage, RESOLUTION_PERMILLE)


def _energies(port: Totals) -> list[Figure]:
    power = port.power
    if power.n < 2:
        return [no_figure(name, unit, "No power was read.", power.n) for name, unit in ENERGIES]
    resolution = RESOLUTION_PERMILLE * port.period_s
    part = Figure("energy_recorded_permille_s", port.recorded, "‰·s", power.n, power.coverage, resolution)
    gap = power.gap
    whole = part.named("energy_permille_s") if gap is None else no_figure("energy_permille_s", "‰·s", gap, power.n, power.coverage)
    return [whole, part, _joules(whole, port.rated_w)]


ENERGIES = (("energy_permille_s", "‰·s"), ("energy_recorded_permille_s", "‰·s"), ("energy_j", "J"))


def _joules(whole: Figure, rated_w: float | None) -> Figure:
    if rated_w is None:
        why = "The station's full-scale power is not declared (rated_power_w in the line file)."
        return no_figure("energy_j", "J", why, whole.n, whole.coverage)
    if whole.value is None or whole.resolution is None:
        return no_figure("energy_j", "J", whole.why or "", whole.n, whole.coverage)
    return Figure("energy_j", whole.value * rated_w / 1000, "J", whole.n, whole.coverage, whole.resolution * rated_w / 1000)


def _duty(port: Totals) -> Figure:
    if not port.power_n:
        return no_figure("duty_percent", "%", "No power was read while the tool worked.")
    share = 100.0 * (port.power_high / port.power_n)
    return Figure("duty_percent", share, "%", port.power_n, port.power.coverage, 100.0 / port.power_n)


def _utilisation(port: Totals) -> Figure:
    known = port.state.n
    if not known:
        return no_figure("utilisation_percent", "%", "The tool's state was never read.")
    return Figure("utilisation_percent", 100.0 * port.working / known, "%", known, port.state.coverage, 100.0 / known)


def _joint_share(port: Totals, joints: Sequence[Joint]) -> Figure:
    if not port.working:
        return no_figure("joint_share_percent", "%", "The tool was never seen working.")
    busy = sum(joint.dwell_s or 0.0 for joint in joints)
    share = 100.0 * busy / (port.working * port.period_s)
    return Figure("joint_share_percent", share, "%", len(joints), port.temperature.coverage, 100.0 / port.working)
