"""Looks at which nothing happened: every counter plainly went on, and every port shows that it was not reset. Most looks are such.

The same questions as `judging.py` and `span.py` ask of one difference after the other, asked of a whole look at once and in plain
numbers; whatever is not answered here is left to them. A long ledger has half a million differences.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from jbclog.maintenance.counter_totals.history import Key
from jbclog.maintenance.counter_totals.interval import Interval
from jbclog.maintenance.counter_totals.sentences import RULES
from jbclog.maintenance.counter_totals.span import LEAST_HOURS, Reading, top_of
from jbclog.maintenance.counter_totals.totals import Difference, Kind
from jbclog.maintenance.counter_totals.traits import DRIFT, FIVE_DIGITS, HOURS, Trait

LAST_HOUR = top_of(FIVE_DIGITS, HOURS)
Readings = Mapping[Key, Reading]


@dataclass(slots=True)
class Counter:
    """What is known of a counter for good. `pace`: the fastest it can be thought to go, an hour of `hours`, where that was seen."""

    key: Key
    trait: Trait
    modulus: float
    pace: float | None
    step: float = field(init=False)
    top: float = field(init=False)
    fastest: float = field(init=False)
    is_time: bool = field(init=False)
    hours: tuple[Key, ...] = field(init=False)

    def __post_init__(self) -> None:
        self.step, self.fastest, self.is_time = self.trait.step, self.trait.fastest, self.trait.is_time
        self.top = top_of(self.modulus, self.trait)
        self.hours = tuple((self.key[0], name) for name in self.trait.hours)


def is_plain(look: int, last: Readings, now: Readings, counters: Mapping[Key, Counter], elapsed_h: float) -> bool:
    """Whether all that was read at a look went on from the look before it, `elapsed_h` (finite) earlier at most."""
    ports, sure = set(), set()
    for key, after in now.items():
        before, counter = last.get(key), counters[key]
        if before is None or before.look != look - 1:
            return False
        lasted = elapsed_h * DRIFT if counter.is_time else lasted_h(counter.hours, last, now, before.look, elapsed_h)
        if not _went_on(counter, before.shown, after.shown, lasted):
            return False
        ports.add(key[0])
        if after.shown.low > elapsed_h * (DRIFT if counter.is_time else counter.fastest):
            sure.add(key[0])
    return bool(ports) and ports == sure


def lasted_h(hours: Sequence[Key], last: Readings, now: Readings, look: int, elapsed_h: float) -> float:
    """How long a counter of events can have counted: by the counter of time that it goes with, or by what went by.

    One that shows its last number may stand still, and tells nothing."""
    for key in hours:
        before, after = last.get(key), now.get(key)
        if before and after and before.look == look and before.shown.low <= after.shown.high < LAST_HOUR:
            return min(elapsed_h * DRIFT, after.shown.high - before.shown.low + 1.0)
    return elapsed_h * DRIFT


def _went_on(counter: Counter, before: Interval, after: Interval, lasted: float) -> bool:
    """Whether it cannot have rolled over, and not faster than can be: `counted_on`, of the commonest case."""
    if after.high >= counter.top or after.high < before.low:
        return False
    grown, most = after.low - before.high, lasted if counter.is_time else lasted * counter.fastest
    if grown > most + counter.step:
        return False
    usual = most if counter.pace is None else min(most, counter.pace * max(lasted, LEAST_HOURS))
    return (usual + counter.step - grown) / counter.modulus < 1.0


def difference(counter: Counter, before: Reading, after: Reading, begin: str, end: str) -> Difference:
    """What is told of it."""
    low, high = after.shown.low - before.shown.high, after.shown.high - before.shown.low
    is_unchanged = low <= 0 <= high
    rule = "unchanged" if is_unchanged else "went_on"
    worked = Interval(max(0.0, low - counter.step), max(0.0, high) + counter.step)
    kind = Kind.ZERO if is_unchanged else Kind.NORMAL
    return Difference(*counter.key, begin, end, before.shown.low, after.shown.low, kind, rule, RULES[rule], worked, is_known=True)
