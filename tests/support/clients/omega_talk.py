"""One OMEGA client and a controller made for the test, in memory, on a clock that jumps.

``OmegaTalk(("A", "a0"), ("C0065",)).do(lambda station: station.read(INFORMATION))``: each turn is
the text that must come and what is said to it, nothing being silence. An answer is a text, bytes as
they are, or a pair of seconds and either: how long after the question it is there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from support.clients.talk import in_turn
from support.product import LineFormat, OmegaStation, Steps, VirtualClock

T = TypeVar("T")
Answer = str | bytes | tuple[float, str | bytes]
Turn = tuple[str, *tuple[Answer, ...]]
PROMPT_S = 0.1


def framed(text: str) -> bytes:
    """`text` as a frame, by the manual's rule (003, 11.2) and not by the code under test."""
    return b"\x02" + text.encode() + b"\x03" + f"{sum(text.encode()) % 256:02X}".encode()


class Controller:
    """Says what the turns have; what it heard is in `heard`, with the moments in `moments`."""

    def __init__(self, turns: Sequence[Turn], always: Mapping[str, str]) -> None:
        self.turns = list(turns)
        self._always = always
        self.heard: list[str] = []
        self.moments: list[float] = []

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        text = data[1:-3].decode()
        assert data == framed(text)
        self.heard.append(text)
        self.moments.append(now)
        if not self.turns and text in self._always:
            return [self._at(now, self._always[text])]
        assert self.turns, f"{text} was asked and nothing more was to be"
        expected, *answers = self.turns.pop(0)
        assert text == expected
        return [self._at(now, answer) for answer in answers]

    def is_unplugged(self, now: float) -> bool:
        return False

    def _at(self, now: float, answer: Answer) -> tuple[float, bytes]:
        after_s, said = answer if isinstance(answer, tuple) else (PROMPT_S, answer)
        return now + after_s, framed(said) if isinstance(said, str) else said


class OmegaTalk:
    """A client and its controller. Every turn must have been taken at the end, whether that raises
    or not.

    `always` is what is said once all turns are over.
    """

    def __init__(self, *turns: Turn, always: Mapping[str, str] | None = None) -> None:
        self.station = OmegaStation(LineFormat(9600))
        self.end = Controller(turns, always or {})
        self.clock = VirtualClock()

    def do(self, ask: Callable[[OmegaStation], Steps[T]]) -> T:
        return self.each(ask)[0]

    def each(self, *asks: Callable[[OmegaStation], Steps[T]]) -> list[T]:
        """Do one after the other; what one raises comes out."""
        try:
            return in_turn(self.station, self.end, self.clock, asks)
        finally:
            assert self.end.turns == []
