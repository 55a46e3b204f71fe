"""Looks without an event, which most are: every counter continues, and every port rules out a
reset.

A long ledger has half a million differences. The fast path applies the rules of `advance.py` and
`span.py` to a whole look at once, in plain numbers, and leaves every other look to them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from jbclog.maintenance.counter_totals.history import Key
from jbclog.maintenance.counter_totals.observed import DRIFT, FIVE_DIGITS, HOURS, Trait
from jbclog.maintenance.counter_totals.span import LEAST_HOURS, Interval, Reading, top_of

LAST_HOUR = top_of(FIVE_DIGITS, HOURS)
Readings = Mapping[Key, Reading]


@dataclass(slots=True)
class Counter:
    """Constants of a counter. `pace`: the greatest usual advance per hour of `hours`; None if too
    little was seen.
    """

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
        trait = self.trait
        self.step, self.fastest, self.is_time = trait.step, trait.fastest, trait.is_time
        self.top = top_of(self.modulus, trait)
        self.hours = tuple((self.key[0], name) for name in trait.hours)

    def possible(self, lasted_h: float) -> tuple[float, float]:
        """Return the greatest advance in that time at a plausible rate, and at its usual one."""
        most = lasted_h if self.is_time else lasted_h * self.fastest
        if self.pace is None:
            return most, most
        return most, min(most, self.pace * max(lasted_h, LEAST_HOURS))


def is_plain(
    look: int, last: Readings, now: Readings, counters: Mapping[Key, Counter], elapsed_h: float
) -> bool:
    """Whether every counter read at a look continues from the look before, at most `elapsed_h`
    (finite) earlier.
    """
    ports, sure = set(), set()
    for key, after in now.items():
        before, counter = last.get(key), counters[key]
        if before is None or before.look != look - 1:
            return False
        lasted = (
            elapsed_h * DRIFT
            if counter.is_time
            else lasted_h(counter.hours, last, now, before.look, elapsed_h)
        )
        if not _continues(counter, before.shown, after.shown, lasted):
            return False
        ports.add(key[0])
        if after.shown.low > elapsed_h * (DRIFT if counter.is_time else counter.fastest):
            sure.add(key[0])
    return bool(ports) and ports == sure


def lasted_h(
    hours: Sequence[Key], last: Readings, now: Readings, look: int, elapsed_h: float
) -> float:
    """Return how long a counter of events can have counted: by its first hour counter, or by the
    elapsed time.

    An hour counter at its last number may have stopped, and is not used.
    """
    for key in hours:
        before, after = last.get(key), now.get(key)
        if (
            before
            and after
            and before.look == look
            and before.shown.low <= after.shown.high < LAST_HOUR
        ):
            return min(elapsed_h * DRIFT, after.shown.high - before.shown.low + 1.0)
    return elapsed_h * DRIFT


def _continues(counter: Counter, before: Interval, after: Interval, lasted: float) -> bool:
    """Whether it advanced at a plausible rate and cannot have rolled over (see `counted_on`)."""
    if after.high >= counter.top or after.high < before.low:
        return False
    grown, (most, usual) = after.low - before.high, counter.possible(lasted)
    if grown > most + counter.step:
        return False
    return (usual + counter.step - grown) / counter.modulus < 1.0
