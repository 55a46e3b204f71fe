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

# -- fleet -----------------------------------------------------------------------------------------

BEFORE, FLEET = "before", "fleet"


@dataclass(frozen=True, slots=True)
class Meter:
    """A counter of a port: the current reading, its total, the last difference, and the rate (per
    day, if known).
    """

    port: int
    counter: str
    uom: str
    read: Count | None
    counter_total: CounterTotal
    last: Difference | None
    per_day: Interval | None


@dataclass(frozen=True, slots=True)
class UseFigure:
    """A figure of a station's use (`use.py`), with its range if it has one; null with a reason
    (`why`) if not known.

    `name` is a stable word (``use_percent``, ``idle_hot_h``, ``mm_a_joint``, ...), `title` its
    text, `by` the definition if others are possible. It comes from `n` differences between readings
    over `days`. `port` null: all ports together.
    """

    name: str
    title: str
    uom: str
    value: float | None
    range: Interval | None = None
    port: int | None = None
    why: str = ""
    n: int = 0
    days: float | None = None
    by: str = ""


@dataclass(frozen=True, slots=True)
class Week:
    """Seven days from `begin` (UTC date): working hours per day of all ports, null without readings
    around them.

    `is_spread`: readings were further apart than a week, so the hours between them are spread
    evenly.
    """

    start: str
    per_day: Interval | None
    is_spread: bool = False


@dataclass(frozen=True, slots=True)
class Drift:
    """Software or a parameter that differs from the last audit or from the fleet: `than` is
    ``before`` or ``fleet``.

    In a fleet `held_by` of the `of` other comparable stations (or ports) have the `expected` value.
    """

    name: str
    value: str
    expected: str
    than: str
    held_by: int = 0
    of: int = 0

    @property
    def text(self) -> str:
        """Return ``350, 7 of 8 others have 330``; ``350, was 330 at the last audit``."""
        if self.than == BEFORE:
            return f"{self.value}, was {self.expected} at the last audit"
        return f"{self.value}, {self.held_by} of {self.of} others have {self.expected}"


@dataclass(frozen=True, slots=True)
class StationAudit:
    """A station of the production line as seen now (`seen`) or last (`last_seen`), with the results
    from the ledger.
    """

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
    notes: tuple[str, ...] = ()  # a sentence for each irregular difference
    question: str = ""  # what a person must record, if counters fell since the previous audit

    @property
    def state(self) -> State:
        """The state of the worst task."""
        order = list(State)
        return max((task.state for task in self.tasks), key=order.index, default=State.FINE)

    @property
    def doubts(self) -> tuple[Difference, ...]:
        """Doubtful differences since the previous audit; none beside a `question`."""
        if self.question:
            return ()
        return tuple(
            meter.last for meter in self.meters if meter.last is not None and meter.last.is_doubtful
        )


@dataclass(frozen=True, slots=True)
class FleetAudit:
    """The result of an audit. `wrong`: sentences about damaged lines of the ledger; `ledger_head`:
    the hash of its last line; `not_kept`: why the ledger could not be read, or lacks the readings
    of this audit.
    """

    line: str
    audit: str
    ledger: str
    ledger_head: str
    stations: tuple[StationAudit, ...]
    wrong: tuple[str, ...] = ()
    facts: tuple[Fact, ...] = ()  # recorded maintenance, oldest first
    not_kept: tuple[str, ...] = ()

    @property
    def is_whole(self) -> bool:
        return all(station.seen for station in self.stations)


# -- titles ----------------------------------------------------------------------------------------
# The figures of a station's use by name: title, unit, and the definition if there could be another.


@dataclass(frozen=True, slots=True)
class Title:
    """The texts of a figure."""

    text: str
    uom: str
    by: str = ""


TITLES: Final = {
    "work_h_last": Title("Working hours since the previous audit", "h"),
    "work_h_a_day_30": Title(
        "Working hours per day, last 30 days", "h a day", "calendar days, all ports added"
    ),
    "work_h_a_day_365": Title(
        "Working hours per day, last year", "h a day", "calendar days, all ports added"
    ),
    "use_percent": Title("Use", "%", "working hours of the hours plugged in, last year"),
    "sleep_percent": Title("Sleep and hibernation", "%", "of the hours plugged in, last year"),
    "no_tool_percent": Title("Without a tool", "%", "of the hours plugged in, last year"),
    "joints_a_day": Title(
        "Joints per day", "a day", "wire feeds or desoldering cycles; calendar days, last year"
    ),
    "joints_a_work_h": Title(
        "Joints per working hour", "1/h", "wire feeds or desoldering cycles, last year"
    ),
    "mm_a_joint": Title("Solder wire per joint", "mm", "last 30 days, or since the previous audit"),
    "mm_a_joint_before": Title("Solder wire per joint, earlier", "mm", "the rest of the last year"),
    "idle_hot_h": Title(
        "Idle while hot, at least",
        "h",
        "working hours beyond the joints' time at the station's best weekly rate, last year",
    ),
    "idle_hot_percent": Title("Idle while hot, at least", "%", "of the working hours, last year"),
    "idle_hot_kwh": Title(
        "Energy while idle, at most",
        "kWh",
        "idle hours at rated power; holding a tip hot takes less",
    ),
    "errors_last": Title(
        "Errors since the previous audit",
        "",
        "recorded by runs; errors between runs are not counted",
    ),
    "error_mtbf_h": Title(
        "Hours between errors, at most",
        "h",
        "hours plugged in per error recorded by runs, 90 % bounds; errors between runs are not"
        " counted",
    ),
}


def known(
    name: str, value: Interval, n: int, days: float, stated: float | None = None
) -> UseFigure:
    """Return a figure with its range, from `n` differences over `days`. `stated`: its value if that
    is not the middle.
    """
    title = TITLES[name]
    found = UseFigure(name, title.text, title.uom, stated, value, n=n, days=days, by=title.by)
    if stated is not None:
        return found
    return (
        replace(found, value=value.middle)
        if value.is_bounded
        else replace(found, why="no upper bound is known")
    )


def unknown(name: str, why: str) -> UseFigure:
    """Return a figure that is not known, with the reason."""
    return UseFigure(name, TITLES[name].text, TITLES[name].uom, None, why=why, by=TITLES[name].by)


# -- findings --------------------------------------------------------------------------------------
# The findings of an audit, and its exit code (docs/reference/exit-codes.md).

ABSENT: Final = "nak4"  # the station does not have that counter


class Finding(StrEnum):
    """Findings that `--fail-on` can name."""

    OVERDUE = "overdue"
    DUE = "due"
    SOON = "soon"
    # a doubtful difference, a question, or a counter on which no two reads agreed
    SUSPECT = "suspect"
    DRIFT = "drift"
    UNSEEN = "unseen"  # a station that did not answer, or not with all of its counters


USUAL: Final = (Finding.OVERDUE, Finding.DUE, Finding.SUSPECT, Finding.UNSEEN)
_TASKS: Final = {State.OVERDUE: Finding.OVERDUE, State.DUE: Finding.DUE, State.SOON: Finding.SOON}


def findings(station: StationAudit) -> set[Finding]:
    """Return all findings at this station."""
    return set(_found(station))


def _found(station: StationAudit) -> Iterator[Finding]:
    yield from (_TASKS[task.state] for task in station.tasks if task.state in _TASKS)
    if station.doubts or station.question:
        yield Finding.SUSPECT
    if station.drifts:
        yield Finding.DRIFT
    if not station.seen:
        yield Finding.UNSEEN
        return
    for meter in station.meters:
        if meter.read is not None and meter.read.standing is Standing.MOVING:
            yield Finding.SUSPECT
        if (
            meter.read is not None
            and meter.read.standing is Standing.UNREAD
            and meter.read.why != ABSENT
        ):
            yield Finding.UNSEEN


def exit_code(audit: FleetAudit, fail_on: Collection[Finding] = USUAL) -> int:
    """Return 3 if a station was not seen, else 1 for any other finding in `fail_on`, else 0.

    Ignores damage of the ledger.
    """
    found = {one for station in audit.stations for one in findings(station)} & set(fail_on)
    if Finding.UNSEEN in found:
        return 3
    return 1 if found else 0
