"""How a station was used: working, idle while hot, asleep, in error.

Every figure is of the differences between readings, with the range that they allow; what they cannot tell is null with a reason.
Shares are of the time that the station was plugged in, over the last year at most.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import lru_cache
from itertools import pairwise
from math import sqrt
from statistics import NormalDist
from typing import Final, TypeGuard

from jbclog.maintenance.counter_totals.observed import Observation
from jbclog.maintenance.counter_totals.span import NOTHING, Interval, seconds
from jbclog.maintenance.counter_totals.totals import Trace
from jbclog.maintenance.fleet import UseFigure, known, unknown

# -- span of use --------------------------------------------------------------------------------------------------------------
# A stretch of a counter's time, from one of its readings to a later one, and what was worked in it.

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


# -- idle ---------------------------------------------------------------------------------------------------------------------
# Hot idle time: working hours in which no joint was made, as far as counters can tell it.
#
# A station counts the hours that its tool works, not what it does with them. Where it counts joints as well, the week in which it
# took the least time for each is a pace that it can keep; what it worked beyond that pace, it was hot for nothing. That is a lower
# bound: even its best week has idle time in it. Where nothing counts joints, nothing is claimed.

NAMES: Final = ("idle_hot_h", "idle_hot_percent", "idle_hot_kwh")
STRETCH_DAYS, FEWEST_JOINTS, LEAST_JOINTS = 7.0, 4, 20.0
NO_IDLE_HOURS: Final = "this station counts no joints, so that its working hours cannot be told from idle ones"

NONE_SURE: Final = "no idle hour is sure: what is known of hours and joints leaves room for none"

Each = Sequence[Stretch | None]


def idle_of(work: Each, joints: Each, rated_power_w: float | None) -> Iterator[UseFigure]:
    """The figures of ports whose working hours and joints of the last year these are.

    >>> [figure.why for figure in idle_of([None], [None], None)][0]
    'this station counts no joints, so that its working hours cannot be told from idle ones'
    """
    ports = [(one, made) for one, made in zip(work, joints, strict=True) if one is not None and made is not None]
    if not ports:
        yield from (unknown(name, NO_IDLE_HOURS) for name in NAMES)
        return
    paces = [list(_hours_a_joint(*port)) for port in ports]
    fewest = min(len(one) for one in paces)
    if fewest < FEWEST_JOINTS:
        yield from (unknown(name, f"not enough data: {fewest} of {FEWEST_JOINTS} weeks with joints") for name in NAMES)
        return
    hours = sum((_beyond(*port, min(one)) for port, one in zip(ports, paces, strict=True)), NOTHING)
    if hours.low <= 0:
        yield from (unknown(name, NONE_SURE) for name in NAMES)
        return
    yield from _figures(hours, [one for one, _ in ports], rated_power_w)


def _hours_a_joint(work: Stretch, joints: Stretch) -> Iterator[float]:
    """Hours a joint in each part of a week or more that has joints: no less than it really took."""
    made = {part.times: part.total for part in parted(joints, STRETCH_DAYS)}
    for part in parted(work, STRETCH_DAYS):
        count, hours = made.get(part.times, NOTHING), part.total
        if count.low >= LEAST_JOINTS and hours.low > 0 and hours.is_bounded:
            yield hours.high / count.low


def _beyond(work: Stretch, joints: Stretch, pace_h: float) -> Interval:
    return Interval(max(work.total.low - joints.total.high * pace_h, 0.0), work.total.high)


def _figures(idle: Interval, work: Sequence[Stretch], rated_power_w: float | None) -> Iterator[UseFigure]:
    n, days = work[0].n, work[0].days
    share = Interval(100 * idle.low / max(sum_of(work).high, 1.0), 100.0)
    yield known("idle_hot_h", idle, n, days, stated=idle.low)
    yield known("idle_hot_percent", share, n, days, stated=share.low)
    if rated_power_w is None:
        yield unknown("idle_hot_kwh", "the line file declares no rated_power_w: hours only")
    else:
        most = idle.low * rated_power_w / 1000
        yield known("idle_hot_kwh", Interval(0.0, most), n, days, stated=most)


# -- station errors -----------------------------------------------------------------------------------------------------------
# Errors of a station since last time, and how far apart they are: only where the records of runs tell.
#
# An audit reads which error there is now; one that came and went between two audits it cannot see. Runs see those that happen
# during them. So the hours that count are those of readings behind which a run's record stands.

FEWEST_ERRORS: Final = 3
NO_RECORD: Final = "no run was recorded that would tell"
DOUBT: Final = 0.05  # to each side
SET_BACK_S: Final = 86400.0  # a mark that lies further ahead than this is of a wrong clock


def errors_of(looks: Sequence[Observation]) -> Iterator[UseFigure]:
    """The figures of these looks at one station, oldest first; the first of them has no time before it."""
    told = [(before, now) for before, now in pairwise(looks) if now.errors.events is not None]
    if told and told[-1][1] is looks[-1]:
        count = float(count_of(looks[-1]))
        yield known("errors_last", Interval(count, count), 1, _days(*told[-1]))
    else:
        yield unknown("errors_last", NO_RECORD)
    yield _apart(sum(count_of(now) for _, now in told), sum(_plugged(*pair) for pair in told), len(told), looks)


def counted_until(looks: Sequence[Observation], now: str) -> str | None:
    """From when on errors are to be counted at one station: where the looks at it ended to count, or when it was last seen.

    A clock that is set back a little counts nothing twice; a mark of a clock that was far ahead does not count. None: never seen.
    """
    marks = [look.errors.until for look in looks if look.errors.until is not None] or [look.time for look in looks]
    latest = seconds(now) + SET_BACK_S
    return max((mark for mark in marks if seconds(mark) <= latest), key=seconds, default=None)


def count_of(look: Observation) -> int:
    """Events of errors, of whatever kind, in the runs since the look before."""
    return sum(count for kind, count in (look.errors.events or {}).items() if kind.endswith(".error"))


def _apart(count: int, hours: float, n: int, looks: Sequence[Observation]) -> UseFigure:
    if not n:
        return unknown("error_mtbf_h", NO_RECORD)
    if count < FEWEST_ERRORS or hours <= 0:
        return unknown("error_mtbf_h", f"not enough data: {count} of {FEWEST_ERRORS} errors")
    few, many = poisson_bounds(count, DOUBT)
    return known("error_mtbf_h", Interval(hours / many, hours / few), n, _days(looks[0], looks[-1]), stated=hours / count)


def _plugged(before: Observation, now: Observation) -> float:
    """Hours plugged in from one look to the next, of the port that counted most; 0 where the counters do not tell."""
    first, last = _hours(before), _hours(now)
    return max((last[port] - first[port] for port in last if port in first), default=0.0)


def _hours(look: Observation) -> dict[int, float]:
    """The hours that each port was plugged in."""
    return {one.port: one.value for one in look.counts if one.counter in ("plugged_h", "on_h") and one.value is not None}


def _days(before: Observation, now: Observation) -> float:
    return (moment(now.time) - moment(before.time)).total_seconds() / 86400


# -- how many there could have been ---------------------------------------------------------------------------------------------


def poisson_bounds(count: int, doubt: float) -> tuple[float, float]:
    """The least and the greatest mean that `count` events leave, each with a chance of `doubt` to be wrong.

    After Wilson and Hilferty (1931); from three events on within 1 % of the exact ones, which are 0.818 and 7.754 for these.

    >>> [round(bound, 2) for bound in poisson_bounds(3, 0.05)]
    [0.81, 7.74]
    """
    z = NormalDist().inv_cdf(1 - doubt)
    return _hilferty(count, -z), _hilferty(count + 1, z)


def _hilferty(count: int, z: float) -> float:
    return count * (1 - 1 / (9 * count) + z / (3 * sqrt(count))) ** 3


# -- use ----------------------------------------------------------------------------------------------------------------------

YEAR, MONTH = 365.0, 30.0
WORK: Final = "work_h"
PLUGGED: Final = ("plugged_h", "on_h")  # hot air stations call it so
JOINTS: Final = ("dispensed_cycles", "desolder_cycles")
SHARES: Final = {"use_percent": (WORK,), "sleep_percent": ("sleep_h", "hibernation_h"), "no_tool_percent": ("no_tool_h",)}
NOT_TWICE: Final = "not counted here, or not read twice yet"
NO_JOINTS: Final = "this station counts no joints"

"""The same time of one counter at each port; None where it was not read twice."""


@dataclass(frozen=True, slots=True)
class Past:
    """What is known of one station: its counters' traces by port and name, and the looks that saw it, oldest first."""

    traces: Mapping[tuple[int, str], Trace]
    looks: Sequence[Observation]
    now: str
    rated_power_w: float | None = None
    believed: Believed = lambda look: True

    @property
    def ports(self) -> tuple[int, ...]:
        return tuple(sorted({port for port, _ in self.traces}))

    def of(self, port: int, *counters: str) -> Stretch | None:
        """All of the first of these counters that was read twice at this port."""
        found = (whole(self.traces.get((port, name)), self.believed) for name in counters)
        return next((one for one in found if one is not None), None)

    def last_year(self, port: int, *counters: str) -> Stretch | None:
        """The part of it that began within the last year."""
        return within(self.of(port, *counters), self.now, YEAR)


def use_of(past: Past) -> tuple[UseFigure, ...]:
    """Every figure: of all ports together (port null), and of each where there are several."""
    ports = past.ports
    found = list(_of_ports(past, ports))
    if len(ports) > 1:
        found += [replace(one, port=port) for port in ports for one in _of_ports(past, (port,))]
    return (*found, *errors_of(past.looks))


def _of_ports(past: Past, ports: Sequence[int]) -> Iterator[UseFigure]:
    yield from _worked(past, ports)
    yield from (_share(past, ports, name, parts) for name, parts in SHARES.items())
    joints = [_joints(past, port) for port in ports]
    yield from _paces(past, ports, joints)
    yield from _wire(past, ports)
    work = [past.last_year(port, WORK) for port in ports]
    yield from idle_of(work, joints, past.rated_power_w)


# -- how much it worked -----------------------------------------------------------------------------------------------------


def _worked(past: Past, ports: Sequence[int]) -> Iterator[UseFigure]:
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
    return _figure(name, each, most_100, "not plugged in long enough to tell")


# -- joints and wire --------------------------------------------------------------------------------------------------------


def _joints(past: Past, port: int) -> Stretch | None:
    """The counter that counts joints at this port: feeds, or what was desoldered if anything ever was; else none."""
    each = (past.last_year(port, name) for name in JOINTS)
    return next((one for one in each if one is not None and one.total.high > 0), None)


def _paces(past: Past, ports: Sequence[int], joints: Each) -> Iterator[UseFigure]:
    counted = [(port, one) for port, one in zip(ports, joints, strict=True) if one is not None]
    if not counted:
        yield from (unknown(name, NO_JOINTS) for name in ("joints_a_day", "joints_a_work_h"))
        return
    made = [one for _, one in counted]
    yield _figure("joints_a_day", made, sum_of(made).per(made[0].days))
    work = [past.last_year(port, WORK) for port, _ in counted]
    yield _figure(
        "joints_a_work_h", made, ratio(sum_of(made), sum_of(work)) if are_all(work) else None, "hardly any hour was worked"
    )


def _wire(past: Past, ports: Sequence[int]) -> Iterator[UseFigure]:
    wire, feeds = ([past.last_year(port, name) for port in ports] for name in ("dispensed_mm", "dispensed_cycles"))
    pairs = [(one, fed) for one, fed in zip(wire, feeds, strict=True) if one is not None and fed is not None]
    if not pairs:
        yield from (unknown(name, "this station feeds no wire") for name in ("mm_a_joint", "mm_a_joint_before"))
        return
    late = [(lately(one, past.now), lately(fed, past.now)) for one, fed in pairs]
    early = [(before(one, new), before(fed, made)) for (one, fed), (new, made) in zip(pairs, late, strict=True)]
    for name, some in (("mm_a_joint", late), ("mm_a_joint_before", early)):
        length, fed_often = [one for one, _ in some], [fed for _, fed in some]
        known_mm = ratio(sum_of(length), sum_of(fed_often)) if are_all(length) and are_all(fed_often) else None
        yield _figure(name, length, known_mm, "nothing was fed")


def lately(one: Stretch, now: str) -> Stretch:
    """About the last 30 days; the last difference alone where readings are rarer."""
    return window(one, now, MONTH) or last(one)


def before(one: Stretch, later: Stretch) -> Stretch | None:
    """What is before a later part of it; None where that is all."""
    return one.part(0, one.n + 1 - later.n) if one.n > later.n else None


# -- as figures -------------------------------------------------------------------------------------------------------------


def are_all(each: Each) -> TypeGuard[Sequence[Stretch]]:
    """Whether each port's is known; not of no port at all."""
    return bool(each) and None not in each


def _figure(name: str, each: Each, value: Interval | None, otherwise: str = NOT_TWICE) -> UseFigure:
    if not are_all(each):
        return unknown(name, NOT_TWICE)
    if value is None:
        return unknown(name, otherwise)
    return known(name, value, max(one.n for one in each), each[0].days)
