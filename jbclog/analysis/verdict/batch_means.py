"""The bounds of rules 1 and 2, by batch means, to compare runs that these rules judged.

The readings, in order, are divided into `BATCHES` batches of about equal size, of at least
`LEAST_BATCH_S` each. The spread of the batches' means, with Student's t, gives the two-sided bound
of the mean (B. Schmeiser, Batch Size Effects in the Analysis of Simulation Output, Operations
Research 30 (1982)). The one-sided upper bound of the standard deviation is that of chi-squared with
effective sample size − 1 degrees of freedom. Fewer than `LEAST_BATCHES` batches give no bound.

These bounds are too narrow if the tip drifts more slowly than a batch is long; since rules 3
`bounds.py` replaces them.
"""

from __future__ import annotations

from math import sqrt
from statistics import NormalDist
from typing import Final

import numpy as np

from jbclog.analysis.verdict.bounds import FLOOR_C, STEP_C, Bound, Cells, Floats

BATCHES: Final = 20
LEAST_BATCHES: Final = 8
LEAST_BATCH_S: Final = 3.0
CELL_S: Final = 1.0
TWO_SIDED, ONE_SIDED = NormalDist().inv_cdf(0.975), NormalDist().inv_cdf(0.95)


def means_of_batches(cells: Cells, period_s: float) -> Floats:
    """Return the means of the batches in order; empty if there are fewer than `LEAST_BATCHES`."""
    counts, sums, _ = cells.in_order()
    batches = min(BATCHES, int(counts.sum() * period_s / LEAST_BATCH_S))
    if batches < LEAST_BATCHES:
        return np.empty(0)
    reached = np.cumsum(counts) - counts / 2
    number = np.minimum((reached * batches / counts.sum()).astype(np.int64), batches - 1)
    _, number = np.unique(number, return_inverse=True)  # a long cell can leave a batch empty
    return np.asarray(np.bincount(number, sums) / np.bincount(number, counts), dtype=np.float64)


def bounds_by_batches(n: int, mean: float, sd: float, means: Floats) -> tuple[Bound, Bound] | None:
    """Return the bounds of mean and standard deviation of `n` readings from their batch means;
    None: too few batches.
    """
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
    """Return Student's t for 97.5 %, by R. A. Fisher's expansion: accurate to 0.001 from 7 degrees
    of freedom on.
    """
    z, v = TWO_SIDED, freedom
    first, second = (z**3 + z) / 4, (5 * z**5 + 16 * z**3 + 3 * z) / 96
    return z + first / v + second / v**2 + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384 / v**3


def chi_squared(freedom: float) -> float:
    """Return chi-squared for 5 %, by E. B. Wilson and M. M. Hilferty (1931): accurate to 1.2 % from
    6 degrees of freedom on.
    """
    share = 2 / (9 * freedom)
    return float(freedom * (1 - share - ONE_SIDED * sqrt(share)) ** 3)
