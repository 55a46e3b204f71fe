"""Captions of figures, and the minute of a long run that gets a figure of its own."""

from __future__ import annotations

from typing import Final

import numpy as np

from jbclog.analysis.figures.curves import blocks, extreme
from jbclog.analysis.figures.style import WIDE
from jbclog.analysis.figures.ticks import duration_text
from jbclog.analysis.figures.trace import JointEnd, MarkKind, Trace
from jbclog.core.clock import utc_of
from jbclog.core.text import count_text

WINDOW_S: Final = 60.0
LONG_S: Final = 180.0  # in a shorter run single joints are visible in the first figure
MOST_GAPS_NAMED: Final = 3
WORTH_A_LOOK: Final = {
    MarkKind.ALARM: "the first alarm",
    MarkKind.UNCONFIRMED: "the first doubtful alarm",
    MarkKind.ERROR: "the first error",
}


def closer(trace: Trace) -> tuple[Trace, str] | None:
    """Return one minute of the trace and why that one; None for a short run."""
    if trace.end - trace.start <= LONG_S:
        return None
    middle, why = _moment(trace)
    start = min(max(middle - WINDOW_S / 2, trace.start), trace.end - WINDOW_S)
    return trace.between(start, start + WINDOW_S), why


def _moment(trace: Trace) -> tuple[float, str]:
    for kind, why in WORTH_A_LOOK.items():
        first = next((mark for mark in trace.marks if mark.kind is kind), None)
        if first is not None:
            return (first.span.start + first.span.end) / 2, why
    hottest = _hottest(trace)
    return (
        (hottest, "the hottest reading")
        if hottest is not None
        else ((trace.start + trace.end) / 2, "the middle of the run")
    )


def _hottest(trace: Trace) -> float | None:
    """Return when the tip was hottest for the first time; None if never read."""
    greatest = extreme(trace.temperature, np.max)
    for rows in blocks(0 if greatest is None else len(trace.temperature)):
        places = np.flatnonzero(trace.temperature[rows] == greatest)
        if len(places):
            return float(trace.seconds[rows][places[0]])
    return None


def caption(trace: Trace) -> str:
    """Return the day, the meaning of the band, and the longest gaps by name."""
    parts = [f"{_day(trace)}, times in UTC."]
    read = int(np.count_nonzero(~np.isnan(trace.setting)))
    if read:
        parts.append(
            f"Setpoint shown where it was read{', as dots' if read <= WIDE.most_dots else ''}."
        )
    if len(trace.seconds) > 2 * WIDE.stretches:
        stretch = (trace.end - trace.start) / WIDE.stretches
        parts.append(f"Line: mean, band: min–max of every {duration_text(stretch)}.")
    if trace.joints:
        parts.append(joints_marked(trace))
    gaps = trace.longest_gaps
    named = [
        f"{gap.word.replace('_', ' ')} {duration_text(gap.seconds)} at {_clock(trace, gap.start)}"
        for gap in gaps[:MOST_GAPS_NAMED]
    ]
    if named:
        more = len(gaps) - len(named)
        parts.append(f"No data: {', '.join(named)}{f' and {more} more' if more else ''}.")
    return " ".join(parts)


def closer_caption(part: Trace, why: str) -> str:
    """Return which minute it is and why that one."""
    joints = f" {joints_marked(part)}" if part.joints else ""
    return f"Detail: {_clock(part, part.start)} to {_clock(part, part.end)}, around {why}.{joints}"


def joints_marked(trace: Trace) -> str:
    """Return the meaning of the bars at the foot of the temperature."""
    count, late = len(trace.joints), sum(one.word == JointEnd.LATE for one in trace.joints)
    bars = f"Bars at the foot: {count_text(count, 'joint')}"
    return (
        f"{bars}; high and red: {late} after which the next one came before the tip was back."
        if late
        else f"{bars}."
    )


def description(place: str, trace: Trace) -> str:
    """Return the alternative text of the figure."""
    if trace.states:
        return (
            f"{place}: its states over {duration_text(trace.end - trace.start)}, {len(trace.gaps)}"
            " gaps."
        )
    least, greatest = extreme(trace.temperature, np.min), extreme(trace.temperature, np.max)
    seen = "never read" if least is None else f"from {least:g} to {greatest:g} °C"
    alarms = sum(mark.kind is MarkKind.ALARM for mark in trace.marks)
    length = duration_text(trace.end - trace.start)
    what = "tip" if trace.air is None else "air"
    joints = f"{len(trace.joints)} joints, " if trace.joints else ""
    return (
        f"{place}: {what} temperature {seen} over {length}, {joints}{alarms} alarms,"
        f" {len(trace.gaps)} gaps, power below."
    )


def _day(trace: Trace) -> str:
    return utc_of(trace.grid.t0_utc_us + round(trace.start * 1e6)).strftime("%Y-%m-%d")


def _clock(trace: Trace, seconds: float) -> str:
    return utc_of(trace.grid.t0_utc_us + round(seconds * 1e6)).strftime("%H:%M:%S")
