"""How far an index of a fitted distribution can be trusted: by samples drawn from that distribution, and fitted again.

The parametric bootstrap of the index' logarithm about its value (basic; additive where the index is not above zero). Of more than
`MOST` values so many are drawn, and the spread is scaled by the root of their numbers. The draws are the same every time.
"""

from __future__ import annotations

from math import sqrt
from typing import Final

import numpy as np

from jbclog.analysis.spc.distribution import REACH, Fit, Floats

DRAWS: Final = 500
MOST: Final = 400
SEED: Final = 1


def quantile_indices(low: Floats, middle: Floats, high: Floats, lower: float | None, upper: float | None) -> tuple[Floats, Floats]:
    """Pp and Ppk by percentiles 0.135, 50 and 99.865 (ISO 22514-2); Pp is NaN where a limit is missing."""
    ways = [] if upper is None else [(upper - middle) / (high - middle)]
    ways += [] if lower is None else [(middle - lower) / (middle - low)]
    both = np.full_like(middle, np.nan) if lower is None or upper is None else (upper - lower) / (high - low)
    return both, np.minimum.reduce(ways)


def drawn_indices(fit: Fit, n: int, lower: float | None, upper: float | None) -> tuple[Floats, Floats, float]:
    """Pp and Ppk of samples drawn from the fit; and by what their spread is to be scaled."""
    size = min(n, MOST)
    generator = np.random.default_rng(SEED)
    rows = fit.family.quantiles(fit.fitted, generator.normal(size=(DRAWS, size)))
    if fit.family.needs_positive:  # beyond the edge of a power there is nothing: a value as good as there
        middle_of_all = fit.at(0.0)
        rows = np.clip(np.nan_to_num(rows, nan=middle_of_all), middle_of_all * 1e-6, middle_of_all * 1e6)
    again = fit.family.fit(rows)
    low, middle, high = (fit.family.quantiles(again, np.full((DRAWS, 1), score))[:, 0] for score in (-REACH, 0.0, REACH))
    with np.errstate(invalid="ignore"):
        both, nearer = quantile_indices(low, middle, high, lower, upper)
    return both, nearer, sqrt(size / n)


def basic_bounds(value: float, drawn: Floats, scale: float, shares: tuple[float, ...]) -> tuple[float, ...]:
    """Bounds of `value` at these shares (0.95: a lower one that holds in 95 %)."""
    drawn = np.nan_to_num(drawn, nan=0.0)  # where the spread has no end the index is none
    quantiles = np.quantile(drawn, shares)
    if value > 0 and (quantiles > 0).all():
        return tuple(float(value * (value / one) ** scale) for one in quantiles)
    return tuple(float(value - scale * (one - value)) for one in quantiles)
