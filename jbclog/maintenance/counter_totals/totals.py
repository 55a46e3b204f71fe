"""Total use since the first audit, across resets, roll-overs and exchanged stations.

A counter shows whole steps: 412 hours are 412.0 to 413.0. Only the first and the last reading of a
continued series count, so that its sum is as exact as two readings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

import msgspec

from jbclog.maintenance.counter_totals.span import NOTHING, Interval


class DifferenceKind(StrEnum):
    """Kind of a difference between two readings of a counter; the values are in audits' files."""

    NORMAL = "normal"
    ZERO = "zero"
    ROLL_OVER = "roll_over"
    RESET = "reset"
    REPLACED = "replaced"
    FELL = "fell"
    IMPOSSIBLE = "impossible"
    SUSPECT = "suspect"


DOUBTFUL: Final = frozenset(
    {DifferenceKind.FELL, DifferenceKind.IMPOSSIBLE, DifferenceKind.SUSPECT}
)
PLAIN: Final = frozenset({DifferenceKind.NORMAL, DifferenceKind.ZERO})
RATE_DAYS: Final = 28.0


class Difference(msgspec.Struct, frozen=True, gc=False):
    """The difference between two readings, its kind, and the rule that decided it (name and text).

    `delta` contains the true advance (an unbounded `high` is infinite); `is_known`: it is no wider
    than the counter's resolution. For a `replaced` station it is zero, because the new station was
    seen for the first time.
    """

    port: int
    counter: str
    start: str
    stop: str
    before: float
    after: float
    kind: DifferenceKind
    rule: str
    text: str
    delta: Interval
    is_known: bool

    @property
    def is_doubtful(self) -> bool:
        return self.kind in DOUBTFUL


CONTINUED: Final = {"unchanged": "Unchanged.", "went_on": "It advanced at a plausible rate."}
"""The rules of a counter that continues without an event, and their texts."""


def continued(
    port: int,
    counter: str,
    step: float,
    before: Interval,
    after: Interval,
    start: str,
    stop: str,
) -> Difference:
    """Return the difference of a counter that continues from what it showed at `start` to what it
    showed at `stop`.
    """
    low, high = after.low - before.high, after.high - before.low
    is_unchanged = low <= 0 <= high
    rule = "unchanged" if is_unchanged else "went_on"
    return Difference(
        port,
        counter,
        start,
        stop,
        before.low,
        after.low,
        DifferenceKind.ZERO if is_unchanged else DifferenceKind.NORMAL,
        rule,
        CONTINUED[rule],
        Interval(max(0.0, low - step), max(0.0, high) + step),
        is_known=True,
    )


@dataclass(frozen=True, slots=True)
class CounterTotal:
    """The advance from `since` (UTC) to the last reading: `total` contains the true value;
    `is_known`: no difference is in doubt.

    `first` is the reading at `since`. `marks` are all differences other than known normal and zero
    ones, oldest first.
    """

    total: Interval
    since: str
    first: float
    is_known: bool
    marks: tuple[Difference, ...] = ()


class Join(StrEnum):
    """How a reading follows the one before it."""

    ON = "on"  # the count continued: only the first and the last reading of such a series matter
    # reset in between: it shows the advance since the reset, and more may be lost
    FROM_ZERO = "from zero"
    LOOSE = "loose"  # only bounds are known


class Point(msgspec.Struct, frozen=True, gc=False):
    """A reading and how it follows the one before. `shown` includes roll-overs; `lost`: the advance
    lost by a reset; for a loose join the whole advance.
    """

    look: int
    time: str
    shown: Interval
    join: Join = Join.ON
    lost: Interval = NOTHING


@dataclass(slots=True)
class Trace:
    """A counter of one station from its first reading: its points, and the difference that leads to
    each but the first.

    `kept` has the differences: None for one of a counter that continues and has not rolled over. A
    long ledger has millions of these, so they are made of their points when asked for. `aside` are
    differences outside the sum: from the station that was replaced.
    """

    port: int
    counter: str
    step: float
    points: list[Point] = field(default_factory=list)
    kept: list[Difference | None] = field(default_factory=list)
    aside: list[Difference] = field(default_factory=list)

    @property
    def differences(self) -> list[Difference]:
        return [self.difference(place) for place in range(len(self.kept))]

    def difference(self, place: int) -> Difference:
        """Return the difference that leads to the point after `place`; -1: to the last."""
        place %= len(self.kept)
        kept = self.kept[place]
        if kept is not None:
            return kept
        before, after = self.points[place], self.points[place + 1]
        return continued(
            self.port,
            self.counter,
            self.step,
            before.shown,
            after.shown,
            before.time,
            after.time,
        )

    @property
    def is_time(self) -> bool:
        """Whether it counts hours."""
        return self.counter.endswith("_h")

    @property
    def uom(self) -> str:
        return "h" if self.is_time else "mm" if self.counter.endswith("_mm") else "count"

    def between(self, begin: int, end: int) -> Interval:
        """Return the advance from one point to a later one, both by index."""
        total, start, from_zero = NOTHING, begin, False
        for place in range(begin + 1, end + 1):
            point = self.points[place]
            if point.join is Join.ON:
                continue
            total = total + self._series(start, place - 1, from_zero) + point.lost
            start, from_zero = place, point.join is Join.FROM_ZERO
        return total + self._series(start, end, from_zero)

    def _series(self, start: int, end: int, from_zero: bool) -> Interval:
        """Return the advance of a continued series. After a reset it starts at exactly zero, not
        within a step of a reading.
        """
        if start == end and not from_zero:
            return NOTHING
        first, last = self.points[start].shown, self.points[end].shown
        if from_zero:
            return Interval(last.low, last.high + self.step)
        return Interval(
            max(0.0, last.low - first.high - self.step), last.high - first.low + self.step
        )

    def is_known(self, begin: int, end: int) -> bool:
        """Whether no difference between two points is in doubt."""
        return all(one is None or one.is_known for one in self.kept[begin:end])

    @property
    def counter_total(self) -> CounterTotal:
        last = len(self.points) - 1
        marks = [one for one in self.kept if one and (one.kind not in PLAIN or not one.is_known)]
        return CounterTotal(
            total=self.between(0, last),
            since=self.points[0].time,
            first=self.points[0].shown.low,
            is_known=self.is_known(0, last),
            marks=tuple(sorted([*marks, *self.aside], key=lambda one: one.stop)),
        )


def per_day(trace: Trace, times: Sequence[float]) -> Interval | None:
    """Return the rate from the latest point at least `RATE_DAYS` old, or from the first; None for
    less than a day.

    `times` are those of the points in seconds since 1970, NaN for a wrong clock.
    """
    last = len(times) - 1
    right = [place for place, time in enumerate(times) if not math.isnan(time)]
    begin = max(
        (place for place in right if times[last] - times[place] >= RATE_DAYS * 86400),
        default=right[0] if right else 0,
    )
    lasted = (times[last] - times[begin]) / 86400
    return trace.between(begin, last).per(lasted) if lasted >= 1 else None
