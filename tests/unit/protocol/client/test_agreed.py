"""How many answers a value wants before something is decided by it."""

from __future__ import annotations

from collections import Counter

import pytest

from support.clients.talk import Talk
from support.product import (
    CONFIRMING_ANSWERS,
    FAMILIES,
    OFF,
    AnswerTimeout,
    ImplausibleAnswer,
    Value,
    confirmed_value,
    read_confirmed,
)

DDE = FAMILIES["dde"].commands
LIMIT, HOURS, DELAY = DDE["alarm_high_limit"], DDE["plugged_hours"], DDE["alarm_high_delay"]


def talk(*answers: str, question: str = "RHA1", code: str = "AHA1") -> Talk:
    return Talk(*((question, code + answer) for answer in answers))


@pytest.mark.parametrize(
    ("answers", "value", "doubts"),
    [
        (("00380", "00380"), 380, 0),
        (("00240", "00380", "00380"), 380, 1),
        (("00380", "00240", "00380"), 380, 1),
        (("00240", "00350", "00380", "00380"), 380, 2),
        (("00000", "99999"), OFF, 0),  # two wire forms of the same
    ],
)
def test_two_answers_that_say_the_same_are_believed(
    answers: tuple[str, ...], value: Value, doubts: int
) -> None:
    doubted: Counter[str] = Counter()
    assert (
        talk(*answers).do(lambda station: read_confirmed(station, LIMIT, 1, doubted=doubted))
        == value
    )
    assert doubted["alarm_high_limit"] == doubts


def test_answers_that_never_agree_are_no_value() -> None:
    with pytest.raises(
        ImplausibleAnswer,
        match="alarm high limit of port 1: 240 °C, 350 °C, 380 °C, 365 °C when asked 4 times",
    ):
        talk("00240", "00350", "00380", "00365").do(
            lambda station: read_confirmed(station, LIMIT, 1)
        )
    assert CONFIRMING_ANSWERS == 4


def test_what_was_known_before_wants_one_answer_only() -> None:
    assert talk("00380").do(lambda station: read_confirmed(station, LIMIT, 1, known=380)) == 380
    assert (
        talk("00385", "00385").do(lambda station: read_confirmed(station, LIMIT, 1, known=380))
        == 385
    )
    assert (
        talk("00240", "00380").do(lambda station: read_confirmed(station, LIMIT, 1, known=380))
        == 380
    )


def test_a_delay_that_is_off_counts_as_known() -> None:
    assert (
        talk("99999", question="RHD1", code="AHD1").do(
            lambda station: read_confirmed(station, DELAY, 1, known=OFF)
        )
        is OFF
    )


@pytest.mark.parametrize(
    ("answers", "value"),
    [
        (("00099", "00100", "00100"), 100),
        (("00099", "00100", "00101"), 100),
        (("00099", "00110", "00101", "00101"), 101),
        (("00109", "00099", "00100", "00101"), 100),
    ],
)
def test_a_counter_may_go_on_while_it_is_asked(answers: tuple[str, ...], value: int) -> None:
    told = talk(*answers, question="RCP1", code="ACP1")
    assert told.do(lambda station: read_confirmed(station, HOURS, 1, grows=True)) == value


def test_what_does_not_grow_wants_two_that_are_equal() -> None:
    assert confirmed_value([99, 100, 101]) is None
    assert confirmed_value([99, 100, 101], grows=True) == 100
    assert confirmed_value([99, 101, 100], grows=True) is None
    assert confirmed_value(["a", "b", "c"], grows=True) is None


def test_a_station_that_falls_silent_in_between_gives_nothing() -> None:
    silent = Talk(("RHA1", "AHA100380"), ("RHA1",), ("RSMN",), ("RSER",))
    with pytest.raises(AnswerTimeout):
        silent.do(lambda station: read_confirmed(station, LIMIT, 1))
