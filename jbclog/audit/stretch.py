"""Time between readings: how much was worked in a stretch of it, as intervals that are as narrow as the readings allow.

Neighbouring differences of whole hours are each one hour wide to either side. A counter that just went on is told by its first
and last reading alone, so over many of them it is still only one hour: `total_of` takes the width once for each unbroken series.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from functools import lru_cache
from itertools import groupby

from jbclog.audit.interval import NOTHING, Interval
from jbclog.audit.odometer import Difference, Kind

WENT_ON = frozenset({Kind.NORMAL, Kind.ZERO, Kind.ROLL_OVER})
ABOUT = 1.5  # a window of 30 days is one of 20 to 45: readings are when they are

moment = lru_cache(maxsize=65536)(datetime.fromisoformat)


def total_of(differences: Sequence[Difference]) -> Interval:
    """What all of them together are; nothing where there are none."""
    total = NOTHING
    for unbroken, group in groupby(differences, key=lambda one: one.kind in WENT_ON):
        series = list(group)
        total = total + (_unbroken(series) if unbroken else sum((one.delta for one in series), NOTHING))
    return total


def _unbroken(differences: Sequence[Difference]) -> Interval:
    grown = sum(grown_by(one) for one in differences)
    width = max(one.delta.high - grown_by(one) for one in differences)
    return Interval(max(grown - width, 0.0), grown + width)


def grown_by(one: Difference) -> float:
    """By how much the reading grew; over a roll-over by what it must have been."""
    return one.delta.middle if one.kind is Kind.ROLL_OVER else one.after - one.before


def days_of(differences: Sequence[Difference]) -> float:
    """From the first of their readings to the last."""
    return _days(differences[0].begin, differences[-1].end) if differences else 0.0


def _days(begin: str, end: str) -> float:
    return (moment(end) - moment(begin)) / timedelta(days=1)


def window(differences: Sequence[Difference], now: str, days: float) -> Sequence[Difference]:
    """Those of about the last `days`, from the reading nearest to then; none where no reading is near."""
    if not differences:
        return ()
    first = min(range(len(differences)), key=lambda at: abs(_days(differences[at].begin, now) - days))
    chosen = differences[first:]
    is_near = days_of(chosen) >= days / ABOUT and _days(chosen[0].begin, now) <= days * ABOUT
    return chosen if is_near else ()


def within(differences: Sequence[Difference], now: str, days: float) -> Sequence[Difference]:
    """Those that began within the last `days`."""
    return [one for one in differences if _days(one.begin, now) <= days]


def parted(differences: Sequence[Difference], days: float) -> Iterator[Sequence[Difference]]:
    """Neighbouring ones together, until they last at least `days`; a rest that is shorter is left out."""
    begun = 0
    for at in range(len(differences)):
        if days_of(differences[begun : at + 1]) >= days:
            yield differences[begun : at + 1]
            begun = at + 1


def ratio(part: Interval, whole: Interval) -> Interval | None:
    """Part over whole; None where the whole may be nothing or has no bound."""
    if whole.low <= 0 or not whole.is_bounded:
        return None
    return Interval(part.low / whole.high, part.high / whole.low)
