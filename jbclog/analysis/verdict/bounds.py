"""95 % bounds of a mean and a standard deviation, corrected for autocorrelation.

Consecutive readings of a tip are correlated: ten thousand of them are worth far fewer independent
ones. So the uncertainty is taken from the slowest variation of the readings themselves, by the
equal-weighted cosine estimate (E. Lazarus, D. J. Lewis, J. H. Stock and M. W. Watson, HAR
Inference: Recommendations for Practice, Journal of Business & Economic Statistics 36 (2018)):

1. The readings, in order and without the gaps between them, are projected on the first cosines of
   the record's length. The mean square of the projections is the variance of the mean, and
   Student's t with as many degrees of freedom as there are cosines gives its bound.
2. There are `FEWEST` cosines up to `FIRST_S` of rest, then one more for each `EACH_S`, at most
   `MOST`: with more of them, the bound holds less often than in 88 % of cases if the correlation
   time is a fifteenth of the rest.
3. The upper bound of the standard deviation, one-sided, uses the same estimate for the squares of
   the deviations, on a logarithmic scale because their distribution is skewed. The variance that a
   record of this length hides, at most that of its mean, is added.
4. Less than `LEAST_S` of rest, or fewer than `LEAST_CELLS` cells with readings, give no bound.
5. Readings are whole °C. A tip that does not move may be anywhere within half a step; the more it
   moves, the better the steps average out. For a standard deviation s below half a step the mean
   may be off by √(¼ - s²) steps, which is exact for a tip at the edge of a step, and is added to
   its bound. The standard deviation is never known to be below what steps show, `STEP_C` / √12.

`tests/unit/analysis/verdict/test_coverage.py` measures how often the bounds hold.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import exp, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

CELL_S: Final = 0.5
MOST_CELLS: Final = 2048
FEWEST: Final = 5
MOST: Final = 6
FIRST_S: Final = 600.0
EACH_S: Final = 120.0
LEAST_S: Final = 300.0
LEAST_CELLS: Final = 15
SURE: Final = 0.95
STEP_C: Final = 1.0
FLOOR_C: Final = STEP_C / sqrt(12)
TINY: Final = 1e-12  # °C²: the variance of equal readings

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Bound:
    """95 % bound of a figure, in its unit: two-sided, or upper only (`low` is None).

    `n` readings have an effective sample size of `n_effective`.
    """

    low: float | None
    high: float
    n: int
    n_effective: float

    def keeps(self, limit: float) -> bool:
        """Whether the bound is within `limit` on both sides."""
        return max(abs(self.high), abs(self.low or 0.0)) <= limit


@dataclass(slots=True)
class Cells:
    """Number, sum and sum of squares of the readings in each cell of time; if there are too many
    cells, they double in width.
    """

    width_s: float = CELL_S
    sums: dict[int, tuple[int, float, float]] = field(default_factory=dict)

    def add(self, seconds: Floats, values: Floats) -> None:
        """Add readings with their times in s."""
        numbers, cell = np.unique(
            np.floor_divide(seconds, self.width_s).astype(np.int64), return_inverse=True
        )
        counts = np.bincount(cell).tolist()
        totals = np.bincount(cell, values).tolist()
        squares = np.bincount(cell, np.square(values)).tolist()
        for number, *sums in zip(numbers.tolist(), counts, totals, squares, strict=True):
            self._put(number, *sums)
        while len(self.sums) > MOST_CELLS:
            self._double()

    def _put(self, number: int, count: int, total: float, squares: float) -> None:
        before = self.sums.get(number, (0, 0.0, 0.0))
        self.sums[number] = before[0] + count, before[1] + total, before[2] + squares

    def _double(self) -> None:
        narrow = self.sums
        self.sums = {}
        self.width_s *= 2
        for number, sums in narrow.items():
            self._put(number // 2, *sums)

    def in_order(self) -> tuple[Floats, Floats, Floats]:
        """Return counts, sums and sums of squares of the cells that have readings."""
        rows = [self.sums[number] for number in sorted(self.sums)]
        sums = np.array(rows, dtype=np.float64).reshape(-1, 3)
        return sums[:, 0], sums[:, 1], sums[:, 2]


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds of a mean and a standard deviation.

    `error`: standard error of the mean, with `freedom` degrees of freedom. `rounding`: what whole
    degrees add to it. All but `freedom` in °C.
    """

    mean: Bound
    sd: Bound
    error: float
    freedom: int
    rounding: float

    def half(self, level: float) -> float:
        """Return the half-width of the mean's two-sided interval at this level."""
        return self.rounding + _student((1 + level) / 2, self.freedom) * self.error


def bounds_of_cells(cells: Cells, seconds: float, mean: float, sd: float) -> Bounds | str:
    """Return the bounds of readings that cover `seconds` and have this mean and standard deviation,
    or why there are none.
    """
    counts, sums, squares = cells.in_order()
    if seconds < LEAST_S or len(counts) < LEAST_CELLS:
        return (
            f"A 95 % bound takes {LEAST_S:g} s of the tip at rest, and {LEAST_CELLS} readings;"
            f" there are {seconds:.1f} s."
        )
    n = int(counts.sum())
    cosines = _cosines(counts, cosines_for(seconds))
    variance = max(sd * sd, TINY)
    of_mean = _variance_of_mean(sums - counts * mean, cosines, n)
    deviations = squares - 2 * mean * sums + counts * mean**2
    of_variance = _variance_of_mean(deviations - counts * deviations.sum() / n, cosines, n)

    freedom = cosines.shape[1]
    error = sqrt(of_mean)
    rounding = STEP_C * sqrt(max(0.25 - (sd / STEP_C) ** 2, 0.0))
    half = rounding + _student((1 + SURE) / 2, freedom) * error
    one_sided = _student(SURE, freedom)
    # e to the hundredth is beyond any limit, and to the thousandth an overflow
    factor = exp(min(one_sided * sqrt(of_variance) / variance, 100.0))
    high = sqrt(variance * factor + one_sided**2 * of_mean)
    return Bounds(
        Bound(mean - half, mean + half, n, _worth(variance, of_mean, n)),
        Bound(None, max(high, FLOOR_C), n, _worth(2 * variance**2, of_variance, n)),
        error,
        freedom,
        rounding,
    )


def cosines_for(seconds: float) -> int:
    """Return the number of cosines for so much rest."""
    more = int(max(seconds - FIRST_S, 0.0) // EACH_S)
    return min(FEWEST + more, MOST)


def _cosines(counts: Floats, number: int) -> Floats:
    """Return the first cosines over the readings in order, a row for each cell."""
    middle = (np.cumsum(counts) - counts / 2) / counts.sum()
    waves = np.pi * np.outer(middle, np.arange(1, number + 1))
    return np.asarray(sqrt(2) * np.cos(waves), dtype=np.float64)


def _variance_of_mean(sums: Floats, cosines: Floats, n: int) -> float:
    """Return the variance of the mean of `n` readings whose sum in all cells is 0."""
    return float(np.square(sums @ cosines / n).mean())


def _worth(single: float, of_mean: float, n: int) -> float:
    """Return how many independent readings are worth these `n`, by the variance of a single one and
    that of their mean.
    """
    return single / of_mean if of_mean * n > single else float(n)


def _student(share: float, freedom: int) -> float:
    """Return the quantile of Student's t."""
    from scipy.special import stdtrit  # a run without any rest needs none of it

    return float(stdtrit(freedom, share))
