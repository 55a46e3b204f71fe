"""The 95 % quantile of times, some of them censored: estimate and upper 95 % bound.

The estimate of censored times is the product-limit estimate (E. L. Kaplan and P. Meier,
Nonparametric Estimation from Incomplete Observations, Journal of the American Statistical
Association 53 (1958)). Without censoring it is the least value that at least this share of all
values does not exceed.

The bound holds for any distribution. Of n independent values in ascending order, the one with m
values above it is at least the 95 % quantile with probability 1 - B(m; n, 0.05), where B is the
cumulative binomial distribution; m is the largest number for which that is 95 % (S. S. Wilks,
Determination of Sample Sizes for Setting Tolerance Limits, Annals of Mathematical Statistics 12
(1941)). It takes `LEAST` values, whose maximum is then the bound; from 93 values on it is the
second largest, from 124 on the third.

Correlated neighbours lower the effective sample size: with a significant (one-sided 5 %)
correlation r between consecutive values, it is n (1 - r) / (1 + r), and m is taken in proportion.
An unknown value counts as larger than every known one, so that a time too long to be seen cannot
improve the bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from statistics import NormalDist
from typing import Final

import numpy as np

from jbclog.analysis.verdict.bounds import Bound, Floats

SHARE: Final = 0.95
SURE: Final = 0.95
LEAST: Final = 59
CHANCE: Final = NormalDist().inv_cdf(0.95)

# scipy is loaded where it is needed: most runs have no joints


def censored_quantile(times: Sequence[tuple[float | None, bool]], share: float) -> float | None:
    """Return the quantile of times, each with whether it ended then (or is longer); None if less
    than `share` ended.
    """
    from scipy.stats import CensoredData, ecdf

    ended = [time for time, has_ended in times if time is not None and has_ended]
    longer = [time for time, has_ended in times if time is not None and not has_ended]
    if not ended:
        return None
    ended_by = ecdf(CensoredData(uncensored=ended, right=longer)).cdf
    reached = np.flatnonzero(ended_by.probabilities >= share - 1e-12)
    return float(ended_by.quantiles[reached[0]]) if len(reached) else None


def upper_p95(values: Sequence[float | None]) -> Bound | str:
    """Return the upper 95 % bound of the 95 % quantile, or why there is none. None: a value that is
    not known.
    """
    known = np.array([value for value in values if value is not None], dtype=np.float64)
    effective = effective_size(known) * len(values) / max(len(known), 1)
    if effective < LEAST:
        worth = f", worth {effective:.0f} that are independent" if len(values) >= LEAST else ""
        return f"A 95 % bound takes {LEAST} joints; there are {len(values)}{worth}."
    above = int(len(values) * most_above(effective) / effective)
    unknown = len(values) - len(known)
    if unknown > above:
        return (
            f"The recovery of {unknown} of them is not known and may be longer; a 95 % bound allows"
            f" {above}."
        )
    highest = float(np.sort(known)[len(known) - 1 - (above - unknown)])
    return Bound(None, highest, len(values), effective)


def most_above(n: float) -> int:
    """Return how many of n values may lie above the bound; -1 if n is too small for one."""
    from scipy.special import betainc

    above = 0
    # the cumulative binomial distribution of `above`, also for an n between two numbers
    while above < n and betainc(n - above, above + 1, SHARE) <= 1 - SURE:
        above += 1
    return above - 1


def effective_size(values: Floats) -> float:
    """Return the effective sample size of the values, by their lag-1 correlation."""
    n = len(values)
    deviations = values - values.mean() if n else values
    squares = float((deviations * deviations).sum())
    if n < 3 or not squares:
        return float(n)
    r = float((deviations[1:] * deviations[:-1]).sum()) / squares
    return n * (1 - r) / (1 + r) if r > CHANCE / sqrt(n) else float(n)
