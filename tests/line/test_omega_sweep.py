"""Answers of OMEGA that are late, repeated, cut, merged, echoed, foreign or missing: no value is
ever assigned to another question.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from random import Random

import pytest

from support.clients.omega_talk import framed
from support.product import (
    FAMILIES,
    LineFormat,
    OmegaStation,
    Reopen,
    StationError,
    Value,
    VirtualClock,
    VirtualDriver,
    Wait,
    do,
)

COMMANDS = FAMILIES["omega"].commands
ASKED = [
    COMMANDS[name]
    for name in ("information", "temperature_control", "set_temperature_state", "mode")
]
DIGITS = {command.letters: len(command.quantity.names) for command in ASKED}  # type: ignore[attr-defined]  # digits
KINDS = ("late", "twice", "cut", "echo", "foreign", "noise", "lost", "by itself")
QUESTIONS = 60


class Disturbed:
    """A controller that answers with a random digit, on a link that disturbs every third answer.

    Answers keep their order, as on a serial line. `said` has the true answer to each question, in
    order.
    """

    def __init__(self, kinds: Sequence[str], seed: int) -> None:
        self._random = Random(seed)
        self._kinds = kinds
        self._free = 0.0
        self.said: list[tuple[str, int]] = []

    def is_unplugged(self, now: float) -> bool:
        return False

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        letter, roll = data[1:2].decode(), self._random
        digit = roll.randrange(DIGITS[letter])
        self.said.append((letter, digit))
        answer, delay = framed(f"{letter.lower()}{digit}"), roll.uniform(0.0, 0.25)
        kind = roll.choice(self._kinds) if roll.random() < 1 / 3 else ""
        pieces = self._pieces(kind, data, answer)
        begin = max(
            self._free, now + 0.01 + delay + (roll.uniform(0.2, 0.9) if kind == "late" else 0.0)
        )
        self._free = begin + len(pieces) * 0.002
        return [(begin + place * 0.002, piece) for place, piece in enumerate(pieces)]

    def _pieces(self, kind: str, question: bytes, answer: bytes) -> list[bytes]:
        cut = self._random.randrange(1, len(answer))
        return {
            "twice": [answer, answer],
            "cut": [answer[:cut]],
            "echo": [question, answer],
            "foreign": [framed("z0") + framed("x9") + answer],
            "noise": [self._random.randbytes(9), answer[:cut], answer[cut:]],
            "lost": [],
            "by itself": [framed("h") + answer[:cut], answer[cut:]],
        }.get(kind, [answer])


async def asked_in_turn(
    station: OmegaStation, line: Disturbed, seed: int
) -> list[tuple[Value, int]]:
    """Ask at random; return each value with the last digit that was answered to its letter."""
    roll, got = Random(seed), []
    station.unasked(await do(Reopen()))
    for _ in range(QUESTIONS):
        command = roll.choice(ASKED)
        try:
            value = await station.read(command)
        except StationError:
            station.unasked(await do(Wait(station.now + roll.choice([0.0, 0.1, 1.0]))))
            continue
        told = next(digit for letter, digit in reversed(line.said) if letter == command.letters)
        got.append((value, command.quantity.decode(str(told))))
    return got


def disturbed(kinds: Sequence[str], seed: int) -> tuple[OmegaStation, list[tuple[Value, int]]]:
    station, line, outcome = OmegaStation(LineFormat(9600)), Disturbed(kinds, seed), []

    async def steps() -> None:
        outcome.extend(await asked_in_turn(station, line, seed + 1))

    driver = VirtualDriver(VirtualClock())
    driver.add(steps(), line)
    driver.run()
    return station, outcome


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(5))
def test_a_value_is_that_of_the_question_that_was_asked(kind: str, seed: int) -> None:
    _, got = disturbed([kind], seed)
    assert len(got) > QUESTIONS / 2
    assert [pair for pair in got if pair[0] != pair[1]] == []


@pytest.mark.parametrize("seed", range(10))
def test_all_of_them_together(seed: int) -> None:
    station, got = disturbed(KINDS, 1000 + seed)
    assert len(got) > QUESTIONS / 3
    assert [pair for pair in got if pair[0] != pair[1]] == []
    assert station.exchanges >= QUESTIONS


@pytest.mark.campaign
@pytest.mark.timeout(3600)
def test_a_thousand_of_them(counted: Callable[..., None]) -> None:
    for seed in range(1000):
        _, got = disturbed(KINDS, 10_000 + seed)
        assert [pair for pair in got if pair[0] != pair[1]] == [], seed
        counted(conversations=1, questions=QUESTIONS, values=len(got), wrong_values=0)
