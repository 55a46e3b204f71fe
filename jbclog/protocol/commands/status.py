"""The status word `0MDES` of R-PSx and W-PSx: what it says in each kind of station, and which words are ordered.

The units digit names the state of the tool; the tens digit is the extractor state of soldering stations and the cooling
of hot air (manual 002, "Tool Operating Status"; manual 001, 4.6; docs/reference/protocol.md, Status word;
docs/reference/contradictions.md, B-17 to B-19).
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
    """One kind of station's status words.

    `names` are the states by units digit, `heating` those of them in which the tool is at work, `resting` those that it
    is safe in. `orders` are the words that may be written, by the name that a recipe uses; `last_resorts` are those that
    are tried where another is not reached: the tool cools by itself from them, whatever else the station does. Where
    `tens_rests` the tens digit alone stops the work. Where `has_suction` the hundreds digit orders suction, too.
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
        """`word` with suction ordered on or off; unchanged where no word orders suction."""
        return (*word[:2], int(on), *word[3:]) if self.has_suction else word

    def sucks(self, word: StatusWord) -> bool:
        """Whether suction is on; False where no word orders it."""
        return self.has_suction and word[2] == 1

    def safe_words(self, state: str, *, suction: bool) -> tuple[StatusWord, ...]:
        """The words that make a tool safe, in the order in which they are tried: `state`, where `suction` is kept on first with
        it and then without, and the last resorts.
        """
        plain = self.orders[state]
        words = (self.with_suction(plain, on=suction), plain, *(self.orders[name] for name in self.last_resorts))
        return tuple(dict.fromkeys(words))

    def is_working(self, word: StatusWord) -> bool:
        """Whether the tool is at work."""
        return word[4] in self.heating and not (self.tens_rests and word[3])

    def is_resting(self, word: StatusWord) -> bool:
        """Whether the tool is in a state that it is safe in, whoever put it there."""
        return word[4] in self.resting and not (self.tens_rests and word[3])

    def is_safe(self, found: StatusWord, ordered: StatusWord) -> bool:
        """Whether `found`, read back, says that a safe state that was ordered is reached: all resting states alike."""
        if ordered[4] in self.resting:
            return found[4] in self.resting
        return found[3] == ordered[3] or self.is_resting(found)

    def confirms(self, found: StatusWord, ordered: StatusWord) -> bool:
        """Whether `found` is what was ordered: stand may have become sleep already, and hot air may have cooled down.

        Suction, desoldering and motor are not compared.
        """
        if (self.tens_rests or ordered[4] in self.heating) and found[3] != ordered[3]:
            return False
        return found[4] == ordered[4] or (ordered[4] in self.resting and found[4] in self.resting)

    def state(self, word: StatusWord) -> str:
        """The state in words: ``stand``, ``extractor``, ``extractor-stand``."""
        named = self.names[word[4]]
        if not word[3]:
            return named
        return self.tens if (word[4] in self.heating) == self.tens_rests else f"{self.tens}-{named}"

    def shown(self, word: StatusWord) -> str:
        """The state in words, with suction where it is on: ``cooling with suction``."""
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

NO_STATUS = StatusTable((), frozenset(), frozenset(), MappingProxyType({}), last_resorts=(), tens="", tens_rests=False)
"""Of stations that have no status word."""
