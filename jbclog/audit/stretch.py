"""A stretch of a counter's time, from one of its readings to a later one, and what was worked in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import lru_cache

from jbclog.audit.interval import NOTHING, Interval
from jbclog.audit.odometer import Trace

ABOUT = 1.5  # a window of 30 days is one of 20 to 45: readings are when they are

moment = lru_cache(maxsize=4096)(datetime.fromisoformat)


@dataclass(frozen=True, slots=True)
class Stretch:
    """From the point `begin` of a trace to its point `end`, by their places."""

    trace: Trace
    begin: int
    end: int

    @property
    def n(self) -> int:
        """Differences between readings in it."""
        return self.end - self.begin

    @property
    def total(self) -> Interval:
        return self.trace.between(self.begin, self.end)

    @property
    def times(self) -> tuple[datetime, datetime]:
        return self.at(self.begin), self.at(self.end)

    @property
    def days(self) -> float:
        begin, end = self.times
        return (end - begin) / timedelta(days=1)

    def at(self, place: int) -> datetime:
        """When a reading was."""
        return moment(self.trace.points[place].time)


def whole(trace: Trace | None) -> Stretch | None:
    """From its first reading to its last; None where it was not read twice."""
    return Stretch(trace, 0, len(trace.points) - 1) if trace is not None and len(trace.points) > 1 else None


def last(one: Stretch) -> Stretch:
    """Its last difference alone."""
    return replace(one, begin=one.end - 1)


def window(one: Stretch, now: str, days: float) -> Stretch | None:
    """About the last `days`, from the reading nearest to then; None where no reading is near."""
    wanted = moment(now) - timedelta(days=days)
    begin = min(range(one.begin, one.end), key=lambda place: abs(one.at(place) - wanted))
    found = replace(one, begin=begin)
    is_near = moment(now) - one.at(begin) <= timedelta(days=days * ABOUT) and found.days >= days / ABOUT
    return found if is_near else None


def within(one: Stretch | None, now: str, days: float) -> Stretch | None:
    """The part that began within the last `days`; None where there is none."""
    if one is None:
        return None
    first = moment(now) - timedelta(days=days)
    begin = next((place for place in range(one.begin, one.end) if one.at(place) >= first), None)
    return None if begin is None else replace(one, begin=begin)


def parted(one: Stretch, days: float) -> Iterator[Stretch]:
    """Neighbouring parts of at least `days` each; a rest that is shorter is left out."""
    begin = one.begin
    for place in range(one.begin + 1, one.end + 1):
        part = Stretch(one.trace, begin, place)
        if part.days >= days:
            yield part
            begin = place


def sum_of(stretches: Sequence[Stretch]) -> Interval:
    """What was worked in all of them."""
    return sum((one.total for one in stretches), NOTHING)


def ratio(part: Interval, whole: Interval) -> Interval | None:
    """Part over whole; None where the whole may be nothing or has no bound."""
    if whole.low <= 0 or not whole.is_bounded:
        return None
    return Interval(part.low / whole.high, part.high / whole.low)
