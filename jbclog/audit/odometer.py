"""The software odometer: how much was worked since the first audit, over resets, roll-overs and exchanged stations."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from jbclog.audit.interval import Interval


class Kind(StrEnum):
    """What a difference between two readings of a counter is."""

    NORMAL = "normal"
    ZERO = "zero"
    ROLL_OVER = "roll_over"
    RESET = "reset"
    REPLACED = "replaced"
    IMPOSSIBLE = "impossible"
    SUSPECT = "suspect"


DOUBTFUL: Final = frozenset({Kind.IMPOSSIBLE, Kind.SUSPECT})


@dataclass(frozen=True, slots=True)
class Difference:
    """Between two readings, of what kind, and by which rule (its name, and a sentence).

    `delta` holds what was really worked in between (`high` infinite where nothing bounds it); `is_known` where it is no wider
    than the counter's own resolution. For a `replaced` station it is what the new one did since it was first seen: nothing.
    """

    port: int
    counter: str
    begin: str
    end: str
    before: float
    after: float
    kind: Kind
    rule: str
    text: str
    delta: Interval
    is_known: bool

    @property
    def is_doubtful(self) -> bool:
        return self.kind in DOUBTFUL


@dataclass(frozen=True, slots=True)
class Odometer:
    """What was worked from `since` (UTC) to the last reading: `total` holds the truth, `is_known` where it is as narrow as can be.

    `first` is what the counter showed at `since`. `marks` are all differences that are not plainly normal or zero, oldest first.
    """

    total: Interval
    since: str
    first: float
    is_known: bool
    marks: tuple[Difference, ...] = ()
