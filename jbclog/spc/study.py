"""What people ask for: a chart or an index of a feature, or the sentence that says why there is none."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from jbclog.errors import UsageError
from jbclog.spc import charts
from jbclog.spc.capability import Capability, indices
from jbclog.spc.charts import Chart, Floats
from jbclog.spc.refusal import (
    LEAST_FOR_CAPABILITY,
    LEAST_POINTS,
    Refused,
    autocorrelated,
    first_refusal,
    not_normal,
    too_few,
    unresolved,
    unstable,
)


def control_chart(values: ArrayLike, *, resolution: float | None = None) -> tuple[Chart, Chart] | Refused:
    """The individuals and the moving range chart of a feature in the order in which it came; NaN, not known, is left out.

    `resolution` is the least step of the values, in their unit. Raises `UsageError` where a value is infinite.
    """
    points = _known(values)
    refused = first_refusal(
        (
            lambda: too_few(len(points), LEAST_POINTS, "values"),
            lambda: unresolved(points, float(points.std(ddof=1)), resolution),
            lambda: autocorrelated(points),
        )
    )
    return refused or (charts.individuals(points), charts.moving_ranges(points))


def subgroup_charts(subgroups: ArrayLike, *, resolution: float | None = None) -> tuple[Chart, Chart] | Refused:
    """The charts of means and ranges of subgroups, a row each."""
    rows = np.asarray(subgroups, dtype=np.float64)
    refused = first_refusal(
        (
            lambda: too_few(len(rows), LEAST_POINTS, "subgroups"),
            lambda: unresolved(rows.ravel(), charts.sigma_of_ranges(rows), resolution),
            lambda: autocorrelated(rows.mean(axis=1)),
        )
    )
    return refused or (charts.means(rows), charts.ranges(rows))


def capability(
    values: ArrayLike, *, lower: float | None = None, upper: float | None = None, resolution: float | None = None
) -> Capability | Refused:
    """Cp, Cpk, Pp and Ppk of a feature against its limits, with bounds; NaN, not known, is left out, and `n` counts the others.

    Raises `UsageError` where no limit is stated, the lower one is not below the upper, or a value is infinite.
    """
    if lower is None and upper is None:
        raise UsageError("capability is held against limits: state a lower or an upper one, or both")
    if lower is not None and upper is not None and lower >= upper:
        raise UsageError(f"the lower limit {lower:g} is not below the upper limit {upper:g}")
    points = _known(values)
    refused = first_refusal(
        (
            lambda: too_few(len(points), LEAST_FOR_CAPABILITY, "values"),
            lambda: unresolved(points, float(points.std(ddof=1)), resolution),
            lambda: autocorrelated(points),
            lambda: unstable(charts.individuals(points)),
            lambda: not_normal(points),
        )
    )
    return refused or indices(points, lower, upper)


def _known(values: ArrayLike) -> Floats:
    """The values that are known, in their order; NaN is one that is not."""
    points = np.asarray(values, dtype=np.float64)
    if points.ndim != 1:
        raise UsageError(f"a feature is one value after another, not an array of shape {points.shape}")
    if np.isinf(points).any():
        raise UsageError("a feature is finite: an infinite value comes of a division by zero before it got here")
    return points[~np.isnan(points)]
