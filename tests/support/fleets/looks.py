"""Histories of a station that are made by hand: what its counters showed at each look, and how many
hours after the first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta

from jbclog.maintenance.counter_totals.history import History
from jbclog.maintenance.counter_totals.observed import Count, Fact, Identity, Observation, Standing
from jbclog.maintenance.counter_totals.totals import Difference, Trace
from jbclog.maintenance.counter_totals.tracing import Traces, traces_of
from jbclog.maintenance.ledger import unit_of

BEGIN = datetime(2026, 1, 5, 5, tzinfo=UTC)
WHO = Identity("dde", "DDE", "8886412")
Shown = float | tuple[float, ...] | None
"""A value; several where it was moving; None where it was not read."""


def at(hour: float) -> str:
    return (BEGIN + timedelta(hours=hour)).isoformat()


def count(port: int, name: str, shown: Shown) -> Count:
    if shown is None:
        return Count(port, name, unit_of(name), None, Standing.UNREAD, why="timeout")
    if isinstance(shown, tuple):
        return Count(port, name, unit_of(name), None, Standing.MOVING, shown)
    return Count(port, name, unit_of(name), shown)


def seen(
    hour: float, shown: Mapping[str, Shown], who: Identity = WHO, port: int = 1
) -> Observation:
    """A look; counters of other ports as ``2.work_h``."""
    counts = []
    for name, value in shown.items():
        other, dot, rest = name.partition(".")
        counts.append(count(int(other), rest, value) if dot else count(port, name, value))
    return Observation(
        at(hour), at(hour), "line", "dde-1", "loop://", True, identity=who, counts=tuple(counts)
    )


def told(hour: float, task: str, port: int | None = None, part: str = "") -> Fact:
    return Fact(at(hour), at(hour), "A. Rossi", "line", "dde-1", task, port, part)


def traced(looks: Sequence[Observation], facts: Sequence[Fact] = ()) -> Traces:
    return traces_of(History("line", "dde-1", list(looks), list(facts)))


def series(every_h: float, *facts: Fact, **shown: Sequence[Shown]) -> dict[str, Trace]:
    """Traces of port 1's counters that showed so at looks so far apart."""
    names = list(shown)
    looks = [
        seen(place * every_h, dict(zip(names, values, strict=True)))
        for place, values in enumerate(zip(*shown.values(), strict=True))
    ]
    return {name: trace for (_, name), trace in traced(looks, facts).now.items()}


def rules(trace: Trace) -> list[str]:
    return [one.rule for one in trace.differences]


def last(trace: Trace) -> Difference:
    return trace.differences[-1]
