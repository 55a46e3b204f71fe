"""A wire that a random tape disturbs in every way that a wire can be, in both directions, and that
keeps its own books.

It lies between a session and the tap of a virtual station. `books` has every question as it left
the session, what the station had to say to it, and the bytes that the session was given for it.
`forged` are the whole answers that the wire let come although the station did not say them then, or
not so, and that no check byte shows: no receiver can tell them, so they may be recorded, and
nothing else that is wrong may (docs/reference/faults.md, I4). `misled` are questions that it turned
into other whole ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from random import Random

from support.links.damage import DAMAGES, jbc_holds, omega_holds
from support.links.injector import KINDS, Deed, Injector
from support.product import Ask, IoResult, Listen, Request, StationFacts, Steps, do
from support.virtual.virtual_run import Tap

ON_QUESTIONS = ("question_lost", *(f"question_{name}" for name in DAMAGES))
OF_ANY_PROTOCOL = (
    "lost",
    "late",
    "twice",
    "merged",
    "torn",
    "cut_short",
    "echo",
    "foreign",
    "foreign_within",
    *DAMAGES,
    *ON_QUESTIONS,
)
ALL_KINDS = (*KINDS, *DAMAGES, *ON_QUESTIONS)
# the share of questions that are disturbed
FAIR, ROUGH = (0.0, 0.0, 0.0005, 0.003), (0.01, 0.05, 0.2, 0.5)
PATIENCE_S = (0.0, 0.005, 0.02, 0.0999, 0.1001, 0.11, 0.399, 0.401)
LONGEST_S = 20.0  # that an answer, or a copy of it, is on its way


@dataclass(slots=True)
class Tape:
    """What becomes of each question: fair stretches and rough ones in turn, as a number decides."""

    random: Random
    kinds: Sequence[str]
    calm: int  # questions before anything happens
    often: float = 0.0
    now: Sequence[str] = ()

    def get(self, number: int) -> Deed | None:
        if number >= self.calm:
            self._turn(number)
        return self._deed() if self.often and self.random.random() < self.often else None

    def _turn(self, number: int) -> None:
        is_rough = self.random.random() < 0.3
        self.often = self.random.choice(ROUGH if is_rough else FAIR)
        self.calm = number + self.random.randint(10, 300 if is_rough else 3000)
        self.now = self.random.sample(self.kinds, self.random.randint(1, len(self.kinds)))

    def _deed(self) -> Deed:
        random = self.random
        by_s = [
            random.choice(PATIENCE_S),
            random.uniform(0, 0.3),
            random.uniform(0, 3),
            random.uniform(0, LONGEST_S),
        ]
        return Deed(
            random.choice(self.now), random.choice(by_s), random.random(), random.random() < 0.3
        )


@dataclass(slots=True)
class Exchange:
    """A question as it left the session; the station's answer to it (None: it heard none, or
    another); what came then.

    `beside` is what else the station said then: the answer to a question whose end it heard only
    now.
    """

    at: float
    text: str = ""
    truth: str | None = None
    beside: tuple[str, ...] = ()
    given: list[tuple[float, bytes]] = field(default_factory=list)
    is_plain: bool = False  # the answer came, and nothing else


@dataclass(frozen=True, slots=True)
class Forgery:
    """A whole answer that the station does not say at that moment: its text, and when it came."""

    text: str
    at: float


class NoisyWire(Injector):
    """The wire. `is_omega` decides which frames are whole; put `kept` around the session."""

    def __init__(self, tap: Tap, tape: Tape, random: Random, *, is_omega: bool = False) -> None:
        super().__init__(self._heard_by, {}, tap.is_unplugged)
        self.books: list[Exchange] = []
        self.forgeries: list[Forgery] = []
        self.misled: list[str] = []
        self._tap, self._tape, self._random = tap, tape, random
        self._holds, self._tail = (omega_holds, 3) if is_omega else (jbc_holds, 2)

    async def kept(self, session: Steps[StationFacts]) -> StationFacts:
        """The session, with what it asks and is given put into the books."""
        step: Callable[[], Request] = partial(session.send, None)
        while True:
            try:
                wish = step()
            except StopIteration as end:
                facts: StationFacts = end.value
                return facts
            if isinstance(wish, Ask):
                self.books.append(Exchange(0.0, self.text_of(wish.data)))
            try:
                heard: IoResult = await do(wish)
            except Exception as error:
                step = partial(session.throw, error)
                continue
            if heard.data and self.books and isinstance(wish, Ask | Listen):
                self._given(self.books[-1], heard)
            step = partial(session.send, heard)

    def _given(self, one: Exchange, heard: IoResult) -> None:
        one.given.append((heard.now, heard.data))
        one.is_plain = (
            len(one.given) == 1
            and self._holds(heard.data)
            and self.text_of(heard.data) == one.truth
        )

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        self.books[-1].at = now
        deed = self._tape.get(self.number + 1)
        if deed is not None and deed.kind in ON_QUESTIONS:
            return self._ask_otherwise(deed, data, now)
        self.plan = {} if deed is None else {self.number + 1: deed}
        return super().receive(data, now)

    def _heard_by(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        """What the station says to these bytes. It may be two things: a refusal of what was left of
        an earlier question, too.
        """
        before = len(self._tap.heard)
        came = self._tap.receive(data, now)
        said = [self.text_of(answer) for _, answer in came if self._holds(answer)]
        clean = (
            self._tap.heard[-1].clean if len(self._tap.heard) > before and len(came) < 2 else None
        )
        self.books[-1].truth = clean or next(
            (text for text in said if text[:1] != "N"), next(iter(said), None)
        )
        self.books[-1].beside = tuple(said)
        return came

    def _ask_otherwise(self, deed: Deed, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        """Let the station hear another question than was asked, or none."""
        self.number += 1
        self.did[deed.kind] += 1
        damage = DAMAGES.get(deed.kind.removeprefix("question_"))
        heard = damage(data, self._random) if damage and len(data) > 4 else b""
        came = list(self.receive_clean(heard, now)) if heard else []
        if heard != data and self._holds(heard):
            self.misled.append(self.text_of(heard))
            # whatever it says, it was not asked that
            self.books[-1].truth, self.books[-1].beside = None, ()
            for at, answer in came:
                self._forge(at, answer)
        return came

    def _do(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        damage = DAMAGES.get(deed.kind)
        if damage is None:
            return super()._do(deed, data, at, answer, before)
        damaged = damage(answer, self._random) if len(answer) > 4 else answer
        if damaged != answer and self._holds(damaged):
            self._forge(at, damaged)
        return [(at, damaged)]

    def _forge(self, at: float, answer: bytes) -> None:
        self.forgeries.append(Forgery(self.text_of(answer), at))

    def text_of(self, frame: bytes) -> str:
        """Header, code and data; addresses are left out."""
        body = frame[1 : -self._tail].decode("ascii", "replace")
        return body[4:] if body[:1].isdigit() else body
