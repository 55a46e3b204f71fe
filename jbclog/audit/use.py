"""Figures of a station's use: how much it worked, how long it was hot for nothing, how it sleeps, what its joints take.

Every figure is of the differences between readings, with the range that they allow; what they cannot tell is null with a reason.
Shares are of the time that the station was plugged in, over the last year at most.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from jbclog.audit.fleet import UseFigure
from jbclog.audit.idle import idle_of
from jbclog.audit.interval import NOTHING, Interval
from jbclog.audit.observed import Observation
from jbclog.audit.odometer import Difference
from jbclog.audit.stretch import days_of, ratio, total_of, window, within
from jbclog.audit.titles import known, unknown
from jbclog.audit.trouble import errors_of

YEAR, MONTH = 365.0, 30.0
WORK: Final = "work_h"
PLUGGED: Final = ("plugged_h", "on_h")  # hot air stations call it so
JOINTS: Final = ("dispensed_cycles", "desolder_cycles")
SHARES: Final = {"use_percent": (WORK,), "sleep_percent": ("sleep_h", "hibernation_h"), "no_tool_percent": ("no_tool_h",)}
NOT_TWICE: Final = "not counted here, or not read twice yet"
NO_JOINTS: Final = "this station counts no joints"

Each = Sequence[Sequence[Difference]]
"""The differences of one counter, for each port."""


@dataclass(frozen=True, slots=True)
class Past:
    """What is known of one station: its counters' differences by port and name, and the looks that saw it, oldest first."""

    differences: Mapping[tuple[int, str], Sequence[Difference]]
    looks: Sequence[Observation]
    now: str
    rated_power_w: float | None = None

    @property
    def ports(self) -> tuple[int, ...]:
        return tuple(sorted({port for port, _ in self.differences}))

    def of(self, port: int, *counters: str) -> Sequence[Difference]:
        """Those of the first of these counters that was read twice at this port."""
        return next((found for name in counters if (found := self.differences.get((port, name), ()))), ())

    def last_year(self, port: int, *counters: str) -> Sequence[Difference]:
        """Those of them that began within the last year."""
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


# -- how much it worked ---------------------------------------------------------------------------------------------------------


def _worked(past: Past, ports: Sequence[int]) -> Iterator[UseFigure]:
    each = [past.of(port, WORK) for port in ports]
    last = [one[-1:] for one in each]
    yield _figure("work_h_last", last, _sum(last))
    yield _a_day("work_h_a_day_30", each, past.now, MONTH)
    yield _a_day("work_h_a_day_365", each, past.now, YEAR)


def _a_day(name: str, each: Each, now: str, days: float) -> UseFigure:
    near = [window(one, now, days) for one in each]
    if all(each) and not all(near):
        return unknown(name, f"no reading about {days:.0f} days ago")
    return _figure(name, near, _sum(near).per(days_of(near[0])) if near and all(near) else None)


def _share(past: Past, ports: Sequence[int], name: str, parts: Sequence[str]) -> UseFigure:
    whole = [past.last_year(port, *PLUGGED) for port in ports]
    each = [past.last_year(port, part) for port in ports for part in parts]
    share = ratio(_sum(each), _sum(whole))
    if all(each) and all(whole) and share is None:
        return unknown(name, "not plugged in long enough to tell")
    return _figure(name, each, share and Interval(100 * share.low, min(100 * share.high, 100.0)))


# -- joints and wire ------------------------------------------------------------------------------------------------------------


def _joints(past: Past, port: int) -> Sequence[Difference]:
    """The counter that counts joints at this port: feeds, or what was desoldered if anything ever was; else nothing."""
    each = (past.last_year(port, name) for name in JOINTS)
    return next((one for one in each if one and total_of(one).high > 0), ())


def _paces(past: Past, ports: Sequence[int], joints: Each) -> Iterator[UseFigure]:
    if not any(joints):
        yield from (unknown(name, NO_JOINTS) for name in ("joints_a_day", "joints_a_work_h"))
        return
    counted = [(port, one) for port, one in zip(ports, joints, strict=True) if one]
    made = [one for _, one in counted]
    yield _figure("joints_a_day", made, _sum(made).per(days_of(made[0])))
    pace = ratio(_sum(made), _sum([past.last_year(port, WORK) for port, _ in counted]))
    yield _figure("joints_a_work_h", made, pace, "hardly any hour was worked")


def _wire(past: Past, ports: Sequence[int]) -> Iterator[UseFigure]:
    wire, feeds = ([past.last_year(port, name) for port in ports] for name in ("dispensed_mm", "dispensed_cycles"))
    if not any(wire) or not any(feeds):
        yield from (unknown(name, "this station feeds no wire") for name in ("mm_a_joint", "mm_a_joint_before"))
        return
    now, before = ([[one[part] for one in each] for part in (slice(-1, None), slice(None, -1))] for each in (wire, feeds))
    for name, length, cycles in (("mm_a_joint", now[0], before[0]), ("mm_a_joint_before", now[1], before[1])):
        yield _figure(name, length, ratio(_sum(length), _sum(cycles)), "nothing was fed")


# -- as figures -----------------------------------------------------------------------------------------------------------------


def _figure(name: str, each: Each, value: Interval | None, otherwise: str = NOT_TWICE) -> UseFigure:
    if not each or not all(each) or value is None:
        return unknown(name, NOT_TWICE if not each or not all(each) else otherwise)
    return known(name, value, max(len(one) for one in each), days_of(each[0]))


def _sum(each: Each) -> Interval:
    return sum((total_of(one) for one in each), NOTHING)
