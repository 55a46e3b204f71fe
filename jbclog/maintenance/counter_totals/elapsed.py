"""How long it was between two looks, as far as the host's clock can be believed.

Times are UTC, so summer time is no matter. Looks are in the ledger's order, which nobody can set back: where the times are not
in order too, the fewest looks that explain it had a wrong clock, and what is known of them is only that they were in between.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from datetime import datetime
from functools import lru_cache

HOUR = 3600.0


@lru_cache(maxsize=1 << 16)
def seconds(time: str) -> float:
    """Seconds since 1970 of a time of the ledger."""
    return datetime.fromisoformat(time).timestamp()


class Elapsed:
    """Between the looks at `times` (seconds since 1970, in the ledger's order)."""

    def __init__(self, times: Sequence[float]) -> None:
        self.times = times
        self._right = _longest_in_order(times)
        self._is_right = frozenset(self._right)

    def is_right(self, look: int) -> bool:
        """Whether the clock of this look agrees with those of most others."""
        return look in self._is_right

    def at_most_h(self, begin: int, end: int) -> float:
        """Hours from one look to a later one, at the most; infinite where no look with a right clock came after it yet."""
        right = self._right
        before, after = bisect_right(right, begin) - 1, bisect_left(right, end)
        if before < 0 or after == len(right):
            return math.inf
        return (self.times[right[after]] - self.times[right[before]]) / HOUR


def _longest_in_order(times: Sequence[float]) -> list[int]:
    """The longest series of looks whose times do not go back; of several, the one that ends earliest."""
    ends: list[int] = []
    heights: list[float] = []
    behind: list[int] = []
    for look, time in enumerate(times):
        place = bisect_right(heights, time)
        behind.append(ends[place - 1] if place else -1)
        ends[place : place + 1] = [look]
        heights[place : place + 1] = [time]
    series, look = [], ends[-1] if ends else -1
    while look >= 0:
        series.append(look)
        look = behind[look]
    return series[::-1]
