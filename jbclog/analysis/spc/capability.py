"""Capability indices with confidence bounds.

For normal values, Cp and Cpk take the spread from differences of neighbours, Pp and Ppk from all
values. Bounds of Cp and Pp are those of a variance (chi-squared), of Cpk and Ppk Bissell's
approximation (1990).

For other distributions, the indices are shares of the distance from the median to the percentiles
0.135 and 99.865 (ISO 22514-2), which is three sigma for normal values. Cp and Cpk then equal Pp and
Ppk, because the process is stable. Bounds come from a parametric bootstrap of the logarithm of the
index (basic; of the index itself if it is not above zero). If no distribution fits, the percentiles
are those of the values, and the bound is that of the share beyond the limits (Clopper-Pearson).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt
from typing import Final

import numpy as np

from jbclog.analysis.spc import special
from jbclog.analysis.spc.charts import sigma_of_moving_ranges
from jbclog.analysis.spc.distribution import REACH, Fit, Floats, widest_fit

SAMPLES: Final = 500  # bootstrap samples
# values per sample; for more values the spread is scaled by the square root of the ratio
MOST_DRAWN: Final = 400
SEED: Final = 1
CONFIDENCE = 0.95
MOVING_RANGE_SHARE = 0.62
"""Degrees of freedom of a mean moving range of two, as a share of those of a standard deviation
(Wheeler, Advanced Topics in SPC).
"""


@dataclass(frozen=True, slots=True)
class Index:
    """An index, its one-sided 95 % lower bound (`bound`, used by verdicts) and its two-sided 95 %
    interval.
    """

    value: float
    bound: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Capability:
    """Capability of a feature; `cp` and `pp` are None with a single limit.

    `distribution` is the fitted one ("percentiles": none fits), `chance` the p-value of the fit;
    `percentiles` are 0.135, 50 and 99.865.
    """

    n: int
    mean: float
    sigma_within: float
    sigma_overall: float
    lower: float | None
    upper: float | None
    cp: Index | None
    cpk: Index
    pp: Index | None
    ppk: Index
    distribution: str = "normal"
    chance: float | None = None
    percentiles: tuple[float, float, float] | None = None


def indices(points: Floats, lower: float | None, upper: float | None) -> Capability:
    """Return the indices of normal individual values, without checking that they apply."""
    mean, n = float(points.mean()), len(points)
    within, overall = sigma_of_moving_ranges(points), float(points.std(ddof=1))
    freedoms = MOVING_RANGE_SHARE * (n - 1), float(n - 1)
    cp, pp = (
        _potential(lower, upper, sigma, freedom)
        for sigma, freedom in zip((within, overall), freedoms, strict=True)
    )
    cpk, ppk = (
        _actual(mean, lower, upper, s, n, freedom)
        for s, freedom in zip((within, overall), freedoms, strict=True)
    )
    return Capability(n, mean, within, overall, lower, upper, cp, cpk, pp, ppk)


def _potential(
    lower: float | None, upper: float | None, sigma: float, freedom: float
) -> Index | None:
    """Return the tolerance in units of six sigma."""
    if lower is None or upper is None:
        return None
    value, tail = (upper - lower) / (6 * sigma), (1 - CONFIDENCE) / 2
    chi_squares = (
        2 * special.gammaincinv(freedom / 2, share) for share in (1 - CONFIDENCE, tail, 1 - tail)
    )
    bound, low, high = (value * sqrt(chi_square / freedom) for chi_square in chi_squares)
    return Index(value, float(bound), float(low), float(high))


def _actual(
    mean: float, lower: float | None, upper: float | None, sigma: float, n: int, freedom: float
) -> Index:
    """Return the distance to the nearer limit in units of three sigma."""
    distances = [upper - mean] if upper is not None else []
    distances += [mean - lower] if lower is not None else []
    value = min(distances) / (3 * sigma)
    return actual_index(value, n, freedom)


def actual_index(value: float, n: int, freedom: float) -> Index:
    """Return a Cpk or Ppk of `n` values with its bounds (Bissell 1990; Montgomery, section
    8.3.4).
    """
    error = sqrt(1 / (9 * n) + value**2 / (2 * freedom))
    one, two = float(special.ndtri(CONFIDENCE)), float(special.ndtri((1 + CONFIDENCE) / 2))
    return Index(
        value, float(value - one * error), float(value - two * error), float(value + two * error)
    )


def indices_of_fit(
    points: Floats, fit: Fit, lower: float | None, upper: float | None
) -> Capability:
    """Return the indices of values that are not normal; their bounds allow for the choice of the
    distribution.
    """
    low, middle, high = fit.at(-REACH), fit.at(0.0), fit.at(REACH)
    found = [
        _index_of_fit(one, len(points), lower, upper) for one in (fit, *_alternatives(points, fit))
    ]
    pps = [one for one, _ in found if one is not None]
    pp, ppk = _widest(pps) if pps else None, _widest([one for _, one in found])
    within, overall = sigma_of_moving_ranges(points), float(points.std(ddof=1))
    of_all = Capability(
        len(points), float(points.mean()), within, overall, lower, upper, pp, ppk, pp, ppk
    )
    return replace(
        of_all, distribution=fit.name, chance=fit.chance, percentiles=(low, middle, high)
    )


def _alternatives(points: Floats, fit: Fit) -> tuple[Fit, ...]:
    """Return the three-parameter family next to one of two: which of them fits better is often
    chance, and it decides the tail.
    """
    wider = widest_fit(points) if fit.family.free == 2 and not fit.outliers else None
    return () if wider is None else (wider,)


def _index_of_fit(
    fit: Fit, n: int, lower: float | None, upper: float | None
) -> tuple[Index | None, Index]:
    """Return Pp (with both limits) and Ppk from the percentiles of a fit, with bootstrap bounds."""
    low, middle, high = (np.array([fit.at(score)]) for score in (-REACH, 0.0, REACH))
    both, nearer = quantile_indices(low, middle, high, lower, upper)
    drawn_both, drawn_nearer, scale = drawn_indices(fit, n, lower, upper)
    pp = None if lower is None or upper is None else _bounded(float(both[0]), drawn_both, scale)
    return pp, _bounded(float(nearer[0]), drawn_nearer, scale)


def _bounded(value: float, drawn: Floats, scale: float) -> Index:
    tail = (1 - CONFIDENCE) / 2
    bound, low, high = basic_bounds(value, drawn, scale, (CONFIDENCE, 1 - tail, tail))
    return Index(value, bound, low, high)


def _widest(found: list[Index]) -> Index:
    """Return the first index, with the widest bounds of all."""
    bound, low = min(one.bound for one in found), min(one.low for one in found)
    return Index(found[0].value, bound, low, max(one.high for one in found))


def quantile_indices(
    low: Floats, middle: Floats, high: Floats, lower: float | None, upper: float | None
) -> tuple[Floats, Floats]:
    """Return Pp and Ppk from the percentiles 0.135, 50 and 99.865 (ISO 22514-2); Pp is NaN if a
    limit is missing.
    """
    distances = [] if upper is None else [(upper - middle) / (high - middle)]
    distances += [] if lower is None else [(middle - lower) / (middle - low)]
    both = (
        np.full_like(middle, np.nan)
        if lower is None or upper is None
        else (upper - lower) / (high - low)
    )
    return both, np.minimum.reduce(distances)


def drawn_indices(
    fit: Fit, n: int, lower: float | None, upper: float | None
) -> tuple[Floats, Floats, float]:
    """Return Pp and Ppk of samples drawn from the fit with a fixed seed, and the factor that scales
    their spread.
    """
    size = min(n, MOST_DRAWN)
    generator = np.random.default_rng(SEED)
    rows = fit.family.quantiles(fit.fitted, generator.normal(size=(SAMPLES, size)))
    if fit.family.needs_positive:  # a power has no values beyond its edge: use one close to it
        middle_of_all = fit.at(0.0)
        rows = np.clip(
            np.nan_to_num(rows, nan=middle_of_all), middle_of_all * 1e-6, middle_of_all * 1e6
        )
    again = fit.family.fit(rows)
    low, middle, high = (
        fit.family.quantiles(again, np.full((SAMPLES, 1), score))[:, 0]
        for score in (-REACH, 0.0, REACH)
    )
    with np.errstate(invalid="ignore"):
        both, nearer = quantile_indices(low, middle, high, lower, upper)
    return both, nearer, sqrt(size / n)


def basic_bounds(
    value: float, drawn: Floats, scale: float, shares: tuple[float, ...]
) -> tuple[float, ...]:
    """Return the bootstrap bounds of `value` at these shares (0.95: a lower bound that holds in 95
    %).
    """
    drawn = np.nan_to_num(drawn, nan=0.0)  # an infinite spread makes the index zero
    quantiles = np.quantile(drawn, shares)
    if value > 0 and (quantiles > 0).all():
        return tuple(float(value * (value / one) ** scale) for one in quantiles)
    return tuple(float(value - scale * (one - value)) for one in quantiles)


def indices_of_percentiles(points: Floats, lower: float | None, upper: float | None) -> Capability:
    """Return the indices of many values that no distribution fits, from their own percentiles."""
    low, middle, high = (
        float(one)
        for one in np.quantile(points, special.ndtr([-REACH, 0.0, REACH]), method="median_unbiased")
    )
    both, nearer = quantile_indices(
        np.array([low]), np.array([middle]), np.array([high]), lower, upper
    )
    beyond = 0 if lower is None else int(np.count_nonzero(points < lower))
    beyond += 0 if upper is None else int(np.count_nonzero(points > upper))
    one, tail, rest = (
        _index_of_share(beyond, len(points), share)
        for share in (1 - CONFIDENCE, (1 - CONFIDENCE) / 2, None)
    )
    value = float(nearer[0])
    ppk = Index(value, min(one, value), min(tail, value), max(rest, value))
    pp = (
        None
        if lower is None or upper is None
        else Index(float(both[0]), ppk.bound, ppk.low, float("inf"))
    )
    within, overall = sigma_of_moving_ranges(points), float(points.std(ddof=1))
    found = Capability(
        len(points), float(points.mean()), within, overall, lower, upper, pp, ppk, pp, ppk
    )
    return replace(found, distribution="percentiles", percentiles=(low, middle, high))


def _index_of_share(beyond: int, n: int, chance: float | None) -> float:
    """Return the index for the greatest share beyond a limit that `beyond` of `n` allow (`chance`
    None: for the least).
    """
    if chance is None:
        least = (
            float(special.betaincinv(beyond, n - beyond + 1, (1 - CONFIDENCE) / 2))
            if beyond
            else 0.0
        )
        return float(-special.ndtri(least)) / 3 if least > 0 else float("inf")
    most = float(special.betaincinv(beyond + 1, n - beyond, 1 - chance)) if beyond < n else 1.0
    return float(-special.ndtri(most)) / 3
