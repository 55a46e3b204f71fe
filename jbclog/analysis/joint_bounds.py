"""Bounds that a run's raw power sets to the joints in its tables; `jbclog check` compares them.

They use the *excess*, the power above what holds the tip against its loss to the air, and so do not
repeat the heat balance that found the joints.

1. *Dwell*: a joint lasts no longer than its recovery and the delay of the temperature, unless the
   regulator brings the tip back while the work still draws heat. The excess shows that: from the
   recovery to the end its mean is above `WORK_PERMILLE` then. Of the joints whose recovery is known
   at most `MOST_SHARE` may last longer without it.
2. *Share*: the joints of a port take no more of its working time than the time in which the excess,
   as a mean over `MEAN_S`, is above `WORK_PERMILLE`.

A tip well above its setpoint (an overheat) gives heat without power: joints that begin so are not
compared, and that time counts as power.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pyarrow as pa

from jbclog.analysis.clock_steps import steps_in
from jbclog.analysis.derived_files import MetricRow, metric_rows_in
from jbclog.analysis.joints.port_reader import PortReader
from jbclog.analysis.joints.port_rows import COLUMNS
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.thermal import AIR_C
from jbclog.analysis.joints.windows import TakesRows, View, Windows
from jbclog.analysis.port_data import Flags, Floats, setting_in_force
from jbclog.analysis.run_joints import joints_of_port
from jbclog.analysis.run_metrics import stored_table
from jbclog.analysis.run_tables import RunTables
from jbclog.record.clock_steps import COLUMNS as STEP_COLUMNS

WORK_PERMILLE: Final = 35.0  # the flow that a contact reaches at least (`contacts`)
MEAN_S: Final = 1.0
OVERHEAT_C: Final = 3.0
FEWEST: Final = 3  # joints: a gap or a feed may hide the excess of a single one
MOST_SHARE: Final = 0.25
EDGE_PERIODS: Final = 2.0  # both ends are known to a period
AGAIN: Final = "make the tables again with `jbclog report`"
METRICS: Final = (
    *("joint_dwell_s", "joint_share_percent"),
    *("tip_loss_permille_per_k", "temperature_delay_s"),
)


@dataclass(frozen=True, slots=True)
class JointTimes:
    """The joints of a port in s, NaN where not known: when each began, how long it lasted, and its
    recovery; a joint that began in an overheat has none.
    """

    starts: Floats
    dwells: Floats
    recoveries: Floats


class PortBounds:
    """The sweep over the rows of one port that compares its joints; see the top.

    `loss` is that of the tip in ‰/K, `delay_s` that of its temperature, `share` that of the joints
    in its working time, in per cent; None: not compared.
    """

    def __init__(
        self, loss: float, delay_s: float, joints: JointTimes, share: float | None
    ) -> None:
        self._loss, self._share = loss, share
        known = ~np.isnan(joints.recoveries) & (joints.recoveries > 0) & ~np.isnan(joints.dwells)
        self._compared = int(known.sum())
        self._back = joints.starts[known] + joints.recoveries[known] + delay_s
        self._ends = joints.starts[known] + joints.dwells[known]
        self._late = self._working = self._allowed = 0
        self._sweeps = iter([Windows(self.look, with_parts=False)])

    def next_sweep(self) -> TakesRows | None:
        return next(self._sweeps, None)

    def look(self, view: View) -> None:
        """Compare the joints whose tip was back in this window, and add its working time."""
        series = view.series
        excess = series.rows.power - self._loss * (series.rows.temperature - AIR_C)
        own = view.own(series.seconds)
        working = series.rows.working[own]
        self._working += int(working.sum())
        self._allowed += int((working & _may_be_in_joint(series, excess)[own]).sum())
        moments = series.moments
        first, last = np.searchsorted(self._back, [view.begin_s, view.end_s])
        for back, end in zip(self._back[first:last], self._ends[first:last], strict=True):
            if end <= back + EDGE_PERIODS * series.period_s:
                continue
            rows = slice(*np.searchsorted(moments, [back, end]))
            read = excess[rows][~np.isnan(excess[rows])]
            if len(read) and read.mean() < WORK_PERMILLE:
                self._late += 1

    def texts(self) -> Iterator[str]:
        """Yield a sentence for each bound that does not hold, once the sweep has ended."""
        if self._late >= FEWEST and self._late > MOST_SHARE * self._compared:
            yield (
                f"{self._late} of {self._compared} joints last after their tip was back, and its"
                f" power shows no work then (below {WORK_PERMILLE:g} ‰)"
            )
        if self._share is None or not self._working:
            return
        allowed = 100 * self._allowed / self._working
        if self._share > allowed:
            yield (
                f"joints take {self._share:.1f} % of the working time, but the power shows work in"
                f" {allowed:.1f} % of it"
            )


def _may_be_in_joint(series: Series, excess: Floats) -> Flags:
    """Return the rows in which power or an overheat may give heat to work."""
    read = ~np.isnan(excess)
    window = np.ones(max(round(MEAN_S / series.period_s), 1))
    total = np.convolve(np.where(read, excess, 0.0), window, "same")[: len(excess)]
    number = np.convolve(read.astype(np.float64), window, "same")[: len(excess)]
    setpoint = setting_in_force(series.seconds, series.rows.setting)
    is_hot = series.rows.temperature > setpoint + OVERHEAT_C
    return np.asarray((total > WORK_PERMILLE * number) | (number == 0) | is_hot, dtype=np.bool_)


def beyond_bounds(run: RunTables) -> list[str]:
    """Return a sentence for each bound that the derived joints and metrics of a sealed run break;
    none without these tables. Raises `RecordError`.
    """
    stored = stored_table(run, "metrics")
    if stored is None:
        return []
    metrics = metric_rows_in(stored)
    joints = stored_table(run, "joints")
    found: list[str] = []
    samples = run.samples_by_port(COLUMNS)
    steps = steps_in(run.groups("events", STEP_COLUMNS))
    for facts in run.stations:
        for port in facts.ports:
            bounds = _bounds_of(_values(metrics, facts.name, port), joints, facts.name, port)
            if bounds is None:
                continue
            PortReader(facts, port, samples, steps, run.manifest.t0_utc_us).sweep(bounds)
            found += [f"{facts.name} port {port}: {text}; {AGAIN}" for text in bounds.texts()]
    return found


def _values(metrics: Sequence[MetricRow], station: str, port: int) -> dict[str, float]:
    """Return those of `METRICS` that the port has."""
    return {
        row.metric: row.value
        for row in metrics
        if (row.station, row.port) == (station, port)
        and row.metric in METRICS
        and row.value is not None
    }


def _bounds_of(
    values: dict[str, float], joints: pa.Table | None, station: str, port: int
) -> PortBounds | None:
    loss = values.get("tip_loss_permille_per_k")
    if loss is None or "joint_dwell_s" not in values:
        return None
    none = np.empty(0)
    times = JointTimes(none, none, none)
    if joints is not None:
        times = times_of(joints_of_port(joints, station, port))
    delay_s = values.get("temperature_delay_s", 0.0)
    return PortBounds(loss, delay_s, times, values.get("joint_share_percent"))


def times_of(joints: pa.Table) -> JointTimes:
    """Return the times of one port's joints in the table of joints, in order."""
    names = ("start_s", "dwell_s", "recovery_s", "deficit_c", "resting_below_c")
    starts, dwells, recoveries, deficits, below = (
        np.asarray(joints[name].to_numpy(), dtype=np.float64) for name in names
    )
    is_hot = (deficits < -OVERHEAT_C) | (below < -OVERHEAT_C)
    return JointTimes(starts, dwells, np.where(is_hot, np.nan, recoveries))
