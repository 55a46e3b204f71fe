"""The tools of one station that must be made safe, and how far that got. The steps are in `secure.py`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from jbclog.core.errors import LinkFlooded
from jbclog.core.io_requests import Steps
from jbclog.protocol.client.interface import Client
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.status import StatusWord

VERIFIED, SENT, FAILED = "verified", "sent", "failed"
ORDER_S = 0.25  # that one tool is left for its order, at the most; as long as the quickest took, where that is known
MARGIN_S = 0.5  # beside that, for what is lost on the way


Prove = Callable[[], Steps[bool]]
"""Asks who is at the end of the line; whether it is the station that is meant. May raise what a question may."""


@dataclass(slots=True)
class Tool:
    """One port's tool and how far it got: `FAILED`, `SENT` (acknowledged, or over a flooded link) or `VERIFIED` (read back as
    `status`).

    `suction`: whether the orders keep suction on (hot air); None where it is learnt by looking, and off until then.
    """

    port: int
    suction: bool | None = False
    reached: str = FAILED
    status: StatusWord | None = None
    was_spared: bool = False  # it rested already, and was not told to
    ordered: StatusWord | None = None  # the last order that went out, whatever came of it
    was_lost: bool = False  # that order was not answered, and is not what was read back
    _first: StatusWord | None = None
    _passed_over: dict[StatusWord, str] = field(default_factory=dict)
    _ruled_out: set[StatusWord] = field(default_factory=set)

    @property
    def is_safe(self) -> bool:
        return self.reached == VERIFIED

    @property
    def was_told(self) -> bool:
        return self.ordered is not None

    @property
    def fell_back(self) -> str:
        """Why it was told another state than the one that was to be; empty where it was not."""
        return "; ".join(self._passed_over.values()) if self.ordered != self._first else ""

    def tell(self, word: StatusWord) -> None:
        """Take note that this order goes out."""
        self._first = self._first or word
        self.ordered, self.status, self.was_lost = word, None, False

    def pass_over(self, word: StatusWord, why: str, *, rule_out: bool = True) -> None:
        """This order did not make it safe. Where another follows on it (`rule_out`) it is not given again: the tool may rest by
        then, and would be heated.
        """
        self._passed_over.setdefault(word, why)
        if rule_out:
            self._ruled_out.add(word)

    def is_ruled_out(self, word: StatusWord) -> bool:
        """Whether the station does not take this order, or the tool does not cool by it."""
        return word in self._ruled_out

    def choices(self, words: Sequence[StatusWord]) -> list[StatusWord]:
        """Those of these orders that may still make it safe; the last one always may."""
        *others, last = words
        return [*(word for word in others if word not in self._ruled_out), last]


@dataclass(slots=True)
class Task:
    """The tools of one station that must be made safe, and what is known of the station.

    `wanted` is the name of one of the family's safe states; another, which a lease from elsewhere may name, is not ordered, but
    the usual one. `feeds`: the feeder may be running. `is_proven`: the port has
    not broken since the station said who it is; where it has, nothing is written before `prove` says so again. `spare`: a tool
    that rests already is left alone, because a tool that sleeps would wake to be told to stand.
    """

    client: Client
    family: Family
    wanted: str
    tools: list[Tool]
    feeds: bool
    prove: Prove
    is_proven: bool = True
    spare: bool = False
    is_stranger: bool = False  # nothing is told over a flooded link: another station was found there, or it was told before
    flood: LinkFlooded | None = None  # that its link brought, and the orders had to do without an answer
    is_silent: bool = False  # the last that was asked was not answered: acknowledgements are not waited for long
    has_waited: bool = field(init=False, default=False)  # in vain, for an acknowledgement
    order_s: float = field(init=False, default=ORDER_S)  # how long an order to one tool takes, with its reading back
    has_fed: bool = field(init=False)
    is_flooded: bool = field(init=False, default=False)  # its link, in this round
    end: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        self.has_fed = self.feeds
        if self.wanted not in self.family.safe_states:
            self.wanted = next(iter(self.family.safe_states), self.wanted)

    def words(self, tool: Tool) -> list[StatusWord]:
        """The orders that may make this tool safe, in the order in which they are tried."""
        return tool.choices(self.family.status.safe_words(self.wanted, suction=bool(tool.suction)))

    def has_to_cool(self, word: StatusWord) -> bool:
        """Whether this state counts only when the tool is seen to cool."""
        status = self.family.status
        proven = [status.orders[state] for state in self.family.proven_by_cooling if state in status.orders]
        return not status.is_resting(word) and any(word[3] == one[3] for one in proven)

    def latest(self, tools: int) -> float:
        """When the orders to so many tools must begin, so that all of them go out and are read back."""
        return self.end - MARGIN_S - tools * self.order_s if tools else self.end

    def note_flood(self, flood: LinkFlooded) -> None:
        """Its link is flooded: who is there, and what was done, has to be proven anew."""
        self.flood, self.is_flooded, self.is_proven = flood, True, False

    @property
    def is_done(self) -> bool:
        return not self.feeds and all(tool.is_safe for tool in self.tools)
