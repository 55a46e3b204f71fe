"""Power and energy: what the heater was told to give.

Definitions. Power is in per mille of the station's theoretical maximum (R-PP). *Energy* is its integral over the whole record
by the trapezoid rule on the run's own grid, in ‰·s; without a value where the record has a gap. *Recorded energy* is the same
over the stretches without a gap, and so a lower bound. In joules, ‰·s × the full-scale power / 1000, only where the line file
declares that power. *Mean power*: the mean of the readings while the tool works. *Duty*: the time at `AT_LEAST_PERMILLE` or
more as a share of the working readings. *Utilisation*: readings of the state in which the tool works, as a share of all
readings of the state. *Joint share*: the time in joints as a share of the working time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jbclog.analysis.joints.figure import Figure, no_figure
from jbclog.analysis.joints.recovery import Joint
from jbclog.analysis.joints.series import RESOLUTION_PERMILLE, Series, Window

AT_LEAST_PERMILLE = 500.0


def energy(series: Series, joints: Sequence[Joint] | None) -> list[Figure]:
    """Power, energy, duty and utilisation; `joints` is None for tools in which joints are not looked for."""
    power = series.whole(series.rows.power)
    return [
        _mean(series, power),
        *_energies(series, power),
        _duty(series, power),
        _utilisation(series),
        *([] if joints is None else [_joint_share(series, joints)]),
    ]


def _working(series: Series, power: Window) -> Window:
    values = np.where(series.rows.working, series.rows.power, np.nan)
    there = ~np.isnan(values)
    return Window(power.start_s, power.end_s, series.period_s, series.gap_s, series.seconds[there], values[there])


def _mean(series: Series, power: Window) -> Figure:
    working = _working(series, power)
    if not working.n:
        return no_figure("power_mean_permille", "‰", "No power was read while the tool worked.")
    return Figure("power_mean_permille", float(working.values.mean()), "‰", working.n, power.coverage, RESOLUTION_PERMILLE)


def _energies(series: Series, power: Window) -> list[Figure]:
    if power.n < 2:
        return [no_figure(name, unit, "No power was read.", power.n) for name, unit in ENERGIES]
    steps = np.diff(power.seconds)
    pieces = (power.values[1:] + power.values[:-1]) / 2 * steps
    recorded = float(pieces[steps <= series.gap_s + 1e-6].sum())
    resolution = RESOLUTION_PERMILLE * series.period_s
    part = Figure("energy_recorded_permille_s", recorded, "‰·s", power.n, power.coverage, resolution)
    gap = power.gap
    whole = part.named("energy_permille_s") if gap is None else no_figure("energy_permille_s", "‰·s", gap, power.n, power.coverage)
    return [whole, part, _joules(whole, series.rated_w)]


ENERGIES = (("energy_permille_s", "‰·s"), ("energy_recorded_permille_s", "‰·s"), ("energy_j", "J"))


def _joules(whole: Figure, rated_w: float | None) -> Figure:
    if rated_w is None:
        why = "The station's full-scale power is not declared (rated_power_w in the line file)."
        return no_figure("energy_j", "J", why, whole.n, whole.coverage)
    if whole.value is None or whole.resolution is None:
        return no_figure("energy_j", "J", whole.why or "", whole.n, whole.coverage)
    return Figure("energy_j", whole.value * rated_w / 1000, "J", whole.n, whole.coverage, whole.resolution * rated_w / 1000)


def _duty(series: Series, power: Window) -> Figure:
    working = _working(series, power)
    if not working.n:
        return no_figure("duty_percent", "%", "No power was read while the tool worked.")
    share = 100.0 * float((working.values >= AT_LEAST_PERMILLE).mean())
    return Figure("duty_percent", share, "%", working.n, power.coverage, 100.0 / working.n)


def _utilisation(series: Series) -> Figure:
    known = int(series.known.sum())
    if not known:
        return no_figure("utilisation_percent", "%", "The tool's state was never read.")
    coverage = series.whole(np.where(series.known, 1.0, np.nan)).coverage
    return Figure("utilisation_percent", 100.0 * float(series.rows.working.sum()) / known, "%", known, coverage, 100.0 / known)


def _joint_share(series: Series, joints: Sequence[Joint]) -> Figure:
    working = int(series.rows.working.sum())
    if not working:
        return no_figure("joint_share_percent", "%", "The tool was never seen working.")
    busy = sum(joint.dwell_s or 0.0 for joint in joints)
    share = 100.0 * busy / (working * series.period_s)
    return Figure("joint_share_percent", share, "%", len(joints), series.whole(series.rows.temperature).coverage, 100.0 / working)
