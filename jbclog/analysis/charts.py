"""Control charts of measured values, within a run and over runs.

Within a run a point is a joint, and a metric is any number in the table of joints. Over runs a
point is a run's metric, as in `trend.py`. Charts of counts are in `count_charts.py`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd
import pyarrow as pa

from jbclog.analysis import spc
from jbclog.analysis.count_charts import COUNTED
from jbclog.analysis.derived_schemas import JOINTS_SCHEMA
from jbclog.analysis.run import Run
from jbclog.analysis.runs import Runs
from jbclog.analysis.spc.distribution import Floats
from jbclog.analysis.trend import metric_unit, not_a_metric, trends
from jbclog.analysis.verdict.evidence import joints_not_known
from jbclog.core.errors import UsageError
from jbclog.core.text import count_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OF_VALUES: Final = ("imr", "ewma", "cusum", "xbar-s")
NOT_A_METRIC: Final = ("start_s", "stop_s", "confidence")
RECOVERY, DWELL = "recovery_s", "dwell_s"
# above this share of joints without recovery, the others' figures would look too good
MOST_LATE: Final = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """The values of one metric of one port, oldest first.

    - `each`: kind of point, ``joint`` or ``run``; `names`: of the points
    - `missing`: number of points without a value
    - `late`: for the recovery, how many of these are joints that the next one followed before the
      tip recovered
    - `why`: the reason if the joints of the port are not known
    """

    station: str
    port: int
    metric: str
    uom: str
    each: str
    values: Floats
    names: list[str]
    missing: int = 0
    resolution: float | None = None
    late: int = 0
    why: str | None = None

    @property
    def place(self) -> tuple[str, int]:
        return self.station, self.port


@dataclass(frozen=True, slots=True)
class Fixed:
    """Fixed control limits of one port; for a distribution other than normal, percentiles 0.135, 50
    and 99.865.
    """

    station: str
    port: int
    centre: float
    lower: float
    upper: float
    distribution: str
    n: int


@dataclass(frozen=True, slots=True, eq=False)
class Charted:
    """The charts of a series with limits of its own, or why there are none.

    `fixed`: the chart with fixed limits, if there are any. `names`: of the points of the first
    chart. `scale`: the charted quantity, if not the value itself.
    """

    series: Series
    kind: str
    names: list[str]
    charts: tuple[spc.Chart, ...] | spc.Refused
    fixed: spc.Chart | None = None
    capability: spc.Capability | spc.Refused | None = None
    scale: str | None = None
    notes: list[str] = field(default_factory=list)

    def plot(self) -> Figure:
        """Draw the charts and the distribution; if they are refused, the values with the reason."""
        from jbclog.analysis.plots import chart_figure

        return chart_figure([self])


def joint_metrics() -> dict[str, str]:
    """Return metric of a joint -> unit."""
    fields = [
        one
        for one in JOINTS_SCHEMA
        if pa.types.is_floating(one.type) and one.name not in NOT_A_METRIC
    ]
    return {one.name: (one.metadata or {}).get(b"uom", b"").decode() for one in fields}


def series_of_run(
    run: Run, metric: str, station: str | None = None, port: int | None = None
) -> list[Series]:
    """Return the metric of each joint in order, for each port.

    Raises `UsageError` for a metric that joints do not have.
    """
    units = joint_metrics()
    if metric not in units:
        raise UsageError(
            f"joints have no metric {not_a_metric(metric, units)} They have {', '.join(units)}; or"
            f" {', '.join(COUNTED)}"
        )
    found = [
        _of_joints(str(name), at, rows, metric, units[metric])
        for (name, number), rows in run.joints(station).groupby(["station", "port"], sort=True)
        if port in (None, at := int(str(number)))
    ]
    # joints are listed without a dwell where their number is not known
    known = {one.place for one in found if len(one.values) or metric != DWELL}
    not_known = _not_known(run, station, known)
    none = np.empty(0)
    found = [one for one in found if one.place not in not_known]
    found += [
        Series(name, at, metric, units[metric], "joint", none, [], why=why)
        for (name, at), why in not_known.items()
        if port in (None, at)
    ]
    return sorted(found, key=lambda one: one.place)


def _of_joints(station: str, port: int, rows: pd.DataFrame, metric: str, unit: str) -> Series:
    values = rows[metric].to_numpy(dtype=np.float64, na_value=np.nan)
    known = ~np.isnan(values)
    return Series(
        station,
        port,
        metric,
        unit,
        "joint",
        values[known],
        [f"joint {joint}" for joint in rows["joint"].to_numpy()[known]],
        int((~known).sum()),
        late=int(rows["recovered"].eq(False).sum()) if metric == RECOVERY else 0,
    )


def _not_known(
    run: Run, station: str | None, seen: set[tuple[str, int]]
) -> dict[tuple[str, int], str]:
    """Return why joints are not known, for each port outside `seen` that worked without any."""
    ports = {
        (facts.name, port)
        for facts in run.manifest.stations
        for port in facts.ports
        if station in (None, facts.name)
    }
    if not ports - seen:
        return {}
    by_port: dict[tuple[str, int], dict[str, tuple[object, str]]] = {}
    for row in run.metrics(station).to_dict("records"):
        by_port.setdefault((str(row["station"]), int(row["port"])), {})[str(row["metric"])] = (
            row["n"],
            str(row["why"]),
        )
    return {
        place: metrics["joints"][1]
        for place, metrics in by_port.items()
        if place in ports - seen
        and metrics["power_mean_permille"][0]
        and metrics["joints"][1] not in ("None", "nan", "<NA>")
    }


def series_of_runs(
    runs: Runs, metric: str, station: str | None = None, port: int | None = None
) -> list[Series]:
    """Return the metric of each run in order, for each port.

    Raises `UsageError` for a metric that runs do not have.
    """
    unit = metric_unit(metric)
    return [
        Series(
            one.station,
            one.port,
            metric,
            unit,
            "run",
            one.values,
            [point.run for point in one.known],
            len(one.points) - len(one.known),
            one.resolution,
        )
        for one in trends(runs, metric, station, port)
    ]


def chart_of_runs(runs: Runs, metric: str, station: str, port: int) -> Charted:
    """Return the charts of the metric of each run at one port.

    Raises `UsageError` for a metric, station or port that no run has.
    """
    found = series_of_runs(runs, metric, station, port)
    if not found:
        runs.expect_place(station, port)
        raise UsageError(f"no run has values of {metric} of {station} port {port}")
    return charted(found[0])


def joined(series: Iterable[Series]) -> list[Series]:
    """Concatenate the series of each station and port."""
    by_port: dict[tuple[str, int], Series] = {}
    for one in series:
        before = by_port.get(one.place)
        if before is not None:
            values, names = np.concatenate([before.values, one.values]), [*before.names, *one.names]
            missing, late = before.missing + one.missing, before.late + one.late
            one = replace(
                before,
                values=values,
                names=names,
                missing=missing,
                late=late,
                why=before.why or one.why,
            )
        by_port[one.place] = one
    return [by_port[port] for port in sorted(by_port)]


def charted(
    series: Series,
    kind: str = "imr",
    *,
    size: int = 5,
    tests: tuple[int, ...] = spc.DEFAULT_TESTS,
    fixed: Fixed | None = None,
    lower: float | None = None,
    upper: float | None = None,
) -> Charted:
    """Return the charts of a series, and its capability if `lower` or `upper` is given.

    `kind` is one of `OF_VALUES`; `size`: values per subgroup of an xbar-s chart; `tests`: numbers
    of the Nelson tests.
    """
    refused = _joints_unknown(series) or too_many_late(series.late, len(series.values))
    if refused is not None:
        return Charted(
            series,
            kind,
            series.names,
            refused,
            capability=None if lower is None and upper is None else refused,
        )
    made = _charted(series, kind, size, tests, fixed, lower, upper)
    return made if not series.late else replace(made, notes=[*made.notes, _left_out(series.late)])


def _joints_unknown(series: Series) -> spc.Refused | None:
    if series.why is None or len(series.values):
        return None
    return spc.Refused("not_known", joints_not_known(series.why, are_some=False))


def too_many_late(late: int, back: int) -> spc.Refused | None:
    """Refuse recoveries that do not represent all joints because more than `MOST_LATE` of them are
    late; else None.
    """
    if late <= MOST_LATE * (late + back):
        return None
    return spc.Refused(
        "not_recovered",
        f"After {late} of {late + back} joints the next one came before the tip was back.",
    )


def _left_out(late: int) -> str:
    return f"{count_text(late, 'joint')} left out: the next one came before the tip was back."


def _charted(
    series: Series,
    kind: str,
    size: int,
    tests: tuple[int, ...],
    fixed: Fixed | None,
    lower: float | None,
    upper: float | None,
) -> Charted:
    values, step = series.values, series.resolution
    has_limits = lower is not None or upper is not None
    index = (
        spc.capability(values, lower=lower, upper=upper, resolution=step) if has_limits else None
    )
    with_fixed = (
        None
        if fixed is None or len(values) < 2
        else spc.fixed(values, fixed.centre, fixed.lower, fixed.upper, tests)
    )
    if kind == "xbar-s":
        return _of_subgroups(series, size, tests, with_fixed, index)
    own = spc.control_chart(values, resolution=step, tests=tests)
    if kind == "imr" or isinstance(own, spc.Refused):
        return Charted(series, kind, series.names, own, with_fixed, index)
    charts, scale = _with_memory(series, kind, fixed)
    return Charted(series, kind, series.names, charts, with_fixed, index, scale)


def _with_memory(
    series: Series, kind: str, fixed: Fixed | None
) -> tuple[tuple[spc.Chart, ...], str | None]:
    """Return an EWMA chart or CUSUM charts, and the charted quantity if it is not the value itself.

    They use the fixed centre, if there is one. Otherwise values that are not normal are charted by
    their normal scores.
    """
    points = series.values
    centre: float | None = None
    sigma: float | None = None
    scale: str | None = None
    fit = spc.fitting(points, series.resolution) if fixed is None else None
    if fixed is not None:
        centre, sigma = fixed.centre, (fixed.upper - fixed.lower) / 6
    elif fit is not None and fit.name != "normal":
        points, scale = fit.scores(points), f"normal scores ({fit.name})"
        centre, sigma = 0.0, 1.0
    if kind == "ewma":
        return (spc.ewma(points, centre=centre, sigma=sigma),), scale
    return spc.cusum(points, centre=centre, sigma=sigma), scale or "sigma"


def _of_subgroups(
    series: Series,
    size: int,
    tests: tuple[int, ...],
    with_fixed: spc.Chart | None,
    index: spc.Capability | spc.Refused | None,
) -> Charted:
    count = len(series.values) // size
    rows = series.values[: count * size].reshape(count, size)
    names = [
        f"{series.names[number * size]} to {series.names[(number + 1) * size - 1]}"
        for number in range(count)
    ]
    rest = len(series.values) - count * size
    notes = (
        [
            f"The last {rest} of {len(series.values)} values fill no subgroup of {size} and are"
            " left out."
        ]
        if rest
        else []
    )
    found = spc.subgroup_charts_by_sd(rows, resolution=series.resolution, tests=tests)
    return Charted(series, "xbar-s", names, found, with_fixed, index, notes=notes)
