"""Control charts: points, centre line, limits and signals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from math import exp, lgamma, sqrt
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jbclog.analysis.spc import special
from jbclog.analysis.spc.distribution import Fit, Floats
from jbclog.analysis.spc.nelson import BEYOND_3, DEFAULT_TESTS, Signal, signals

GRID = 1000  # quantiles that represent a distribution
# range of the integrals below; beyond it a normal tail is below the precision of a float
FURTHEST_SIGMA, STEPS = 8.5, 1701
ROWS_AT_ONCE: Final = 64
LIMIT_ONLY = (1,)
"""Tests for charts whose neighbouring points are not independent: ranges that share a value,
weighted means.
"""
RUN_LENGTHS: Final = {"EWMA": 550.0, "CUSUM up": 465.0}
"""Average run length of a stable process, in points, with known limits and the default weight,
width, slack and decision.

CUSUM: on either side. By simulation, to three per cent; 465 is also in Montgomery, table 9.3.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """A control chart; `lower` and `upper` have a limit for each point.

    `sigma` is that of a plotted point, on an EWMA chart of the last one. `distribution` is that of
    the values: if it is not normal, the limits are its percentiles 0.135 and 99.865, the centre is
    its median, and the tests use the values' normal scores. `tests` are the applied tests.
    """

    name: str
    points: Floats
    centre: float
    sigma: float
    lower: Floats
    upper: Floats
    signals: tuple[Signal, ...]
    distribution: str = "normal"
    tests: tuple[int, ...] = LIMIT_ONLY


def individuals(
    values: ArrayLike,
    tests: tuple[int, ...] = DEFAULT_TESTS,
    *,
    fit: Fit | None = None,
    centre: float | None = None,
    sigma: float | None = None,
) -> Chart:
    """Return the individuals chart: sigma from the mean moving range of two (NIST 6.3.2.2), or the
    limits of another distribution.

    `centre` and `sigma` default to those of the values, and are ignored if `fit` is not normal.
    Raises `ValueError` for fewer than two values, or one that is not finite.
    """
    points = _floats(values)
    if fit is not None and fit.name != "normal":
        lower, middle, upper = (np.full(len(points), fit.at(score)) for score in (-3.0, 0.0, 3.0))
        spread = float(upper[0] - lower[0]) / 6
        found = signals(fit.scores(points), tests)
        return Chart(
            "individuals", points, float(middle[0]), spread, lower, upper, found, fit.name, tests
        )
    return _three_sigma("individuals", points, *_given_or_own(points, centre, sigma), tests)


def moving_ranges(values: ArrayLike, *, fit: Fit | None = None) -> Chart:
    """Return the chart of moving ranges of two. They overlap, so the limit is the only test.

    With `fit`, the limit is that of differences of the fitted distribution. Raises `ValueError` for
    fewer than two values, or one that is not finite.
    """
    spans = np.abs(np.diff(_floats(values)))
    if fit is None or fit.name == "normal":
        return _of_ranges("moving ranges", spans, 2)
    grid = fit.family.quantiles(fit.fitted, special.ndtri((np.arange(GRID) + 0.5) / GRID))
    upper = float(np.quantile(np.abs(grid[:, np.newaxis] - grid), 1 - BEYOND_3))
    centre = float(spans.mean())
    lower, top = np.zeros(len(spans)), np.full(len(spans), max(upper, centre))
    chart = _chart("moving ranges", spans, centre, (top[0] - centre) / 3, lower, top, LIMIT_ONLY)
    return replace(chart, distribution=fit.name)


def fixed(
    values: ArrayLike,
    centre: float,
    lower: float,
    upper: float,
    tests: tuple[int, ...] = DEFAULT_TESTS,
) -> Chart:
    """Chart individual values against limits of a phase I study.

    If the limits are not symmetric, the tests measure distances in thirds of the distance to the
    limit on their side. Raises `ValueError` for NaN, and for a centre that is not between the
    limits.
    """
    points = np.asarray(values, dtype=np.float64)
    if points.ndim != 1 or not np.isfinite(points).all():
        raise ValueError("a chart needs a row of finite values")
    if not lower < centre < upper:
        raise ValueError(
            f"the centre must be between the limits {lower:g} and {upper:g} (got {centre:g})"
        )
    edges = np.full(len(points), lower), np.full(len(points), upper)
    return _chart("individuals", points, centre, (upper - lower) / 6, *edges, tests)


def means(subgroups: ArrayLike, tests: tuple[int, ...] = DEFAULT_TESTS) -> Chart:
    """Return the chart of means of subgroups (a row each), with sigma from the mean range within
    them (NIST 6.3.2.1).

    Raises `ValueError` for rows of fewer than two values, or one that is not finite.
    """
    rows = _rows(subgroups)
    sigma = sigma_of_ranges(rows) / sqrt(rows.shape[1])
    return _three_sigma("subgroup means", rows.mean(axis=1), float(rows.mean()), sigma, tests)


def ranges(subgroups: ArrayLike) -> Chart:
    """Return the chart of ranges within subgroups (a row each).

    Raises `ValueError` for rows of fewer than two values, or one that is not finite.
    """
    rows = _rows(subgroups)
    return _of_ranges("subgroup ranges", np.ptp(rows, axis=1), rows.shape[1])


def means_by_sd(subgroups: ArrayLike, tests: tuple[int, ...] = DEFAULT_TESTS) -> Chart:
    """Return the chart of means of subgroups (a row each), with sigma from the mean standard
    deviation within them (X-bar of X-bar and S).

    Raises `ValueError` for rows of fewer than two values, or one that is not finite.
    """
    rows = _rows(subgroups)
    size = rows.shape[1]
    sigma = float(rows.std(axis=1, ddof=1).mean()) / c4(size) / sqrt(size)
    return _three_sigma("subgroup means", rows.mean(axis=1), float(rows.mean()), sigma, tests)


def sds(subgroups: ArrayLike) -> Chart:
    """Return the chart of standard deviations within subgroups (a row each): S of X-bar and S
    (Montgomery, section 6.3).

    Raises `ValueError` for rows of fewer than two values, or one that is not finite.
    """
    rows = _rows(subgroups)
    points, known = rows.std(axis=1, ddof=1), c4(rows.shape[1])
    centre = float(points.mean())
    sigma = centre * sqrt(1 - known**2) / known
    limits = _from_zero(len(points), centre, sigma)
    return _chart("subgroup standard deviations", points, centre, sigma, *limits, LIMIT_ONLY)


def ewma(
    values: ArrayLike,
    weight: float = 0.2,
    width: float = 3.0,
    centre: float | None = None,
    sigma: float | None = None,
) -> Chart:
    """Return the chart of exponentially weighted moving averages (NIST 6.3.2.4), with limits for
    each point from its own variance.

    `centre` and `sigma` (of a single value) default to those of the values. Raises `ValueError` for
    a weight outside 0 < `weight` ≤ 1, and as `individuals`.
    """
    points = _floats(values)
    if not 0 < weight <= 1:
        raise ValueError(
            f"the weight of an EWMA chart must be above 0 and at most 1 (got {weight:g})"
        )
    middle, spread = _given_or_own(points, centre, sigma)
    averages, last = np.empty_like(points), middle
    for place, value in enumerate(points):
        last = averages[place] = weight * value + (1 - weight) * last
    share = weight / (2 - weight) * (1 - (1 - weight) ** (2 * np.arange(1, len(points) + 1)))
    reach = width * spread * np.sqrt(share)
    return _chart(
        "EWMA",
        averages,
        middle,
        spread * sqrt(share[-1]),
        middle - reach,
        middle + reach,
        LIMIT_ONLY,
    )


def cusum(
    values: ArrayLike,
    slack: float = 0.5,
    decision: float = 5.0,
    centre: float | None = None,
    sigma: float | None = None,
) -> tuple[Chart, Chart]:
    """Return the charts of cumulative sums above and below the centre, in sigma (NIST 6.3.2.3;
    Montgomery, section 9.1).

    `slack` (k) and `decision` (h) are in sigma; 0.5 and 5 detect a shift of one sigma, and signal
    once in 465 stable points on average. The lower sums are negative. Raises `ValueError` if sigma
    is not above 0.
    """
    points = _floats(values)
    middle, spread = _given_or_own(points, centre, sigma)
    if not spread > 0:
        raise ValueError(f"sigma of a CUSUM chart must be above 0 (got {spread:g})")
    zones = (points - middle) / spread
    return _sums("CUSUM up", zones, slack, decision), _sums(
        "CUSUM down", -zones, slack, decision, sign=-1
    )


def shares(counts: ArrayLike, sizes: ArrayLike) -> Chart:
    """Return the p chart: `counts` as shares of `sizes`, with limits for each size (Montgomery,
    section 7.2).

    Raises `ValueError` for a count below 0 or above its size, and for a size that is not above 0.
    """
    found, of = _counts(counts, sizes)
    if (found > of).any():
        raise ValueError("each count must be at most its size")
    mean = float(found.sum() / of.sum())
    return _counted("p", found / of, mean, np.sqrt(mean * (1 - mean) / of), most=1.0)


def rates(counts: ArrayLike, sizes: ArrayLike) -> Chart:
    """Return the u chart: `counts` per unit of `sizes`, such as hours or units, with limits for
    each size (Montgomery, section 7.3).

    Raises `ValueError` for a count below 0, and for a size that is not above 0.
    """
    found, of = _counts(counts, sizes)
    mean = float(found.sum() / of.sum())
    return _counted("u", found / of, mean, np.sqrt(mean / of), most=np.inf)


def sigma_of_moving_ranges(points: Floats) -> float:
    """Return sigma of single values from the mean moving range of two."""
    return float(np.abs(np.diff(points)).mean()) / d2(2)


def sigma_of_ranges(rows: Floats) -> float:
    """Return sigma of single values from the mean range within subgroups."""
    return float(np.ptp(rows, axis=1).mean()) / d2(rows.shape[1])


def _given_or_own(points: Floats, centre: float | None, sigma: float | None) -> tuple[float, float]:
    """Return the given centre and sigma, or those of the values."""
    return (
        float(points.mean()) if centre is None else centre,
        sigma_of_moving_ranges(points) if sigma is None else sigma,
    )


def _three_sigma(
    name: str, points: Floats, centre: float, sigma: float, tests: tuple[int, ...]
) -> Chart:
    limit = np.full(len(points), 3 * sigma)
    return _chart(name, points, centre, sigma, centre - limit, centre + limit, tests)


def _sums(name: str, zones: Floats, slack: float, decision: float, sign: int = 1) -> Chart:
    sums, last = np.empty_like(zones), 0.0
    for place, zone in enumerate(zones):
        last = sums[place] = max(0.0, last + zone - slack)
    edges = np.zeros(len(zones)), np.full(len(zones), decision)
    lower, upper = edges if sign > 0 else (-edges[1], edges[0])
    return Chart(name, sign * sums, 0.0, 1.0, lower, upper, _beyond(sums > decision))


def _counted(name: str, points: Floats, mean: float, sigma: Floats, most: float) -> Chart:
    lower, upper = np.maximum(mean - 3 * sigma, 0.0), np.minimum(mean + 3 * sigma, most)
    found = _beyond((points > upper) | (points < lower))
    return Chart(name, points, mean, float(sigma[-1]), lower, upper, found)


def _beyond(outside: NDArray[np.bool_]) -> tuple[Signal, ...]:
    return tuple(Signal(1, int(place), int(place)) for place in np.flatnonzero(outside))


def _counts(counts: ArrayLike, sizes: ArrayLike) -> tuple[Floats, Floats]:
    found = _floats(counts)
    of = np.broadcast_to(np.asarray(sizes, dtype=np.float64), found.shape)
    if not (np.isfinite(of).all() and (of > 0).all() and (found >= 0).all()):
        raise ValueError("counts must be at least 0 and sizes above 0")
    return found, np.asarray(of)


def _of_ranges(name: str, spans: Floats, size: int) -> Chart:
    centre = float(spans.mean())
    sigma = d3(size) / d2(size) * centre
    return _chart(name, spans, centre, sigma, *_from_zero(len(spans), centre, sigma), LIMIT_ONLY)


def _from_zero(points: int, centre: float, sigma: float) -> tuple[Floats, Floats]:
    """Return three-sigma limits of a measure of spread for each point, the lower one not below
    zero.
    """
    return np.full(points, max(centre - 3 * sigma, 0.0)), np.full(points, centre + 3 * sigma)


def _chart(
    name: str,
    points: Floats,
    centre: float,
    sigma: float,
    lower: Floats,
    upper: Floats,
    tests: tuple[int, ...],
) -> Chart:
    """Return a chart; distances are in thirds of the distance to the limit on their side, which is
    sigma for symmetric limits.
    """
    distances = points - centre
    third = np.where(distances >= 0, upper - centre, centre - lower) / 3
    if not distances.any():
        # all values are equal: no signals
        return Chart(name, points, centre, sigma, lower, upper, (), tests=tests)
    zones = np.divide(
        distances,
        third,
        out=np.where(distances == 0, 0.0, np.copysign(np.inf, distances)),
        where=third > 0,
    )
    return Chart(name, points, centre, sigma, lower, upper, signals(zones, tests), tests=tests)


def _floats(values: ArrayLike) -> Floats:
    points = np.asarray(values, dtype=np.float64)
    if points.ndim != 1 or len(points) < 2:
        raise ValueError(f"a chart needs a row of at least two values (got shape {points.shape})")
    if not np.isfinite(points).all():
        raise ValueError("a chart needs finite values; leave out the others")
    return points


def _rows(subgroups: ArrayLike) -> Floats:
    rows = np.asarray(subgroups, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] < 2 or not rows.shape[0]:
        raise ValueError(f"subgroups must be rows of at least two values (got shape {rows.shape})")
    if not np.isfinite(rows).all():
        raise ValueError("a chart needs finite values; leave out the others")
    return rows


@cache
def c4(n: int) -> float:
    """Return the mean of the standard deviation of `n` normal values, in units of sigma
    (Montgomery, appendix VI).
    """
    return sqrt(2 / (n - 1)) * exp(lgamma(n / 2) - lgamma((n - 1) / 2))


@cache
def d2(n: int) -> float:
    """Return the mean range of `n` normal values, in units of sigma: the integral of 1 - F**n - (1
    - F)**n.
    """
    x = np.linspace(-FURTHEST_SIGMA, FURTHEST_SIGMA, STEPS)
    below = special.ndtr(x)
    return float(np.trapezoid(1 - below**n - (1 - below) ** n, x))


@cache
def d3(n: int) -> float:
    """Return the standard deviation of the range of `n` normal values, in units of sigma."""
    x = np.linspace(-FURTHEST_SIGMA, FURTHEST_SIGMA, STEPS)
    below = special.ndtr(x)
    square = 2 * float(np.trapezoid(np.concatenate([*_inner_of_d3(n, x, below)]), x))
    return sqrt(square - d2(n) ** 2)


def _inner_of_d3(n: int, x: Floats, below: Floats) -> Iterator[Floats]:
    """Yield the inner integrals, a few rows at once: together they take 100 MB."""
    high = below[np.newaxis, :]
    for first in range(0, len(x), ROWS_AT_ONCE):
        low = below[first : first + ROWS_AT_ONCE, np.newaxis]
        inner = np.triu(1 - high**n - (1 - low) ** n + (high - low).clip(0) ** n, first)
        # the edge of the triangle in which the greatest value lies above the least
        rows = np.arange(len(low))
        inner[rows, first + rows] /= 2
        yield np.trapezoid(inner, x, axis=1)
