"""Entry points: a chart or an index of a feature, or the reason why it is refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from jbclog.analysis.spc import charts, special
from jbclog.analysis.spc.capability import (
    Capability,
    indices,
    indices_of_fit,
    indices_of_percentiles,
)
from jbclog.analysis.spc.charts import Chart
from jbclog.analysis.spc.distribution import Fit, Floats, fitting, normal_fit
from jbclog.analysis.spc.nelson import DEFAULT_TESTS
from jbclog.analysis.spc.refusal import (
    LEAST_FOR_CAPABILITY,
    LEAST_POINTS,
    Refused,
    autocorrelated,
    first_refusal,
    mixed,
    no_distribution,
    rank_scores,
    shifted,
    too_few,
    unresolved,
    unstable,
)
from jbclog.core.errors import UsageError

FEATURE: Final = ("station", "port", "metric")
OF_METRICS: Final = (*FEATURE, "value", "resolution")
MOST_NAMED: Final = 6


@runtime_checkable
class Metrics(Protocol):
    """Rows of `Runs.metrics`, a DataFrame: columns by their names."""

    @property
    def columns(self) -> Any:
        """The names."""

    def __getitem__(self, name: str) -> Any:
        """Return a column."""


def control_chart(
    values: ArrayLike | Metrics,
    *,
    resolution: float | None = None,
    tests: tuple[int, ...] = DEFAULT_TESTS,
) -> tuple[Chart, Chart] | Refused:
    """Return the individuals and moving range charts of a feature, or the reason for a refusal.

    - `values`: in measured order, NaN (not known) is left out; or rows of `Runs.metrics` of one
      metric of one port, whose resolutions then count
    - `resolution`: the smallest step of the values, in their unit. Without it, of values alone,
      nothing shows that their spread is only that of their steps

    The limits are those of the distribution that fits, or of a normal one if none does: an unstable
    process fits none, and the chart shows it. Raises `UsageError` if a value is infinite, or for
    rows of several metrics or ports.
    """
    if isinstance(values, Metrics):
        values, resolution = _of_metrics(values, resolution)
    points = _known_values(values)
    refused = _few_or_coarse(points, LEAST_POINTS, resolution)
    if refused is not None:
        return refused
    fit = fitting(points, _step(points, resolution))
    refused = autocorrelated(points if fit is None else fit.scores(points))
    return refused or (
        charts.individuals(points, tests, fit=fit),
        charts.moving_ranges(points, fit=fit),
    )


def phase_one(values: ArrayLike, *, resolution: float | None = None) -> Chart | Refused:
    """Return the individuals chart of a stable feature that follows a distribution, as limits for
    later values, or the reason for a refusal.

    Raises `UsageError` if a value is infinite.
    """
    points = _known_values(values)
    fit = _stable(points, resolution)
    if isinstance(fit, Refused):
        return fit
    if fit is None:
        text = (
            f"No distribution fits the {len(points)} values, so no limits can be given that later"
            " values keep to."
        )
        return Refused("not_normal", text)
    return charts.individuals(points, fit=fit)


def subgroup_charts(
    subgroups: ArrayLike, *, resolution: float | None = None
) -> tuple[Chart, Chart] | Refused:
    """Return the charts of means and ranges of subgroups (X-bar and R), a row each, or the reason
    for a refusal.
    """
    rows = np.asarray(subgroups, dtype=np.float64)
    refused = _refused_subgroups(rows, charts.sigma_of_ranges, resolution)
    return refused or (charts.means(rows), charts.ranges(rows))


def subgroup_charts_by_sd(
    subgroups: ArrayLike, *, resolution: float | None = None, tests: tuple[int, ...] = DEFAULT_TESTS
) -> tuple[Chart, Chart] | Refused:
    """Return the charts of means and standard deviations of subgroups (X-bar and S), a row each, or
    the reason for a refusal.
    """
    rows = np.asarray(subgroups, dtype=np.float64)
    refused = _refused_subgroups(
        rows, lambda rows: float(rows.std(axis=1, ddof=1).mean()), resolution
    )
    return refused or (charts.means_by_sd(rows, tests), charts.sds(rows))


def capability(
    values: ArrayLike,
    *,
    lower: float | None = None,
    upper: float | None = None,
    resolution: float | None = None,
) -> Capability | Refused:
    """Return Cp, Cpk, Pp and Ppk of a feature against its limits, with bounds, or the reason for a
    refusal.

    NaN (not known) is left out and not counted in `n`. Fits a distribution, tests stability on the
    scale on which it is normal, and takes the indices from its percentiles. Raises `UsageError` if
    no limit is given, the lower one is not below the upper, or a value is infinite.
    """
    if lower is None and upper is None:
        raise UsageError("capability needs a lower limit, an upper limit or both")
    if lower is not None and upper is not None and lower >= upper:
        raise UsageError(f"the lower limit must be below the upper limit {upper:g} (got {lower:g})")
    points = _known_values(values)
    fit = _stable(points, resolution)
    if isinstance(fit, Refused):
        return fit
    if fit is None:
        return indices_of_percentiles(points, lower, upper)
    if fit.name != "normal":
        return indices_of_fit(points, fit, lower, upper)
    return replace(
        indices(points, lower, upper),
        chance=fit.chance,
        percentiles=(fit.at(-3.0), fit.at(0.0), fit.at(3.0)),
    )


def probability_plot(values: ArrayLike, *, resolution: float | None = None) -> ProbabilityPlot:
    """Return the values against the normal scores of their ranks, and the line of the distribution
    that fits.

    Raises `UsageError` for fewer than two values, or if one is infinite.
    """
    points = np.sort(_known_values(values))
    if len(points) < 2:
        raise UsageError(f"a probability plot needs at least two values (got {len(points)})")
    ranks = np.asarray(
        special.ndtri((np.arange(1, len(points) + 1) - 0.375) / (len(points) + 0.25))
    )
    fit = fitting(points, _step(points, resolution))
    line = None if fit is None else fit.family.quantiles(fit.fitted, ranks)
    return ProbabilityPlot(
        ranks, points, line, None if fit is None else fit.name, None if fit is None else fit.chance
    )


@dataclass(frozen=True, slots=True, eq=False)
class ProbabilityPlot:
    """Sorted values against the normal scores of their ranks (Blom), and the line of the
    distribution, if one fits.
    """

    scores: Floats
    values: Floats
    line: Floats | None
    distribution: str | None
    chance: float | None


def _of_metrics(metrics: Metrics, resolution: float | None) -> tuple[Floats, float | None]:
    """Return the values of a table of metrics, and the given resolution or the median of theirs."""
    lacking = [name for name in OF_METRICS if name not in metrics.columns]
    if lacking:
        raise UsageError(
            f"a table of metrics has the columns {', '.join(OF_METRICS)}; this one lacks"
            f" {', '.join(lacking)}"
        )
    features = dict.fromkeys(zip(*(metrics[name] for name in FEATURE), strict=True))
    names = [f"{name} of {station} port {port}" for station, port, name in features]
    if len(names) > 1:
        more = ", …" if len(names) > MOST_NAMED else ""
        raise UsageError(
            "a chart is of one metric of one port; these rows have"
            f" {', '.join(names[:MOST_NAMED])}{more}"
        )
    values = np.asarray(metrics["value"], dtype=np.float64)
    steps = np.asarray(metrics["resolution"], dtype=np.float64)
    is_known = ~np.isnan(values) & ~np.isnan(steps)
    return values, resolution or median_step(steps[is_known].tolist())


def median_step(steps: Sequence[float]) -> float | None:
    """Return the resolution of values with these resolutions; None if there are none."""
    return float(np.median(steps)) if steps else None


def _few_or_coarse(points: Floats, least: int, resolution: float | None) -> Refused | None:
    return first_refusal(
        (
            lambda: too_few(len(points), least, "values"),
            lambda: unresolved(points, float(points.std(ddof=1)), resolution),
        )
    )


def _stable(points: Floats, resolution: float | None) -> Fit | Refused | None:
    """Return the distribution of a stable feature, or a refusal; None if none fits and the values
    are enough for their own percentiles.
    """
    step = _step(points, resolution)
    refused = _few_or_coarse(points, LEAST_FOR_CAPABILITY, resolution)
    if refused is not None:
        return refused
    fit = fitting(points, step)
    scores = rank_scores(points) if fit is None else fit.scores(points)
    refused = first_refusal(
        (
            lambda: autocorrelated(scores),
            lambda: _out_of_control(points, fit, scores, step),
            lambda: shifted(points),
            lambda: mixed(points, fit or normal_fit(points), step),
            lambda: no_distribution(points) if fit is None else None,
        )
    )
    return refused or fit


def _out_of_control(
    points: Floats, fit: Fit | None, scores: Floats, step: float | None
) -> Refused | None:
    """Return a refusal for points and patterns that no stable process has, on the scale on which
    the values are normal.

    Limits come from the values as read, so they include the resolution. What is compared with them
    is certain of each value: it lies as close to the centre as its step allows, and a value whose
    step contains the centre is on neither side of it.
    """
    chart = charts.individuals(scores)
    if not step:
        return unstable(chart, chart.points - chart.centre)
    middle = float(np.median(points)) if fit is None else fit.at(0.0)
    away = points - middle
    is_at_centre = np.abs(away) <= step / 2
    nearest = scores if fit is None else fit.scores(points - np.sign(away) * step / 2)
    return unstable(chart, np.where(is_at_centre, 0.0, nearest))


def _refused_subgroups(
    rows: Floats, sigma: Callable[[Floats], float], resolution: float | None
) -> Refused | None:
    return first_refusal(
        (
            lambda: too_few(len(rows), LEAST_POINTS, "subgroups"),
            lambda: unresolved(rows.ravel(), sigma(rows), resolution),
            lambda: autocorrelated(rows.mean(axis=1)),
        )
    )


def _step(points: Floats, resolution: float | None) -> float | None:
    """Return the step of the values: the stated one, or their least difference if most of them are
    equal to another.
    """
    distinct = np.unique(points)
    if resolution or len(distinct) > len(points) / 2 or len(distinct) < 2:
        return resolution
    return float(np.diff(distinct).min())


def _known_values(values: ArrayLike) -> Floats:
    """Return the values without NaN, in order."""
    points = np.asarray(values, dtype=np.float64)
    if points.ndim != 1:
        raise UsageError(f"a feature must be one-dimensional (got shape {points.shape})")
    if np.isinf(points).any():
        raise UsageError(
            "a feature must be finite; an infinite value comes from a division by zero in its"
            " computation"
        )
    return points[~np.isnan(points)]
