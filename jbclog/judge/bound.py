"""How well a mean and a standard deviation are known: 95 % bounds that mind that neighbours are alike.

A tip's readings follow each other: ten thousand of them are worth far fewer independent ones, and a bound from their number
would promise too much. So the mean's uncertainty is taken from *batch means* (B. Schmeiser, Batch Size Effects in the Analysis
of Simulation Output, Operations Research 30 (1982)): the readings, in their order, are parted into `BATCHES` batches of about
as many readings each, of `LEAST_BATCH_S` at least, and the spread of the batches' means, with Student's t, gives the mean's
two-sided bound; slow drift is in it. The number of independent readings that would give as much is *n effective* = variance of
the readings / squared standard error. The standard deviation's upper bound is that of chi-squared with n effective − 1 degrees
of freedom, one-sided; that is on the safe side where neighbours are alike. Fewer than `LEAST_BATCHES` batches give no bound.

Readings come in whole °C. Where they stand so still that their spread is below what such steps can show (`STEP_C` / √12), the
mean is known to half a step at best and the spread to that floor.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

BATCHES, LEAST_BATCHES, LEAST_BATCH_S = 20, 8, 3.0
CELL_S, MOST_CELLS = 1.0, 2048
STEP_C = 1.0
FLOOR_C = STEP_C / sqrt(12)
TWO_SIDED, ONE_SIDED = NormalDist().inv_cdf(0.975), NormalDist().inv_cdf(0.95)

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
    """Number and sum of the readings in each stretch of time; the stretches double when there are too many, so it stays small."""

    width_s: float = CELL_S
    counts: dict[int, int] = field(default_factory=dict)
    sums: dict[int, float] = field(default_factory=dict)

    def add(self, seconds: Floats, values: Floats) -> None:
        """Take readings with their times on the run's axis."""
        places, first = np.unique(np.floor_divide(seconds, self.width_s).astype(np.int64), return_inverse=True)
        for place, count, total in zip(places, np.bincount(first), np.bincount(first, values), strict=True):
            self._put(int(place), int(count), float(total))
        while len(self.counts) > MOST_CELLS:
            self._double()

    def _put(self, place: int, count: int, total: float) -> None:
        self.counts[place] = self.counts.get(place, 0) + count
        self.sums[place] = self.sums.get(place, 0.0) + total

    def _double(self) -> None:
        held = [(place, self.counts[place], self.sums[place]) for place in self.counts]
        self.width_s *= 2
        self.counts, self.sums = {}, {}
        for place, count, total in held:
            self._put(place // 2, count, total)

    def batch_means(self, period_s: float) -> Floats:
        """The means of the batches, in their order; empty where the readings are too few for `LEAST_BATCHES`."""
        places = sorted(self.counts)
        counts, sums = np.array([self.counts[p] for p in places]), np.array([self.sums[p] for p in places])
        batches = min(BATCHES, int(counts.sum() * period_s / LEAST_BATCH_S))
        if batches < LEAST_BATCHES:
            return np.empty(0)
        reached = np.cumsum(counts) - counts / 2
        number = np.minimum((reached * batches / counts.sum()).astype(np.int64), batches - 1)
        _, number = np.unique(number, return_inverse=True)  # a long cell can leave a batch empty
        return np.asarray(np.bincount(number, sums) / np.bincount(number, counts), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Known:
    """The bounds of one tip's mean and standard deviation."""

    mean: Bound
    sd: Bound


def known(n: int, mean: float, sd: float, means: Floats) -> Known | None:
    """The bounds of `n` readings with this mean and standard deviation, from their batches' means; None: too few batches."""
    if len(means) < LEAST_BATCHES:
        return None
    freedom = len(means) - 1
    error = float(means.std(ddof=1)) / sqrt(len(means))
    effective = min(float(n), sd * sd / (error * error)) if error else float(n)
    still = sd < FLOOR_C
    half = max(students_t(freedom) * error, STEP_C / 2 if still else 0.0)
    spread = max(sd * sqrt((effective - 1) / chi_squared(effective - 1)), FLOOR_C if still else 0.0)
    return Known(Bound(mean - half, mean + half, n, effective), Bound(None, spread, n, effective))


def students_t(freedom: int) -> float:
    """Student's t for 97.5 %; R. A. Fisher's expansion, good to 0.001 from 7 degrees of freedom on."""
    z, v = TWO_SIDED, freedom
    first, second = (z**3 + z) / 4, (5 * z**5 + 16 * z**3 + 3 * z) / 96
    return z + first / v + second / v**2 + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384 / v**3


def chi_squared(freedom: float) -> float:
    """Chi-squared for 5 %; Wilson and Hilferty (1931), good to 1.2 % from 6 degrees of freedom on."""
    share = 2 / (9 * freedom)
    return float(freedom * (1 - share - ONE_SIDED * sqrt(share)) ** 3)
