"""Control charts of runs, and the fixed limits that they may cite.

Within a run a point is a joint, a metric any number that the table of joints has; over a folder of runs a point is a run's metric,
as in `trend`. Alarms are counted in equal stretches of a run, or per run, over the hours recorded (u); rejects are the share of the
judged runs of a day (p); a Pareto ranks alarms by their limit and losses by their reason.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from jbclog.analysis import spc
from jbclog.analysis.alarms import Detector, Episode
from jbclog.analysis.spc.refusal import there_are
from jbclog.analysis.stored_tables import JOINTS_SCHEMA
from jbclog.analysis.trend import metric_unit, trends
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.core.foreign.json_reader import builder

if TYPE_CHECKING:
    from jbclog.analysis.run import Run
    from jbclog.analysis.runs import Runs

# -- charts -------------------------------------------------------------------------------------------------------------------

KINDS: Final = ("imr", "ewma", "cusum", "xbar-s", "u", "p", "pareto")
OF_VALUES: Final = KINDS[:4]
COUNTED: Final = {"alarms": ("u", "pareto"), "rejects": ("p",), "losses": ("pareto",)}
"""What is counted and not measured, and its charts; the first is the default."""
NOT_A_METRIC: Final = ("start_s", "end_s", "confidence")
LEAST_COUNTED: Final = 10
RECOVERY: Final = "recovery_s"
MOST_LATE: Final = 0.05  # the share of joints without recovery above which figures of the others would flatter
NO_LOSS: Final = frozenset({"due", "ok", "not_counting"})  # an answer that says that nothing is counted now is no loss
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """A feature in the order in which it came; `missing` more have none. `each` is what a point is: ``joint`` or ``run``.

    `late`: of those the joints that the next one followed before the tip was back, where the feature is the recovery. `why`: the
    joints of the port are not known.
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


@dataclass(frozen=True, slots=True, eq=False)
class Charted:
    """One feature's charts with limits of its own, or why it has none; with fixed limits, where there are any for it.

    `names` are those of the points of the first chart. `scale` says what is charted where it is not the value itself.
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
    """A u or a p chart; `sizes` are hours or runs."""

    metric: str
    kind: str
    names: list[str]
    counts: Floats
    sizes: Floats
    chart: spc.Chart | spc.Refused


@dataclass(frozen=True, slots=True)
class Ranked:
    """A Pareto: what, how many, per cent of all and of all up to it."""

    metric: str
    total: int
    rows: list[tuple[str, int, float, float]]


def joint_metrics() -> dict[str, str]:
    """The metrics of a joint and their units."""
    fields = [one for one in JOINTS_SCHEMA if pa.types.is_floating(one.type) and one.name not in NOT_A_METRIC]
    return {one.name: (one.metadata or {}).get(b"unit", b"").decode() for one in fields}


def series_of_run(run: Run, metric: str, station: str | None = None, port: int | None = None) -> list[Series]:
    """The metric of joint after joint, for each port. Raises `UsageError` for a metric that joints do not have."""
    known = joint_metrics()
    if metric not in known:
        near = get_close_matches(metric[:64], known, n=1)
        meant = f"; did you mean {near[0]}?" if near else "."
        raise UsageError(f"joints have no metric {metric[:64]!r}{meant} They have {', '.join(known)}; or {', '.join(COUNTED)}")
    joints = run.joints(station)
    found = []
    for (name, number), rows in joints.groupby(["station", "port"], sort=True):
        at = int(str(number))
        if port not in (None, at):
            continue
        values = rows[metric].to_numpy(dtype=np.float64, na_value=np.nan)
        there = ~np.isnan(values)
        names = [f"joint {joint}" for joint in rows["joint"].to_numpy()[there]]
        late = int(rows["recovered"].eq(False).sum()) if metric == RECOVERY else 0
        found.append(Series(str(name), at, metric, known[metric], "joint", values[there], names, int((~there).sum()), late=late))
    none = np.empty(0)
    found += [
        Series(name, at, metric, known[metric], "joint", none, [], why=why)
        for (name, at), why in _not_known(run, station, {one.place for one in found}).items()
        if port in (None, at)
    ]
    return sorted(found, key=lambda one: one.place)


def _not_known(run: Run, station: str | None, seen: set[tuple[str, int]]) -> dict[tuple[str, int], str]:
    """The other ports that worked and whose joints are not known, and why."""
    ports = {(facts.name, port) for facts in run.manifest.stations for port in facts.ports if station in (None, facts.name)}
    if not ports - seen:
        return {}
    told: dict[tuple[str, int], dict[str, tuple[object, str]]] = {}
    for row in run.metrics(station).to_dict("records"):
        told.setdefault((str(row["station"]), int(row["port"])), {})[str(row["metric"])] = (row["n"], str(row["why"]))
    return {
        place: metrics["joints"][1]
        for place, metrics in told.items()
        if place in ports - seen and metrics["power_mean_permille"][0] and metrics["joints"][1] not in ("None", "nan", "<NA>")
    }


def series_of_runs(runs: Runs, metric: str, station: str | None = None, port: int | None = None) -> list[Series]:
    """The metric of run after run, for each port. Raises `UsageError` for a metric that runs do not have."""
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
    """The charts of one feature. Capability is held against `lower` and `upper`, where any is stated."""
    refused = _joints_unknown(series) or too_many_late(series.late, len(series.values))
    if refused is not None:
        return Charted(series, kind, series.names, refused, capability=None if lower is None and upper is None else refused)
    made = _charted(series, kind, size, tests, fixed, lower, upper)
    return made if not series.late else replace(made, notes=[*made.notes, _left_out(series.late)])


def _joints_unknown(series: Series) -> spc.Refused | None:
    if series.why is None or len(series.values):
        return None
    return spc.Refused("not_known", f"Joints are not known: {series.why[:1].lower()}{series.why[1:]}")


def too_many_late(late: int, back: int) -> spc.Refused | None:
    """Why the recoveries of the joints after which the tip was back say nothing of all joints; None where they do."""
    if late <= MOST_LATE * (late + back):
        return None
    return spc.Refused("not_recovered", f"After {late} of {late + back} joints the next one came before the tip was back.")


def _left_out(late: int) -> str:
    return f"{late} joint{'s' * (late != 1)} that the next one followed before the tip was back left out: longer than seen."


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
    asked = lower is not None or upper is not None
    index = spc.capability(values, lower=lower, upper=upper, resolution=step) if asked else None
    beside = None if fixed is None or len(values) < 2 else spc.fixed(values, fixed.centre, fixed.lower, fixed.upper, tests)
    if kind == "xbar-s":
        return _of_subgroups(series, size, tests, beside, index)
    own = spc.control_chart(values, resolution=step, tests=tests)
    if kind == "imr" or isinstance(own, spc.Refused):
        return Charted(series, kind, series.names, own, beside, index)
    fit = spc.fitting(values, step)
    is_scored = fixed is None and fit is not None and fit.name != "normal"
    points = fit.scores(values) if is_scored and fit is not None else values
    centre, sigma = (0.0, 1.0) if is_scored else (None, None) if fixed is None else (fixed.centre, (fixed.upper - fixed.lower) / 6)
    scale = f"normal scores ({fit.name})" if is_scored and fit is not None else None
    charts = (spc.ewma(points, centre=centre, sigma=sigma),) if kind == "ewma" else spc.cusum(points, centre=centre, sigma=sigma)
    return Charted(series, kind, series.names, charts, beside, index, scale if kind == "ewma" or scale else "sigma")


def _of_subgroups(
    series: Series, size: int, tests: tuple[int, ...], beside: spc.Chart | None, index: spc.Capability | spc.Refused | None
) -> Charted:
    count = len(series.values) // size
    rows = series.values[: count * size].reshape(count, size)
    names = [f"{series.names[place * size]} to {series.names[(place + 1) * size - 1]}" for place in range(count)]
    rest = len(series.values) - count * size
    notes = [f"The last {rest} of {len(series.values)} values fill no subgroup of {size} and are left out."] if rest else []
    found = spc.subgroup_charts_by_sd(rows, resolution=series.resolution, tests=tests)
    return Charted(series, "xbar-s", names, found, beside, index, notes=notes)


def alarms_in_run(run: Run, every_s: float) -> Counted:
    """Alarms of our samples in equal stretches of a run's record, over their hours."""
    if not (np.isfinite(every_s) and every_s > 0):
        raise UsageError(f"a stretch of {every_s:g} s: it must be above 0")
    begin, end = _span(run) or (0.0, 0.0)
    edges = np.append(np.arange(begin, end, every_s), end)  # the last stretch may be shorter, and has the limits of its length
    raised = np.clip([one.onset_us / 1e6 for one in _episodes(run)], begin, end)
    counts = np.histogram(raised, edges)[0].astype(np.float64) if len(edges) > 1 else np.zeros(0)
    names = [f"{pd.Timestamp(at, unit='s'):%Y-%m-%d %H:%M:%S}" for at in edges[:-1]]
    return _u("alarms", "stretches", names, counts, np.diff(edges) / 3600)


def alarms_in_runs(runs: Runs) -> Counted:
    """Alarms of our samples, per run, over its hours."""
    names, counts, sizes = [], [], []
    for run in runs:
        span = _span(run)
        if span is not None:
            names.append(run.name)
            counts.append(float(len(_episodes(run))))
            sizes.append((span[1] - span[0]) / 3600)
    return _u("alarms", "runs", names, np.array(counts), np.array(sizes))


def rejects(runs: Runs) -> Counted:
    """Runs that were rejected, of all that were judged, for each day in UTC."""
    of: Counter[str] = Counter()
    rejected: Counter[str] = Counter()
    for one in runs.found:
        if one.verdict is not None and one.started is not None:
            day = one.started[:10]
            of[day] += 1
            rejected[day] += one.verdict == "REJECT"
    names = sorted(of)
    counts, sizes = (np.array([which[name] for name in names], dtype=np.float64) for which in (rejected, of))
    refused = _too_few(len(names), "days with a judged run")
    return Counted("rejects", "p", names, counts, sizes, refused or spc.shares(counts, sizes))


def ranked_alarms(runs: Iterable[Run]) -> Ranked:
    """Alarms of our samples by station, port and limit."""
    return ranked("alarms", Counter(f"{one.station} port {one.port} {one.side}" for run in runs for one in _episodes(run)))


def ranked_losses(runs: Iterable[Run]) -> Ranked:
    """Readings that were due and are not there, by station and reason."""
    lost: Counter[str] = Counter()
    for run in runs:
        for station, ports in run.manifest.ledger.items():
            for signals in ports.values():
                for counts in signals.values():
                    lost.update({f"{station} {reason}": n for reason, n in counts.items() if reason not in NO_LOSS and n})
    return ranked("losses", lost)


def ranked(metric: str, counted: Mapping[str, int]) -> Ranked:
    """The most frequent first; equal ones by name."""
    total, so_far, rows = sum(counted.values()), 0, []
    for name, count in sorted(counted.items(), key=lambda one: (-one[1], one[0])):
        so_far += count
        rows.append((name, count, 100 * count / total, 100 * so_far / total))
    return Ranked(metric, total, rows)


def _u(metric: str, what: str, names: list[str], counts: Floats, hours: Floats) -> Counted:
    return Counted(metric, "u", names, counts, hours, _too_few(len(names), what) or spc.rates(counts, hours))


def _too_few(count: int, what: str) -> spc.Refused | None:
    if count >= LEAST_COUNTED:
        return None
    return spc.Refused("too_few", f"{there_are(count, what)}; a chart of counts takes at least {LEAST_COUNTED}.")


def _episodes(run: Run) -> list[Episode]:
    """The alarms by our samples, with delay and deadband."""
    found = run.alarm_findings().incidents
    return [each for one in found for each in one.episodes if each.detector is Detector.SAMPLES]


def _span(run: Run) -> tuple[float, float] | None:
    """First and last row in seconds since 1970; None where there is none."""
    begin, end = np.inf, -np.inf
    for piece in run.stream("samples", columns=["time"]):
        micros = piece["time"].astype("int64")
        begin, end = min(begin, float(micros.min()) / 1e6), max(end, float(micros.max()) / 1e6)
    return (begin, end) if end > begin else None


def joined(series: Iterable[Series]) -> list[Series]:
    """Those of the same port one behind the other, by station and port."""
    by_place: dict[tuple[str, int], Series] = {}
    for one in series:
        before = by_place.get(one.place)
        if before is not None:
            values, names = np.concatenate([before.values, one.values]), [*before.names, *one.names]
            missing, late = before.missing + one.missing, before.late + one.late
            one = replace(before, values=values, names=names, missing=missing, late=late, why=before.why or one.why)
        by_place[one.place] = one
    return [by_place[place] for place in sorted(by_place)]


# -- control limits -----------------------------------------------------------------------------------------------------------
# Fixed control limits from a phase I study, in a file that charts cite by its hash.
#
# The file is JSON: what was charted, for each port centre and limits with their distribution, how many values they rest on, and the
# fingerprints of the runs that these came from. The same runs give the same bytes.

FORMAT: Final = "jbclog control limits 1"


@dataclass(frozen=True, slots=True)
class Fixed:
    """Limits of one port; for other distributions than normal percentiles 0.135 and 99.865 about the median."""

    station: str
    port: int
    centre: float
    lower: float
    upper: float
    distribution: str
    n: int


@dataclass(frozen=True, slots=True)
class Source:
    """A run that the limits came from: its name, and the SHA-256 of its manifest."""

    run: str
    manifest_sha256: str


@dataclass(frozen=True, slots=True)
class Limits:
    """All of a file. `each`: what a point is, ``joint`` or ``run``."""

    format: str
    metric: str
    unit: str
    each: str
    limits: list[Fixed]
    sources: list[Source]

    def of(self, series: Series) -> Fixed | None:
        """Those of one feature. Raises `UsageError` where the file is of another metric."""
        if (self.metric, self.each) != (series.metric, series.each):
            raise UsageError(
                f"the limits are of {self.metric} by {self.each}, the chart is of {series.metric} by {series.each}; learn others"
            )
        return next((one for one in self.limits if (one.station, one.port) == series.place), None)


_build_limits: Final = builder(Limits)


def learn(series: Series) -> Fixed | spc.Refused:
    """The limits of one feature, where it is stable and a distribution fits it."""
    chart = too_many_late(series.late, len(series.values)) or spc.phase_one(series.values, resolution=series.resolution)
    if isinstance(chart, spc.Refused):
        return chart
    edges = float(chart.lower[0]), float(chart.upper[0])
    return Fixed(series.station, series.port, chart.centre, *edges, chart.distribution, len(series.values))


def as_bytes(limits: Limits) -> bytes:
    """The file's bytes."""
    return (json.dumps(asdict(limits), indent=1, sort_keys=True, ensure_ascii=False) + "\n").encode()


def limits_of(metric: str, unit: str, each: str, found: Iterable[Fixed], sources: Iterable[Source]) -> Limits:
    return Limits(FORMAT, metric, unit, each, list(found), list(sources))


def read_limits(path: Path) -> tuple[Limits, str]:
    """The limits and the SHA-256 of their file. Raises `RecordError` where it cannot be read, or is none."""
    try:
        data = read_foreign(path, Kind.SETTINGS)
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}") from error
    try:
        limits = _build_limits(json.loads(data))
    except (ValueError, RecursionError) as error:
        raise RecordError(f"{path} is no file of control limits; `jbclog limits learn` writes one") from error
    if limits.format != FORMAT or any(not one.lower < one.centre < one.upper for one in limits.limits):
        raise RecordError(f"{path} is no file of control limits of this version ({FORMAT}); learn them anew")
    return limits, hashlib.sha256(data).hexdigest()
