"""The result of an audit, its findings and exit code."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

from jbclog.maintenance.counter_totals.observed import Count, Errors, Fact, Identity, Standing
from jbclog.maintenance.counter_totals.span import Interval
from jbclog.maintenance.counter_totals.totals import CounterTotal, Difference
from jbclog.maintenance.due import State, TaskState

# -- fleet --------------------------------------------------------------------------------------------------------------------

BEFORE, FLEET = "before", "fleet"


@dataclass(frozen=True, slots=True)
class Meter:
    """A counter of a port: what was read now, the odometer behind it, the last difference, the pace (per day, where known)."""

    port: int
    counter: str
    unit: str
    read: Count | None
    odometer: CounterTotal
    last: Difference | None
    per_day: Interval | None


@dataclass(frozen=True, slots=True)
class UseFigure:
    """A figure of a station's use (`use.py`): its range where it has one, null with a reason (`why`) where it is not known.

    `name` is a stable word (``use_percent``, ``idle_hot_h``, ``mm_per_joint``, ...), `title` what people read, `by` the
    definition where there could be another. It rests on `n` differences between readings, over `days`.
    `port` null: all ports together.
    """

    name: str
    title: str
    unit: str
    value: float | None
    range: Interval | None = None
    port: int | None = None
    why: str = ""
    n: int = 0
    days: float | None = None
    by: str = ""


@dataclass(frozen=True, slots=True)
class Week:
    """Seven days from `begin` (UTC date): port hours that were worked a day, null where no two readings tell.

    `is_spread` where readings were further apart than a week, so that a longer time's hours are spread evenly.
    """

    begin: str
    per_day: Interval | None
    is_spread: bool = False


@dataclass(frozen=True, slots=True)
class Drift:
    """Software or a parameter that is not what it was, or not what the fleet has: `than` is ``before`` or ``fleet``.

    From the fleet: `held_by` stations (or ports) of the `of` others alike have what is `expected`.
    """

    name: str
    value: str
    expected: str
    than: str
    held_by: int = 0
    of: int = 0

    @property
    def text(self) -> str:
        """``350, 7 of 8 others have 330``; ``350, was 330 at the last audit``."""
        if self.than == BEFORE:
            return f"{self.value}, was {self.expected} at the last audit"
        return f"{self.value}, {self.held_by} of {self.of} others have {self.expected}"


@dataclass(frozen=True, slots=True)
class StationAudit:
    """A row: a station of the line, as it was seen now (`seen`) or last (`last_seen`), with all that follows from the ledger."""

    line: str
    station: str
    url: str
    seen: bool
    why: str
    source: str
    last_seen: str | None
    audits: int
    identity: Identity | None
    meters: tuple[Meter, ...] = ()
    tasks: tuple[TaskState, ...] = ()
    use: tuple[UseFigure, ...] = ()
    errors: Errors | None = None
    drifts: tuple[Drift, ...] = ()
    weeks: tuple[Week, ...] = ()  # the last 53, oldest first
    notes: tuple[str, ...] = ()  # a sentence for everything that is not as it should be

    @property
    def state(self) -> State:
        """That of the worst task."""
        order = list(State)
        return max((task.state for task in self.tasks), key=order.index, default=State.FINE)

    @property
    def doubts(self) -> tuple[Difference, ...]:
        """Differences since last time that nobody can be sure of."""
        return tuple(meter.last for meter in self.meters if meter.last is not None and meter.last.is_doubtful)


@dataclass(frozen=True, slots=True)
class FleetAudit:
    """All of it. `wrong` are sentences about damaged lines of the ledger; `ledger_head` is the hash of its last line."""

    line: str
    audit: str
    ledger: str
    ledger_head: str
    stations: tuple[StationAudit, ...]
    wrong: tuple[str, ...] = ()
    facts: tuple[Fact, ...] = ()  # what people told, oldest first

    @property
    def is_whole(self) -> bool:
        return all(station.seen for station in self.stations)


# -- titles -------------------------------------------------------------------------------------------------------------------
# The figures of a station's use by name: what people read, the unit, and the definition where there could be another.


@dataclass(frozen=True, slots=True)
class Title:
    """What people read of a figure."""

    text: str
    unit: str
    by: str = ""


TITLES: Final = {
    "work_h_last": Title("Worked since the audit before", "h"),
    "work_h_a_day_30": Title("Worked a day, last 30 days", "h a day", "calendar days, all ports added"),
    "work_h_a_day_365": Title("Worked a day, last year", "h a day", "calendar days, all ports added"),
    "use_percent": Title("Use", "%", "working hours of the hours plugged in, last year"),
    "sleep_percent": Title("Sleep and hibernation", "%", "of the hours plugged in, last year"),
    "no_tool_percent": Title("Without a tool", "%", "of the hours plugged in, last year"),
    "joints_a_day": Title("Joints a day", "a day", "feeds of wire, or desoldering cycles; calendar days, last year"),
    "joints_a_work_h": Title("Joints a working hour", "1/h", "feeds of wire, or desoldering cycles, last year"),
    "mm_a_joint": Title("Wire a joint", "mm", "of the last 30 days, or between the last two readings"),
    "mm_a_joint_before": Title("Wire a joint, before that", "mm", "of the year before that"),
    "idle_hot_h": Title(
        "Hot for nothing, at least",
        "h",
        "working hours less those that the joints would have taken at the station's own best pace of a week; last year",
    ),
    "idle_hot_percent": Title("Hot for nothing, at least", "%", "of the working hours, last year"),
    "idle_hot_kwh": Title("Wasted by that, at most", "kWh", "those hours at rated power; a tip that is only held hot takes less"),
    "errors_last": Title("Errors since the audit before", "", "events that runs recorded; between runs nobody looked"),
    "error_mtbf_h": Title(
        "Hours between errors, at most",
        "h",
        "hours plugged in for each error that runs saw, 90 % bounds; between runs nobody looked",
    ),
}


def known(name: str, value: Interval, n: int, days: float, stated: float | None = None) -> UseFigure:
    """A figure with its range, which rests on `n` differences over `days`; `stated` where its bound is what is meant."""
    title = TITLES[name]
    found = UseFigure(name, title.text, title.unit, stated, value, n=n, days=days, by=title.by)
    if stated is not None:
        return found
    return replace(found, value=value.middle) if value.is_bounded else replace(found, why="nothing bounds it from above")


def unknown(name: str, why: str) -> UseFigure:
    """A figure that cannot be known, and why."""
    return UseFigure(name, TITLES[name].text, TITLES[name].unit, None, why=why, by=TITLES[name].by)


# -- ending -------------------------------------------------------------------------------------------------------------------
# What an audit comes to: the findings that it may end with, and the exit code (docs/reference/exit-codes.md).

ABSENT: Final = "nak4"  # the station does not have that counter


class Finding(StrEnum):
    """What `--fail-on` can name."""

    OVERDUE = "overdue"
    DUE = "due"
    SOON = "soon"
    SUSPECT = "suspect"  # a difference that nobody can be sure of, or a counter on which no two reads agreed
    DRIFT = "drift"
    UNSEEN = "unseen"  # a station that did not answer, or did not tell all of its counters


USUAL: Final = (Finding.OVERDUE, Finding.DUE, Finding.SUSPECT, Finding.UNSEEN)
_TASKS: Final = {State.OVERDUE: Finding.OVERDUE, State.DUE: Finding.DUE, State.SOON: Finding.SOON}


def findings(station: StationAudit) -> set[Finding]:
    """Everything that there is to find at this station."""
    return set(_found(station))


def _found(station: StationAudit) -> Iterator[Finding]:
    yield from (_TASKS[task.state] for task in station.tasks if task.state in _TASKS)
    if station.doubts:
        yield Finding.SUSPECT
    if station.drifts:
        yield Finding.DRIFT
    if not station.seen:
        yield Finding.UNSEEN
        return
    for meter in station.meters:
        if meter.read is not None and meter.read.standing is Standing.MOVING:
            yield Finding.SUSPECT
        if meter.read is not None and meter.read.standing is Standing.UNREAD and meter.read.why != ABSENT:
            yield Finding.UNSEEN


def exit_code(audit: FleetAudit, fail_on: Collection[Finding] = USUAL) -> int:
    """3 where a station was not seen, else 1 where something is due or suspect; 0 where all is fine. The ledger is not in it."""
    found = {one for station in audit.stations for one in findings(station)} & set(fail_on)
    if Finding.UNSEEN in found:
        return 3
    return 1 if found else 0
