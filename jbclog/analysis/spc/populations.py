"""Whether values come from two populations: two tips, two recipes, joints and touches taken for one feature.

A mixture of two normal distributions is fitted by expectation maximisation. It is held to be two populations where it is clearly
likelier than the one distribution that fits best and than an even spread (BIC, by `CLEARLY`), and the two lie clearly apart: D of
Ashman, Bird and Zepf (Astronomical Journal 108, 1994) above 2, which a mixture needs to have two peaks.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log, sqrt
from typing import Final

import numpy as np

from jbclog.analysis.spc.distribution import LOG_ROOT, Fit, Floats

CLEARLY: Final = 10.0  # BIC; "very strong" of Kass and Raftery 1995
APART: Final = 2.0
LEAST_SHARE: Final = 0.05  # fewer are outliers
STEPS: Final = 200


@dataclass(frozen=True, slots=True)
class Two:
    """Both means and standard deviations, and the share of the first in all values."""

    means: tuple[float, float]
    sds: tuple[float, float]
    share: float


def two_populations(values: Floats, one: Fit, resolution: float | None = None) -> Two | None:
    """The two populations, where they explain the values clearly better than the one distribution."""
    n, ordered = len(values), np.sort(values)
    floor = max(0.1 * float(values.std()), (resolution or 0.0) / sqrt(12))
    found, likelihood = _mixture(ordered, floor)
    apart = abs(found.means[1] - found.means[0]) / sqrt((found.sds[0] ** 2 + found.sds[1] ** 2) / 2)
    if apart <= APART or not LEAST_SHARE <= found.share <= 1 - LEAST_SHARE:
        return None
    mixed = 5 * log(n) - 2 * likelihood
    even = 2 * log(n) + 2 * n * log(float(np.ptp(values)))
    return found if mixed + CLEARLY < min(even, one.bic(values)) else None


def _mixture(ordered: Floats, floor: float) -> tuple[Two, float]:
    """The likeliest mixture of two, and the logarithm of its likelihood; from the gap that parts the values best."""
    n = len(ordered)
    counts = np.arange(1, n)
    sums = np.cumsum(ordered)[:-1]
    between = (sums / counts - (ordered.sum() - sums) / (n - counts)) ** 2 * counts * (n - counts)
    cut = int(np.argmax(between)) + 1
    weight = np.zeros((2, n))
    weight[0, :cut] = weight[1, cut:] = 1.0
    last = -np.inf
    for _ in range(STEPS):
        share = np.maximum(weight.sum(axis=1), 1e-9)
        means = (weight @ ordered) / share
        sds = np.maximum(np.sqrt((weight * (ordered - means[:, np.newaxis]) ** 2).sum(axis=1) / share), floor)
        away = (ordered - means[:, np.newaxis]) / sds[:, np.newaxis]
        parts = np.log(share / n)[:, np.newaxis] - np.log(sds)[:, np.newaxis] + LOG_ROOT - away**2 / 2
        total = np.logaddexp(parts[0], parts[1])
        weight = np.exp(parts - total)
        likelihood = float(total.sum())
        if likelihood - last < 1e-6 * n:
            break
        last = likelihood
    two = Two((float(means[0]), float(means[1])), (float(sds[0]), float(sds[1])), float(share[0] / n))
    return two, likelihood
