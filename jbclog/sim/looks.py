"""A question with its second and third look, and what the recording's session believed of the answers.

What is hard to believe is asked again at once (`session.doubt`), and so is what was not understood, with one harmless
question in between. Those askings are one group on the tape: the answers bear each other out or contradict each other,
and one alone may say what nobody ever believed. A group is given in order or passed over whole, and never split.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from jbclog.protocol import frame, omega
from jbclog.protocol.commands.command import Effect
from jbclog.protocol.commands.robot import READINGS
from jbclog.protocol.frame import Frame
from jbclog.protocol.omega import OmegaReader
from jbclog.protocol.reader import FrameReader
from jbclog.sim.exchanges import Exchange, Ticks

LOOK_S = 0.25  # from an answer to the next look at it, at the most: a recorder's host may have been busy
RETRY_S = 1.0  # the same where nothing was understood: a patience, and another question's answer
MOST = 9  # three looks, each asked three times; more of the same is no doubt
BELIEVED_AT_ONCE = 2  # looks of which the last was believed whatever the other said: without doubt, or it was asked a third time

CLEARED = tuple(command.letters for command in READINGS if command.effect is Effect.CLEARS)


def is_understood(one: Exchange) -> bool:
    """Whether a good frame came before the next question."""
    heard = said(one)
    if frame.only_reads(one.question):
        return any(isinstance(found, Frame) for found in FrameReader().feed(heard))
    if omega.only_reads(one.question):
        return any(isinstance(found, str) for found in OmegaReader().feed(heard))
    return bool(heard)


def has_flags(one: Exchange) -> bool:
    """Whether flags were told that the station holds until they are read, and forgets with that."""
    heard = FrameReader().feed(said(one))
    found = next((answer for answer in heard if isinstance(answer, Frame) and answer.header == "A"), None)
    return found is not None and found.text.startswith(CLEARED) and found.text[3:].strip("0") != ""


def said(one: Exchange) -> bytes:
    """All that came."""
    return b"".join(data for _, data in one.replies)


@dataclass(slots=True)
class Looks:
    """The askings of one question that belong together, in order; never empty. `number` counts all questions up to its last."""

    all: list[Exchange]
    number: int
    is_understood: bool

    @property
    def at_s(self) -> float:
        return self.all[0].at_s

    @property
    def question(self) -> bytes:
        return self.all[0].question

    @property
    def stretch(self) -> int:
        return self.all[0].stretch

    @property
    def has_flags(self) -> bool:
        return any(has_flags(one) for one in self.all)

    def goes_on_with(self, one: Exchange, number: int) -> bool:
        """Whether `one` is the next look."""
        last, behind = self.all[-1], number - self.number
        if (one.question, one.stretch) != (self.question, self.stretch) or last.lost_s is not None or len(self.all) == MOST:
            return False
        gap_s = one.at_s - last.at_s - (last.replies[-1][0] if last.replies else 0.0)
        return gap_s < LOOK_S if behind == 1 else gap_s < RETRY_S and not self.is_over(number - 1)

    def is_over(self, number: int) -> bool:
        """Whether the question behind that of this number cannot belong to it any more."""
        return number - self.number >= (1 if self.is_understood else 2)

    def add(self, one: Exchange, number: int) -> None:
        self.all.append(one)
        self.number, self.is_understood = number, is_understood(one)

    def believed(self, before: Exchange | None) -> Exchange | None:
        """The answer that was believed in the end, which is that from `before` where none of these was."""
        last, others = self.all[-1], [said(one) for one in self.all[:-1]]
        if before is None:
            return last if last.replies else None
        if not is_understood(last):
            return before
        is_proven = len(self.all) <= BELIEVED_AT_ONCE or said(last) in (*others, said(before))
        return last if is_proven else before


def looks(tape: Iterable[Exchange], ticks: Ticks | None = None, sampled: bytes = b"") -> Iterator[Looks]:
    """The groups of a tape, in the order in which they were begun. Ticks begin with the question `sampled`."""
    waiting: list[Looks] = []
    for number, one in enumerate(tape):
        group = next((group for group in waiting if group.goes_on_with(one, number)), None)
        if group is None or (one.question == sampled and _is_next_tick(ticks, group, one)):
            waiting.append(Looks([one], number, is_understood(one)))
        else:
            group.add(one, number)
        while waiting and waiting[0].is_over(number):
            yield waiting.pop(0)
    yield from waiting


def _is_next_tick(ticks: Ticks | None, group: Looks, one: Exchange) -> bool:
    """Whether a tick begins here, as it does where a station is asked one thing only."""
    return ticks is not None and ticks.is_on_time(one.at_s) and ticks.number(one.at_s) != ticks.number(group.at_s)
