"""Mean, spread and median of any number of values in bounded memory."""

from __future__ import annotations

from collections import Counter
from math import sqrt
from typing import Final

import numpy as np

from jbclog.analysis.port_data import Floats

MOST_KEPT: Final = 20_000


class Values:
    """Values added piece by piece: up to `MOST_KEPT` as they are; beyond, counted after rounding to
    `decimals`.
    """

    def __init__(self, decimals: int) -> None:
        self.n = 0
        self._decimals = decimals
        self._kept: list[Floats] = []
        self._counts: Counter[float] = Counter()

    def add(self, values: Floats) -> None:
        """Add values; none of them is NaN."""
        self.n += len(values)
        self._kept.append(values)
        if self.n > MOST_KEPT:
            found, counts = np.unique(
                np.concatenate(self._kept).round(self._decimals), return_counts=True
            )
            self._counts.update(dict(zip(found.tolist(), counts.tolist(), strict=True)))
            self._kept.clear()

    @property
    def mean(self) -> float:
        """The mean; NaN without values."""
        values, counts = self._counted()
        return float(values.mean()) if counts is None else float((counts * values).sum()) / self.n

    @property
    def sd(self) -> float:
        """The standard deviation (n - 1)."""
        values, counts = self._counted()
        if counts is None:
            return float(values.std(ddof=1))
        return sqrt(float((counts * np.square(values - self.mean)).sum()) / (self.n - 1))

    @property
    def range(self) -> float:
        """The greatest minus the least value."""
        return float(np.ptp(self._counted()[0]))

    @property
    def median(self) -> float:
        """The median; NaN without values."""
        values, counts = self._counted()
        if counts is None:
            return float(np.median(values)) if len(values) else np.nan
        behind = np.cumsum(counts)
        below, above = np.searchsorted(behind, [(self.n - 1) // 2, self.n // 2], side="right")
        return float(values[below] + values[above]) / 2

    def _counted(self) -> tuple[Floats, Floats | None]:
        """Return the values in the order added; or the distinct ones, sorted, with the count of
        each.
        """
        if not self._counts:
            return np.concatenate([np.empty(0), *self._kept]), None
        values = np.array(sorted(self._counts))
        return values, np.array(
            [self._counts[value] for value in values.tolist()], dtype=np.float64
        )
