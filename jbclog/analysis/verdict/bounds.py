"""How well a mean, a deviation and a quantile are known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import groupby
from math import erfc, exp, lgamma, log, sqrt
from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.typing import NDArray

# -- censored -----------------------------------------------------------------------------------------------------------------
# The quantile of times of which some are only known to be longer: the product-limit estimate.
#
# E. L. Kaplan and P. Meier, Nonparametric Estimation from Incomplete Observations, Journal of the American Statistical Association
# 53 (1958). Without censoring it is the least value that at least this share of all values does not exceed.


def censored_quantile(times: Sequence[tuple[float | None, bool]], share: float) -> float | None:
    """`times`: a time in s, and whether it ended then or went on for longer. None where less than `share` is seen to end."""
    ordered = sorted((time, not ended) for time, ended in times if time is not None)
    left, surviving = len(ordered), 1.0
    for time, some in groupby(ordered, key=lambda one: one[0]):
        there = list(some)
        surviving *= 1 - sum(not goes_on for _, goes_on in there) / left
        left -= len(there)
        if surviving <= 1 - share + 1e-12:
            return float(time)
    return None


# -- bound --------------------------------------------------------------------------------------------------------------------
# How well a mean and a standard deviation are known: 95 % bounds corrected for autocorrelation.
#
# A tip's readings follow each other: ten thousand of them are worth far fewer independent ones, and where the tip drifts slowly
# nobody knows beforehand how many. Batch means cannot tell: once the drift outlasts a batch, the batches are alike, too. So the
# uncertainty is taken from the lowest frequencies of the readings themselves, and how these frequencies hang together is left open:
#
# - The readings, in their order and without what lies between them, are projected on the first `COSINES` cosines of the record's
#   length. Each projection has nearly its own variance, the spectrum at that frequency (U. K. Müller and M. W. Watson,
#   Low-Frequency Econometrics, in Advances in Economics and Econometrics: Eleventh World Congress (2017)). The variance of the mean
#   is the spectrum at frequency zero.
# - The spectrum is that of a first-order autoregressive course whose correlation time is `TIMES` of the record, with none or some
#   white noise (`WHITE`) on top; the variances are exact for the record's length. Which of these it is, is not decided: each is
#   weighted by how well it explains the projections (`WHITE_WEIGHT` for those with noise, a flat prior otherwise, that of the
#   unknown scale integrated out). Each gives Student's t with as many degrees of freedom as there are cosines, and the bound is the
#   quantile of their mixture. A record that is short for its drift so gets a wide bound, and not one that is too narrow.
# - The standard deviation's upper bound, one-sided, is the quantile of the same mixture over chi-squared: the variance that was
#   seen, with what a record of this length hides of a slow course, on the degrees of freedom that such a course leaves. Faster
#   variation is worth what the course of the squares says by its own lowest frequencies.
#
# `COSINES`, `TIMES`, `WHITE` and `WHITE_WEIGHT` were chosen by simulation so that the bounds hold where it is hardest, at
# correlation times up to two thirds of the record; how often they hold is tried by `tests/unit/analysis/verdict/test_coverage.py`.
#
# Less than `LEAST_S` of readings, or fewer than `LEAST_CELLS` cells of them, give no bound.
#
# Readings come in whole °C. A tip that stands still stays anywhere within half a step; the more it moves, the better the steps
# average out. For a spread s below half a step the mean may be off by √(¼ − s²) steps, which is exact for a tip at the edge of a
# step, and that is added to its bound; the spread is never known to be below what steps can show (`STEP_C` / √12).

CELL_S, MOST_CELLS = 0.5, 2048
COSINES: Final = 12
TIMES: Final = np.geomspace(1 / 600, 3.0, 22)
WHITE: Final = np.array([0.0, 0.05, 0.2, 0.6, 2.0])  # spectrum of the noise as a share of the other's at frequency zero
WHITE_WEIGHT: Final = 0.1
LEAST_S, LEAST_CELLS = 30.0, 15
SURE: Final = 0.95
STEP_C = 1.0
FLOOR_C = STEP_C / sqrt(12)
TWO_SIDED: Final = NormalDist().inv_cdf((1 + SURE) / 2)
NEARLY_NOTHING: Final = 1e-12  # °C²: readings that are all the same
HALVINGS: Final = 45

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Bound:
    """The 95 % bound of a figure, in its unit: two-sided, or an upper one alone (`low` is None).

    `n` readings are worth `n_effective` independent ones.
    """

    low: float | None
    high: float
    n: int
    n_effective: float

    def keeps(self, limit: float) -> bool:
        """Whether all of it is within `limit`, either way."""
        return max(abs(self.high), abs(self.low or 0.0)) <= limit


@dataclass(slots=True)
class Cells:
    """Number, sum and sum of squares of the readings in each stretch of time; the stretches double when there are too many."""

    width_s: float = CELL_S
    held: dict[int, tuple[int, float, float]] = field(default_factory=dict)

    def add(self, seconds: Floats, values: Floats) -> None:
        """Take readings with their times on the run's axis."""
        places, first = np.unique(np.floor_divide(seconds, self.width_s).astype(np.int64), return_inverse=True)
        sums = np.bincount(first), np.bincount(first, values), np.bincount(first, np.square(values))
        for place, count, total, squares in zip(places.tolist(), *(one.tolist() for one in sums), strict=True):
            self._put(place, count, total, squares)
        while len(self.held) > MOST_CELLS:
            self._double()

    def _put(self, place: int, count: int, total: float, squares: float) -> None:
        before = self.held.get(place)
        self.held[place] = (
            (count, total, squares) if before is None else (before[0] + count, before[1] + total, before[2] + squares)
        )

    def _double(self) -> None:
        held, self.held = self.held, {}
        self.width_s *= 2
        for place, sums in held.items():
            self._put(place // 2, *sums)

    def in_order(self) -> tuple[Floats, Floats, Floats]:
        """Counts, sums and sums of squares of the cells that have readings."""
        sums = np.array([self.held[place] for place in sorted(self.held)], dtype=np.float64).reshape(-1, 3)
        return sums[:, 0], sums[:, 1], sums[:, 2]


@dataclass(frozen=True, slots=True)
class Known:
    """The bounds of one tip's mean and standard deviation. `half(level)`: half of the mean's two-sided interval of that level."""

    mean: Bound
    sd: Bound
    half: Callable[[float], float]


@dataclass(frozen=True, slots=True)
class _Courses:
    """All courses that are thought of, a row each: what they are at each cosine and at frequency zero for a variance of 1.

    `freedom` is what their variance is worth in independent readings; `prior` the logarithm of their weight.
    """

    spectrum: Floats
    at_zero: Floats
    slow_at_zero: Floats  # without the noise
    freedom: Floats
    prior: Floats


def known(cells: Cells, seconds: float, mean: float, sd: float) -> Known | str:
    """The bounds of readings that cover `seconds` and have this mean and standard deviation, or a sentence why there are none."""
    counts, sums, squares = cells.in_order()
    if seconds < LEAST_S or len(counts) < LEAST_CELLS:
        return f"A 95 % bound takes {LEAST_S:g} s of the tip at rest, and {LEAST_CELLS} readings; there are {seconds:.1f} s."
    n, cosines = int(counts.sum()), _cosines(counts)
    there = _projected(sums - counts * mean, cosines, n)
    courses = _courses(len(there))
    fit = np.square(there) @ (1 / courses.spectrum).T + NEARLY_NOTHING
    weights = _weights(courses, fit, len(there))
    scales = np.sqrt(courses.at_zero * fit / len(there))
    steps = STEP_C * sqrt(max(0.25 - (sd / STEP_C) ** 2, 0.0))

    def half(level: float) -> float:
        return steps + _half(weights, scales, len(there), level)

    apart = squares - 2 * mean * sums + counts * mean**2
    of_squares = _projected(apart - counts * apart.sum() / n, cosines, n)
    high, freedom = _spread(courses, weights, fit / len(there), sd * sd, n, float(np.square(of_squares).mean()))
    error, still = half(SURE), max(sd, NEARLY_NOTHING)
    worth = min(float(n), (TWO_SIDED * still / error) ** 2) if sd > FLOOR_C else float(n)
    return Known(Bound(mean - error, mean + error, n, worth), Bound(None, max(high, FLOOR_C), n, freedom + 1), half)


def _cosines(counts: Floats) -> Floats:
    """The first cosines over the readings in their order, at each cell."""
    at = (np.cumsum(counts) - counts / 2) / counts.sum()
    return np.asarray(sqrt(2) * np.cos(np.pi * np.outer(at, np.arange(1, min(COSINES, len(counts) // 2) + 1))))


def _projected(sums: Floats, cosines: Floats, n: int) -> Floats:
    return np.asarray(sums @ cosines / n, dtype=np.float64)


@lru_cache(maxsize=COSINES)
def _courses(cosines: int) -> _Courses:
    """The autoregressive courses, exact for their projections on cosines; each without and with noise."""
    rate = 1 / TIMES[:, None]
    numbers = np.arange(1, 2001)[None]
    waves, sign = np.pi * numbers, 1.0 - 2.0 * (numbers % 2)
    slow = 2 * rate / (rate**2 + waves**2) - 4 * rate**2 * (1 - sign * np.exp(-rate)) / (rate**2 + waves**2) ** 2
    zero = 2 / rate - 2 * (1 - np.exp(-rate)) / rate**2
    freedom = (slow.sum(1) ** 2 / np.square(slow).sum(1)).repeat(len(WHITE))
    spectrum = (slow[:, None, :cosines] + WHITE[None, :, None] * zero[:, :, None]).reshape(-1, cosines)
    prior = np.tile(np.log(np.where(WHITE == 0, 1.0, WHITE_WEIGHT)), len(TIMES))
    return _Courses(spectrum, (zero * (1 + WHITE[None])).reshape(-1), zero[:, 0].repeat(len(WHITE)), freedom, prior)


def _weights(courses: _Courses, fit: Floats, cosines: int) -> Floats:
    """How much each course is to be believed; its scale is integrated out with the prior 1/scale."""
    told = courses.prior - np.log(courses.spectrum).sum(1) / 2 - cosines / 2 * np.log(fit)
    weights = np.exp(told - told.max())
    return np.asarray(weights / weights.sum(), dtype=np.float64)


def _half(weights: Floats, scales: Floats, freedom: int, level: float) -> float:
    """The mean is farther off than this with a probability of 1 - `level`: the quantile of a mixture of Student's t."""

    def beyond(half: float) -> float:
        return float(weights @ _beyond_t(half / scales, freedom))

    return _where(lambda half: beyond(half) > 1 - level, float(scales.max()) * 100)


def _beyond_t(t: Floats, freedom: int) -> Floats:
    """How often Student's t is farther from 0, either way; D. L. Wallace (1959), good to 0.0005 from 5 degrees of freedom on."""
    z = (8 * freedom + 1) / (8 * freedom + 3) * np.sqrt(freedom * np.log1p(t * t / freedom))
    return np.array([erfc(one / sqrt(2)) for one in z])


def _below_chi_squared(value: Floats, freedom: Floats) -> Floats:
    """How often chi-squared is less; E. B. Wilson and M. M. Hilferty (1931)."""
    share = 2 / (9 * freedom)
    z = (np.cbrt(value / freedom) - (1 - share)) / np.sqrt(share)
    return np.array([erfc(-one / sqrt(2)) / 2 for one in z])


def _spread(courses: _Courses, weights: Floats, scale: Floats, variance: float, n: int, squares_vary: float) -> tuple[float, float]:
    """The upper bound of the standard deviation, and the degrees of freedom of the variance.

    `scale` is the variance of each course by its fit; `squares_vary` the variance of a projection of the squares.
    """
    variance, shown = max(variance, NEARLY_NOTHING), 1 - courses.slow_at_zero
    slow = np.minimum(scale, variance / shown)  # it cannot have shown more than there was
    of_squares = min(max(2 * variance**2 / max(squares_vary, NEARLY_NOTHING**2), 2.0), n - 1.0)
    share = slow * shown / variance
    freedom = 1 / (share**2 / np.minimum(courses.freedom, n - 1) + (1 - share) ** 2 / of_squares)
    freedom = np.minimum(freedom, of_squares)
    whole = variance + courses.slow_at_zero * slow

    def beyond(sd: float) -> float:
        return float(weights @ _below_chi_squared(freedom * whole / sd**2, freedom))

    return _where(lambda sd: beyond(sd) > 1 - SURE, 1000 * sqrt(float(whole.max()))), float(weights @ freedom)


def _where(is_below: Callable[[float], bool], high: float) -> float:
    """Where it ends to be so, between 0 and `high`."""
    low = 0.0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if is_below(middle) else (low, middle)
    return high


# -- quantile -----------------------------------------------------------------------------------------------------------------
# How well a 95 % quantile is known: its upper 95 % bound, whatever the distribution is.
#
# Of n independent values in their order the one with m above it is at least the 95 % quantile with a probability of
# 1 - B(m; n, 0.05), B being the cumulative binomial distribution; m is the greatest for which that is 95 % (S. S. Wilks,
# Determination of Sample Sizes for Setting Tolerance Limits, Annals of Mathematical Statistics 12 (1941)). It takes `LEAST` values,
# of which then the greatest is the bound; 93 for the second, 124 for the third.
#
# Where neighbours are alike, n values are worth fewer: with a correlation r of each value with the next that is beyond chance
# (one-sided 5 %), n (1 - r) / (1 + r) of them, and m is taken in proportion. A value that is not known counts as greater than any
# that is, so that what was too long to be seen cannot make the bound look better.

SHARE, QUANTILE_SURE = 0.95, 0.95
LEAST: Final = 59
CHANCE: Final = NormalDist().inv_cdf(0.95)


def p95(values: Sequence[float]) -> float:
    """The 95 % quantile, between two values in proportion."""
    return round(float(np.percentile(values, 100 * SHARE)), 6)


def upper_p95(values: Sequence[float | None]) -> Bound | str:
    """The upper 95 % bound of the 95 % quantile, or a sentence why there is none. None: a value that is not known."""
    known = np.array([value for value in values if value is not None], dtype=np.float64)
    effective = worth(known) * len(values) / max(len(known), 1)
    if effective < LEAST:
        worth_of = f", worth {effective:.0f} that are independent" if len(values) >= LEAST else ""
        return f"A 95 % bound takes {LEAST} joints; there are {len(values)}{worth_of}."
    above = int(len(values) * most_above(effective) / effective)
    unknown = len(values) - len(known)
    if unknown > above:
        return f"The recovery of {unknown} of them is not known and may be longer; a 95 % bound allows {above}."
    highest = float(np.sort(known)[len(known) - 1 - (above - unknown)])
    return Bound(None, highest, len(values), effective)


def most_above(n: float) -> int:
    """How many of n values may lie above the one that is the bound; -1 where none can be."""
    total, above = 0.0, -1
    while total <= 1 - QUANTILE_SURE and above < n:
        above += 1
        total += exp(_log_binomial(n, above) + above * log(1 - SHARE) + (n - above) * log(SHARE))
    return above - 1


def _log_binomial(n: float, k: int) -> float:
    return lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)


def worth(values: Floats) -> float:
    """How many independent values these are worth, by the correlation of each with the next."""
    n = len(values)
    apart = values - values.mean() if n else values
    squares = float((apart * apart).sum())
    if n < 3 or not squares:
        return float(n)
    r = float((apart[1:] * apart[:-1]).sum()) / squares
    return n * (1 - r) / (1 + r) if r > CHANCE / sqrt(n) else float(n)


# -- batch means --------------------------------------------------------------------------------------------------------------
# The bounds of rules 1 and 2, by batch means: runs that were judged by them are judged so again.
#
# The mean's uncertainty is taken from *batch means* (B. Schmeiser, Batch Size Effects in the Analysis of Simulation Output,
# Operations Research 30 (1982)): the readings, in their order, are parted into `BATCHES` batches of about as many readings each, of
# `LEAST_BATCH_S` at least, and the spread of the batches' means, with Student's t, gives the mean's two-sided bound. The standard
# deviation's upper bound is that of chi-squared with n effective − 1 degrees of freedom, one-sided. Fewer than `LEAST_BATCHES`
# batches give no bound. It does not hold where the tip drifts more slowly than a batch is long, which is why rules 3 have another
# (`bound`).

BATCHES, LEAST_BATCHES, LEAST_BATCH_S = 20, 8, 3.0
MEANS_CELL_S: Final = 1.0
MEANS_TWO_SIDED, ONE_SIDED = NormalDist().inv_cdf(0.975), NormalDist().inv_cdf(0.95)


def batch_means(cells: Cells, period_s: float) -> Floats:
    """The means of the batches, in their order; empty where the readings are too few for `LEAST_BATCHES`."""
    counts, sums, _ = cells.in_order()
    batches = min(BATCHES, int(counts.sum() * period_s / LEAST_BATCH_S))
    if batches < LEAST_BATCHES:
        return np.empty(0)
    reached = np.cumsum(counts) - counts / 2
    number = np.minimum((reached * batches / counts.sum()).astype(np.int64), batches - 1)
    _, number = np.unique(number, return_inverse=True)  # a long cell can leave a batch empty
    return np.asarray(np.bincount(number, sums) / np.bincount(number, counts), dtype=np.float64)


def known_by_batches(n: int, mean: float, sd: float, means: Floats) -> tuple[Bound, Bound] | None:
    """The bounds of the mean and the standard deviation of `n` readings, from their batches' means; None: too few batches."""
    if len(means) < LEAST_BATCHES:
        return None
    freedom = len(means) - 1
    error = float(means.std(ddof=1)) / sqrt(len(means))
    effective = min(float(n), sd * sd / (error * error)) if error else float(n)
    still = sd < FLOOR_C
    half = max(students_t(freedom) * error, STEP_C / 2 if still else 0.0)
    spread = max(sd * sqrt((effective - 1) / chi_squared(effective - 1)), FLOOR_C if still else 0.0)
    return Bound(mean - half, mean + half, n, effective), Bound(None, spread, n, effective)


def students_t(freedom: int) -> float:
    """Student's t for 97.5 %; R. A. Fisher's expansion, good to 0.001 from 7 degrees of freedom on."""
    z, v = MEANS_TWO_SIDED, freedom
    first, second = (z**3 + z) / 4, (5 * z**5 + 16 * z**3 + 3 * z) / 96
    return z + first / v + second / v**2 + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384 / v**3


def chi_squared(freedom: float) -> float:
    """Chi-squared for 5 %; Wilson and Hilferty (1931), good to 1.2 % from 6 degrees of freedom on."""
    share = 2 / (9 * freedom)
    return float(freedom * (1 - share - ONE_SIDED * sqrt(share)) ** 3)
