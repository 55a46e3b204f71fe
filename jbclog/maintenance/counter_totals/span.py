"""A counter from one reading to the next, and what can have happened in between, each thing asked by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

from jbclog.maintenance.counter_totals.interval import Interval
from jbclog.maintenance.counter_totals.traits import DRIFT, Trait

MANY = 1000  # roll-overs; beyond it nobody counts
LEAST_HOURS = 4.0  # a pace is not told of fewer


def top_of(modulus: float, trait: Trait) -> float:
    """The last number before it rolls over."""
    return modulus - (trait.step or 1.0)


@dataclass(slots=True)  # as `Interval`: never changed, and made too often to be frozen
class Reading:
    """What a counter showed at a look (its number in the station's history): two values where it was moving."""

    look: int
    shown: Interval


@dataclass(slots=True)  # a frozen one takes three times as long to make, and there are hundreds of thousands
class Span:
    """From `before` to `after`. `elapsed_h`: at most. `most`: what can have been worked at the fastest plausible pace; `usual`:
    at ten times the fastest that was seen. `grown`: by how much the readings differ, two of a moving one each way."""

    port: int
    counter: str
    trait: Trait
    modulus: float
    before: Reading
    after: Reading
    elapsed_h: float
    most: float
    usual: float
    grown: Interval

    @property
    def fell(self) -> bool:
        return self.grown.high < 0

    @property
    def is_unchanged(self) -> bool:
        return self.grown.low <= 0 <= self.grown.high

    @property
    def top(self) -> float:
        return top_of(self.modulus, self.trait)

    @property
    def can_go_on(self) -> bool:
        """Whether it can just have counted on."""
        return not self.fell and self.grown.low <= self.most + self.trait.step

    @property
    def worked(self) -> Interval:
        """What was worked if it just counted on."""
        return Interval(max(0.0, self.grown.low - self.trait.step), max(0.0, self.grown.high) + self.trait.step)

    def turns(self, most: float) -> range:
        """How often it can have rolled over if no more than `most` was worked, from once on."""
        room = most + self.trait.step - self.grown.low
        return range(1, 1 + min(MANY, max(0, math.floor(room / self.modulus)) if math.isfinite(room) else MANY))

    @property
    def at_most(self) -> float:
        """What can have been worked in this time, by whichever unit stood there."""
        return self.elapsed_h * DRIFT * (1.0 if self.trait.is_time else self.trait.fastest)

    @property
    def can_be_reset(self) -> bool:
        """Whether all that it shows can have been counted since the last reading, from zero."""
        shown = self.after.shown.low
        return shown <= (self.elapsed_h * DRIFT if self.trait.is_time else self.elapsed_h * self.trait.fastest)

    @property
    def is_impossible(self) -> bool:
        """Whether nothing that a counter does explains it."""
        return not (self.can_go_on or self.turns(self.most) or self.can_be_reset)
