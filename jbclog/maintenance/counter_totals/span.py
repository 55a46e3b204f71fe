"""A counter between two readings: elapsed time, possible advance, possible events."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from datetime import datetime
from functools import lru_cache

import msgspec

from jbclog.maintenance.counter_totals.observed import DRIFT, Trait

# -- interval --------------------------------------------------------------------------------------


# millions are made; a frozen dataclass takes several times as long
class Interval(msgspec.Struct, frozen=True, gc=False):
    """A number from `low` to `high`, both included; unbounded, `high` is infinite (JSON: null)."""

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
        """Return the interval divided by a positive number."""
        return Interval(self.low / amount, self.high / amount)


NOTHING = Interval(0.0, 0.0)


# -- elapsed ---------------------------------------------------------------------------------------
# The time between two looks, as far as the host's clock is right.
#
# The ledger's order is certain; the host's clock may be set back. If the times are not in that
# order, the smallest set of looks that explains it had a wrong clock: they happened between their
# neighbours, and no more is known.

HOUR = 3600.0


@lru_cache(maxsize=1 << 16)
def seconds(time: str) -> float:
    """Convert a time of the ledger to seconds since 1970."""
    return datetime.fromisoformat(time).timestamp()


class Elapsed:
    """The time between looks at `times` (seconds since 1970, in the ledger's order)."""

    def __init__(self, times: Sequence[float]) -> None:
        self.times = times
        self._right = _longest_in_order(times)
        self._is_right = frozenset(self._right)

    def is_right(self, look: int) -> bool:
        """Whether the clock of this look agrees with those of most other looks."""
        return look in self._is_right

    def at_most_h(self, begin: int, end: int) -> float:
        """Return the maximum hours between two looks, from the nearest looks with a right clock
        around them; infinite without these.
        """
        right = self._right
        before, after = bisect_right(right, begin) - 1, bisect_left(right, end)
        if before < 0 or after == len(right):
            return math.inf
        return (self.times[right[after]] - self.times[right[before]]) / HOUR


def _longest_in_order(times: Sequence[float]) -> list[int]:
    """Return the longest series of looks in order of time; of several, the one that ends first."""
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


# -- span ------------------------------------------------------------------------------------------

MANY = 1000  # roll-overs; more are not counted
LEAST_HOURS = 4.0  # fewer give no rate


def top_of(modulus: float, trait: Trait) -> float:
    """Return the last number before the counter rolls over."""
    return modulus - (trait.step or 1.0)


class Reading(msgspec.Struct, frozen=True, gc=False):
    """Reading of a counter at a look (number in the history); a moving one showed a range."""

    look: int
    shown: Interval


class Span(msgspec.Struct, frozen=True, gc=False):
    """From one reading to a later one.

    - `elapsed_h`: at most
    - `most`: the advance at the fastest plausible rate
    - `usual`: at ten times the fastest rate seen
    - `grown`: the difference of the readings, with both values of a moving one
    """

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
    def key(self) -> tuple[int, str]:
        return self.port, self.counter

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
    def can_continue(self) -> bool:
        """Whether a continued count without a roll-over explains it."""
        return not self.fell and self.grown.low <= self.most + self.trait.step

    @property
    def worked(self) -> Interval:
        """The advance if the count continued without a roll-over."""
        return Interval(
            max(0.0, self.grown.low - self.trait.step), max(0.0, self.grown.high) + self.trait.step
        )

    def roll_overs(self, most: float) -> range:
        """Return the possible numbers of roll-overs, from one, for an advance of at most `most`."""
        left = most + self.trait.step - self.grown.low
        possible = max(0, math.floor(left / self.modulus)) if math.isfinite(left) else MANY
        return range(1, 1 + min(MANY, possible))

    @property
    def at_most(self) -> float:
        """The greatest possible advance in this time, of any unit."""
        return self.elapsed_h * DRIFT * (1.0 if self.trait.is_time else self.trait.fastest)

    @property
    def can_be_reset(self) -> bool:
        """Whether it can have counted from zero to its reading since the last one."""
        shown = self.after.shown.low
        return shown <= (
            self.elapsed_h * DRIFT if self.trait.is_time else self.elapsed_h * self.trait.fastest
        )
