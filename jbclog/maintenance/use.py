"""How a station was used: working, idle while hot, asleep, in error.

Every figure comes from differences between readings, with the range that they allow; an unknown
figure is null with a reason. Shares refer to the time that the station was plugged in, over the
last year at most.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import lru_cache
from itertools import accumulate, pairwise
from math import sqrt
from statistics import NormalDist
from typing import Final, TypeGuard

from jbclog.maintenance.counter_totals.observed import Observation
from jbclog.maintenance.counter_totals.span import NOTHING, Interval, seconds
from jbclog.maintenance.counter_totals.totals import Join, Point, Trace
from jbclog.maintenance.fleet import UseFigure, Week, known, unknown

# -- span of use -----------------------------------------------------------------------------------
# A stretch of a counter's readings, and the advance over it.

ABOUT = 1.5  # a window of 30 days may have 20 to 45, as readings are irregular

Believed = Callable[[int], bool]
"""Whether the time of the look of that number is right."""

moment = lru_cache(maxsize=4096)(datetime.fromisoformat)


@dataclass(frozen=True, slots=True)
class Stretch:
    """Successive readings of a trace, by index, without those whose time is not believed."""

    trace: Trace
    places: tuple[int, ...]

    @property
    def n(self) -> int:
        """The number of differences between its readings."""
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


# -- idle ------------------------------------------------------------------------------------------
# Idle while hot: working hours without joints, as far as counters show them.
#
# A station counts the working hours of its tool. If it also counts joints, its best week (least
# time per joint) is a rate that it can reach, and working hours beyond that rate are idle while
# hot. This is a lower bound, as the best week has idle time too. A station that counts no joints
# has no such figure.

NAMES: Final = ("idle_hot_h", "idle_hot_percent", "idle_hot_kwh")
STRETCH_DAYS, FEWEST_JOINTS, LEAST_JOINTS = 7.0, 4, 20.0
NO_IDLE_HOURS: Final = "this station counts no joints, so its idle hours are not known"
NONE_CERTAIN: Final = "no hour is certainly idle: the joints may have taken all working hours"

Each = Sequence[Stretch | None]


def idle_of(work: Each, joints: Each, rated_power_w: float | None) -> Iterator[UseFigure]:
    """Yield the figures of ports by their working hours and joints of the last year.

    >>> [figure.why for figure in idle_of([None], [None], None)][0]
    'this station counts no joints, so its idle hours are not known'
    """
    ports = [
        (one, made)
        for one, made in zip(work, joints, strict=True)
        if one is not None and made is not None
    ]
    if not ports:
        yield from (unknown(name, NO_IDLE_HOURS) for name in NAMES)
        return
    paces = [list(_hours_a_joint(*port)) for port in ports]
    fewest = min(len(one) for one in paces)
    if fewest < FEWEST_JOINTS:
        yield from (
            unknown(name, f"not enough data: {fewest} of {FEWEST_JOINTS} weeks with joints")
            for name in NAMES
        )
        return
    hours = sum((_beyond(*port, min(one)) for port, one in zip(ports, paces, strict=True)), NOTHING)
    if hours.low <= 0:
        yield from (unknown(name, NONE_CERTAIN) for name in NAMES)
        return
    yield from _figures(hours, [one for one, _ in ports], rated_power_w)


def _hours_a_joint(work: Stretch, joints: Stretch) -> Iterator[float]:
    """Yield the hours per joint of each part of a week or more with joints: an upper bound."""
    made = {part.times: part.total for part in parted(joints, STRETCH_DAYS)}
    for part in parted(work, STRETCH_DAYS):
        count, hours = made.get(part.times, NOTHING), part.total
        if count.low >= LEAST_JOINTS and hours.low > 0 and hours.is_bounded:
            yield hours.high / count.low


def _beyond(work: Stretch, joints: Stretch, pace_h: float) -> Interval:
    return Interval(max(work.total.low - joints.total.high * pace_h, 0.0), work.total.high)


def _figures(
    idle: Interval, work: Sequence[Stretch], rated_power_w: float | None
) -> Iterator[UseFigure]:
    n, days = work[0].n, work[0].days
    share = Interval(100 * idle.low / max(sum_of(work).high, 1.0), 100.0)
    yield known("idle_hot_h", idle, n, days, stated=idle.low)
    yield known("idle_hot_percent", share, n, days, stated=share.low)
    if rated_power_w is None:
        yield unknown("idle_hot_kwh", "the line file declares no rated_power_w: hours only")
    else:
        most = idle.low * rated_power_w / 1000
        yield known("idle_hot_kwh", Interval(0.0, most), n, days, stated=most)


# -- station errors --------------------------------------------------------------------------------
# Errors of a station since the last audit, and the time between them.
#
# An audit reads the present error only; an error that ends between two audits shows only in the
# records of runs. So only hours between audits with such records count.

FEWEST_ERRORS: Final = 3
NO_RECORD: Final = "no run was recorded"
DOUBT: Final = 0.05  # to each side
SET_BACK_S: Final = 86400.0  # a mark further ahead is from a wrong clock


def errors_of(looks: Sequence[Observation]) -> Iterator[UseFigure]:
    """Yield the figures of these looks at a station, oldest first; the first starts the time."""
    pairs = [(before, now) for before, now in pairwise(looks) if now.errors.events is not None]
    if pairs and pairs[-1][1] is looks[-1]:
        count = float(count_of(looks[-1]))
        yield known("errors_last", Interval(count, count), 1, _days(*pairs[-1]))
    else:
        yield unknown("errors_last", NO_RECORD)
    yield _mtbf(
        sum(count_of(now) for _, now in pairs),
        sum(_plugged(*pair) for pair in pairs),
        len(pairs),
        looks,
    )


def counted_until(looks: Sequence[Observation], now: str) -> str | None:
    """Return the time from which to count errors: where the last count ended, or when the station
    was last seen; None: never.

    A clock set back a little counts no error twice; marks of a clock that was far ahead do not
    count.
    """
    marks = [look.errors.until for look in looks if look.errors.until is not None] or [
        look.time for look in looks
    ]
    latest = seconds(now) + SET_BACK_S
    return max((mark for mark in marks if seconds(mark) <= latest), key=seconds, default=None)


def count_of(look: Observation) -> int:
    """Return the number of error events in the runs since the look before."""
    return sum(
        count for kind, count in (look.errors.events or {}).items() if kind.endswith(".error")
    )


def _mtbf(count: int, hours: float, n: int, looks: Sequence[Observation]) -> UseFigure:
    if not n:
        return unknown("error_mtbf_h", NO_RECORD)
    if count < FEWEST_ERRORS or hours <= 0:
        return unknown("error_mtbf_h", f"not enough data: {count} of {FEWEST_ERRORS} errors")
    few, many = poisson_bounds(count, DOUBT)
    return known(
        "error_mtbf_h",
        Interval(hours / many, hours / few),
        n,
        _days(looks[0], looks[-1]),
        stated=hours / count,
    )


def _plugged(before: Observation, now: Observation) -> float:
    """Return the hours plugged in between two looks, of the port with most; 0 if not known."""
    first, last = _hours(before), _hours(now)
    return max((last[port] - first[port] for port in last if port in first), default=0.0)


def _hours(look: Observation) -> dict[int, float]:
    """Return the plugged-in hours of each port."""
    return {
        one.port: one.value
        for one in look.counts
        if one.counter in ("plugged_h", "on_h") and one.value is not None
    }


def _days(before: Observation, now: Observation) -> float:
    return (moment(now.time) - moment(before.time)).total_seconds() / 86400


def poisson_bounds(count: int, doubt: float) -> tuple[float, float]:
    """Return the confidence bounds of a Poisson mean after `count` events, each wrong with the
    probability `doubt`.

    After Wilson and Hilferty (1931); within 1 % of the exact bounds from three events on (exact
    here: 0.818 and 7.754).

    >>> [round(bound, 2) for bound in poisson_bounds(3, 0.05)]
    [0.81, 7.74]
    """
    z = NormalDist().inv_cdf(1 - doubt)
    return _hilferty(count, -z), _hilferty(count + 1, z)


def _hilferty(count: int, z: float) -> float:
    return count * (1 - 1 / (9 * count) + z / (3 * sqrt(count))) ** 3


# -- use -------------------------------------------------------------------------------------------

YEAR, MONTH = 365.0, 30.0
WORK: Final = "work_h"
PLUGGED: Final = ("plugged_h", "on_h")  # the second is that of hot air stations
JOINTS: Final = ("dispensed_cycles", "desolder_cycles")
SHARES: Final = {
    "use_percent": (WORK,),
    "sleep_percent": ("sleep_h", "hibernation_h"),
    "no_tool_percent": ("no_tool_h",),
}
NOT_TWICE: Final = "not counted here, or not read twice yet"
NO_JOINTS: Final = "this station counts no joints"


@dataclass(frozen=True, slots=True)
class Past:
    """The history of one station: its counters' traces by port and name, and the looks that it
    answered, oldest first.
    """

    traces: Mapping[tuple[int, str], Trace]
    looks: Sequence[Observation]
    now: str
    rated_power_w: float | None = None
    believed: Believed = lambda look: True

    @property
    def ports(self) -> tuple[int, ...]:
        return tuple(sorted({port for port, _ in self.traces}))

    def of(self, port: int, *counters: str) -> Stretch | None:
        """Return the whole stretch of the first of these counters read twice at this port."""
        found = (whole(self.traces.get((port, name)), self.believed) for name in counters)
        return next((one for one in found if one is not None), None)

    def last_year(self, port: int, *counters: str) -> Stretch | None:
        """Return the part of `of` that began within the last year."""
        return within(self.of(port, *counters), self.now, YEAR)


def use_of(past: Past) -> tuple[UseFigure, ...]:
    """Return every figure: of all ports together (port null), and of each of several ports."""
    ports = past.ports
    found = list(_of_ports(past, ports))
    if len(ports) > 1:
        found += [replace(one, port=port) for port in ports for one in _of_ports(past, (port,))]
    return (*found, *errors_of(past.looks))


def _of_ports(past: Past, ports: Sequence[int]) -> Iterator[UseFigure]:
    yield from _hours_worked(past, ports)
    yield from (_share(past, ports, name, parts) for name, parts in SHARES.items())
    joints = [_joints(past, port) for port in ports]
    yield from _joint_rates(past, ports, joints)
    yield from _solder_wire(past, ports)
    work = [past.last_year(port, WORK) for port in ports]
    yield from idle_of(work, joints, past.rated_power_w)


# -- hours -----------------------------------------------------------------------------------------


def _hours_worked(past: Past, ports: Sequence[int]) -> Iterator[UseFigure]:
    each = [past.of(port, WORK) for port in ports]
    newest = [one and last(one) for one in each]
    yield _figure("work_h_last", newest, sum_of(newest) if are_all(newest) else None)
    yield _a_day("work_h_a_day_30", each, past.now, MONTH)
    yield _a_day("work_h_a_day_365", each, past.now, YEAR)


def _a_day(name: str, each: Each, now: str, days: float) -> UseFigure:
    near = [one and window(one, now, days) for one in each]
    if are_all(each) and not are_all(near):
        return unknown(name, f"no reading about {days:.0f} days ago")
    return _figure(name, near, sum_of(near).per(near[0].days) if are_all(near) else None)


def _share(past: Past, ports: Sequence[int], name: str, parts: Sequence[str]) -> UseFigure:
    plugged = [past.last_year(port, *PLUGGED) for port in ports]
    each = [past.last_year(port, part) for port in ports for part in parts]
    if not are_all(plugged) or not are_all(each):
        return unknown(name, NOT_TWICE)
    share = ratio(sum_of(each), sum_of(plugged))
    most_100 = share and Interval(100 * share.low, min(100 * share.high, 100.0))
    return _figure(name, each, most_100, "not plugged in long enough")


# -- joints and solder wire ------------------------------------------------------------------------


def _joints(past: Past, port: int) -> Stretch | None:
    """Return the joints of the last year at this port: wire feeds, else desoldering cycles; None if
    nothing was counted.
    """
    each = (past.last_year(port, name) for name in JOINTS)
    return next((one for one in each if one is not None and one.total.high > 0), None)


def _joint_rates(past: Past, ports: Sequence[int], joints: Each) -> Iterator[UseFigure]:
    counted = [(port, one) for port, one in zip(ports, joints, strict=True) if one is not None]
    if not counted:
        yield from (unknown(name, NO_JOINTS) for name in ("joints_a_day", "joints_a_work_h"))
        return
    made = [one for _, one in counted]
    yield _figure("joints_a_day", made, sum_of(made).per(made[0].days))
    work = [past.last_year(port, WORK) for port, _ in counted]
    rate = ratio(sum_of(made), sum_of(work)) if are_all(work) else None
    yield _figure("joints_a_work_h", made, rate, "hardly any working hours")


def _solder_wire(past: Past, ports: Sequence[int]) -> Iterator[UseFigure]:
    wire, feeds = (
        [past.last_year(port, name) for port in ports]
        for name in ("dispensed_mm", "dispensed_cycles")
    )
    pairs = [
        (one, fed)
        for one, fed in zip(wire, feeds, strict=True)
        if one is not None and fed is not None
    ]
    if not pairs:
        yield from (
            unknown(name, "this station feeds no solder wire")
            for name in ("mm_a_joint", "mm_a_joint_before")
        )
        return
    late = [(lately(one, past.now), lately(fed, past.now)) for one, fed in pairs]
    early = [
        (before(one, new), before(fed, made))
        for (one, fed), (new, made) in zip(pairs, late, strict=True)
    ]
    for name, some in (("mm_a_joint", late), ("mm_a_joint_before", early)):
        length, fed_often = [one for one, _ in some], [fed for _, fed in some]
        known_mm = (
            ratio(sum_of(length), sum_of(fed_often))
            if are_all(length) and are_all(fed_often)
            else None
        )
        yield _figure(name, length, known_mm, "no solder wire was fed")


def lately(one: Stretch, now: str) -> Stretch:
    """Return about the last 30 days; with rarer readings, the last difference alone."""
    return window(one, now, MONTH) or last(one)


def before(one: Stretch, later: Stretch) -> Stretch | None:
    """Return the part before `later`; None if there is none."""
    return one.part(0, one.n + 1 - later.n) if one.n > later.n else None


def are_all(each: Each) -> TypeGuard[Sequence[Stretch]]:
    """Whether there are ports and each has a stretch."""
    return bool(each) and None not in each


def _figure(name: str, each: Each, value: Interval | None, otherwise: str = NOT_TWICE) -> UseFigure:
    if not are_all(each):
        return unknown(name, NOT_TWICE)
    if value is None:
        return unknown(name, otherwise)
    return known(name, value, max(one.n for one in each), each[0].days)


# -- weeks -----------------------------------------------------------------------------------------
# A station's year by week: working hours per day of all ports, for the plots of use.
#
# Between two readings the hours are spread evenly, and marked if the readings are further apart
# than a week. A continued counter is uncertain by its resolution once, not with each reading.

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
    """The least and greatest advance of a counter at each reading, and its resolution."""

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
        share = (when - self.times[at - 1]) / (self.times[at] - self.times[at - 1])
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
