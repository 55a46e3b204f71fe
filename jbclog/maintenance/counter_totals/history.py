"""What the ledger has of one station: the looks that saw it and the facts, in order, and from them a trace for every counter."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

from jbclog.maintenance.counter_totals.elapsed import Elapsed, seconds
from jbclog.maintenance.counter_totals.interval import Interval
from jbclog.maintenance.counter_totals.observed import Count, Entry, Fact, Observation, Standing
from jbclog.maintenance.counter_totals.span import Reading

Key = tuple[int, str]
"""A counter of a station: port and name."""

MOVES_AT_MOST = 1000.0  # two readings of one look that differ by more are not of a counter that moves


@dataclass
class History:
    """One station of one line. `looks` are the observations that saw it, `all` the others too."""

    line: str
    station: str
    all: list[Observation] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)

    @cached_property
    def looks(self) -> list[Observation]:
        return [one for one in self.all if one.seen]

    @cached_property
    def times(self) -> list[float]:
        """Of the looks, in seconds since 1970, as the host believed."""
        return [seconds(one.time) for one in self.looks]

    @cached_property
    def elapsed(self) -> Elapsed:
        return Elapsed(self.times)

    @cached_property
    def readings(self) -> dict[Key, list[Reading]]:
        """Every counter's, oldest first, without what was not read."""
        found: dict[Key, list[Reading]] = {}
        for look, seen in enumerate(self.looks):
            for count in seen.counts:
                shown = _shown(count)
                if shown is not None:
                    found.setdefault((count.port, count.counter), []).append(Reading(look, shown))
        return found

    def told(self, task: str, begin: int, end: int) -> Iterator[Fact]:
        """Facts of a task of `STATED` whose time is between two looks."""
        for fact in self.facts:
            if fact.task == task and self.times[begin] < seconds(fact.time) <= self.times[end]:
                yield fact


def _shown(count: Count) -> Interval | None:
    if count.standing is Standing.OK and count.value is not None:
        return Interval(count.value, count.value)
    if count.standing is Standing.MOVING and count.values:
        low, high = min(count.values), max(count.values)
        return Interval(low, high) if high - low <= MOVES_AT_MOST else None
    return None


def histories(entries: Iterable[Entry]) -> dict[tuple[str, str], History]:
    """By line and station, as they first appear."""
    found: dict[tuple[str, str], History] = {}
    for entry in entries:
        history = found.setdefault((entry.line, entry.station), History(entry.line, entry.station))
        if isinstance(entry, Fact):
            history.facts.append(entry)
        else:
            history.all.append(entry)
    return found
