"""How ranges, dates and states are said on the page of an audit."""

from __future__ import annotations

from collections.abc import Iterable
from math import floor, isfinite
from typing import Final

from jbclog.config.tasks_file import DAYS
from jbclog.core.text import number
from jbclog.maintenance.counter_totals.span import Interval
from jbclog.maintenance.due import Due, State, TaskState

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
