"""The distribution that a feature follows: normal, lognormal, Weibull, Box-Cox, lognormal with a
threshold, or none.

Each family is a monotone map from values to normal scores, so that stability is tested, and limits
are set, on a scale on which the values are normal. Of the families that the Anderson-Darling test
accepts (p at least `ACCEPTED`), the most likely is taken (BIC): normal unless another is clearly
more likely, and one of three parameters only if none of two fits. A family is also accepted if it
fits all values but a few far beyond it: these count as outliers, not as the shape of another
family.

Sources: ISO 22514-2 (performance by distribution); M. A. Stephens, in D'Agostino and Stephens,
Goodness-of-Fit Techniques (1986), for both tests; Box and Cox, J. R. Statist. Soc. B 26 (1964); the
threshold at which the logarithms have no skewness: P. Royston, J. R. Statist. Soc. C 41 (1992).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.spc import special

Floats = NDArray[np.float64]

ACCEPTED: Final = 0.05
# p-value of such an outlier among all values, under the family that fits the others
FAR_OUT: Final = 0.001
OUTLIERS: Final = 0.02  # largest share of the values, or one value
MOST_OUTLIERS: Final = 50  # largest number: more are a tail, not outliers
# tolerance of the score by the tightest fit: a fit with fewer values left out may have another
# shape
SLACK: Final = 2.0
# A² of the tightest fit above which no fit with fewer values left out is tried. A is a distance
# between values and distribution, at most 0.87 for an accepted family; the values put back (at most
# 2 %, and 50) change it by less than 4.
HOPELESS: Final = 40.0
REACH: Final = 3.0  # standard scores of the percentiles 0.135 and 99.865
# difference of BIC by which another family must be better (Raftery 1995: positive evidence)
NORMAL_FIRST: Final = 2.0
LOG_ROOT: Final = -0.5 * float(np.log(2 * np.pi))


class Family(ABC):
    """A distribution with `free` parameters: arrays with one row for each sample, or plain numbers
    for one sample.
    """

    name: str
    free: int
    needs_positive = True

    @abstractmethod
    def fit(self, rows: Floats) -> tuple[Floats, ...]:
        """Return the parameters of each row of values, shaped for arithmetic with the rows."""

    @abstractmethod
    def scores(self, fitted: tuple[Floats, ...], values: Floats) -> Floats:
        """Return the standard normal scores of values; infinite beyond the distribution's edge."""

    @abstractmethod
    def quantiles(self, fitted: tuple[Floats, ...], scores: Floats) -> Floats:
        """Return the values at standard normal scores; NaN or infinite where there is none."""

    def chance(self, fitted: tuple[Floats, ...], values: Floats) -> float:
        """Return the p-value of values as far from this family (Anderson-Darling, estimated
        parameters).
        """
        return chance_of_normal(self.distance(fitted, values))

    def distance(self, fitted: tuple[Floats, ...], values: Floats) -> float:
        """Return A² of the values, adjusted for their number."""
        return _distance_from_normal(self.scores(fitted, values))


class Normal(Family):
    name, free, needs_positive = "normal", 2, False

    def fit(self, rows: Floats) -> tuple[Floats, ...]:
        return rows.mean(axis=-1, keepdims=True), rows.std(axis=-1, ddof=1, keepdims=True)

    def scores(self, fitted: tuple[Floats, ...], values: Floats) -> Floats:
        return np.asarray((values - fitted[0]) / fitted[1])

    def quantiles(self, fitted: tuple[Floats, ...], scores: Floats) -> Floats:
        return np.asarray(fitted[0] + fitted[1] * scores)


class Lognormal(Normal):
    name, free, needs_positive = "lognormal", 2, True

    def fit(self, rows: Floats) -> tuple[Floats, ...]:
        return super().fit(np.log(rows))

    def scores(self, fitted: tuple[Floats, ...], values: Floats) -> Floats:
        return super().scores(fitted, _log(values))

    def quantiles(self, fitted: tuple[Floats, ...], scores: Floats) -> Floats:
        return np.exp(super().quantiles(fitted, scores))


class Weibull(Family):
    """A Weibull distribution, shape and scale by maximum likelihood."""

    name, free = "Weibull", 2

    def fit(self, rows: Floats) -> tuple[Floats, ...]:
        logs = np.log(rows)
        middle, top = logs.mean(axis=-1, keepdims=True), logs.max(axis=-1, keepdims=True)
        shape = np.pi / sqrt(6) / np.maximum(logs.std(axis=-1, keepdims=True), 1e-9)
        for _ in range(25):  # Newton; from the estimate by moments it takes fewer than ten steps
            weight = np.exp(shape * (logs - top))
            total = weight.sum(axis=-1, keepdims=True)
            first = (weight * logs).sum(axis=-1, keepdims=True) / total
            second = (weight * logs**2).sum(axis=-1, keepdims=True) / total
            step = (1 / shape + middle - first) / (1 / shape**2 + second - first**2)
            shape = np.maximum(shape + step, shape / 2)
        scale = top + np.log(np.exp(shape * (logs - top)).mean(axis=-1, keepdims=True)) / shape
        return shape, np.exp(scale)

    def scores(self, fitted: tuple[Floats, ...], values: Floats) -> Floats:
        hazard = self._hazard(fitted, values)
        with np.errstate(divide="ignore"):
            below = np.log(-np.expm1(-hazard))
        return np.where(
            hazard > 0.7, -special.ndtri_exp(-np.maximum(hazard, 1e-300)), special.ndtri_exp(below)
        )

    def quantiles(self, fitted: tuple[Floats, ...], scores: Floats) -> Floats:
        shape, scale = fitted
        return np.asarray(scale * (-special.log_ndtr(-np.asarray(scores))) ** (1 / shape))

    def chance(self, fitted: tuple[Floats, ...], values: Floats) -> float:
        squared = self.distance(fitted, values)
        return float(special.expit(0.1 - 1.24 * np.log(squared) - 4.48 * squared))

    def distance(self, fitted: tuple[Floats, ...], values: Floats) -> float:
        ordered = np.sort(self._hazard(fitted, values))
        n = len(ordered)
        with np.errstate(divide="ignore"):
            below = np.log(-np.expm1(-ordered))
        return _anderson_darling(below, -ordered[::-1], n) * (1 + 0.2 / sqrt(n))

    @staticmethod
    def _hazard(fitted: tuple[Floats, ...], values: Floats) -> Floats:
        shape, scale = fitted
        return np.asarray((np.maximum(values, 0.0) / scale) ** shape)


class BoxCox(Normal):
    """Normal after the power transform that makes the values most likely; percentiles beyond the
    edge of the power do not exist.
    """

    name, free, needs_positive = "Box-Cox", 3, True
    POWERS: Final = (-3.0, 5.0)

    def fit(self, rows: Floats) -> tuple[Floats, ...]:
        shape = (*rows.shape[:-1], 1)
        middle = np.exp(np.log(rows).mean(axis=-1, keepdims=True))
        even = rows / middle  # a power of values near 1 neither overflows nor vanishes
        low, high = (np.full(shape, edge) for edge in self.POWERS)
        for _ in range(30):  # golden section: the likelihood has one peak
            one, two = high - 0.618034 * (high - low), low + 0.618034 * (high - low)
            is_left = _spread_of_power(even, one) < _spread_of_power(even, two)
            low, high = np.where(is_left, low, one), np.where(is_left, two, high)
        power = (low + high) / 2
        return (*super().fit(special.boxcox(even, power)), power, middle)

    def scores(self, fitted: tuple[Floats, ...], values: Floats) -> Floats:
        return super().scores(
            fitted, special.boxcox(np.maximum(values, 1e-300) / fitted[3], fitted[2])
        )

    def quantiles(self, fitted: tuple[Floats, ...], scores: Floats) -> Floats:
        powered = super().quantiles(fitted, scores)
        inside = 1 + fitted[2] * powered > 0
        edge = np.where(fitted[2] > 0, 0.0, np.inf)
        return np.where(
            inside, special.inv_boxcox(np.where(inside, powered, 0.0), fitted[2]) * fitted[3], edge
        )


class Threshold(Normal):
    """Lognormal above (or, mirrored, below) a threshold at which the logarithms have no skewness.
    Values may be negative.
    """

    name, free, needs_positive = "lognormal with a threshold", 3, False

    def fit(self, rows: Floats) -> tuple[Floats, ...]:
        spread = rows.std(axis=-1, keepdims=True)
        side = np.where(_skewness(rows) >= 0, 1.0, -1.0)
        least = (side * rows).min(axis=-1, keepdims=True)
        low, high = (np.full_like(least, float(np.log(edge))) for edge in (1e-4, 1e3))
        # to 5e-7; in logarithms of the distance from threshold to nearest value, in standard
        # deviations
        for _ in range(25):
            middle = (low + high) / 2
            is_skewed = _skewness(np.log(side * rows - least + np.exp(middle) * spread)) > 0
            low, high = np.where(is_skewed, low, middle), np.where(is_skewed, middle, high)
        threshold = least - np.exp((low + high) / 2) * spread
        return (*super().fit(np.log(side * rows - threshold)), threshold, side)

    def scores(self, fitted: tuple[Floats, ...], values: Floats) -> Floats:
        return np.asarray(fitted[3] * super().scores(fitted, _log(fitted[3] * values - fitted[2])))

    def quantiles(self, fitted: tuple[Floats, ...], scores: Floats) -> Floats:
        return np.asarray(
            fitted[3] * (np.exp(super().quantiles(fitted, fitted[3] * scores)) + fitted[2])
        )


FAMILIES: Final[tuple[Family, ...]] = (Normal(), Lognormal(), Weibull(), BoxCox(), Threshold())


def fitting(values: Floats, resolution: float | None = None) -> Fit | None:
    """Return the family that fits best, or None. For the test, rounded values (`resolution`) are
    spread evenly over their steps.
    """
    points = spread_over_steps(values, resolution)
    if not np.ptp(points) > 0:
        return None
    possible = [family for family in FAMILIES if points.min() > 0 or not family.needs_positive]
    for free in (2, 3):  # two parameters first: three could fit a tail to an outlier
        some = [family for family in possible if family.free == free]
        found = [fit for family in some if (fit := _fit(family, points)) is not None]
        if found:
            return min(
                found, key=lambda one: one.bic(points) - NORMAL_FIRST * (one.family is FAMILIES[0])
            )
        beside = (_but_for_outliers(family, points) for family in some)
        fit = next((one for one in beside if one is not None), None)
        if fit is not None:
            return fit
    return None


def normal_fit(values: Floats) -> Fit:
    """Return the normal distribution of the values, even if it does not fit."""
    fitted = FAMILIES[0].fit(values)
    return Fit(FAMILIES[0], fitted, FAMILIES[0].chance(fitted, values))


def widest_fit(values: Floats) -> Fit | None:
    """Return the lognormal with a threshold and the values' skewness, even if it does not fit; None
    if it has no tails.
    """
    family = FAMILIES[-1]
    fitted = family.fit(values)
    if not np.isfinite(family.quantiles(fitted, np.array([-REACH, REACH]))).all():
        return None
    return Fit(family, fitted, family.chance(fitted, values))


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A fitted family: its parameters and the p-value of the fit (Anderson-Darling).

    `outliers` is the number of values left out of the fit because they lie far beyond it.
    """

    family: Family
    fitted: tuple[Floats, ...]
    chance: float
    outliers: int = 0

    @property
    def name(self) -> str:
        return self.family.name

    def scores(self, values: Floats) -> Floats:
        """Return standard normal scores, clipped to ±37 beyond the distribution's edge."""
        return np.clip(self.family.scores(self.fitted, values), -37.0, 37.0)

    def at(self, score: float) -> float:
        """Return the value at a normal score: 0 the median, ±3 the percentiles 99.865 and 0.135."""
        return float(self.family.quantiles(self.fitted, np.array([score]))[0])

    def bic(self, values: Floats) -> float:
        """Return the Bayesian information criterion: lower is more likely."""
        return self.family.free * float(np.log(len(values))) - 2 * float(
            self.log_density(values).sum()
        )

    def log_density(self, values: Floats) -> Floats:
        """Return the logarithm of the density, from the slope of the scores."""
        step = 1e-4 * float(values.std())
        slope = (self.scores(values + step) - self.scores(values - step)) / (2 * step)
        return np.asarray(
            LOG_ROOT - self.scores(values) ** 2 / 2 + np.log(np.maximum(slope, 1e-300))
        )


def spread_over_steps(values: Floats, resolution: float | None) -> Floats:
    """Spread rounded values evenly over their steps, because the test needs values without ties."""
    if not resolution:
        return values
    steps = np.round(values / resolution)
    order = np.argsort(values, kind="stable")
    _, counts = np.unique(steps[order], return_counts=True)
    places = np.concatenate([(np.arange(count) + 0.5) / count - 0.5 for count in counts])
    spread = np.empty_like(values)
    spread[order] = steps[order] * resolution + places * resolution
    # a positive feature stays positive
    return np.where(values > 0, np.maximum(spread, resolution / 100), spread)


def _distance_from_normal(values: Floats) -> float:
    n = len(values)
    ordered = np.sort((values - values.mean()) / values.std(ddof=1))
    return _anderson_darling(special.log_ndtr(ordered), special.log_ndtr(-ordered[::-1]), n) * (
        1 + 0.75 / n + 2.25 / n**2
    )


def chance_of_normal(a: float) -> float:
    """Return the p-value of an adjusted A² of values whose mean and spread were estimated from them
    (Stephens' approximation).
    """
    if a >= 0.6:
        chance = np.exp(1.2937 - 5.709 * a + 0.0186 * a**2) if a < 13 else 0.0
    elif a > 0.34:
        chance = np.exp(0.9177 - 4.279 * a - 1.38 * a**2)
    elif a > 0.2:
        chance = 1 - np.exp(-8.318 + 42.796 * a - 59.938 * a**2)
    else:
        chance = 1 - np.exp(-13.436 + 101.14 * a - 223.73 * a**2)
    return float(chance)


def _anderson_darling(log_below: Floats, log_above_reversed: Floats, n: int) -> float:
    """Return A² of sorted values, from the logarithms of the share below each, and of the share
    above each from the last to the first.
    """
    return -n - float(((2 * np.arange(1, n + 1) - 1) * (log_below + log_above_reversed)).sum()) / n


def _fit(family: Family, points: Floats) -> Fit | None:
    fitted = family.fit(points)
    edges = family.quantiles(fitted, np.array([-REACH, REACH]))
    if not (np.isfinite(edges).all() and np.isfinite(family.scores(fitted, points)).all()):
        return None
    chance = family.chance(fitted, points)
    return Fit(family, fitted, chance) if chance >= ACCEPTED else None


def _but_for_outliers(family: Family, points: Floats) -> Fit | None:
    """Return the fit without the few values furthest from the median, if they are far beyond it."""
    n = len(points)
    most = min(max(1, int(OUTLIERS * n)), MOST_OUTLIERS)
    order = np.argsort(np.abs(points - np.median(points)))
    furthest = points[order[-most:]]
    tightest = points[np.sort(order[:-most])]
    fitted = family.fit(tightest)
    if HOPELESS < family.distance(fitted, tightest) < np.inf:
        return None
    near = _scores_at_most(family, fitted, furthest)
    for left_out in range(1, most + 1):
        if not _is_far_out(near[-left_out] + SLACK, n):
            continue
        found = _fit(family, points[np.sort(order[:-left_out])])
        if found is not None and _is_far_out(
            float(np.abs(found.scores(furthest[-left_out:])).min()), n
        ):
            return Fit(family, found.fitted, found.chance, left_out)
    return None


def _scores_at_most(family: Family, fitted: tuple[Floats, ...], furthest: Floats) -> Floats:
    """Return an upper estimate of the score of each of `furthest`, by the fit of the values without
    all of them, whose spread is the least.
    """
    scores = np.abs(family.scores(fitted, furthest))
    return np.where(np.isnan(scores), np.inf, scores)


def _is_far_out(score: float, n: int) -> bool:
    """Whether a score this high is unlikely among `n` values."""
    return bool(2 * n * special.ndtr(-score) < FAR_OUT)


def _spread_of_power(even: Floats, power: Floats) -> Floats:
    """Return the quantity to minimise for the most likely power; the values have the geometric mean
    1.
    """
    return np.asarray(special.boxcox(even, power).std(axis=-1, keepdims=True))


def _skewness(rows: Floats) -> Floats:
    away = rows - rows.mean(axis=-1, keepdims=True)
    # `**3` is many times slower
    return np.asarray((away * away * away).mean(axis=-1, keepdims=True))


def _log(values: Floats) -> Floats:
    """Return the logarithm, bounded below for values that have none."""
    return np.log(np.maximum(values, 1e-300))
