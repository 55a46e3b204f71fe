"""The quantile of times of which some are only known to be longer: the product-limit estimate.

E. L. Kaplan and P. Meier, Nonparametric Estimation from Incomplete Observations, Journal of the American Statistical Association
53 (1958). Without censoring it is the least value that at least this share of all values does not exceed.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby


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
