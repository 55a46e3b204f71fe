"""Texts of the live view, the same in the terminal and on the page. Unknown values never look like
known ones.
"""

from __future__ import annotations

import time
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from jbclog.app.watch.batch_queue import BatchQueue
from jbclog.core.rows import Severity
from jbclog.core.text import clean, units_text
from jbclog.live import (
    Condition,
    Counter,
    Coverage,
    Joints,
    NumberedEvent,
    Phase,
    PortState,
    Reading,
    RunState,
    StationState,
    Trace,
)
from jbclog.live.sample_history import HOUR_S, TRACE_S
from jbclog.live.states import RUN_ENDED

SEVERITIES: Final = (Severity.INFO, Severity.WARNING, Severity.ERROR, Severity.CRITICAL)
BLOCKS: Final = "▁▂▃▄▅▆▇█"
SPAN_C: Final = 5.0  # smallest range of a sparkline, so that noise does not look like a change
OLD_COUNT_S: Final = 20.0  # age from which on a number of joints is shown with it
LABEL: Final = 8  # columns of the labels of a plot
NO_RUN: Final = "no run yet"
WORST: Final = tuple(Condition)
NOTHING_KNOWN: Final = (Phase.CRASHED, Phase.DELAYED, Phase.UNREADABLE, Phase.GONE)


def age_text(seconds: float) -> str:
    """Return ``0.3 s``, ``12 s``, ``5 min``, ``3 h``."""
    for limit, size, unit in ((10, 1, "s"), (120, 1, "s"), (7200, 60, "min")):
        if seconds < limit:
            return f"{seconds / size:.1f} {unit}" if limit == 10 else f"{seconds / size:.0f} {unit}"
    return f"{seconds / 3600:.0f} h"


def reading_text(reading: Reading, unit: str = "") -> str:
    """Return ``350 °C``, or ``unknown (timeout; last 350 °C, 12 s ago)``."""
    value = clean(f"{reading.value} {unit}".rstrip())
    if reading.is_known:
        return value
    if reading.value is None:
        return (
            reading.why
            if reading.why == "not supported"
            else f"unknown ({clean(reading.why or 'not read yet')})"
        )
    age = "unknown age" if reading.age_s is None else f"{age_text(reading.age_s)} ago"
    last = f"last {value}" if reading.why == RUN_ENDED else f"last {value}, {age}"
    return f"unknown ({clean(reading.why or 'stale')}; {last})"


def power_text(reading: Reading) -> str:
    """Return the power in per cent."""
    if not isinstance(reading.value, int | float):
        return reading_text(reading)
    return reading_text(
        Reading(round(reading.value / 10), reading.age_s, reading.why, reading.is_stale), "%"
    )


def status_text(reading: Reading) -> str:
    """Return the tool's status: ``working``, or ``status unknown (timeout; …)``."""
    text = reading_text(reading)
    return text if reading.is_known else f"status {text}"


def coverage_text(coverage: Coverage) -> str:
    """Return ``99.8 % of 1200``; without a share if nothing was due."""
    if coverage.share is None:
        return "coverage unknown"
    share = (
        f"{100 * coverage.share:.1f}"
        if coverage.obtained == coverage.due
        else f"{min(100 * coverage.share, 99.9):.1f}"
    )
    return f"coverage {share} % of {coverage.due}" + (
        "" if coverage.is_whole else ", still counting"
    )


def joints_text(joints: Joints) -> str:
    """Return ``joints 12``, ``joints 12 (3 min ago)``, or that their number is not known;
    `joints_why` has the reason.
    """
    if joints.count is not None:
        return f"joints {joints.count}{joints_age(joints)}"
    if joints.is_awaited:
        return "joints –"
    return "joints not known" + (f" ({joints.found} found)" if joints.found else "")


def joints_age(joints: Joints) -> str:
    """Return `` (3 min ago)`` if the number is so old that it matters."""
    age_s = joints.age_s or 0.0
    return f" ({age_text(age_s)} ago)" if age_s >= OLD_COUNT_S else ""


def joints_why(joints: Joints) -> str:
    """Return why the number of joints is not known; empty if it is."""
    return "" if joints.why is None else f"joints: {clean(joints.why)}"


def row_text(port: PortState) -> str:
    """Return the age of the newest row: ``row 0.3 s ago``."""
    if port.temperature.why == RUN_ENDED:
        return "no more rows"
    return "row of unknown age" if port.row_age_s is None else f"row {age_text(port.row_age_s)} ago"


def port_name(port: PortState) -> str:
    tool = f" {port.tool_name}" if port.tool_name else ""
    return clean(f"{port.station} port {port.port}{tool}")


def port_lines(port: PortState, width: int) -> list[str]:
    """Return the lines of a tile: readings, the last minute, age and coverage, problems."""
    lines = [
        f"now {reading_text(port.temperature, '°C')}",
        f"set {reading_text(port.setpoint, '°C')}",
    ]
    lines += [f"power {power_text(port.power)} · {status_text(port.status)}"]
    lines += [sparkline(port.trace, width)]
    lines += [
        " · ".join([row_text(port), *counts(port)]),
        coverage_text(port.coverage),
    ]
    return lines + [f"! {text}" for text in wrong(port)]


def counts(port: PortState) -> list[str]:
    """Return ``joints 12``, and ``alarms 1`` if there was one, which may be over."""
    alarms = [f"alarms {port.alarms_so_far}"] if port.alarms_so_far else []
    return [joints_text(port.joints), *alarms]


def wrong(port: PortState) -> list[str]:
    """Return the sentences of a port's alarms and problems, without the port's name, which its tile
    has.
    """
    return [
        clean(text.removeprefix(f"Port {port.port}: ")) for text in (*port.alarms, *port.problems)
    ]


def not_known(port: PortState, why: str) -> PortState:
    """Return the port with every reading unknown."""
    readings = {name: replace(one, age_s=None, why=why) for name, one in port.readings.items()}
    return replace(port, condition=Condition.STALE, readings=readings, row_age_s=None)


def run_line(run: RunState) -> str:
    """Return the run in one line: name, phase, order and unit."""
    facts = {
        "order": run.order,
        "product": run.product,
        "units": run.units,
        "operator": run.operator,
    }
    known = [
        units_text(run.units) if name == "units" else f"{name} {text}"
        for name, text in facts.items()
        if text
    ]
    verdict = [f"verdict {run.verdict}"] if run.verdict else []
    return clean(" · ".join([run.folder.name, run.phase.upper(), *known, *verdict]))


def worst(run: RunState) -> Condition | None:
    """Return the worst condition of the run's ports; None without ports."""
    return min((port.condition for port in run.ports), key=WORST.index, default=None)


def title(run: RunState | None) -> str:
    """Return the page's title: a phase in which nothing is known, else the worst condition."""
    if run is None:
        return NO_RUN.upper()
    return (
        str(run.phase) if run.phase in NOTHING_KNOWN else str(worst(run) or Condition.NOT_KNOWN)
    ).upper()


def no_run(path: Path) -> str:
    """Return the text shown while a folder has no run."""
    return f"no run in {clean(str(path))} yet; it is shown as soon as one begins"


def status_line(run: RunState) -> str:
    """Return the counts of ports by condition, the worst first, and the run's problems."""
    conditions = [port.condition for port in run.ports]
    counts = [f"{conditions.count(one)} {one}" for one in WORST if one in conditions]
    text = [] if run.phase is Phase.RECORDING else [run.text]
    return " · ".join([", ".join(counts) or "no port yet", *text, *map(clean, run.problems)])


def event_line(numbered: NumberedEvent) -> str:
    """Return an event in one line: local time, severity, place, text."""
    event = numbered.event
    moment = time.strftime("%H:%M:%S", time.localtime(event.time // 1_000_000))
    text = event.text.removeprefix(f"{event.station}: ").removeprefix(f"Port {event.port}: ")
    place = (
        "run"
        if event.station is None
        else event.station
        if event.port is None
        else f"{event.station} port {event.port}"
    )
    return clean(f"{moment}  {event.severity.value:8}  {place}: {text}")


def setting_rows(station: StationState) -> list[list[str]]:
    """Return the settings of a station: heads, then a row for each; empty if none was read."""
    rows = [
        (
            one.name,
            _cell(one.port),
            _cell(one.tool_name),
            one.value or "unknown",
            one.uom,
            one.outcome,
        )
        for one in station.settings
    ]
    return _rows(("setting", "port", "tool", "value", "unit", "outcome"), rows)


def counter_rows(station: StationState) -> list[list[str]]:
    """Return the counters of a station: heads, then a row for each; empty if none was read."""
    rows = [(one.name, _cell(one.port), _number(one), one.uom) for one in station.counters]
    return _rows(("counter", "port", "value", "unit"), rows)


def _number(counter: Counter) -> str:
    return f"unknown ({counter.raw.strip('<>')})" if counter.value is None else f"{counter.value:g}"


def _cell(value: object) -> str:
    return "" if value is None else str(value)


def _rows(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[list[str]]:
    return [list(heads), *([clean(cell) for cell in row] for row in rows)] if rows else []


def columns(lines: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of cells as lines, each column as wide as its widest cell."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    ]


def queue_lines(queues: Sequence[BatchQueue]) -> list[str]:
    """Return the progress of each running batch, and its jobs as a table without heads."""
    return [
        line
        for queue in queues
        for line in (clean(queue.text), *columns([tuple(map(clean, one)) for one in queue.jobs]))
    ]


def zone_text() -> str:
    """Return the zone of the times shown: ``UTC``, ``CET (UTC+0100)``."""
    return time.strftime("%Z (UTC%z)").removesuffix(" (UTC+0000)")


def at_least(severity: Severity, event: NumberedEvent) -> bool:
    return SEVERITIES.index(event.event.severity) >= SEVERITIES.index(severity)


def sparkline(trace: Trace, width: int) -> str:
    """Draw the temperature of the last minute as blocks, the newest at the right; an interval
    without a reading is blank.
    """
    means = _means(trace, width)
    low, high = _range(means)
    return "".join(
        " " if mean is None else BLOCKS[round((mean - low) / (high - low) * (len(BLOCKS) - 1))]
        for mean in means
    )


def plot(trace: Trace, width: int, height: int, span_s: float = TRACE_S) -> list[str]:
    """Draw the temperature of the last seconds in lines of blocks, with its range at the left and
    its time below.
    """
    means = _means(trace, width - LABEL, span_s)
    if span_s > TRACE_S:
        means[-1:] = trace.temperature_c[-1:]
    if not any(mean is not None for mean in means):
        return [f"no reading in the last {'minute' if span_s == TRACE_S else 'hour'}"]
    low, high = _range(means)
    steps = [
        (
            None
            if mean is None
            else 1 + round((mean - low) / (high - low) * (height * len(BLOCKS) - 1))
        )
        for mean in means
    ]
    lines = []
    for line in reversed(range(height)):
        label = f"{high:.0f} °C" if line == height - 1 else f"{low:.0f} °C" if line == 0 else ""
        lines.append(f"{label:>{LABEL - 1}} " + "".join(_block(step, line) for step in steps))
    seconds = f"-{span_s:.0f} s" if span_s <= TRACE_S else f"-{span_s / 60:.0f} min"
    return [*lines, " " * LABEL + seconds + "now".rjust(max(width - LABEL - len(seconds), 4))]


def hour_plot(port: PortState, width: int, height: int) -> list[str]:
    """Draw the last hour as `plot` does; its last column is the newest reading, so that no mean
    hides the present.
    """
    trace = _hour_to_now(port)
    if trace.last_s - min(trace.seconds, default=trace.last_s) < max(
        TRACE_S, 2 * HOUR_S / max(width - LABEL, 1)
    ):
        return ["too short yet for an hour's plot; `h` shows the last minute"]
    return plot(trace, width, height, HOUR_S)


def _hour_to_now(port: PortState) -> Trace:
    """Return the hour's means up to the begin of the last minute, then that minute as read."""
    old, new = port.hour, port.trace
    count = bisect_left(old.seconds, new.seconds[0]) if new.seconds else len(old.seconds)
    return Trace(
        old.seconds[:count] + new.seconds,
        old.temperature_c[:count] + new.temperature_c,
        old.power_permille[:count] + new.power_permille,
    )


def _block(step: int | None, line: int) -> str:
    filled = 0 if step is None else min(step - line * len(BLOCKS), len(BLOCKS))
    return " " if filled < 1 else BLOCKS[filled - 1]


def _means(trace: Trace, width: int, span_s: float = TRACE_S) -> list[float | None]:
    """Return the mean temperature of each of `width` intervals of the last `span_s` seconds."""
    stretches: list[list[float]] = [[] for _ in range(max(width, 1))]
    for seconds, value in zip(trace.seconds, trace.temperature_c, strict=True):
        if value is not None:
            stretches[_place(seconds - trace.last_s, len(stretches), span_s)].append(value)
    means = [sum(values) / len(values) if values else None for values in stretches]
    return _without_thin_gaps(means, trace, span_s)


def _place(before_s: float, width: int, span_s: float) -> int:
    """Return the interval, of `width`, of a row `before_s` (negative) seconds from the newest
    one.
    """
    return min(max(int((before_s + span_s) / span_s * width), 0), width - 1)


def _without_thin_gaps(
    means: list[float | None], trace: Trace, span_s: float
) -> list[float | None]:
    """Fill intervals that are blank only because they are shorter than the distance of two rows."""
    rows = {_place(seconds - trace.last_s, len(means), span_s) for seconds in trace.seconds}
    first = min(rows, default=len(means))
    filled: list[float | None] = []
    for place, mean in enumerate(means):
        filled.append(filled[-1] if mean is None and place > first and place not in rows else mean)
    return filled


def _range(means: Sequence[float | None]) -> tuple[float, float]:
    known = [mean for mean in means if mean is not None] or [0.0]
    middle, half = (min(known) + max(known)) / 2, max(max(known) - min(known), SPAN_C) / 2
    return middle - half, middle + half
