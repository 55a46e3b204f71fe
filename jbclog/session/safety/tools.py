"""The tools of one station to make safe, and their progress. `secure.py` has the steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from jbclog.core.errors import LinkFlooded
from jbclog.core.io_requests import Steps
from jbclog.core.states import SafetyResult
from jbclog.protocol.client.interface import Client
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.status import StatusWord
from jbclog.session.safety.time_budget import TimeBudget

Prove = Callable[[], Steps[bool]]
"""Reads the identity; returns True if it is the intended station. May raise what a read raises."""


@dataclass(slots=True)
class ToolSafety:
    """One port's tool and its progress: `FAILED`, `SENT` (acknowledged, or over a flooded link) or
    `VERIFIED` (read back as `status`).

    `suction`: the orders keep suction on (hot air); None if reading decides, off until then.
    """

    port: int
    suction: bool | None = False
    reached: SafetyResult = SafetyResult.FAILED
    status: StatusWord | None = None
    was_spared: bool = False  # it was at rest already, and got no order
    ordered: StatusWord | None = None  # the last order sent, with whatever result
    was_lost: bool = False  # that order was not answered, and the read-back differs
    _first: StatusWord | None = None
    _passed_over: dict[StatusWord, str] = field(default_factory=dict)
    _ruled_out: set[StatusWord] = field(default_factory=set)
    _unconfirmed: set[StatusWord] = field(default_factory=set)  # of those, no answer rules them out

    @property
    def is_safe(self) -> bool:
        return self.reached == SafetyResult.VERIFIED

    @property
    def was_ordered(self) -> bool:
        return self.ordered is not None

    @property
    def fell_back(self) -> str:
        """Why another state than the intended one was ordered; empty if it was not."""
        return "; ".join(self._passed_over.values()) if self.ordered != self._first else ""

    def note_order(self, word: StatusWord) -> None:
        self._first = self._first or word
        self.ordered, self.status, self.was_lost = word, None, False

    def pass_over(self, word: StatusWord, why: str, *, rule_out: bool = True) -> None:
        """Register that this order did not make the tool safe. With `rule_out`, if a fallback
        follows, do not repeat it: the tool may rest by then, and would be heated.
        """
        self._passed_over.setdefault(word, why)
        if rule_out:
            self._ruled_out.add(word)
            self._unconfirmed.discard(word)

    def pass_over_unconfirmed(self, word: StatusWord, why: str) -> None:
        """As `pass_over` for an order without a usable answer, which may have been obeyed."""
        is_open = self.may_obey(word)
        self.pass_over(word, why)
        if is_open:
            self._unconfirmed.add(word)

    def may_obey(self, word: StatusWord) -> bool:
        """Return True unless an answer of the station rules this order out."""
        return word not in self._ruled_out or word in self._unconfirmed

    def is_ruled_out(self, word: StatusWord) -> bool:
        """Return True if the station refuses this order, or the tool does not cool by it."""
        return word in self._ruled_out

    def choices(self, words: Sequence[StatusWord]) -> list[StatusWord]:
        """Return the orders that may still make it safe; the last one always may."""
        *others, last = words
        return [*(word for word in others if word not in self._ruled_out), last]


@dataclass(slots=True)
class SafetyTask:
    """The tools of one station to make safe, and what is known about the station.

    `wanted` is one of the family's safe states; any other, which an untrusted lease may name, is
    replaced by the default. `feeds`: the feeder may be running. `is_proven`: the link has not
    broken since the station was identified; otherwise nothing is written before `prove` succeeds.
    `look`: checks over the intact link, before the first order, whether it is still that station,
    because a status that puts a soldering tool to rest switches hot air on. `spare`: leave a
    resting tool alone, because an order to stand would wake a sleeping tool.
    """

    client: Client
    family: Family
    wanted: str
    tools: list[ToolSafety]
    feeds: bool
    prove: Prove
    is_proven: bool = True
    look: Prove | None = None
    spare: bool = False
    # no orders over a flooded link: another station was found there before
    is_stranger: bool = False
    # a flood on its link, during which orders are sent without an answer
    flood: LinkFlooded | None = None
    # the last request was not answered: do not wait long for acknowledgements
    is_silent: bool = False
    has_waited: bool = field(init=False, default=False)  # an acknowledgement timed out
    has_fed: bool = field(init=False)  # at the beginning: a robot may start the feeder again
    is_flooded: bool = field(init=False, default=False)  # in this round
    budget: TimeBudget = field(init=False)

    def __post_init__(self) -> None:
        self.has_fed = self.feeds
        self.budget = TimeBudget(self.client)
        if self.wanted not in self.family.safe_states:
            self.wanted = next(iter(self.family.safe_states), self.wanted)

    def words(self, tool: ToolSafety) -> list[StatusWord]:
        """Return the orders that may make this tool safe, in the order to try."""
        return tool.choices(self.family.status.safe_words(self.wanted, suction=bool(tool.suction)))

    def unproven_word(self, tool: ToolSafety) -> StatusWord:
        """Return the order for a tool of which nothing can be read: the wanted state, unless it
        would have to be seen to cool or the station has ruled it out.
        """
        words = self.family.status.safe_words(self.wanted, suction=bool(tool.suction))
        likely = (word for word in words if tool.may_obey(word) and not self.has_to_cool(word))
        return next(likely, words[-1])

    def has_to_cool(self, word: StatusWord) -> bool:
        """Return True if this state counts only if the tool is seen to cool."""
        status = self.family.status
        proven = [
            status.orders[state]
            for state in self.family.proven_by_cooling
            if state in status.orders
        ]
        return not status.is_resting(word) and any(word[3] == one[3] for one in proven)

    def note_flood(self, flood: LinkFlooded) -> None:
        """Register that the link is flooded: identity and results must be proven again."""
        self.flood, self.is_flooded, self.is_proven = flood, True, False

    @property
    def is_done(self) -> bool:
        return not self.feeds and all(tool.is_safe for tool in self.tools)
