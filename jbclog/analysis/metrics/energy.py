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

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from jbclog.analysis.joints.figure import Figure, no_figure
from jbclog.analysis.joints.packed import dwells_of
from jbclog.analysis.joints.recovery import Joint
from jbclog.analysis.joints.series import RESOLUTION_PERMILLE, Column, Series
from jbclog.analysis.verdict.idle import Floats

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
        self.temperature.add(seconds, rows.temperature)
        self.power.add(seconds, rows.power)
        self.state.add(seconds, np.where(series.known, 1.0, np.nan))
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


def energy(
    port: Totals, joints: Sequence[Joint] | None, number_why: str | None = None
) -> list[Figure]:
    """Return power, energy, duty and utilisation; `joints` None: the tool makes none.

    `number_why` is why the number of joints is not known.
    """
    return [
        _mean(port),
        *_energies(port),
        _duty(port),
        _utilisation(port),
        *([] if joints is None else [_joint_share(port, joints, number_why)]),
    ]


def _mean(port: Totals) -> Figure:
    if not port.power_n:
        return no_figure("power_mean_permille", "‰", NO_POWER)
    mean = port.power_sum / port.power_n
    return Figure(
        "power_mean_permille", mean, "‰", port.power_n, port.power.coverage, RESOLUTION_PERMILLE
    )


def _energies(port: Totals) -> list[Figure]:
    power = port.power
    if power.n < 2:
        return [no_figure(name, unit, "No power was read.", power.n) for name, unit in ENERGIES]
    resolution = RESOLUTION_PERMILLE * port.period_s
    part = Figure(
        "energy_recorded_permille_s", port.recorded, "‰·s", power.n, power.coverage, resolution
    )
    gap = power.gap
    whole = (
        part.named("energy_permille_s")
        if gap is None
        else no_figure("energy_permille_s", "‰·s", gap, power.n, power.coverage)
    )
    return [whole, part, _joules(whole, port.rated_w)]


ENERGIES = (("energy_permille_s", "‰·s"), ("energy_recorded_permille_s", "‰·s"), ("energy_j", "J"))


def _joules(whole: Figure, rated_w: float | None) -> Figure:
    if rated_w is None:
        return no_figure("energy_j", "J", NOT_RATED, whole.n, whole.coverage)
    if whole.value is None or whole.resolution is None:
        return no_figure("energy_j", "J", whole.why or "", whole.n, whole.coverage)
    return Figure(
        "energy_j",
        whole.value * rated_w / 1000,
        "J",
        whole.n,
        whole.coverage,
        whole.resolution * rated_w / 1000,
    )


def _duty(port: Totals) -> Figure:
    if not port.power_n:
        return no_figure("duty_percent", "%", NO_POWER)
    share = 100.0 * (port.power_high / port.power_n)
    return Figure(
        "duty_percent", share, "%", port.power_n, port.power.coverage, 100.0 / port.power_n
    )


def _utilisation(port: Totals) -> Figure:
    known = port.state.n
    if not known:
        return no_figure("utilisation_percent", "%", "The tool's state was never read.")
    return Figure(
        "utilisation_percent",
        100.0 * port.working / known,
        "%",
        known,
        port.state.coverage,
        100.0 / known,
    )


def _joint_share(port: Totals, joints: Sequence[Joint], number_why: str | None) -> Figure:
    if number_why is not None:
        return no_figure("joint_share_percent", "%", number_why, len(joints))
    if not port.working:
        return no_figure("joint_share_percent", "%", "The tool was never seen working.")
    busy = sum(dwell or 0.0 for dwell in dwells_of(joints))
    share = 100.0 * busy / (port.working * port.period_s)
    return Figure(
        "joint_share_percent",
        share,
        "%",
        len(joints),
        port.temperature.coverage,
        100.0 / port.working,
    )
