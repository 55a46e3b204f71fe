"""The figures of a station's use by name: what people read, the unit, and the definition where there could be another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from jbclog.maintenance.counter_totals.interval import Interval
from jbclog.maintenance.fleet import UseFigure


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
