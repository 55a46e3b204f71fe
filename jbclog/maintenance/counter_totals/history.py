"""The entries of one station in the ledger, in order: its looks and its facts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

from jbclog.maintenance.counter_totals.observed import Count, Entry, Fact, Observation, Standing
from jbclog.maintenance.counter_totals.span import Elapsed, Interval, Reading, seconds

Key = tuple[int, str]
"""A counter of a station: port and name."""

MOVES_AT_MOST = 1000.0  # reads of one look that differ by more are not those of a moving counter


@dataclass
class History:
    """One station of one line. `looks`: observations that it answered; `all`: all observations."""

    line: str
    station: str
    all: list[Observation] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)

    @cached_property
    def looks(self) -> list[Observation]:
        return [one for one in self.all if one.seen]

    @cached_property
    def times(self) -> list[float]:
        """Times of the looks in seconds since 1970, by the host's clock."""
        return [seconds(one.time) for one in self.looks]

    @cached_property
    def elapsed(self) -> Elapsed:
        return Elapsed(self.times)

    def readings(self) -> dict[Key, list[Reading]]:
        """Return the readings of every counter, oldest first."""
        found: dict[Key, list[Reading]] = {}
        for look, seen in enumerate(self.looks):
            for count in seen.counts:
                shown = _shown(count)
                if shown is not None:
                    found.setdefault((count.port, count.counter), []).append(Reading(look, shown))
        return found

    def stated(self, task: str, begin: int, end: int) -> Iterator[Fact]:
        """Yield the facts of a task of `STATED` whose time is between two looks."""
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
    """Return the histories by line and station, in the order of their first entries."""
    found: dict[tuple[str, str], History] = {}
    for entry in entries:
        history = found.setdefault((entry.line, entry.station), History(entry.line, entry.station))
        if isinstance(entry, Fact):
            history.facts.append(entry)
        else:
            history.all.append(entry)
    return found
