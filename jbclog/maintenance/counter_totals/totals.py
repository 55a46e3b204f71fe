"""The total use since the first audit, across resets, roll-overs and exchanged stations.

What a counter shows is a whole step: 412 hours are 412.0 to 413.0. A series of readings that just went on is told by its first
and last one, however many there were in between, so that its sum is as narrow as two readings are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

import msgspec

from jbclog.maintenance.counter_totals.span import NOTHING, Interval


class Kind(StrEnum):
    """What a difference between two readings of a counter is."""

    NORMAL = "normal"
    ZERO = "zero"
    ROLL_OVER = "roll_over"
    RESET = "reset"
    REPLACED = "replaced"
    IMPOSSIBLE = "impossible"
    SUSPECT = "suspect"


DOUBTFUL: Final = frozenset({Kind.IMPOSSIBLE, Kind.SUSPECT})
PLAIN: Final = frozenset({Kind.NORMAL, Kind.ZERO})


class Difference(msgspec.Struct, frozen=True, gc=False):
    """Between two readings, of what kind, and by which rule (its name, and a sentence).

    `delta` holds what was really worked in between (`high` infinite where nothing bounds it); `is_known` where it is no wider
    than the counter's own resolution. For a `replaced` station it is what the new one did since it was first seen: nothing.
    """

    port: int
    counter: str
    begin: str
    end: str
    before: float
    after: float
    kind: Kind
    rule: str
    text: str
    delta: Interval
    is_known: bool

    @property
    def is_doubtful(self) -> bool:
        return self.kind in DOUBTFUL


@dataclass(frozen=True, slots=True)
class CounterTotal:
    """What was worked from `since` (UTC) to the last reading: `total` holds the truth, `is_known` where it is as narrow as can be.

    `first` is what the counter showed at `since`. `marks` are all differences that are not plainly normal or zero, oldest first.
    """

    total: Interval
    since: str
    first: float
    is_known: bool
    marks: tuple[Difference, ...] = ()


class Join(StrEnum):
    """How a reading hangs together with the one before it."""

    ON = "on"  # the counter went on: only first and last reading of such a series matter
    FROM_ZERO = "from zero"  # it was reset in between: what it shows is what was worked since, and more may be lost
    LOOSE = "loose"  # only bounds are known


class Point(msgspec.Struct, frozen=True, gc=False):
    """A reading with what led to it. `shown` counts on over roll-overs; `lost` is what a reset took, or all that is known."""

    look: int
    time: str
    shown: Interval
    join: Join = Join.ON
    lost: Interval = NOTHING


@dataclass(slots=True)
class Trace:
    """A counter of one station from its first reading on: its points, and the difference that leads to each but the first.

    `aside` are differences that are no part of the sum: to readings that belong to nothing, from the station that was there before.
    """

    port: int
    counter: str
    step: float
    points: list[Point] = field(default_factory=list)
    differences: list[Difference] = field(default_factory=list)
    aside: list[Difference] = field(default_factory=list)

    @property
    def is_time(self) -> bool:
        """Whether it counts hours."""
        return self.counter.endswith("_h")

    @property
    def unit(self) -> str:
        return "h" if self.is_time else "mm" if self.counter.endswith("_mm") else "count"

    def between(self, begin: int, end: int) -> Interval:
        """What was worked from one point to a later one, both by their places."""
        total, start, from_zero = NOTHING, begin, False
        for place in range(begin + 1, end + 1):
            point = self.points[place]
            if point.join is Join.ON:
                continue
            total = total + self._series(start, place - 1, from_zero) + point.lost
            start, from_zero = place, point.join is Join.FROM_ZERO
        return total + self._series(start, end, from_zero)

    def _series(self, start: int, end: int, from_zero: bool) -> Interval:
        """A series that went on. Behind a reset its beginning is zero, not within a step of what was shown first."""
        if start == end and not from_zero:
            return NOTHING
        first, last = self.points[start].shown, self.points[end].shown
        if from_zero:
            return Interval(last.low, last.high + self.step)
        return Interval(max(0.0, last.low - first.high - self.step), last.high - first.low + self.step)

    def is_known(self, begin: int, end: int) -> bool:
        """Whether no difference between two points is in doubt."""
        return all(one.is_known for one in self.differences[begin:end])

    @property
    def odometer(self) -> CounterTotal:
        last = len(self.points) - 1
        marks = [one for one in self.differences if one.kind not in PLAIN or not one.is_known]
        return CounterTotal(
            total=self.between(0, last),
            since=self.points[0].time,
            first=self.points[0].shown.low,
            is_known=self.is_known(0, last),
            marks=tuple(sorted([*marks, *self.aside], key=lambda one: one.end)),
        )


def per_day(trace: Trace, times: Sequence[float], days: float = 28.0) -> Interval | None:
    """The pace over about the last `days`, from the latest point that is at least that long ago, or from the first; else None.

    `times` are those of the points, in seconds since 1970, NaN where the clock was wrong.
    """
    last = len(times) - 1
    right = [place for place, time in enumerate(times) if not math.isnan(time)]
    begin = max((place for place in right if times[last] - times[place] >= days * 86400), default=right[0] if right else 0)
    lasted = (times[last] - times[begin]) / 86400
    return trace.between(begin, last).per(lasted) if lasted >= 1 else None
