"""A number that is known to lie between two others."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(slots=True, unsafe_hash=True)  # never changed; a frozen one takes three times as long to make, and there are millions
class Interval:
    """From `low` to `high`, both allowed; `high` is infinite where nothing bounds it (null in JSON)."""

    low: float
    high: float

    @property
    def width(self) -> float:
        return self.high - self.low

    @property
    def middle(self) -> float:
        return (self.low + self.high) / 2

    @property
    def is_bounded(self) -> bool:
        return math.isfinite(self.high)

    def __add__(self, other: Interval) -> Interval:
        return Interval(self.low + other.low, self.high + other.high)

    def __contains__(self, number: float) -> bool:
        return self.low <= number <= self.high

    def per(self, amount: float) -> Interval:
        """Divided by a positive number."""
        return Interval(self.low / amount, self.high / amount)


NOTHING = Interval(0.0, 0.0)
