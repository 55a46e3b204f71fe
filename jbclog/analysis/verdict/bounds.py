"""95 % bounds of a mean and a standard deviation, corrected for autocorrelation.

Consecutive readings of a tip are correlated: ten thousand of them are worth far fewer independent
ones, and if the tip drifts slowly it is not known beforehand how many. Batch means cannot show it:
if the drift outlasts a batch, the batches are correlated too. So the uncertainty is taken from the
lowest frequencies of the readings themselves, and the relation between these frequencies is left
open:

- The readings, in order and without the gaps between them, are projected on the first
  `COSINES` cosines of the record's length. Each projection has nearly its own variance, the
  spectrum at that frequency (U. K. Müller and M. W. Watson, Low-Frequency Econometrics, in Advances
  in Economics and Econometrics: Eleventh World Congress (2017)). The variance of the mean is the
  spectrum at frequency zero.
- The spectrum is that of a first-order autoregressive process whose correlation time is one of
  `TIMES` records, plus white noise (`WHITE`); the variances are exact for the record's length. No
  single process is chosen: each is weighted by how well it explains the projections (`WHITE_WEIGHT`
  for those with noise, a flat prior otherwise; the unknown scale is integrated out). Each gives
  Student's t with as many degrees of freedom as there are cosines, and the bound is the quantile of
  their mixture. A record that is short for its drift so gets a wide bound.
- The upper bound of the standard deviation, one-sided, is the quantile of the same mixture over
  chi-squared: the observed variance, plus what a record of this length hides of a slow process, on
  the degrees of freedom that such a process leaves. Faster variation counts as many degrees of
  freedom as the lowest frequencies of the squares show.

`COSINES`, `TIMES`, `WHITE` and `WHITE_WEIGHT` were chosen by simulation so that the bounds hold in
the hardest case, at correlation times up to two thirds of the record;
`tests/unit/analysis/verdict/test_coverage.py` measures how often they hold.

Less than `LEAST_S` of readings, or fewer than `LEAST_CELLS` cells of them, give no bound.

Readings are whole °C. A tip that does not move may be anywhere within half a step; the more it
moves, the better the steps average out. For a standard deviation s below half a step the mean may
be off by √(¼ − s²) steps, which is exact for a tip at the edge of a step, and is added to its
bound. The standard deviation is never known to be below what steps can show (`STEP_C` / √12).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from math import erfc, sqrt
from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.typing import NDArray

CELL_S, MOST_CELLS = 0.5, 2048
COSINES: Final = 12
TIMES: Final = np.geomspace(1 / 600, 3.0, 22)
# spectrum of the noise, as a share of the process's at frequency zero
WHITE: Final = np.array([0.0, 0.05, 0.2, 0.6, 2.0])
WHITE_WEIGHT: Final = 0.1
LEAST_S, LEAST_CELLS = 30.0, 15
SURE: Final = 0.95
STEP_C = 1.0
FLOOR_C = STEP_C / sqrt(12)
TWO_SIDED: Final = NormalDist().inv_cdf((1 + SURE) / 2)
TINY: Final = 1e-12  # °C²: the variance of equal readings
HALVINGS: Final = 45

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
    held: dict[int, tuple[int, float, float]] = field(default_factory=dict)

    def add(self, seconds: Floats, values: Floats) -> None:
        """Add readings with their times in s."""
        numbers, cell = np.unique(
            np.floor_divide(seconds, self.width_s).astype(np.int64), return_inverse=True
        )
        sums = np.bincount(cell), np.bincount(cell, values), np.bincount(cell, np.square(values))
        for number, count, total, squares in zip(
            numbers.tolist(), *(one.tolist() for one in sums), strict=True
        ):
            self._put(number, count, total, squares)
        while len(self.held) > MOST_CELLS:
            self._double()

    def _put(self, number: int, count: int, total: float, squares: float) -> None:
        before = self.held.get(number, (0, 0.0, 0.0))
        self.held[number] = before[0] + count, before[1] + total, before[2] + squares

    def _double(self) -> None:
        held, self.held = self.held, {}
        self.width_s *= 2
        for number, sums in held.items():
            self._put(number // 2, *sums)

    def in_order(self) -> tuple[Floats, Floats, Floats]:
        """Return counts, sums and sums of squares of the cells that have readings."""
        sums = np.array(
            [self.held[number] for number in sorted(self.held)], dtype=np.float64
        ).reshape(-1, 3)
        return sums[:, 0], sums[:, 1], sums[:, 2]


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds of a mean and a standard deviation. `half(level)`: half-width of the mean's two-sided
    interval at that level.
    """

    mean: Bound
    sd: Bound
    half: Callable[[float], float]


@dataclass(frozen=True, slots=True)
class _Processes:
    """The autoregressive processes, a row each: their spectrum at each cosine and at frequency
    zero, for a variance of 1.

    `freedom`: degrees of freedom of their variance. `prior`: logarithm of their weight.
    """

    spectrum: Floats
    at_zero: Floats
    slow_at_zero: Floats  # without the noise
    freedom: Floats
    prior: Floats


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
    n, cosines = int(counts.sum()), _cosines(counts)
    projections = _projected(sums - counts * mean, cosines, n)
    processes = _processes(len(projections))
    fit = np.square(projections) @ (1 / processes.spectrum).T + TINY
    weights = _weights(processes, fit, len(projections))
    scales = np.sqrt(processes.at_zero * fit / len(projections))
    rounding = STEP_C * sqrt(max(0.25 - (sd / STEP_C) ** 2, 0.0))

    def half(level: float) -> float:
        return rounding + _half(weights, scales, len(projections), level)

    deviations = squares - 2 * mean * sums + counts * mean**2
    of_squares = _projected(deviations - counts * deviations.sum() / n, cosines, n)
    high, freedom = _spread(
        processes, weights, fit / len(projections), sd * sd, n, float(np.square(of_squares).mean())
    )
    error = half(SURE)
    effective = min(float(n), (TWO_SIDED * sd / error) ** 2) if sd > FLOOR_C else float(n)
    return Bounds(
        Bound(mean - error, mean + error, n, effective),
        Bound(None, max(high, FLOOR_C), n, freedom + 1),
        half,
    )


def _cosines(counts: Floats) -> Floats:
    """Return the first cosines over the readings in order, at each cell."""
    at = (np.cumsum(counts) - counts / 2) / counts.sum()
    return np.asarray(
        sqrt(2) * np.cos(np.pi * np.outer(at, np.arange(1, min(COSINES, len(counts) // 2) + 1)))
    )


def _projected(sums: Floats, cosines: Floats, n: int) -> Floats:
    return np.asarray(sums @ cosines / n, dtype=np.float64)


@lru_cache(maxsize=COSINES)
def _processes(cosines: int) -> _Processes:
    """Return the autoregressive processes, exact for their projections on cosines, each with every
    level of noise.
    """
    rate = 1 / TIMES[:, None]
    numbers = np.arange(1, 2001)[None]
    waves, sign = np.pi * numbers, 1.0 - 2.0 * (numbers % 2)
    slow = (
        2 * rate / (rate**2 + waves**2)
        - 4 * rate**2 * (1 - sign * np.exp(-rate)) / (rate**2 + waves**2) ** 2
    )
    zero = 2 / rate - 2 * (1 - np.exp(-rate)) / rate**2
    freedom = (slow.sum(1) ** 2 / np.square(slow).sum(1)).repeat(len(WHITE))
    spectrum = (slow[:, None, :cosines] + WHITE[None, :, None] * zero[:, :, None]).reshape(
        -1, cosines
    )
    prior = np.tile(np.log(np.where(WHITE == 0, 1.0, WHITE_WEIGHT)), len(TIMES))
    return _Processes(
        spectrum,
        (zero * (1 + WHITE[None])).reshape(-1),
        zero[:, 0].repeat(len(WHITE)),
        freedom,
        prior,
    )


def _weights(processes: _Processes, fit: Floats, cosines: int) -> Floats:
    """Return each process's posterior probability; its scale is integrated out (prior 1/scale)."""
    log_weights = (
        processes.prior - np.log(processes.spectrum).sum(1) / 2 - cosines / 2 * np.log(fit)
    )
    weights = np.exp(log_weights - log_weights.max())
    return np.asarray(weights / weights.sum(), dtype=np.float64)


def _half(weights: Floats, scales: Floats, freedom: int, level: float) -> float:
    """Return the half-width of the mean's interval: the two-sided quantile of a mixture of
    Student's t.
    """

    def beyond(half: float) -> float:
        return float(weights @ _beyond_t(half / scales, freedom))

    return _threshold(lambda half: beyond(half) > 1 - level, float(scales.max()) * 100)


def _beyond_t(t: Floats, freedom: int) -> Floats:
    """Return the two-sided probability beyond t, by D. L. Wallace (1959): accurate to 0.0005 from 5
    degrees of freedom on.
    """
    z = (8 * freedom + 1) / (8 * freedom + 3) * np.sqrt(freedom * np.log1p(t * t / freedom))
    return np.array([erfc(one) for one in (z / sqrt(2)).tolist()])


def _below_chi_squared(value: Floats, freedom: Floats) -> Floats:
    """Return the probability that chi-squared is below `value` (Wilson and Hilferty 1931)."""
    share = 2 / (9 * freedom)
    z = (np.cbrt(value / freedom) - (1 - share)) / np.sqrt(share)
    return np.array([erfc(one) / 2 for one in (-z / sqrt(2)).tolist()])


def _spread(
    processes: _Processes,
    weights: Floats,
    scale: Floats,
    variance: float,
    n: int,
    squares_vary: float,
) -> tuple[float, float]:
    """Return the upper bound of the standard deviation, and the degrees of freedom of the variance.

    `scale`: variance of each process by its fit. `squares_vary`: variance of the projections of the
    squares.
    """
    variance, shown = max(variance, TINY), 1 - processes.slow_at_zero
    # a process cannot show more than the observed variance
    slow = np.minimum(scale, variance / shown)
    of_squares = min(max(2 * variance**2 / max(squares_vary, TINY**2), 2.0), n - 1.0)
    share = slow * shown / variance
    freedom = 1 / (share**2 / np.minimum(processes.freedom, n - 1) + (1 - share) ** 2 / of_squares)
    freedom = np.minimum(freedom, of_squares)
    whole = variance + processes.slow_at_zero * slow

    def beyond(sd: float) -> float:
        return float(weights @ _below_chi_squared(freedom * whole / sd**2, freedom))

    return _threshold(lambda sd: beyond(sd) > 1 - SURE, 1000 * sqrt(float(whole.max()))), float(
        weights @ freedom
    )


def _threshold(is_below: Callable[[float], bool], high: float) -> float:
    """Return the value between 0 and `high` at which `is_below` becomes False, by bisection."""
    low = 0.0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if is_below(middle) else (low, middle)
    return high
