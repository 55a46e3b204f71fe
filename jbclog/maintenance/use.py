"""Figures of a station's use: how much it worked, how long it was hot for nothing, how it sleeps, what its joints take.

Every figure is of the differences between readings, with the range that they allow; what they cannot tell is null with a reason.
Shares are of the time that the station was plugged in, over the last year at most.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeGuard

from jbclog.maintenance.counter_totals.interval import Interval
from jbclog.maintenance.counter_totals.observed import Observation
from jbclog.maintenance.counter_totals.totals import Trace
from jbclog.maintenance.fleet import UseFigure
from jbclog.maintenance.idle import idle_of
from jbclog.maintenance.span_of_use import Believed, Stretch, last, ratio, sum_of, whole, window, within
from jbclog.maintenance.station_errors import errors_of
from jbclog.maintenance.titles import known, unknown

YEAR, MONTH = 365.0, 30.0
WORK: Final = "work_h"
PLUGGED: Final = ("plugged_h", "on_h")  # hot air stations call it so
JOINTS: Final = ("dispensed_cycles", "desolder_cycles")
SHARES: Final = {"use_percent": (WORK,), "sleep_percent": ("sleep_h", "hibernation_h"), "no_tool_percent": ("no_tool_h",)}
NOT_TWICE: Final = "not counted here, or not read twice yet"
NO_JOINTS: Final = "this station counts no joints"

Each = Sequence[Stretch | None]
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
