"""A metric over many runs: its course, its control chart and its capability, for each port by itself.

A point is one run's value of a metric (`Run.metrics`), in the order of the runs' starts; a run whose record does not give it is no
point, and is counted with its reason. A mean of n readings that spread over their steps resolves a step / √n; one of readings that
do not, a step. The chart is that of individual values and moving ranges, capability is held against stated limits; both come from
`spc`, which refuses what would mislead, and says why. A tip that was exchanged, or a recipe that was changed, makes two processes
of one: such changes are told, not hidden in the chart.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from difflib import get_close_matches
from math import sqrt
from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jbclog.analysis import spc
from jbclog.analysis.metrics.definitions import DEFINITIONS
from jbclog.analysis.run_metrics import definitions
from jbclog.analysis.runs import WHAT_A_RATE_CHANGES, rate_text
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.analysis.runs import Runs
    from jbclog.record.find_runs import Found

DEFAULT: Final = "idle_error_c"
UNIT_AT_END: Final = re.compile(r"_(permille_s|permille|percent|c_per_h|mm_s|mm|c|s|j)$")
MEANS: Final = ("idle_error_c",)  # of many readings
SPREAD: Final = "idle_sd_c"  # not known where it is below what steps can show
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Point:
    """One run's value of the metric; None where its record does not give it, and then `why`."""

    run: str
    started: datetime | None
    value: float | None
    n: int
    coverage: float | None
    resolution: float | None
    why: str | None


@dataclass(frozen=True, slots=True)
class Trend:
    """One metric of one port over the runs, a point a run. `values` are those that are known, in order."""

    station: str
    port: int
    metric: str
    unit: str
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
        return float(self.values.mean()) if len(self.values) else None

    @property
    def sd(self) -> float | None:
        return float(self.values.std(ddof=1)) if len(self.values) > 1 else None

    @property
    def signals(self) -> list[tuple[str, str]]:
        """Run and sentence of each signal of the chart of values."""
        if isinstance(self.chart, spc.Refused):
            return []
        return [(self.known[one.last].run, f"test {one.test}: {one.text}") for one in self.chart[0].signals]


def metric_unit(metric: str) -> str:
    """The unit of a metric. Raises `UsageError` with the nearest names where there is none of that name."""
    found = next((one.unit for one in DEFINITIONS if one.name == metric), None)
    if found is None:
        names = [one.name for one in DEFINITIONS]
        near = get_close_matches(metric[:64], names, n=1)
        meant = f"did you mean {near[0]}? " if near else ""
        raise UsageError(f"there is no metric {metric[:64]!r}; {meant}There are {', '.join(names)}")
    return found


def title_of(metric: str) -> str:
    """The metric in words, without its unit: ``idle error``."""
    return UNIT_AT_END.sub("", metric).replace("_", " ")


def metric_text(metric: str) -> str:
    """What it means, in words."""
    table = definitions()
    return str(table.loc[table["metric"] == metric, "definition"].iloc[0])


def trends(
    runs: Runs,
    metric: str = DEFAULT,
    station: str | None = None,
    port: int | None = None,
    lower: float | None = None,
    upper: float | None = None,
) -> list[Trend]:
    """A trend for each station and port. Raises `UsageError` for a metric that there is not, or limits that are none."""
    unit = metric_unit(metric)
    expect_limits(lower, upper)
    found = {one.folder.name: one for one in runs.found}
    return [
        _trend(place, metric, unit, points, lower, upper, found)
        for place, points in sorted(_points(runs, metric, station).items())
        if port in (None, place[1])
    ]


def _points(runs: Runs, metric: str, station: str | None) -> dict[tuple[str, int], list[Point]]:
    """The points of each station and port, in the order of their runs' starts."""
    table = runs.metrics(station)
    rows = table[table["metric"] == metric].sort_values(["started", "run"], kind="stable")
    spread = _dithered(table) if metric in MEANS else set()
    found: dict[tuple[str, int], list[Point]] = {}
    for row in rows.astype(object).where(rows.notna(), None).to_dict("records"):
        started = None if row["started"] is None else row["started"].to_pydatetime()
        value, coverage, step = (_number(row[name]) for name in ("value", "coverage", "resolution"))
        is_dithered = (row["run"], row["station"], row["port"]) in spread
        resolution = step / sqrt(row["n"]) if step is not None and is_dithered else step
        point = Point(str(row["run"]), started, value, int(row["n"]), coverage, resolution, row["why"])
        found.setdefault((str(row["station"]), int(row["port"])), []).append(point)
    return found


def _dithered(table: pd.DataFrame) -> set[tuple[object, object, object]]:
    """Runs, stations and ports whose idle readings spread over their steps: only then a mean shows less than a step."""
    rows = table[(table["metric"] == SPREAD) & table["value"].notna()]
    return set(zip(rows["run"], rows["station"], rows["port"], strict=True))


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None


def expect_limits(lower: float | None, upper: float | None) -> None:
    for name, value in (("--lower", lower), ("--upper", upper)):
        if value is not None and not np.isfinite(value):
            raise UsageError(f"{name} {value}: give a number")
    if lower is not None and upper is not None and lower >= upper:
        raise UsageError(f"the lower limit {lower:g} is not below the upper limit {upper:g}")


def _trend(
    place: tuple[str, int],
    metric: str,
    unit: str,
    points: list[Point],
    lower: float | None,
    upper: float | None,
    found: dict[str, Found],
) -> Trend:
    values = np.array([point.value for point in points if point.value is not None], dtype=np.float64)
    steps = [point.resolution for point in points if point.resolution is not None and point.value is not None]
    resolution = float(np.median(steps)) if steps else None
    chart = spc.control_chart(values, resolution=resolution)
    asked = lower is not None or upper is not None
    index = spc.capability(values, lower=lower, upper=upper, resolution=resolution) if asked else None
    changes = list(_changes([one.run for one in points], found, *place))
    warnings = list(_other_rates([found[one.run] for one in points if one.value is not None], place[0]))
    return Trend(*place, metric, unit, points, chart, index, changes, warnings, resolution)


def _other_rates(runs: Iterable[Found], station: str) -> Iterator[str]:
    """A sentence where the runs were not all sampled as often."""
    counted = Counter(rate_text(one.periods_s[station]) for one in runs if station in one.periods_s)
    if len(counted) > 1:
        told = ", ".join(f"{rate} in {count} run{'' if count == 1 else 's'}" for rate, count in counted.most_common())
        yield f"rates differ: {told}; {WHAT_A_RATE_CHANGES}"


def _changes(names: Iterable[str], found: dict[str, Found], station: str, port: int) -> Iterable[str]:
    """Between which runs the recipe or the tip that was named became another one."""
    before: tuple[Sequence[str], Sequence[str]] | None = None
    for name in names:
        one = found[name]
        now = (one.recipes, _tips(one, station, port))
        if before is not None and now[0] != before[0]:
            yield f"{name}: the recipe is {', '.join(now[0]) or 'not known'}, before it was {', '.join(before[0]) or 'not known'}"
        if before is not None and now[1] != before[1]:
            yield f"{name}: the tip is {', '.join(now[1]) or 'not named'}, before it was {', '.join(before[1]) or 'not named'}"
        before = now


def _tips(one: Found, station: str, port: int) -> tuple[str, ...]:
    """What was said of the tip in this port, the nearest word first."""
    for place in (f"{station}:{port}=", f"{station}="):
        named = tuple(text.removeprefix(place) for text in one.tips if text.startswith(place))
        if named:
            return named
    return tuple(text for text in one.tips if "=" not in text)
