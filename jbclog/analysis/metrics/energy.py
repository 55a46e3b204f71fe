"""Power and energy of the heater, and how much the tool worked.

Power is in ‰ of the station's theoretical maximum (R-PP). *Energy* is its integral over the whole
record by the trapezoid rule on the run's grid, in ‰·s, without a value if the record has a gap.
*Recorded energy* is the same over the stretches without a gap, and so a lower bound. In joules it
is ‰·s × full-scale power / 1000, if the line file declares that power. *Mean power* is the mean of
the readings while the tool works. *Duty* is the time at `AT_LEAST_PERMILLE` or more as a share of
the working readings. *Utilisation* is the readings of the state in which the tool works, as a share
of all readings of the state. *Joint share* is the time in joints as a share of the working time.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from jbclog.analysis.joints.packed import dwells_of
from jbclog.analysis.joints.series import RESOLUTION_PERMILLE, Column, Series
from jbclog.analysis.metrics.metric import TIP, Basis, Value, metric, not_known
from jbclog.analysis.port_data import Floats

AT_LEAST_PERMILLE = 500.0
NOT_RATED = "The station's full-scale power is not declared (rated_power_w in the line file)."
NO_POWER = "No power was read while the tool worked."


@dataclass(slots=True)
class Totals:
    """Sums over all rows of a port, added window by window."""

    period_s: float
    gap_s: float
    rated_w: float | None
    temperature: Column = field(init=False)
    power: Column = field(init=False)
    state: Column = field(init=False)
    working: int = 0  # rows in which the tool works
    power_n: int = 0  # power readings in these
    power_sum: float = 0.0
    power_high: int = 0
    recorded: float = 0.0
    # last reading of the power: its second and value
    _before: Floats = field(default_factory=lambda: np.empty((2, 0)))

    def __post_init__(self) -> None:
        self.temperature, self.power, self.state = (
            Column(self.period_s, self.gap_s) for _ in range(3)
        )

    def take(self, series: Series) -> None:
        seconds, rows = series.seconds, series.rows
        moments = series.moments
        self.temperature.add(seconds, rows.temperature, moments)
        self.power.add(seconds, rows.power, moments)
        self.state.add(seconds, np.where(series.known, 1.0, np.nan), moments)
        self.working += int(rows.working.sum())
        there = ~np.isnan(rows.power)
        working = rows.power[there & rows.working]
        self.power_n, self.power_sum = (
            self.power_n + len(working),
            self.power_sum + float(working.sum()),
        )
        self.power_high += int((working >= AT_LEAST_PERMILLE).sum())
        at, values = np.concatenate([self._before, [seconds[there], rows.power[there]]], axis=1)
        steps = np.diff(at)
        pieces = (values[1:] + values[:-1]) / 2 * steps
        self.recorded += float(pieces[steps <= self.gap_s + 1e-6].sum())
        self._before = np.array([at[-1:], values[-1:]])


def totals_of(series: Series) -> Totals:
    """Return the totals of a port before any of its rows."""
    return Totals(series.period_s, series.gap_s, series.rated_w)


@metric("power_mean_permille", "‰", "Mean of the power readings while the tool works.")
def power_mean_permille(port: Basis) -> Value:
    totals = port.totals
    if not totals.power_n:
        return not_known(NO_POWER)
    mean = totals.power_sum / totals.power_n
    return Value(mean, totals.power_n, totals.power.coverage, RESOLUTION_PERMILLE)


@metric(
    "energy_permille_s",
    "‰·s",
    "Integral of the power over the whole record (trapezoids on the grid of ticks).",
)
def energy_permille_s(port: Basis) -> Value:
    recorded, gap = energy_recorded_permille_s(port), port.totals.power.gap
    if gap is None or recorded.value is None:
        return recorded
    return not_known(gap, recorded.n, recorded.coverage, low=recorded.value)


@metric(
    "energy_recorded_permille_s",
    "‰·s",
    "The same over the stretches without a gap of more than one reading: where there is one, a"
    " lower bound.",
)
def energy_recorded_permille_s(port: Basis) -> Value:
    totals, power = port.totals, port.totals.power
    if power.n < 2:
        return not_known("No power was read.", power.n)
    resolution = RESOLUTION_PERMILLE * totals.period_s
    return Value(totals.recorded, power.n, power.coverage, resolution)


@metric(
    "energy_j",
    "J",
    "energy_permille_s × full-scale power / 1000, where the line file declares that power.",
)
def energy_j(port: Basis) -> Value:
    whole, rated_w = energy_permille_s(port), port.totals.rated_w
    if port.totals.power.n < 2:
        return whole
    if rated_w is None:
        return not_known(NOT_RATED, whole.n, whole.coverage)
    if whole.value is None or whole.resolution is None:
        low = None if whole.low is None else whole.low * rated_w / 1000
        return not_known(whole.why or "", whole.n, whole.coverage, low=low)
    resolution = whole.resolution * rated_w / 1000
    return Value(whole.value * rated_w / 1000, whole.n, whole.coverage, resolution)


@metric(
    "duty_percent",
    "%",
    f"Share of the working readings with {AT_LEAST_PERMILLE:g} ‰ of power or more.",
)
def duty_percent(port: Basis) -> Value:
    totals = port.totals
    if not totals.power_n:
        return not_known(NO_POWER)
    share = 100.0 * (totals.power_high / totals.power_n)
    return Value(share, totals.power_n, totals.power.coverage, 100.0 / totals.power_n)


@metric("utilisation_percent", "%", "Share of the readings of the state in which the tool works.")
def utilisation_percent(port: Basis) -> Value:
    totals, known = port.totals, port.totals.state.n
    if not known:
        return not_known("The tool's state was never read.")
    return Value(100.0 * totals.working / known, known, totals.state.coverage, 100.0 / known)


@metric("joint_share_percent", "%", "Dwell of all joints as a share of the working time.", TIP)
def joint_share_percent(port: Basis) -> Value:
    totals, joints = port.totals, port.found.joints
    if port.joints_why is not None:
        return not_known(port.joints_why, len(joints))
    if not totals.working:
        return not_known("The tool was never seen working.")
    busy = sum(dwell or 0.0 for dwell in dwells_of(joints))
    share = 100.0 * busy / (totals.working * totals.period_s)
    return Value(share, len(joints), totals.temperature.coverage, 100.0 / totals.working)
