"""Use of a station: working, idle while hot, asleep, in error.

Every figure comes from differences between readings, with the range that they allow; an unknown
figure is null with a reason. Shares are of the time that the station was plugged in, over the last
year at most.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeGuard

from jbclog.maintenance.counter_totals.observed import Observation
from jbclog.maintenance.counter_totals.span import NOTHING, Interval
from jbclog.maintenance.counter_totals.totals import Trace
from jbclog.maintenance.fleet import UseFigure, known, unknown
from jbclog.maintenance.station_errors import errors_of
from jbclog.maintenance.stretch import (
    Believed,
    Stretch,
    last,
    parted,
    ratio,
    sum_of,
    whole,
    window,
    within,
)

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

Each = Sequence[Stretch | None]


@dataclass(frozen=True, slots=True)
class Past:
    """History of one station: its counters' traces by port and name, and the looks that it
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
        """Return the whole stretch of the first of these counters that was read twice at this
        port.
        """
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
    days = made[0].days  # none between two looks at the same time
    yield _figure("joints_a_day", made, sum_of(made).per(days) if days else None)
    work = [past.last_year(port, WORK) for port, _ in counted]
    yield _figure("joints_a_work_h", made, _rate(made, work), "hardly any working hours")


def _solder_wire(past: Past, ports: Sequence[int]) -> Iterator[UseFigure]:
    wire, feeds = (
        [past.last_year(port, name) for port in ports]
        for name in ("dispensed_mm", "dispensed_cycles")
    )
    pairs = _both_known(wire, feeds)
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
        yield _figure(name, length, _rate(length, fed_often), "no solder wire was fed")


def lately(one: Stretch, now: str) -> Stretch:
    """Return about the last 30 days; with rarer readings, the last difference alone."""
    return window(one, now, MONTH) or last(one)


def before(one: Stretch, later: Stretch) -> Stretch | None:
    """Return the part before `later`; None if there is none."""
    return one.part(0, one.n + 1 - later.n) if one.n > later.n else None


def are_all(each: Each) -> TypeGuard[Sequence[Stretch]]:
    """Whether there are ports and each has a stretch."""
    return bool(each) and None not in each


def _rate(part: Each, whole: Each) -> Interval | None:
    return ratio(sum_of(part), sum_of(whole)) if are_all(part) and are_all(whole) else None


def _both_known(each: Each, others: Each) -> list[tuple[Stretch, Stretch]]:
    """Return the stretches of the ports where both are known."""
    pairs = zip(each, others, strict=True)
    return [(one, other) for one, other in pairs if one is not None and other is not None]


def _figure(name: str, each: Each, value: Interval | None, otherwise: str = NOT_TWICE) -> UseFigure:
    if not are_all(each):
        return unknown(name, NOT_TWICE)
    if value is None:
        return unknown(name, otherwise)
    return known(name, value, max(one.n for one in each), each[0].days)


# -- idle ------------------------------------------------------------------------------------------
# Idle while hot: working hours without joints, as far as counters show them.
#
# A station counts the working hours of its tool. If it also counts joints, its best week (least
# time per joint) is a rate that it can reach, and working hours beyond that rate are idle while
# hot. This is a lower bound: the best week has idle time too. A station that counts no joints
# has no such figure.

NAMES: Final = ("idle_hot_h", "idle_hot_percent", "idle_hot_kwh")
STRETCH_DAYS, FEWEST_JOINTS, LEAST_JOINTS = 7.0, 4, 20.0
NO_IDLE_HOURS: Final = "this station counts no joints, so its idle hours are not known"
NONE_CERTAIN: Final = "no hour is certainly idle: the joints may have taken all working hours"


def idle_of(work: Each, joints: Each, rated_power_w: float | None) -> Iterator[UseFigure]:
    """Yield the figures of ports by their working hours and joints of the last year.

    >>> [figure.why for figure in idle_of([None], [None], None)][0]
    'this station counts no joints, so its idle hours are not known'
    """
    ports = _both_known(work, joints)
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
