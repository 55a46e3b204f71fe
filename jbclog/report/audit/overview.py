"""The overview of an audit, and the format of ranges, dates and states.

Used-up service intervals are ordered by their use, the others by their due date. A station that did
not answer has the state of its last readings; unless that is worse it stands between tasks that are
due soon and those that are not known.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import floor, isfinite
from typing import Final

from jbclog.config.tasks_file import DAYS
from jbclog.core.chain import LEFT_BY_CRASH, MOST_FAULTS
from jbclog.core.text import count_text, number
from jbclog.maintenance.counter_totals.span import Interval
from jbclog.maintenance.due import Due, State, TaskState
from jbclog.maintenance.fleet import FleetAudit, StationAudit

STATES: Final = {
    State.OVERDUE: ("overdue", "✕", "overdue"),
    State.DUE: ("due", "✕", "due"),
    State.SOON: ("soon", "△", "due soon"),
    State.UNKNOWN: ("unknown", "?", "not known"),
    State.FINE: ("fine", "✓", "fine"),
}
"""State -> class on the page, a sign that needs no colour, a word."""

OFF_SCALE: Final = 1000  # per cent; above it the exact share does not matter
USED_UP: Final = "service interval used up"

COUNTERS: Final = {
    "plugged_h": "plugged in",
    "on_h": "on",
    "no_tool_h": "without a tool",
    "sleep_h": "asleep",
    "hibernation_h": "hibernating",
    "work_h": "working",
    "sleep_cycles": "sleep cycles",
    "desolder_cycles": "desoldering cycles",
    "dispensed_cycles": "feeds",
    "dispensed_mm": "wire fed",
    "tool_cycles": "starts",
    "suction_cycles": "suction cycles",
}


def span(value: Interval | None, digits: int = 0) -> str:
    """Return ``40 to 42``; one number if both ends read alike; ``40 or more`` without a bound; a
    dash if not known.
    """
    if value is None:
        return "–"
    low = number(round(value.low, digits))
    high = number(round(value.high, digits)) if isfinite(value.high) else None
    return f"{low} or more" if high is None else low if low == high else f"{low} to {high}"


def percent(value: Interval | None) -> str:
    """Return ``81 to 84 %``, never rounded up: 99.9 % of an interval is not all of it."""
    if value is None:
        return "–"
    low = floor(value.low + 1e-9)
    if low >= OFF_SCALE:
        return f"over {number(OFF_SCALE)} %"
    return (
        f"{span(Interval(low, floor(value.high + 1e-9)))} %"
        if value.is_bounded
        else f"{number(low)} % or more"
    )


def of_life(task: TaskState) -> str:
    """Return ``1 640 to 1 642 of 2 000 h``; millimetres as metres."""
    scale, unit = (
        (1000.0, "m") if task.uom == "mm" else (1.0, "" if task.uom == "count" else task.uom)
    )
    interval = f"{number(task.life / scale)} {unit}".rstrip()
    return (
        f"not known, of {interval}"
        if task.used is None
        else f"{span(task.used.per(scale))} of {interval}"
    )


def window(task: TaskState) -> str:
    """Return ``2027-03-12 to 2027-06-04``; a single day for tasks by calendar; the reason if there
    is no range.
    """
    if task.due is not None:
        return _by_calendar(task) if task.counter == DAYS else _range(task.due)
    return USED_UP if task.state in (State.DUE, State.OVERDUE) else task.why or "not known"


def _by_calendar(task: TaskState) -> str:
    since = "since " if task.state in (State.DUE, State.OVERDUE) else ""
    return f"{since}{day(task.due.p50 if task.due else None)}, by the calendar"


def _range(due: Due) -> str:
    if due.p10 is None:
        return "not in sight"
    first = due.p10[:10]
    if due.p90 is None:
        return f"{first} or later"
    return f"{first} to {due.p90[:10]}"


def day(time: str | None) -> str:
    """Return the day of an ISO time."""
    return "never" if time is None else time[:10]


def place(station: str, port: int | None) -> str:
    """Return ``dde-1 · port 2``."""
    return station if port is None else f"{station} · port {port}"


def listed(words: Iterable[str]) -> str:
    """Return ``a, b and c``."""
    all_of_it = list(words)
    return (
        " and ".join([", ".join(all_of_it[:-1]), all_of_it[-1]])
        if len(all_of_it) > 1
        else "".join(all_of_it)
    )


BASELINE: Final = ("unknown", "✓", "BASELINE RECORDED")
NOT_SEEN: Final = ("unseen", "–", "not seen")
NO_TASK: Final = ("unknown", "–", "no task")
URGENT: Final = (State.OVERDUE, State.DUE, State.SOON)
WORST_FIRST: Final = (*URGENT, State.UNKNOWN, State.FINE)
FEW: Final = 3
NEVER: Final = "9999"


@dataclass(frozen=True, slots=True)
class DueRow:
    """A station with its worst task and the others that are not fine, each worst first."""

    station: StationAudit
    tasks: tuple[TaskState, ...]

    @property
    def worst(self) -> TaskState | None:
        return self.tasks[0] if self.tasks else None

    @property
    def others(self) -> tuple[TaskState, ...]:
        """The other tasks that are overdue, due or due soon."""
        return tuple(task for task in self.tasks[1:] if task.state in URGENT)

    @property
    def state(self) -> tuple[str, str, str]:
        """Class, sign and word."""
        if self.worst is None or (
            not self.station.seen and self.worst.state in (State.UNKNOWN, State.FINE)
        ):
            return NO_TASK if self.station.seen else NOT_SEEN
        return STATES[self.worst.state]

    @property
    def rank(self) -> tuple[float, str, float, str]:
        """Less is worse."""
        if self.worst is None or self.state == NOT_SEEN:
            return (2.5 if not self.station.seen else 5.0, "", 0.0, self.station.station)
        return (*_urgency(self.worst), self.station.station)


@dataclass(frozen=True, slots=True)
class AuditOverview:
    """The headline (class, sign, words), the number of stations in each state, reasons, and the
    rows.
    """

    headline: tuple[str, str, str]
    counts: tuple[tuple[str, str, str, int], ...]
    reasons: tuple[str, ...]
    rows: tuple[DueRow, ...]


def overview_of(audit: FleetAudit) -> AuditOverview:
    """Return the overview of an audit."""
    rows = sorted(map(_row, audit.stations), key=lambda row: row.rank)
    urgent = (STATES[state] for state in URGENT)
    order = (*urgent, NOT_SEEN, STATES[State.UNKNOWN], NO_TASK, STATES[State.FINE])
    counts = [(*state, sum(row.state == state for row in rows)) for state in order]
    present = tuple(one for one in counts if one[3])
    return AuditOverview(
        _headline(audit, present), present, tuple(_reasons(audit, rows)), tuple(rows)
    )


def _row(station: StationAudit) -> DueRow:
    tasks = sorted(station.tasks, key=lambda task: (*_urgency(task), task.task, task.port or 0))
    return DueRow(station, tuple(tasks))


def _urgency(task: TaskState) -> tuple[float, str, float]:
    """Return the sort key of a task, less is worse: by state, by its first due day, by its use."""
    first = NEVER if task.due is None or task.due.p10 is None else task.due.p10
    is_used_up = task.state in (State.OVERDUE, State.DUE)
    return WORST_FIRST.index(task.state), "" if is_used_up else first, -_reached(task)


def _reached(task: TaskState) -> float:
    return 0.0 if task.percent is None else task.percent.low


def is_baseline(audit: FleetAudit) -> bool:
    """Whether all stations were read for the first time and nothing is due: there is nothing to
    compare with yet.
    """
    is_calm = not (audit.wrong or audit.not_kept) and not any(
        one.doubts or one.question or any(task.state in URGENT for task in one.tasks)
        for one in audit.stations
    )
    return (
        bool(audit.stations)
        and is_calm
        and all(one.seen and one.audits == 1 for one in audit.stations)
    )


def _headline(
    audit: FleetAudit, counts: Sequence[tuple[str, str, str, int]]
) -> tuple[str, str, str]:
    if not audit.stations:
        return ("unknown", "?", "NO STATION AUDITED")
    style, sign, word, number = counts[0]
    if is_baseline(audit):
        return BASELINE
    doubt = _doubt(audit)
    if doubt is not None and word in ("fine", "no task"):
        return ("unknown", "?", doubt)
    if word == "fine":
        return (style, sign, "NOTHING IS DUE")
    if word == "no task":
        return (style, sign, "NO TASK DEFINED")
    return (style, sign, f"{number} {word.upper()}")


def _doubt(audit: FleetAudit) -> str | None:
    """Return why it is not known that nothing is due. A line that a crash cut off was never
    acknowledged: nothing is missing.
    """
    if audit.not_kept:
        return "NOT KEPT IN THE LEDGER"
    if any(not text.endswith(LEFT_BY_CRASH) for text in audit.wrong):
        return "NOT KNOWN: THE LEDGER IS DAMAGED"
    return None


def _reasons(audit: FleetAudit, rows: Sequence[DueRow]) -> list[str]:
    """Return the reasons of the headline, the worst first."""
    found = [
        _reason(row.station, task)
        for row in rows
        for task in row.tasks
        if task.state in (State.OVERDUE, State.DUE)
    ]
    found += [
        f"{row.station.station}: not seen, last on {day(row.station.last_seen)}"
        for row in rows
        if not row.station.seen
    ]
    found += [
        f"{station.station}: {station.question}" for station in audit.stations if station.question
    ]
    doubts = sum(len(station.doubts) for station in audit.stations)
    if doubts:
        found.append(f"{count_text(doubts, 'counter')} changed implausibly; see counter changes")
    found += audit.not_kept
    if audit.wrong:
        lines = (
            count_text(len(audit.wrong), "line")
            if len(audit.wrong) <= MOST_FAULTS
            else f"more than {MOST_FAULTS} lines"
        )
        found.append(f"The ledger is damaged: {lines} ignored")
    found += [
        _reason(row.station, task) for row in rows for task in row.tasks if task.state is State.SOON
    ]
    found += _unknown(rows)
    return [*baseline(audit), *found] if is_baseline(audit) else found or [_calm(audit)]


def _unknown(rows: Sequence[DueRow]) -> Iterator[str]:
    """Yield what is not known and why, once for all stations and ports with the same reason."""
    found: dict[str, list[str]] = {}
    for row in rows:
        for task in row.tasks:
            if task.state is State.UNKNOWN:
                found.setdefault(f"{task.title}, {task.why or 'not known'}", []).append(
                    place(row.station.station, task.port)
                )
    yield from (f"{listed(places)}: {text}" for text, places in found.items())


def baseline(audit: FleetAudit) -> Iterator[str]:
    """Yield what a first audit did, and what to do next."""
    yield (
        f"First audit: {count_text(len(audit.stations), 'station')} read; their use counts from"
        " here."
    )
    yield f"Next: audit daily. Due dates need at least {FEW + 1} audits."
    if not any(one.tasks for one in audit.stations):
        yield "No task is defined: --tasks names a file of tasks with their service intervals."


def _reason(station: StationAudit, task: TaskState) -> str:
    when = f", due {window(task)}" if task.state is State.SOON else ""
    return (
        f"{place(station.station, task.port)}: {task.title}, {percent(task.percent)} of its service"
        f" interval{when}"
    )


def _calm(audit: FleetAudit) -> str:
    audits = max((station.audits for station in audit.stations), default=0)
    if audits == 0:
        return "Nothing has been read yet."
    if audits < FEW + 1:
        return f"This is audit {audits}. Due dates need at least four audits."
    reached = "o task has reached 80 % of its service interval."
    return f"Every station answered, and n{reached}" if audit.is_whole else f"N{reached}"
