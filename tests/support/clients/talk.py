"""One station client and another end made for the test, in memory, on a clock that jumps.

``Talk(("RTT1", "ATT100183")).do(lambda station: station.read(TIP, 1))``: each turn is the question
that must come and what is said to it. An answer is a text (framed and addressed as by station 01),
bytes as they are, or a pair of seconds and either: how long after the question it is there.
``Talk(replies=...)`` takes a function from question to answers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

from support.golden.form import with_check_byte
from support.product import (
    Client,
    Command,
    LineFormat,
    Peer,
    Reopen,
    Station,
    StationError,
    Steps,
    VirtualClock,
    VirtualDriver,
    do,
)

T = TypeVar("T")
C = TypeVar("C", bound=Client)
Asking = Callable[[Station], Steps[T]]
Answer = str | bytes | tuple[float, str | bytes]
Replies = Callable[[str], Sequence[Answer]]
PROMPT_S = 0.016  # an addressed read, its answer and 2 ms of turnaround at 19200 8N1


def framed(text: str, source: int | None = 1, target: int = 0) -> bytes:
    """`text` as a frame, built from the manual's rule and not by the code under test; no source: no
    addresses.
    """
    addresses = "" if source is None else f"{source:02d}{target:02d}"
    return with_check_byte(b"\x02" + (addresses + text).encode() + b"\x03")


class OtherEnd:
    """Says what `replies` gives, one answer after the other as a wire does; what it heard is in
    `heard`.
    """

    def __init__(self, replies: Replies, addressed: bool) -> None:
        self._replies = replies
        self._addressed = addressed
        self._free = 0.0
        self.heard: list[str] = []
        self.moments: list[float] = []  # at which it heard them

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        text = data[5 if self._addressed else 1 : -2].decode()
        self.heard.append(text)
        self.moments.append(now)
        return [self._at(now, answer) for answer in self._replies(text)]

    def is_unplugged(self, now: float) -> bool:
        return False

    def _at(self, now: float, answer: Answer) -> tuple[float, bytes]:
        late_s, said = answer if isinstance(answer, tuple) else (PROMPT_S, answer)
        if isinstance(said, str):
            said = framed(said, 1 if self._addressed else None)
        self._free = max(self._free, now + late_s)  # no answer overtakes another
        return self._free, said


def in_turn(
    client: C, end: Peer, clock: VirtualClock, asks: Iterable[Callable[[C], Steps[T]]]
) -> list[T]:
    """What came out of each of `asks`, done by the client one right after the other; what one
    raises comes out.
    """
    outcome: list[T] = []

    async def steps() -> None:
        client.unasked(await do(Reopen()))
        for ask in asks:
            outcome.append(await ask(client))

    driver = VirtualDriver(clock)
    driver.add(steps(), end)
    driver.run()
    return outcome


class Talk:
    """A station client and its other end."""

    def __init__(
        self,
        *turns: tuple[str, *tuple[Answer, ...]],
        replies: Replies | None = None,
        address: int | None = 1,
        line: LineFormat | None = None,
    ) -> None:
        self.turns = list(turns)
        self.station = Station(line or LineFormat(), address)
        self.end = OtherEnd(replies or self._next_turn, address is not None)
        self.clock = VirtualClock()

    def do(self, ask: Asking[T]) -> T:
        """Do it and give what came out; every turn must have been taken, whether that raises or
        not.
        """
        return self.each(ask)[0]

    def each(self, *asks: Asking[T]) -> list[T]:
        """The same with several, one right after the other."""
        try:
            return in_turn(self.station, self.end, self.clock, asks)
        finally:
            assert self.turns == []

    def _next_turn(self, text: str) -> Sequence[Answer]:
        assert self.turns, f"{text} was asked and nothing more was to be"
        expected, *answers = self.turns.pop(0)
        assert text == expected
        return answers


async def sought(station: Station, model: Command) -> None:
    """What a session does with a silent station: its model is read before anything else."""
    for _ in range(20):
        try:
            await station.read(model)
        except StationError:
            continue
        return
