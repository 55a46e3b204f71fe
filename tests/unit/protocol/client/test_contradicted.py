"""Two answers to one question: the first is contradicted if both are valid and differ."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from support.clients.omega_talk import OmegaTalk
from support.clients.omega_talk import framed as omega_framed
from support.clients.talk import Talk, framed
from support.product import (
    FAMILIES,
    AnswerContradicted,
    Command,
    Contradiction,
    OmegaStation,
    Station,
    Steps,
    Value,
    Wait,
    do,
)

DDE = FAMILIES["dde"].commands
TIP, POWER, TRANSFORMER = DDE["tip_temperature"], DDE["power"], DDE["transformer_temperature"]
INFORMATION, CONTROL = (
    FAMILIES["omega"].commands[name] for name in ("information", "temperature_control")
)
NEXT = ("RPP1", "APP100020")


class Watched:
    """What the client has noted whenever an exchange ended, and at the end."""

    def __init__(self, station: Station | OmegaStation) -> None:
        self.station = station
        self.noted: list[Command] = []
        self.ends: list[bool] = []
        station.ended = self._end

    def _end(self, is_answered: bool) -> None:
        self.ends.append(is_answered)
        self.look()

    def look(self) -> None:
        contradicted = self.station.contradicted
        if isinstance(contradicted, Contradiction):
            self.noted.append(contradicted.command)


def read(command: Command, port: int | None = None) -> Callable[[Station], Steps[Value]]:
    return lambda station: station.read(command, port)


def wait(seconds: float) -> Callable[[Station], Steps[None]]:
    async def steps(station: Station) -> None:
        station.unasked(await do(Wait(station.now + seconds)))

    return steps


def noted(talk: Talk, *asks: Callable[[Station], Steps[object]]) -> list[Command]:
    watched = Watched(talk.station)
    talk.each(*asks)
    watched.look()
    return watched.noted


OLD, TRUE = "ATT100310", "ATT100350"


def test_before_the_answer_to_the_next_question() -> None:
    talk = Talk(("RTT1", OLD, (0.02, TRUE)), NEXT)
    assert noted(talk, read(TIP, 1), read(POWER, 1)) == [TIP]


def test_in_one_read_with_the_answer_to_the_next_question() -> None:
    talk = Talk(("RTT1", OLD), ("RPP1", framed(TRUE) + framed("APP100020")))
    assert noted(talk, read(TIP, 1), read(POWER, 1)) == [TIP]


def test_before_the_next_question() -> None:
    talk = Talk(("RTT1", OLD, (0.02, TRUE)))
    assert noted(talk, read(TIP, 1), wait(0.1)) == [TIP]


def test_in_the_same_read_it_is_no_value() -> None:
    talk = Talk(("RTT1", framed(OLD) + framed(TRUE)))
    with pytest.raises(AnswerContradicted, match=r"tip temperature of port 1.*ATT100310") as raised:
        talk.do(read(TIP, 1))
    assert raised.value.reason == "contradicted"


def test_torn_over_two_reads() -> None:
    true = framed(TRUE)
    talk = Talk(("RTT1", framed(OLD) + true[:6], (0.02, true[6:])), NEXT)
    assert noted(talk, read(TIP, 1), read(POWER, 1)) == [TIP]


def test_a_refusal_contradicts_a_value() -> None:
    talk = Talk(("RTT1", OLD, (0.02, "NTT100004")), NEXT)
    assert noted(talk, read(TIP, 1), read(POWER, 1)) == [TIP]


@pytest.mark.parametrize("padded", ["ATT 00043", "ATT000043"])
def test_in_an_odd_form(padded: str) -> None:
    talk = Talk(("RTT", "ATT00041", (0.02, padded)), NEXT)
    assert noted(talk, read(TRANSFORMER), read(POWER, 1)) == [TRANSFORMER]


@pytest.mark.parametrize(
    "behind",
    ["ATT100310", "ATT200350", "ATT00045", "ATT1", "ATT1003500", "ATT1-----", "NTT200004"],
)
def test_what_is_no_other_answer(behind: str) -> None:
    talk = Talk(("RTT1", OLD, (0.02, behind)), NEXT)
    assert noted(talk, read(TIP, 1), read(POWER, 1)) == []


def test_another_station_contradicts_nothing() -> None:
    talk = Talk(("RTT1", OLD, (0.02, framed(TRUE, 7))), NEXT)
    assert noted(talk, read(TIP, 1), read(POWER, 1)) == []


def test_after_the_next_answer_it_is_only_counted() -> None:
    talk = Talk(("RTT1", OLD), ("RPP1", "APP100020", (0.05, TRUE)))
    assert noted(talk, read(TIP, 1), read(POWER, 1), wait(0.2)) == []
    assert talk.station.strays["unasked"] == 1


def test_two_true_answers_to_a_repeated_question_withdraw_nothing() -> None:
    talk = Talk(
        ("RTT1",),
        ("RSMN", "ASMN  DDE"),
        ("RTT1", TRUE, (0.02, "ATT100351")),
        NEXT,
    )
    assert noted(talk, read(TIP, 1), read(POWER, 1)) == []


def test_a_third_answer_to_two_questions_is_one_too_many() -> None:
    talk = Talk(("RTT1", OLD), ("RTT1", OLD, (0.02, TRUE)), NEXT)
    assert noted(talk, read(TIP, 1), read(TIP, 1), read(POWER, 1)) == [TIP]


def test_an_exchange_without_an_answer_ends_nothing_yet() -> None:
    """Its answer may be late, and so may the true one to the question before."""
    talk = Talk(("RTT1", OLD), ("RPP1", (0.2, TRUE)), ("RSMN", "ASMN  DDE"), NEXT)
    watched = Watched(talk.station)
    talk.each(read(TIP, 1), read(POWER, 1))
    assert watched.ends[:2] == [True, False]
    assert watched.noted[:1] == [TIP]


def test_omega() -> None:
    talk = OmegaTalk(("A", "a0", (0.15, "a1")), ("B", (0.2, "b0")))
    watched = Watched(talk.station)
    talk.each(lambda station: station.read(INFORMATION), lambda station: station.read(CONTROL))
    assert watched.noted == [INFORMATION]


def test_omega_in_one_read() -> None:
    talk = OmegaTalk(("A", omega_framed("a0") + omega_framed("a1")))
    with pytest.raises(AnswerContradicted):
        talk.do(lambda station: station.read(INFORMATION))
