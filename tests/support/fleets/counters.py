"""Counters' differences and looks at stations, made without a ledger: what a test says was read is
what was read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from itertools import pairwise

from jbclog.maintenance.counter_totals.observed import Count, Errors, Identity, Observation
from jbclog.maintenance.counter_totals.span import Interval
from jbclog.maintenance.counter_totals.totals import Difference, DifferenceKind, Join, Point, Trace

NOW = datetime(2026, 11, 21, 6, 0, tzinfo=UTC)


def ago(days: float) -> str:
    """A time so many days before now, as the ledger has it."""
    return (NOW - timedelta(days=days)).isoformat()


def went(counter: str, readings: Sequence[tuple[float, float]], port: int = 1) -> Trace:
    """The trace of a counter that just went on, of readings (days ago, value); hours are whole."""
    trace = Trace(port, counter, 1.0 if counter.endswith("_h") else 0.0)
    for look, (days_ago, value) in enumerate(readings):
        trace.points.append(Point(look, ago(days_ago), Interval(value, value)))
    trace.kept += [between(counter, *pair, port=port) for pair in pairwise(readings)]
    return trace


def then(trace: Trace, days_ago: float, value: float, join: Join, lost: Interval) -> Trace:
    """One more reading, behind a reset or whatever it was."""
    trace.points.append(Point(len(trace.points), ago(days_ago), Interval(value, value), join, lost))
    return trace


def between(
    counter: str,
    before: tuple[float, float],
    after: tuple[float, float],
    *,
    port: int = 1,
    kind: DifferenceKind | None = None,
    delta: Interval | None = None,
    rule: str = "goes on",
    text: str = "It went on.",
) -> Difference:
    """One difference; of what kind and how much where it is not plain."""
    grown, fine = after[1] - before[1], 1.0 if counter.endswith("_h") else 0.0
    plain = DifferenceKind.NORMAL if grown else DifferenceKind.ZERO
    found = delta or Interval(max(grown - fine, 0.0), grown + fine)
    times = ago(before[0]), ago(after[0])
    return Difference(
        port,
        counter,
        *times,
        before[1],
        after[1],
        kind or plain,
        rule,
        text,
        found,
        found.width <= 2,
    )


def look(
    station: str = "dde-1",
    days_ago: float = 0,
    *,
    counts: Mapping[tuple[int, str], float] | None = None,
    parameters: Mapping[str, str] | None = None,
    tool_names: Mapping[int, str] | None = None,
    software: str = "0203456",
    model: str = "DDE",
    events: Mapping[str, int] | None = None,
) -> Observation:
    """A look at a station that answered."""
    read = tuple(Count(port, name, "h", value) for (port, name), value in (counts or {}).items())
    told = Errors(events=None if events is None else dict(events))
    return Observation(
        ago(days_ago),
        ago(days_ago),
        "bench-3",
        station,
        "/dev/ttyUSB0",
        True,
        identity=Identity("dde", model, software),
        counts=read,
        tool_names=dict(tool_names or {}),
        parameters=dict(parameters or {}),
        errors=told,
    )
