"""A metric over many runs: values, control chart and capability for each port.

A point is one run's value of a metric (`Run.metrics`), ordered by the runs' starts; runs without a
value are counted with their reason. The mean of n readings that spread over their steps resolves a
step / √n; otherwise a step. Charts are of individual values and moving ranges, and capability is
against stated limits; both come from `spc`, which refuses misleading results with a reason. A
changed tip or recipe mixes two processes, so the trend lists such changes. A run in several folders
counts once, with a warning.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from difflib import get_close_matches
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis import spc
from jbclog.analysis.derived_files import MetricRow
from jbclog.analysis.metrics.measures import METRICS
from jbclog.analysis.runs import WHAT_A_RATE_CHANGES, Runs, rate_text
from jbclog.analysis.spc.study import median_step
from jbclog.core.errors import UsageError
from jbclog.core.text import count_text, exact
from jbclog.record.find_runs import Copy, Found, copies_texts

DEFAULT: Final = "idle_error_c"
UNIT_AT_END: Final = re.compile(r"_(permille_s|permille|percent|c_per_h|mm_s|mm|c|s|j)$")
MEANS: Final = ("idle_error_c",)  # means of many readings
SPREAD: Final = "idle_sd_c"  # not known if below what steps can show
LATEST: Final = datetime.max.replace(tzinfo=UTC)
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Point:
    """One run's value of the metric; None if its record has none, for the reason in `why`."""

    run: str
    start: datetime | None
    value: float | None
    n: int
    coverage: float | None
    resolution: float | None
    why: str | None


@dataclass(frozen=True, slots=True)
class Trend:
    """One metric of one port, a point per run. `values` are the known ones, oldest first."""

    station: str
    port: int
    metric: str
    uom: str
    points: list[Point]
    chart: tuple[spc.Chart, spc.Chart] | spc.Refused
    capability: spc.Capability | spc.Refused | None
    changes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    resolution: float | None = None

    @property
    def known(self) -> list[Point]:
        return [point for point in self.points if point.value is not None]

    @property
    def values(self) -> Floats:
        return np.array([point.value for point in self.known], dtype=np.float64)

    @property
    def mean(self) -> float | None:
        return (
            exact(float(self.values.mean()), float(np.abs(self.values).max()))
            if len(self.values)
            else None
        )

    @property
    def sd(self) -> float | None:
        return float(self.values.std(ddof=1)) if len(self.values) > 1 else None

    @property
    def signals(self) -> list[tuple[str, str]]:
        """Run and sentence of each signal of the individuals chart."""
        if isinstance(self.chart, spc.Refused):
            return []
        return [
            (self.known[one.last].run, f"test {one.test}: {one.text}")
            for one in self.chart[0].signals
        ]


def metric_unit(metric: str) -> str:
    """Return the unit of a metric. Raises `UsageError` for an unknown name, with suggestions."""
    if metric not in METRICS:
        raise UsageError(
            f"there is no metric {not_a_metric(metric, METRICS)} There are {', '.join(METRICS)}"
        )
    return METRICS[metric].unit


def not_a_metric(name: str, names: Iterable[str]) -> str:
    """Return ``'dwel_s'; did you mean dwell_s?`` for a name that is not one of `names`."""
    near = get_close_matches(name[:64], names, n=1)
    return f"{name[:64]!r}; did you mean {near[0]}?" if near else f"{name[:64]!r}."


def title_of(metric: str) -> str:
    """Return the name of a metric as words without the unit: ``idle error``."""
    return UNIT_AT_END.sub("", metric).replace("_", " ")


def metric_text(metric: str) -> str:
    """Return the definition of a metric."""
    return METRICS[metric].text


def trends(
    runs: Runs,
    metric: str = DEFAULT,
    station: str | None = None,
    port: int | None = None,
    lower: float | None = None,
    upper: float | None = None,
) -> list[Trend]:
    """Return a trend for each station and port.

    Raises `UsageError` for an unknown metric or impossible limits.
    """
    unit = metric_unit(metric)
    expect_limits(lower, upper)
    found = {one.folder.name: one for one in runs.found}
    return [
        _trend(place, metric, unit, points, lower, upper, found, runs.copies)
        for place, points in sorted(_points(runs, metric, station).items())
        if port in (None, place[1])
    ]


def _points(runs: Runs, metric: str, station: str | None) -> dict[tuple[str, int], list[Point]]:
    """Return the points of each station and port, ordered by the starts of the runs."""
    found: dict[tuple[str, int], list[Point]] = {}
    names = {metric, SPREAD} if metric in MEANS else {metric}
    measured: list[tuple[datetime | None, Found, list[MetricRow]]] = []
    for run, rows in runs.metric_rows(station):
        measured.append((_started(run), run, [row for row in rows if row.metric in names]))
    for started, run, rows in sorted(
        measured, key=lambda one: (one[0] or LATEST, one[1].folder.name)
    ):
        dithered = _dithered(rows) if metric in MEANS else set()
        for row in (row for row in rows if row.metric == metric):
            place = row.station, row.port
            found.setdefault(place, []).append(
                _point(run, started, row, is_dithered=place in dithered)
            )
    return found


def _point(run: Found, started: datetime | None, row: MetricRow, *, is_dithered: bool) -> Point:
    step = row.resolution
    resolution = step / sqrt(row.n) if step is not None and is_dithered and row.n > 0 else step
    return Point(run.folder.name, started, row.value, row.n, row.coverage, resolution, row.why)


def _dithered(rows: Iterable[MetricRow]) -> set[tuple[str, int]]:
    """Return the ports whose idle readings spread over steps: only their mean resolves finer."""
    return {
        (row.station, row.port) for row in rows if row.metric == SPREAD and row.value is not None
    }


def _started(run: Found) -> datetime | None:
    if run.start is None:
        return None
    began = datetime.fromisoformat(run.start)  # a `Timestamp` is far slower
    return began.replace(tzinfo=UTC) if began.tzinfo is None else began.astimezone(UTC)


def expect_limits(lower: float | None, upper: float | None) -> None:
    """Raise `UsageError` for limits that are not finite, or a lower limit that is not below the
    upper one.
    """
    for name, value in (("--lower", lower), ("--upper", upper)):
        if value is not None and not np.isfinite(value):
            raise UsageError(f"{name} must be a finite number (got {value})")
    if lower is not None and upper is not None and lower >= upper:
        raise UsageError(f"--lower must be below --upper (got {lower:g} and {upper:g})")


def _trend(
    place: tuple[str, int],
    metric: str,
    unit: str,
    points: list[Point],
    lower: float | None,
    upper: float | None,
    found: dict[str, Found],
    copies: Sequence[Copy],
) -> Trend:
    values = np.array(
        [point.value for point in points if point.value is not None], dtype=np.float64
    )
    steps = [
        point.resolution
        for point in points
        if point.resolution is not None and point.value is not None
    ]
    resolution = median_step(steps)
    chart = spc.control_chart(values, resolution=resolution)
    has_limits = lower is not None or upper is not None
    index = (
        spc.capability(values, lower=lower, upper=upper, resolution=resolution)
        if has_limits
        else None
    )
    changes = list(_changes([one.run for one in points], found, *place))
    measured = [found[one.run] for one in points if one.value is not None]
    copied = [one for one in copies if place[0] in found[one.counted.name].stations]
    warnings = [*_other_rates(measured, place[0]), *copies_texts(copied)]
    return Trend(*place, metric, unit, points, chart, index, changes, warnings, resolution)


def _other_rates(runs: Iterable[Found], station: str) -> Iterator[str]:
    """Yield a sentence if the runs have different sampling rates."""
    counts = Counter(rate_text(one.periods_s[station]) for one in runs if station in one.periods_s)
    if len(counts) > 1:
        rates = ", ".join(
            f"{rate} in {count_text(count, 'run')}" for rate, count in counts.most_common()
        )
        yield f"rates differ: {rates}; {WHAT_A_RATE_CHANGES}"


def _changes(
    names: Iterable[str], found: dict[str, Found], station: str, port: int
) -> Iterable[str]:
    """Yield a sentence for each run whose recipe or named tip differs from that of the run
    before.
    """
    before: tuple[Sequence[str], Sequence[str]] | None = None
    for name in names:
        one = found[name]
        now = (one.recipes, tips_of(one.tips, station, port))
        if before is not None and now[0] != before[0]:
            yield (
                f"{name}: the recipe is {', '.join(now[0]) or 'not known'}, before it was"
                f" {', '.join(before[0]) or 'not known'}"
            )
        if before is not None and now[1] != before[1]:
            yield (
                f"{name}: the tip is {', '.join(now[1]) or 'not named'}, before it was"
                f" {', '.join(before[1]) or 'not named'}"
            )
        before = now


def tips_of(tips: Sequence[str], station: str, port: int) -> tuple[str, ...]:
    """Return the tips that a run names for this port, else for its station, else for the run."""
    for prefix in (f"{station}:{port}=", f"{station}="):
        named = tuple(text.removeprefix(prefix) for text in tips if text.startswith(prefix))
        if named:
            return named
    return tuple(text for text in tips if "=" not in text)
