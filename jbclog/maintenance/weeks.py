"""A station's year by week: working hours per day of all ports, for the plots of use.

Between two readings the hours are spread evenly, and marked if the readings are further apart than
a week. A continued counter is uncertain by its resolution once, not with each reading.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from datetime import datetime, timedelta
from itertools import accumulate, pairwise
from typing import Final

from jbclog.maintenance.counter_totals.span import NOTHING, Interval
from jbclog.maintenance.counter_totals.totals import Join, Point, Trace
from jbclog.maintenance.fleet import Week
from jbclog.maintenance.stretch import Believed, Stretch, moment, whole

WEEKS, DAYS = 53, 7
FAR: Final = timedelta(days=10)


def weeks_of(
    each: Sequence[Trace], now: str, believed: Believed = lambda look: True
) -> tuple[Week, ...]:
    """Return the last 53 weeks up to `now`, oldest first, of ports with these working hours; none
    if no port was read twice.
    """
    stretches = [whole(one, believed) for one in each]
    if not any(stretches):
        return ()
    courses = [_Course(one) for one in stretches]
    end = moment(now)
    begins = [end - timedelta(days=DAYS * (WEEKS - week)) for week in range(WEEKS)]
    return tuple(_week(courses, begin, begin + timedelta(days=DAYS)) for begin in begins)


def _week(courses: Sequence[_Course], begin: datetime, end: datetime) -> Week:
    parts = [part for course in courses if (part := course.between(begin, end)) is not None]
    if len(parts) < len(courses):
        return Week(begin.date().isoformat(), None)
    is_spread = any(course.is_spread(begin, end) for course in courses)
    return Week(begin.date().isoformat(), sum(parts, NOTHING).per(DAYS), is_spread)


class _Course:
    """Lower and upper bound of a counter's advance at each reading, and its resolution."""

    def __init__(self, stretch: Stretch | None) -> None:
        places = [] if stretch is None else stretch.places
        points = [] if stretch is None else stretch.trace.points
        self.times = [moment(points[place].time) for place in places]
        self.far = [pair for pair in pairwise(self.times) if pair[1] - pair[0] > FAR]
        self.fine = 0.0 if stretch is None else stretch.trace.step
        grown = [_over(points[begin : end + 1]) for begin, end in pairwise(places)]
        self.low = [0.0, *accumulate(one.low for one in grown)]
        self.high = [0.0, *accumulate(one.high for one in grown)]

    def between(self, begin: datetime, end: datetime) -> Interval | None:
        """Return its advance; None outside the readings or without a bound."""
        if (
            not self.times
            or begin < self.times[0] - timedelta(days=1)
            or end > self.times[-1] + timedelta(days=1)
        ):
            return None
        low, high = (
            self._at(course, end) - self._at(course, begin) for course in (self.low, self.high)
        )
        grown = Interval(max(low - self.fine, 0.0), high + self.fine)
        return grown if grown.is_bounded else None

    def _at(self, course: Sequence[float], when: datetime) -> float:
        """Return the value at `when`, interpolated linearly between two readings."""
        at = min(max(bisect_right(self.times, when), 1), len(self.times) - 1)
        before, lasted = self.times[at - 1], self.times[at] - self.times[at - 1]
        share = (when - before) / lasted if lasted else float(when >= before)
        return course[at - 1] + min(max(share, 0.0), 1.0) * (course[at] - course[at - 1])

    def is_spread(self, begin: datetime, end: datetime) -> bool:
        """Whether a part of this time is between two readings that are far apart."""
        return any(before < end and after > begin for before, after in self.far)


def _over(points: Sequence[Point]) -> Interval:
    """Return the advance from the first point to the last, no more than the elapsed time."""
    grown = sum((_grown(*pair) for pair in pairwise(points)), NOTHING)
    hours = (moment(points[-1].time) - moment(points[0].time)) / timedelta(hours=1)
    return Interval(grown.low, min(grown.high, max(hours, grown.low)))


def _grown(before: Point, after: Point) -> Interval:
    """Return the advance from one reading to the next, without the resolution's uncertainty."""
    if after.join is Join.ON:
        grown = after.shown.middle - before.shown.middle
        return Interval(grown, grown)
    return after.lost + after.shown if after.join is Join.FROM_ZERO else after.lost
