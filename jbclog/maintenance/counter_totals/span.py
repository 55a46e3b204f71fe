"""A counter between two readings: elapsed time, possible advance, possible events."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from datetime import datetime
from functools import lru_cache

import msgspec

from jbclog.maintenance.counter_totals.observed import DRIFT, Trait

# -- interval -----------------------------------------------------------------------------------------------------------------
# A number that is known to lie between two others.


class Interval(msgspec.Struct, frozen=True, gc=False):  # millions are made; a frozen dataclass takes several times as long
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


# -- elapsed ------------------------------------------------------------------------------------------------------------------
# How long it was between two looks, as far as the host's clock can be believed.
#
# Times are UTC, so summer time is no matter. Looks are in the ledger's order, which nobody can set back: where the times are not
# in order too, the fewest looks that explain it had a wrong clock, and what is known of them is only that they were in between.

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


# -- span ---------------------------------------------------------------------------------------------------------------------

MANY = 1000  # roll-overs; beyond it nobody counts
LEAST_HOURS = 4.0  # a pace is not told of fewer


def top_of(modulus: float, trait: Trait) -> float:
    """The last number before it rolls over."""
    return modulus - (trait.step or 1.0)


class Reading(msgspec.Struct, frozen=True, gc=False):
    """What a counter showed at a look (its number in the station's history): two values where it was moving."""

    look: int
    shown: Interval


class Span(msgspec.Struct, frozen=True, gc=False):
    """From `before` to `after`. `elapsed_h`: at most. `most`: what can have been worked at the fastest plausible pace; `usual`:
    at ten times the fastest that was seen. `grown`: by how much the readings differ, two of a moving one each way."""

    port: int
    counter: str
    trait: Trait
    modulus: float
    before: Reading
    after: Reading
    elapsed_h: float
    most: float
    usual: float
    grown: Interval

    @property
    def fell(self) -> bool:
        return self.grown.high < 0

    @property
    def is_unchanged(self) -> bool:
        return self.grown.low <= 0 <= self.grown.high

    @property
    def top(self) -> float:
        return top_of(self.modulus, self.trait)

    @property
    def can_go_on(self) -> bool:
        """Whether it can just have counted on."""
        return not self.fell and self.grown.low <= self.most + self.trait.step

    @property
    def worked(self) -> Interval:
        """What was worked if it just counted on."""
        return Interval(max(0.0, self.grown.low - self.trait.step), max(0.0, self.grown.high) + self.trait.step)

    def turns(self, most: float) -> range:
        """How often it can have rolled over if no more than `most` was worked, from once on."""
        room = most + self.trait.step - self.grown.low
        return range(1, 1 + min(MANY, max(0, math.floor(room / self.modulus)) if math.isfinite(room) else MANY))

    @property
    def at_most(self) -> float:
        """What can have been worked in this time, by whichever unit stood there."""
        return self.elapsed_h * DRIFT * (1.0 if self.trait.is_time else self.trait.fastest)

    @property
    def can_be_reset(self) -> bool:
        """Whether all that it shows can have been counted since the last reading, from zero."""
        shown = self.after.shown.low
        return shown <= (self.elapsed_h * DRIFT if self.trait.is_time else self.elapsed_h * self.trait.fastest)

    @property
    def is_impossible(self) -> bool:
        """Whether nothing that a counter does explains it."""
        return not (self.can_go_on or self.turns(self.most) or self.can_be_reset)
