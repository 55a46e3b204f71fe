"""Control charts within a run and over runs, and Pareto charts.

Within a run a point is a joint, and a metric is any number in the table of joints; over runs a
point is a run's metric, as in `trend.py`. Alarms are counted in equal stretches of a run, or per
run, over the hours recorded (u chart); rejects are the share of the judged runs of a day (p chart);
a Pareto chart ranks alarms by limit, and losses by reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Final

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from jbclog.analysis import spc
from jbclog.analysis.alarms import Detector, Episode
from jbclog.analysis.run import Run
from jbclog.analysis.runs import Runs
from jbclog.analysis.spc.refusal import there_are
from jbclog.analysis.stored_tables import JOINTS_SCHEMA
from jbclog.analysis.trend import metric_unit, trends
from jbclog.core.errors import UsageError
from jbclog.core.text import count_text

KINDS: Final = ("imr", "ewma", "cusum", "xbar-s", "u", "p", "pareto")
OF_VALUES: Final = KINDS[:4]
COUNTED: Final = {"alarms": ("u", "pareto"), "rejects": ("p",), "losses": ("pareto",)}
"""Counted, not measured, metrics and their charts; the first is the default."""
NOT_A_METRIC: Final = ("start_s", "end_s", "confidence")
LEAST_COUNTED: Final = 10
RECOVERY: Final = "recovery_s"
# share of joints without recovery above which the others' figures would look too good
MOST_LATE: Final = 0.05
# the station answered that it counts nothing now: no loss
NO_LOSS: Final = frozenset({"due", "ok", "not_counting"})
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """The values of one metric of one port, oldest first. `each`: what a point is, ``joint`` or
    ``run``. `names`: of the points.

    `missing`: the number of points without a value. `late`: how many of these are joints that the
    next one followed before the tip was back, for the recovery. `why`: the reason if the joints of
    the port are not known.
    """

    station: str
    port: int
    metric: str
    unit: str
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
    """The fixed control limits of one port; for a distribution other than normal, percentiles
    0.135, 50 and 99.865.
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
    """The charts of a series with its own limits, or why it has none; `fixed`: the chart with fixed
    limits, if there are any.

    `names`: of the points of the first chart. `scale`: what is charted, if not the value itself.
    """

    series: Series
    kind: str
    names: list[str]
    charts: tuple[spc.Chart, ...] | spc.Refused
    fixed: spc.Chart | None = None
    capability: spc.Capability | spc.Refused | None = None
    scale: str | None = None
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True, eq=False)
class Counted:
    """A u or a p chart, or why there is none; `sizes` are hours or runs."""

    metric: str
    kind: str
    names: list[str]
    counts: Floats
    sizes: Floats
    chart: spc.Chart | spc.Refused


@dataclass(frozen=True, slots=True)
class Ranked:
    """A Pareto chart; its rows are name, count, per cent of all, and running total in per cent."""

    metric: str
    total: int
    rows: list[tuple[str, int, float, float]]


def joint_metrics() -> dict[str, str]:
    """Return the metrics of a joint and their units."""
    fields = [
        one
        for one in JOINTS_SCHEMA
        if pa.types.is_floating(one.type) and one.name not in NOT_A_METRIC
    ]
    return {one.name: (one.metadata or {}).get(b"unit", b"").decode() for one in fields}


def series_of_run(
    run: Run, metric: str, station: str | None = None, port: int | None = None
) -> list[Series]:
    """Return the metric of joint after joint for each port. Raises `UsageError` for a metric that
    joints do not have.
    """
    units = joint_metrics()
    if metric not in units:
        near = get_close_matches(metric[:64], units, n=1)
        meant = f"; did you mean {near[0]}?" if near else "."
        raise UsageError(
            f"joints have no metric {metric[:64]!r}{meant} They have {', '.join(units)}; or"
            f" {', '.join(COUNTED)}"
        )
    joints = run.joints(station)
    found = []
    for (name, number), rows in joints.groupby(["station", "port"], sort=True):
        at = int(str(number))
        if port not in (None, at):
            continue
        values = rows[metric].to_numpy(dtype=np.float64, na_value=np.nan)
        known = ~np.isnan(values)
        names = [f"joint {joint}" for joint in rows["joint"].to_numpy()[known]]
        late = int(rows["recovered"].eq(False).sum()) if metric == RECOVERY else 0
        found.append(
            Series(
                str(name),
                at,
                metric,
                units[metric],
                "joint",
                values[known],
                names,
                int((~known).sum()),
                late=late,
            )
        )
    none = np.empty(0)
    found += [
        Series(name, at, metric, units[metric], "joint", none, [], why=why)
        for (name, at), why in _not_known(run, station, {one.place for one in found}).items()
        if port in (None, at)
    ]
    return sorted(found, key=lambda one: one.place)


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
    """Return the metric of run after run for each port. Raises `UsageError` for a metric that runs
    do not have.
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
    """Return the charts of a series. Capability is that against `lower` and `upper`, if any is
    given.

    `kind` is one of `OF_VALUES`; `size`: values in a subgroup of an xbar-s chart; `tests`: numbers
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
    return spc.Refused(
        "not_known", f"Joints are not known: {series.why[:1].lower()}{series.why[1:]}"
    )


def too_many_late(late: int, back: int) -> spc.Refused | None:
    """Return why known recoveries do not represent all joints, if more than `MOST_LATE` of them are
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
    fit = spc.fitting(values, step)
    is_scored = fixed is None and fit is not None and fit.name != "normal"
    points = fit.scores(values) if is_scored and fit is not None else values
    centre, sigma = (
        (0.0, 1.0)
        if is_scored
        else (None, None)
        if fixed is None
        else (fixed.centre, (fixed.upper - fixed.lower) / 6)
    )
    scale = f"normal scores ({fit.name})" if is_scored and fit is not None else None
    charts = (
        (spc.ewma(points, centre=centre, sigma=sigma),)
        if kind == "ewma"
        else spc.cusum(points, centre=centre, sigma=sigma)
    )
    return Charted(
        series,
        kind,
        series.names,
        charts,
        with_fixed,
        index,
        scale if kind == "ewma" or scale else "sigma",
    )


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


def alarms_in_run(run: Run, every_s: float) -> Counted:
    """Return the u chart of alarms by our samples in equal stretches of `every_s` of a run. Raises
    `UsageError`.
    """
    if not (np.isfinite(every_s) and every_s > 0):
        raise UsageError(f"a stretch must be longer than 0 s (got {every_s:g})")
    begin, end = _span(run) or (0.0, 0.0)
    # the last stretch may be shorter; its limits follow its length
    edges = np.append(np.arange(begin, end, every_s), end)
    raised = np.clip([one.onset_us / 1e6 for one in _episodes(run)], begin, end)
    counts = np.histogram(raised, edges)[0].astype(np.float64) if len(edges) > 1 else np.zeros(0)
    names = [f"{pd.Timestamp(at, unit='s'):%Y-%m-%d %H:%M:%S}" for at in edges[:-1]]
    return _u_chart("stretches", names, counts, np.diff(edges) / 3600)


def alarms_in_runs(runs: Runs) -> Counted:
    """Return the u chart of alarms by our samples, per run over its hours."""
    names, counts, sizes = [], [], []
    for one, (span, episodes) in runs.each(lambda one: _counted_in(runs.open(one))):
        if span is not None:
            names.append(one.folder.name)
            counts.append(float(episodes))
            sizes.append((span[1] - span[0]) / 3600)
    return _u_chart("runs", names, np.array(counts), np.array(sizes))


def _counted_in(run: Run) -> tuple[tuple[float, float] | None, int]:
    """Return the time that a run spans, and its number of alarms by our samples."""
    span = _span(run)
    return span, 0 if span is None else len(_episodes(run))


def rejects(runs: Runs) -> Counted:
    """Return the p chart of rejected runs among the judged runs of each day (UTC)."""
    judged: Counter[str] = Counter()
    rejected: Counter[str] = Counter()
    for one in runs.found:
        if one.verdict is not None and one.started is not None:
            day = one.started[:10]
            judged[day] += 1
            rejected[day] += one.verdict == "REJECT"
    names = sorted(judged)
    counts, sizes = (
        np.array([which[name] for name in names], dtype=np.float64) for which in (rejected, judged)
    )
    refused = _too_few(len(names), "days with a judged run")
    return Counted("rejects", "p", names, counts, sizes, refused or spc.shares(counts, sizes))


def ranked_alarms(source: Run | Runs) -> Ranked:
    """Return the Pareto chart of alarms by our samples, by station, port and limit."""
    return ranked("alarms", _added(source, _alarm_counts))


def ranked_losses(source: Run | Runs) -> Ranked:
    """Return the Pareto chart of lost readings, by station and reason."""
    return ranked("losses", _added(source, loss_counts))


def _added(source: Run | Runs, count: Callable[[Run], Counter[str]]) -> Counter[str]:
    if isinstance(source, Run):
        return count(source)
    return sum(
        (counts for _, counts in source.each(lambda one: count(source.open(one)))), Counter()
    )


def _alarm_counts(run: Run) -> Counter[str]:
    return Counter(f"{one.station} port {one.port} {one.side}" for one in _episodes(run))


def loss_counts(run: Run) -> Counter[str]:
    """Return the number of lost readings of a run by station and reason."""
    lost: Counter[str] = Counter()
    for station, ports in run.manifest.ledger.items():
        for signals in ports.values():
            for counts in signals.values():
                lost.update(
                    {
                        f"{station} {reason}": n
                        for reason, n in counts.items()
                        if reason not in NO_LOSS and n
                    }
                )
    return lost


def ranked(metric: str, counted: Mapping[str, int]) -> Ranked:
    """Return a Pareto chart: the most frequent first, equal ones by name."""
    total, so_far, rows = sum(counted.values()), 0, []
    for name, count in sorted(counted.items(), key=lambda one: (-one[1], one[0])):
        so_far += count
        rows.append((name, count, 100 * count / total, 100 * so_far / total))
    return Ranked(metric, total, rows)


def _u_chart(what: str, names: list[str], counts: Floats, hours: Floats) -> Counted:
    return Counted(
        "alarms", "u", names, counts, hours, _too_few(len(names), what) or spc.rates(counts, hours)
    )


def _too_few(count: int, what: str) -> spc.Refused | None:
    if count >= LEAST_COUNTED:
        return None
    return spc.Refused(
        "too_few", f"{there_are(count, what)}; a chart of counts takes at least {LEAST_COUNTED}."
    )


def _episodes(run: Run) -> list[Episode]:
    """Return the alarms by our samples, with delay and deadband."""
    found = run.alarm_findings().incidents
    return [each for one in found for each in one.episodes if each.detector is Detector.SAMPLES]


def _span(run: Run) -> tuple[float, float] | None:
    """Return the first and last row's times in s since 1970; None: the same, or no row."""
    begin, end = np.inf, -np.inf
    for piece in run.stream("samples", columns=["time"]):
        micros = piece["time"].astype("int64")
        begin, end = min(begin, float(micros.min()) / 1e6), max(end, float(micros.max()) / 1e6)
    return (begin, end) if end > begin else None


def joined(series: Iterable[Series]) -> list[Series]:
    """Return one series for each station and port: those of one port, one after another."""
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
