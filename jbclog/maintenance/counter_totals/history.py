"""The entries of one station in the ledger, in order: its looks and its facts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

from jbclog.config.task_names import STATED
from jbclog.maintenance.counter_totals.observed import Count, Entry, Fact, Observation, Standing
from jbclog.maintenance.counter_totals.span import Elapsed, Interval, Reading, seconds

Key = tuple[int, str]
"""A counter of a station: port and name."""

MOVES_AT_MOST = 1000.0  # reads of one look that differ by more are not those of a moving counter


@dataclass
class History:
    """One station of one line. `looks`: observations that it answered."""

    line: str
    station: str
    looks: list[Observation] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)

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

    @cached_property
    def answers(self) -> list[Fact]:
        """What people recorded of the counters themselves."""
        return [fact for fact in self.facts if fact.task in STATED]

    def stated_h(self, task: str, begin: int, end: int, port: int | None = None) -> list[float]:
        """Return the hours from one look to each answer `task` up to a later look; `port`: only
        answers for that port, or for all.
        """
        times = [
            seconds(fact.time)
            for fact in self.answers
            if fact.task == task and (port is None or fact.port in (None, port))
        ]
        first, last = self.times[begin], self.times[end]
        return [(time - first) / 3600 for time in times if first < time <= last]


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
        elif entry.seen:
            history.looks.append(entry)
    return found
