"""How well a 95 % quantile is known: its upper 95 % bound, whatever the distribution is.

Of n independent values in their order the one with m above it is at least the 95 % quantile with a probability of
1 - B(m; n, 0.05), B being the cumulative binomial distribution; m is the greatest for which that is 95 % (S. S. Wilks,
Determination of Sample Sizes for Setting Tolerance Limits, Annals of Mathematical Statistics 12 (1941)). It takes `LEAST` values,
of which then the greatest is the bound; 93 for the second, 124 for the third.

Where neighbours are alike, n values are worth fewer: with a correlation r of each value with the next that is beyond chance
(one-sided 5 %), n (1 - r) / (1 + r) of them, and m is taken in proportion. A value that is not known counts as greater than any
that is, so that what was too long to be seen cannot make the bound look better.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, lgamma, log, sqrt
from statistics import NormalDist
from typing import Final

import numpy as np

from jbclog.analysis.verdict.bound import Bound, Floats

SHARE, SURE = 0.95, 0.95
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
    while total <= 1 - SURE and above < n:
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
