"""Capability indices with what they can be trusted for: bounds and intervals, never a bare number.

Cp and Cpk take the spread from differences of neighbours, Pp and Ppk from all values. Confidence of Cp and Pp is that of a
variance (chi-squared); of Cpk and Ppk Bissell's approximation (1990).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from scipy.special import gammaincinv, ndtri

from jbclog.spc.charts import Floats, sigma_of_moving_ranges

CONFIDENCE = 0.95
MOVING_RANGE_SHARE = 0.62
"""Degrees of freedom of a mean moving range of two, as a share of a standard deviation's (Wheeler, Advanced Topics in SPC)."""


@dataclass(frozen=True, slots=True)
class Index:
    """An index, its one-sided 95 % lower bound (`bound`, what a verdict rests on) and its two-sided 95 % interval."""

    value: float
    bound: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Capability:
    """How the values lie within their limits. `cp` and `pp` are None where only one limit is stated."""

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


def indices(points: Floats, lower: float | None, upper: float | None) -> Capability:
    """The indices of individual values; plain arithmetic, without a look at whether they mean anything."""
    mean, n = float(points.mean()), len(points)
    within, overall = sigma_of_moving_ranges(points), float(points.std(ddof=1))
    freedoms = MOVING_RANGE_SHARE * (n - 1), float(n - 1)
    cp, pp = (_potential(lower, upper, sigma, freedom) for sigma, freedom in zip((within, overall), freedoms, strict=True))
    cpk, ppk = (_actual(mean, lower, upper, s, n, freedom) for s, freedom in zip((within, overall), freedoms, strict=True))
    return Capability(n, mean, within, overall, lower, upper, cp, cpk, pp, ppk)


def _potential(lower: float | None, upper: float | None, sigma: float, freedom: float) -> Index | None:
    """The tolerance in units of six sigma."""
    if lower is None or upper is None:
        return None
    value, tail = (upper - lower) / (6 * sigma), (1 - CONFIDENCE) / 2
    chi_squares = (2 * gammaincinv(freedom / 2, share) for share in (1 - CONFIDENCE, tail, 1 - tail))
    bound, low, high = (value * sqrt(chi_square / freedom) for chi_square in chi_squares)
    return Index(value, float(bound), float(low), float(high))


def _actual(mean: float, lower: float | None, upper: float | None, sigma: float, n: int, freedom: float) -> Index:
    """The way to the nearer limit in units of three sigma."""
    ways = [upper - mean] if upper is not None else []
    ways += [mean - lower] if lower is not None else []
    value = min(ways) / (3 * sigma)
    return actual_index(value, n, freedom)


def actual_index(value: float, n: int, freedom: float) -> Index:
    """A Cpk or Ppk of `n` values with its confidence (Bissell 1990; Montgomery, section 8.3.4)."""
    error = sqrt(1 / (9 * n) + value**2 / (2 * freedom))
    one, two = float(ndtri(CONFIDENCE)), float(ndtri((1 + CONFIDENCE) / 2))
    return Index(value, float(value - one * error), float(value - two * error), float(value + two * error))
