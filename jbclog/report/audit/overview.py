"""What an audit comes to at a glance, and how ranges, dates and states are written.

What is used up stands by how far it is, the rest by how soon it is due. A station that did not answer stands with what its last
readings say; where it has nothing worse, between tasks that are due soon and those that are not known.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import floor, isfinite
from typing import Final

from jbclog.config.tasks_file import DAYS
from jbclog.core.text import number
from jbclog.maintenance.counter_totals.span import Interval
from jbclog.maintenance.due import Due, State, TaskState
from jbclog.maintenance.fleet import FleetAudit, StationAudit

# -- wording ------------------------------------------------------------------------------------------------------------------
# How ranges, dates and states are said on the page of an audit.

STATES: Final = {
    State.OVERDUE: ("overdue", "✕", "overdue"),
    State.DUE: ("due", "✕", "due"),
    State.SOON: ("soon", "△", "due soon"),
    State.UNKNOWN: ("unknown", "?", "not known"),
    State.FINE: ("fine", "✓", "fine"),
}
"""Of each state its class on the page, a sign that needs no colour, and a word."""

OFF_SCALE: Final = 1000  # per cent, from which on it matters no more how many
USED_UP: Final = "its life is used up"

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
    """``40 to 42``; one number where both ends look alike; ``40 or more`` without a bound; a dash for nothing known."""
    if value is None:
        return "–"
    low, high = number(round(value.low, digits)), number(round(value.high, digits)) if isfinite(value.high) else None
    return f"{low} or more" if high is None else low if low == high else f"{low} to {high}"


def percent(value: Interval | None) -> str:
    """``81 to 84 %``. Never rounded up: 99.9 % of a life is not all of it."""
    if value is None:
        return "–"
    low = floor(value.low + 1e-9)
    if low >= OFF_SCALE:
        return f"over {number(OFF_SCALE)} %"
    return f"{span(Interval(low, floor(value.high + 1e-9)))} %" if value.is_bounded else f"{number(low)} % or more"


def of_life(task: TaskState) -> str:
    """``1 640 to 1 642 of 2 000 h``; millimetres as metres."""
    scale, unit = (1000.0, "m") if task.unit == "mm" else (1.0, "" if task.unit == "count" else task.unit)
    life = f"{number(task.life / scale)} {unit}".rstrip()
    return f"not known, of {life}" if task.used is None else f"{span(task.used.per(scale))} of {life}"


def window(task: TaskState) -> str:
    """``2027-03-12 to 2027-06-04``: one day only where the calendar says so. Where there is no range, why."""
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
    """``2026-11-21``, of an ISO time."""
    return "never" if time is None else time[:10]


def place(station: str, port: int | None) -> str:
    """``dde-1 · port 2``."""
    return station if port is None else f"{station} · port {port}"


def counted(number_of: int, one: str, many: str | None = None) -> str:
    """``1 station``, ``3 stations``."""
    return f"{number_of} {one if number_of == 1 else many or one + 's'}"


def listed(words: Iterable[str]) -> str:
    """``a, b and c``."""
    all_of_it = list(words)
    return " and ".join([", ".join(all_of_it[:-1]), all_of_it[-1]]) if len(all_of_it) > 1 else "".join(all_of_it)


# -- overview -----------------------------------------------------------------------------------------------------------------

NOT_SEEN: Final = ("unseen", "–", "not seen")
WORST_FIRST: Final = (State.OVERDUE, State.DUE, State.SOON, State.UNKNOWN, State.FINE)
FEW: Final = 3
NEVER: Final = "9999"


@dataclass(frozen=True, slots=True)
class Row:
    """A station with its worst task and the others that are not fine, each worst first."""

    anchor: str
    station: StationAudit
    tasks: tuple[TaskState, ...]

    @property
    def worst(self) -> TaskState | None:
        return self.tasks[0] if self.tasks else None

    @property
    def others(self) -> tuple[TaskState, ...]:
        """Those behind the worst that somebody has to think of."""
        return tuple(task for task in self.tasks[1:] if task.state in (State.OVERDUE, State.DUE, State.SOON))

    @property
    def state(self) -> tuple[str, str, str]:
        """Class, sign and word."""
        if self.worst is None or (not self.station.seen and self.worst.state in (State.UNKNOWN, State.FINE)):
            return NOT_SEEN if not self.station.seen else ("unknown", "–", "no task")
        return STATES[self.worst.state]

    @property
    def rank(self) -> tuple[float, str, float, str]:
        """Less is worse."""
        if self.worst is None or self.state == NOT_SEEN:
            return (2.5 if not self.station.seen else 5.0, "", 0.0, self.station.station)
        return (*_urgency(self.worst), self.station.station)


@dataclass(frozen=True, slots=True)
class Glance:
    """The headline (class, sign, words), how many stations are in each state, reasons, and the rows."""

    headline: tuple[str, str, str]
    counts: tuple[tuple[str, str, str, int], ...]
    reasons: tuple[str, ...]
    rows: tuple[Row, ...]


def at_a_glance(audit: FleetAudit) -> Glance:
    """All of it, from the value of a fleet."""
    rows = sorted((_row(at, station) for at, station in enumerate(audit.stations)), key=lambda row: row.rank)
    order = [*(STATES[state] for state in WORST_FIRST[:3]), NOT_SEEN, STATES[State.UNKNOWN], ("unknown", "–", "no task")]
    order.append(STATES[State.FINE])
    counts = [(*state, sum(row.state == state for row in rows)) for state in order]
    told = tuple(one for one in counts if one[3])
    return Glance(_headline(audit, told), told, tuple(_reasons(audit, rows)), tuple(rows))


def _row(at: int, station: StationAudit) -> Row:
    tasks = sorted(station.tasks, key=lambda task: (*_urgency(task), task.task, task.port or 0))
    return Row(f"s{at}", station, tuple(tasks))


def _urgency(task: TaskState) -> tuple[float, str, float]:
    """Less is worse: by state, by the day by which it is first due, by how much is used."""
    first = NEVER if task.due is None or task.due.p10 is None else task.due.p10
    is_used_up = task.state in (State.OVERDUE, State.DUE)
    return WORST_FIRST.index(task.state), "" if is_used_up else first, -_reached(task)


def _reached(task: TaskState) -> float:
    return 0.0 if task.percent is None else task.percent.low


def _headline(audit: FleetAudit, counts: Sequence[tuple[str, str, str, int]]) -> tuple[str, str, str]:
    if not audit.stations:
        return ("unknown", "?", "NO STATION AUDITED")
    style, sign, word, number = counts[0]
    if word == "fine":
        return (style, sign, "NOTHING IS DUE")
    if word == "no task":
        return (style, sign, "NO TASK IS STATED")
    return (style, sign, f"{number} {word.upper()}")


def _reasons(audit: FleetAudit, rows: Sequence[Row]) -> list[str]:
    """What the headline rests on, the worst first."""
    found = [_reason(row.station, task) for row in rows for task in row.tasks if task.state in (State.OVERDUE, State.DUE)]
    found += [f"{row.station.station}: not seen, last on {day(row.station.last_seen)}" for row in rows if not row.station.seen]
    doubts = sum(len(station.doubts) for station in audit.stations)
    if doubts:
        found.append(f"{counted(doubts, 'counter')} went as no counter can: the odometer says what it could not know")
    if audit.wrong:
        found.append(f"The ledger is damaged: {counted(len(audit.wrong), 'line')} of it count for nothing")
    found += [_reason(row.station, task) for row in rows for task in row.tasks if task.state is State.SOON]
    found += [
        f"{place(row.station.station, task.port)}: {task.title}, {task.why or 'not known'}"
        for row in rows
        for task in row.tasks
        if task.state is State.UNKNOWN
    ]
    return found or [_calm(audit)]


def _reason(station: StationAudit, task: TaskState) -> str:
    when = f", due {window(task)}" if task.state is State.SOON else ""
    return f"{place(station.station, task.port)}: {task.title}, {percent(task.percent)} of its life{when}"


def _calm(audit: FleetAudit) -> str:
    audits = max((station.audits for station in audit.stations), default=0)
    if audits == 0:
        return "Nothing has been read yet."
    if audits < FEW + 1:
        return f"This is audit {audits}. A due date is given from four audits on, in which a pace can be seen."
    return "Every station answered, and no task has reached 80 % of its life." if audit.is_whole else "No task has reached 80 %."
