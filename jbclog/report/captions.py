"""What a figure shows, in words: for the line above it, and for those who cannot see it."""

from __future__ import annotations

import numpy as np

from jbclog.report.style import WIDE
from jbclog.report.timescale import duration_text, moment
from jbclog.report.trace import LATE, Trace

MOST_GAPS_NAMED = 3


def caption(trace: Trace) -> str:
    """The day, what the band means, and the longest gaps by name."""
    parts = [f"{_day(trace)}, times in UTC."]
    read = int(np.count_nonzero(~np.isnan(trace.setting)))
    if read:
        parts.append(f"The setting is known where it was read{', at the dots' if read <= WIDE.most_dots else ''}.")
    if len(trace.seconds) > 2 * WIDE.stretches:
        stretch = (trace.end - trace.start) / WIDE.stretches
        parts.append(f"Line: mean, band: min–max of every {duration_text(stretch)}.")
    if trace.joints:
        parts.append(joints_marked(trace))
    gaps = sorted(trace.gaps, key=lambda gap: (-round(gap.seconds, 6), gap.start))
    named = [
        f"{gap.word.replace('_', ' ')} {duration_text(gap.seconds)} at {_clock(trace, gap.start)}" for gap in gaps[:MOST_GAPS_NAMED]
    ]
    if named:
        more = len(gaps) - len(named)
        parts.append(f"No data: {', '.join(named)}{f' and {more} more' if more else ''}.")
    return " ".join(parts)


def closer_caption(part: Trace, why: str) -> str:
    """Which minute it is and why that one."""
    joints = f" {joints_marked(part)}" if part.joints else ""
    return f"Closer: {_clock(part, part.start)} to {_clock(part, part.end)}, around {why}.{joints}"


def joints_marked(trace: Trace) -> str:
    """What the bars at the foot of the temperature are."""
    count, late = len(trace.joints), sum(one.word == LATE for one in trace.joints)
    bars = f"Bars at the foot: {count} joint{'s' * (count != 1)}"
    return f"{bars}; high and red: {late} after which the next one came before the tip was back." if late else f"{bars}."


def description(place: str, trace: Trace) -> str:
    """The figure without seeing it."""
    if trace.states:
        return f"{place}: its states over {duration_text(trace.end - trace.start)}, {len(trace.gaps)} gaps."
    known = trace.temperature[~np.isnan(trace.temperature)]
    seen = f"from {known.min():g} to {known.max():g} °C" if len(known) else "never read"
    alarms = sum(mark.kind == "alarm" for mark in trace.marks)
    length = duration_text(trace.end - trace.start)
    what = "tip" if trace.air is None else "air"
    joints = f"{len(trace.joints)} joints, " if trace.joints else ""
    return f"{place}: {what} temperature {seen} over {length}, {joints}{alarms} alarms, {len(trace.gaps)} gaps, power below."


def _day(trace: Trace) -> str:
    return moment(trace.grid.t0_utc_us + round(trace.start * 1e6)).strftime("%Y-%m-%d")


def _clock(trace: Trace, seconds: float) -> str:
    return moment(trace.grid.t0_utc_us + round(seconds * 1e6)).strftime("%H:%M:%S")
