"""The status word `0MDES` of R-PSx and W-PSx: its meaning for each kind of station, and the words
that may be written.

The units digit is the state of the tool; the tens digit is the extractor state of soldering
stations and the cooling of hot air (manual 002, "Tool Operating Status"; manual 001, 4.6;
docs/reference/protocol.md, Status word; docs/reference/contradictions.md, B-17 to B-19).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

StatusWord = tuple[int, ...]

WORKING: StatusWord = (0, 0, 0, 0, 0)
STAND: StatusWord = (0, 0, 0, 0, 1)
EXTRACTOR: StatusWord = (0, 0, 0, 1, 0)


@dataclass(frozen=True, slots=True)
class StatusTable:
    """The status words of one kind of station.

    `names`: states by units digit; in `heating` the tool is at work, in `resting` it is safe.
    `orders`: words that may be written, by their name in a recipe. `last_resorts`: tried if another
    safe state is not reached, because the tool cools by itself in them. `tens_rests`: the tens
    digit alone stops the work. `has_suction`: the hundreds digit orders suction.
    """

    names: tuple[str, ...]
    heating: frozenset[int]
    resting: frozenset[int]
    orders: Mapping[str, StatusWord]
    last_resorts: tuple[str, ...]
    tens: str
    tens_rests: bool
    has_suction: bool = False

    def with_suction(self, word: StatusWord, *, on: bool) -> StatusWord:
        """Return `word` with suction on or off; unchanged if the family has none."""
        return (*word[:2], int(on), *word[3:]) if self.has_suction else word

    def sucks(self, word: StatusWord) -> bool:
        """Return True if suction is on; False if the family has none."""
        return self.has_suction and word[2] == 1

    def safe_words(self, state: str, *, suction: bool) -> tuple[StatusWord, ...]:
        """Return the words that make a tool safe, in the order to try: `state` with `suction`,
        without, then the last resorts.
        """
        plain = self.orders[state]
        words = (
            self.with_suction(plain, on=suction),
            plain,
            *(self.orders[name] for name in self.last_resorts),
        )
        return tuple(dict.fromkeys(words))

    def is_working(self, word: StatusWord) -> bool:
        return word[4] in self.heating and not (self.tens_rests and word[3])

    def is_resting(self, word: StatusWord) -> bool:
        """Return True if the tool is in a safe state, for whatever reason."""
        return word[4] in self.resting and not (self.tens_rests and word[3])

    def is_safe(self, found: StatusWord, ordered: StatusWord) -> bool:
        """Return True if `found`, read back, confirms an ordered safe state: every resting state
        does.
        """
        if ordered[4] in self.resting:
            return found[4] in self.resting
        return found[3] == ordered[3] or self.is_resting(found)

    def confirms(self, found: StatusWord, ordered: StatusWord) -> bool:
        """Return True if `found` confirms `ordered`: stand may have become sleep, and hot air may
        have cooled down.

        Ignores suction, desoldering and motor.
        """
        if (self.tens_rests or ordered[4] in self.heating) and found[3] != ordered[3]:
            return False
        return found[4] == ordered[4] or (ordered[4] in self.resting and found[4] in self.resting)

    def state(self, word: StatusWord) -> str:
        """Name the state: ``stand``, ``extractor``, ``extractor-stand``."""
        named = self.names[word[4]]
        if not word[3]:
            return named
        return self.tens if (word[4] in self.heating) == self.tens_rests else f"{self.tens}-{named}"

    def shown(self, word: StatusWord) -> str:
        """Name the state, with suction if on: ``cooling with suction``."""
        return f"{self.state(word)}{' with suction' if self.sucks(word) else ''}"


SOLDERING_STATUS = StatusTable(
    names=("working", "stand", "sleep", "hibernation"),
    heating=frozenset({0}),
    resting=frozenset({1, 2, 3}),
    orders=MappingProxyType({"working": WORKING, "stand": STAND, "extractor": EXTRACTOR}),
    last_resorts=("stand",),
    tens="extractor",
    tens_rests=True,
)

NO_STATUS = StatusTable(
    (), frozenset(), frozenset(), MappingProxyType({}), last_resorts=(), tens="", tens_rests=False
)
"""For stations without a status word."""
