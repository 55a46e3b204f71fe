"""A stretch of a counter's time, from one of its readings to a later one, and what was worked in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import lru_cache

from jbclog.maintenance.counter_totals.interval import NOTHING, Interval
from jbclog.maintenance.counter_totals.totals import Trace

ABOUT = 1.5  # a window of 30 days is one of 20 to 45: readings are when they are

Believed = Callable[[int], bool]
"""Whether the time of a look, by its number, is right."""

moment = lru_cache(maxsize=4096)(datetime.fromisoformat)


@dataclass(frozen=True, slots=True)
class Stretch:
    """Readings of a trace that follow each other, by their places; those whose time is not believed are left out."""

    trace: Trace
    places: tuple[int, ...]

    @property
    def n(self) -> int:
        """Differences between readings in it."""
        return len(self.places) - 1

    @property
    def total(self) -> Interval:
        """What was worked; of hours never more than went by."""
        worked = self.trace.between(self.places[0], self.places[-1])
        return Interval(worked.low, min(worked.high, max(24 * self.days, worked.low))) if self.trace.is_time else worked

    @property
    def times(self) -> tuple[datetime, datetime]:
        return self.at(0), self.at(-1)

    @property
    def days(self) -> float:
        begin, end = self.times
        return (end - begin) / timedelta(days=1)

    def at(self, number: int) -> datetime:
        """When the reading of that number in it was."""
        return moment(self.trace.points[self.places[number]].time)

    def part(self, begin: int, end: int | None = None) -> Stretch:
        """From one of its readings on, to before another."""
        return replace(self, places=self.places[begin:end])


def whole(trace: Trace | None, believed: Believed = lambda look: True) -> Stretch | None:
    """From its first reading to its last; None where it was not read twice. `believed` are looks whose times are right."""
    places = [] if trace is None else [place for place, point in enumerate(trace.points) if believed(point.look)]
    return Stretch(trace, tuple(places)) if trace is not None and len(places) > 1 else None


def last(one: Stretch) -> Stretch:
    """Its last difference alone."""
    return one.part(-2)


def window(one: Stretch, now: str, days: float) -> Stretch | None:
    """About the last `days`, from the reading nearest to then; None where no reading is near."""
    wanted = moment(now) - timedelta(days=days)
    found = one.part(min(range(one.n), key=lambda number: abs(one.at(number) - wanted)))
    is_near = moment(now) - found.at(0) <= timedelta(days=days * ABOUT) and found.days >= days / ABOUT
    return found if is_near else None


def within(one: Stretch | None, now: str, days: float) -> Stretch | None:
    """The part that began within the last `days`; None where there is none."""
    if one is None:
        return None
    first = moment(now) - timedelta(days=days)
    begin = next((number for number in range(one.n) if one.at(number) >= first), None)
    return None if begin is None else one.part(begin)


def parted(one: Stretch, days: float) -> Iterator[Stretch]:
    """Neighbouring parts of at least `days` each; a rest that is shorter is left out."""
    begin = 0
    for number in range(1, one.n + 1):
        if one.at(number) - one.at(begin) >= timedelta(days=days):
            yield one.part(begin, number + 1)
            begin = number


def sum_of(stretches: Sequence[Stretch]) -> Interval:
    """What was worked in all of them."""
    return sum((one.total for one in stretches), NOTHING)


def ratio(part: Interval, whole: Interval) -> Interval | None:
    """Part over whole; None where the whole may be nothing or has no bound."""
    if whole.low <= 0 or not whole.is_bounded:
        return None
    return Interval(part.low / whole.high, part.high / whole.low)
