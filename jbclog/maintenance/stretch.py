"""A stretch of a counter's readings, and the advance over it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import lru_cache

from jbclog.maintenance.counter_totals.span import NOTHING, Interval
from jbclog.maintenance.counter_totals.totals import Trace

ABOUT = 1.5  # a window of 30 days may have 20 to 45, because readings are irregular

Believed = Callable[[int], bool]
"""Whether the time of the look of that number is right."""

moment = lru_cache(maxsize=4096)(datetime.fromisoformat)


@dataclass(frozen=True, slots=True)
class Stretch:
    """Successive readings of a trace, by index, without those whose time is wrong."""

    trace: Trace
    places: tuple[int, ...]

    @property
    def n(self) -> int:
        """Number of differences between its readings."""
        return len(self.places) - 1

    @property
    def total(self) -> Interval:
        """The advance; of an hour counter no more than the elapsed time."""
        worked = self.trace.between(self.places[0], self.places[-1])
        return (
            Interval(worked.low, min(worked.high, max(24 * self.days, worked.low)))
            if self.trace.is_time
            else worked
        )

    @property
    def times(self) -> tuple[datetime, datetime]:
        return self.at(0), self.at(-1)

    @property
    def days(self) -> float:
        begin, end = self.times
        return (end - begin) / timedelta(days=1)

    def at(self, number: int) -> datetime:
        """Return the time of its reading of that number."""
        return moment(self.trace.points[self.places[number]].time)

    def part(self, begin: int, end: int | None = None) -> Stretch:
        """Return the stretch from one of its readings to the one before `end`."""
        return replace(self, places=self.places[begin:end])


def whole(trace: Trace | None, believed: Believed = lambda look: True) -> Stretch | None:
    """Return the stretch from the first reading to the last; None unless it was read twice.
    `believed`: looks with a right time.
    """
    places = (
        []
        if trace is None
        else [place for place, point in enumerate(trace.points) if believed(point.look)]
    )
    return Stretch(trace, tuple(places)) if trace is not None and len(places) > 1 else None


def last(one: Stretch) -> Stretch:
    """Return the stretch of its last difference."""
    return one.part(-2)


def window(one: Stretch, now: str, days: float) -> Stretch | None:
    """Return the stretch from the reading nearest to `days` ago; None if no reading is near."""
    wanted = moment(now) - timedelta(days=days)
    found = one.part(min(range(one.n), key=lambda number: abs(one.at(number) - wanted)))
    is_near = (
        moment(now) - found.at(0) <= timedelta(days=days * ABOUT) and found.days >= days / ABOUT
    )
    return found if is_near else None


def within(one: Stretch | None, now: str, days: float) -> Stretch | None:
    """Return the part that began within the last `days`; None if there is none."""
    if one is None:
        return None
    first = moment(now) - timedelta(days=days)
    begin = next((number for number in range(one.n) if one.at(number) >= first), None)
    return None if begin is None else one.part(begin)


def parted(one: Stretch, days: float) -> Iterator[Stretch]:
    """Yield adjacent parts of at least `days` each, without a shorter remainder."""
    begin = 0
    for number in range(1, one.n + 1):
        if one.at(number) - one.at(begin) >= timedelta(days=days):
            yield one.part(begin, number + 1)
            begin = number


def sum_of(stretches: Sequence[Stretch]) -> Interval:
    """Return the advance over all stretches."""
    return sum((one.total for one in stretches), NOTHING)


def ratio(part: Interval, whole: Interval) -> Interval | None:
    """Return part over whole; None if the whole may be zero or has no bound."""
    if whole.low <= 0 or not whole.is_bounded:
        return None
    return Interval(part.low / whole.high, part.high / whole.low)
