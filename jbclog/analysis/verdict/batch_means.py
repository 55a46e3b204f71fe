"""The bounds of rules 1 and 2, by batch means: runs that were judged by them are judged so again.

The mean's uncertainty is taken from *batch means* (B. Schmeiser, Batch Size Effects in the Analysis of Simulation Output,
Operations Research 30 (1982)): the readings, in their order, are parted into `BATCHES` batches of about as many readings each, of
`LEAST_BATCH_S` at least, and the spread of the batches' means, with Student's t, gives the mean's two-sided bound. The standard
deviation's upper bound is that of chi-squared with n effective − 1 degrees of freedom, one-sided. Fewer than `LEAST_BATCHES`
batches give no bound. It does not hold where the tip drifts more slowly than a batch is long, which is why rules 3 have another
(`bound`).
"""

from __future__ import annotations

from math import sqrt
from statistics import NormalDist
from typing import Final

import numpy as np

from jbclog.analysis.verdict.bound import FLOOR_C, STEP_C, Bound, Cells, Floats

BATCHES, LEAST_BATCHES, LEAST_BATCH_S = 20, 8, 3.0
CELL_S: Final = 1.0
TWO_SIDED, ONE_SIDED = NormalDist().inv_cdf(0.975), NormalDist().inv_cdf(0.95)


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
    z, v = TWO_SIDED, freedom
    first, second = (z**3 + z) / 4, (5 * z**5 + 16 * z**3 + 3 * z) / 96
    return z + first / v + second / v**2 + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384 / v**3


def chi_squared(freedom: float) -> float:
    """Chi-squared for 5 %; Wilson and Hilferty (1931), good to 1.2 % from 6 degrees of freedom on."""
    share = 2 / (9 * freedom)
    return float(freedom * (1 - share - ONE_SIDED * sqrt(share)) ** 3)
