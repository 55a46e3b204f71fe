"""The client of an OMEGA: answers, silence told apart, what comes late, what goes out once."""

from __future__ import annotations

import pytest

from support.clients.omega_talk import PROMPT_S, OmegaTalk, Turn, framed
from support.product import (
    COMPLETION_S,
    FAMILIES,
    GONE_S,
    OMEGA_ALLOWED_S,
    WITHOUT_DIGIT,
    AnswerCorrupt,
    AnswerFormat,
    AnswerTimeout,
    ConditionRecord,
    Ignored,
    LineFormat,
    NotSupported,
    OmegaStation,
    StationError,
    StationSilent,
    Steps,
    Value,
    Wait,
    client_for,
    do,
    note_answered,
)

COMMANDS = FAMILIES["omega"].commands
A, B, F, G = (
    COMMANDS[name]
    for name in ("information", "temperature_control", "set_temperature_state", "mode")
)
C101, D, H = (
    COMMANDS["condition"].numbered(101),
    COMMANDS["store_condition"],
    COMMANDS["run_condition"],
)
RECORD = ConditionRecord(101, 0, 3.5, *[0.0] * 14)
ON_WIRE = "00650" + "023" + "000" * 14


def ask_a(station: OmegaStation) -> Steps[Value]:
    return station.read(A)


def ask_b(station: OmegaStation) -> Steps[Value]:
    return station.read(B)


def write(station: OmegaStation) -> Steps[None]:
    return station.write(D, RECORD)


def run(station: OmegaStation) -> Steps[None]:
    return station.write(H, 101)


def pause(seconds: float) -> object:
    async def wait(station: OmegaStation) -> None:
        station.unasked(await do(Wait(station.now + seconds)))

    return wait


def failure(talk: OmegaTalk, *asks: object) -> StationError:
    with pytest.raises(StationError) as found:
        talk.each(*asks)  # type: ignore[arg-type]  # of several types of values
    return found.value


def test_it_is_the_client_of_its_family() -> None:
    assert isinstance(client_for(FAMILIES["omega"], LineFormat(9600), None), OmegaStation)


# -- answers ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "question", "answer", "value"),
    [
        (A, "A", "a0", "normal"),
        (A, "A", "a1", "solder shortage"),
        (A, "A", "a2", "solder clogged"),
        (A, "A", "a3", "solder shortage and clogged"),
        (A, "A", "a", WITHOUT_DIGIT),
        (B, "B", "b0", "ready or normal"),
        (B, "B", "b1", "preparing or error"),
        (F, "F", "f0", "in range"),
        (F, "F", "f1", "out of range"),
        (G, "G", "g4", "pre-solder"),
        (C101, "C0065", "c" + ON_WIRE, RECORD),
    ],
)
def test_an_answer_is_read(command: object, question: str, answer: str, value: object) -> None:
    talk = OmegaTalk((question, answer))
    assert talk.do(lambda station: station.read(command)) == value  # type: ignore[arg-type]
    assert talk.station.data == answer[1:]


def test_an_answer_in_pieces_among_garbage_is_found() -> None:
    frame = framed("a2")
    talk = OmegaTalk(
        ("A", (0.02, b"\xff\x02A"), (0.05, frame[:1]), (0.1, frame[1:4]), (0.2, frame[4:]))
    )
    assert talk.do(ask_a) == "solder clogged"
    assert talk.station.garbage_bytes == 3


def test_an_answer_after_the_longest_that_is_printed_is_in_time() -> None:
    """003, 11.1: 0 to 250 ms."""
    assert OmegaTalk(("A", (0.25 + 0.0115, "a0"))).do(ask_a) == "normal"
    assert OMEGA_ALLOWED_S >= 0.4  # docs/reference/contradictions.md, B-47


def test_an_answer_of_another_condition_is_none() -> None:
    other = "c00C9" + ON_WIRE[4:]
    talk = OmegaTalk(("C0065", other, (0.2, "c" + ON_WIRE)))
    assert talk.do(lambda station: station.read(C101)) == RECORD
    assert talk.station.strays == {"code": 1}


@pytest.mark.parametrize("answer", ["a00", "a4", "ax"])
def test_what_no_answer_can_be_is_not_believed(answer: str) -> None:
    """Its length is wrong, or its digit means nothing. Where it is not sure what it answered,
    another letter is asked between.
    """
    between = [] if answer in ("a4", "ax") else [("B", "b0")]
    talk = OmegaTalk(*[turn for _ in range(3) for turn in (("A", answer), *between)])
    note_answered(talk.station, "b")
    assert isinstance(failure(talk, ask_a), AnswerFormat)


def test_an_echo_answers_nothing() -> None:
    talk = OmegaTalk(("A", "A", (0.2, "a1")))
    assert talk.do(ask_a) == "solder shortage"
    assert talk.station.strays == {"echo": 1}


# -- silence ---------------------------------------------------------------------------------------


def test_a_lost_answer_is_asked_for_again_behind_another_question() -> None:
    talk = OmegaTalk(("B", "b0"), ("A",), ("B", "b0"), ("A", "a1"))
    assert talk.each(ask_b, ask_a) == ["ready or normal", "solder shortage"]


def test_an_answer_that_is_torn_by_the_time_out_is_none() -> None:
    """Its begin came in time and its end does not: the two are not put together."""
    talk = OmegaTalk(("A", b"\x02a", (0.5, b"0\x0391")), ("B", "b0"), ("A", "a1"))
    assert talk.do(ask_a) == "solder shortage"
    assert (talk.station.strays, talk.station.garbage_bytes) == ({}, 6)


def test_what_is_ignored_while_the_next_question_is_answered_was_refused() -> None:
    """docs/reference/protocol.md, OMEGA: an unknown number is ignored; A tells that from a line
    that is dead.
    """
    turn = [("C0065",), ("A", "a0")]
    talk = OmegaTalk(*turn * 3)
    error = failure(talk, lambda station: station.read(C101))
    assert isinstance(error, Ignored)
    assert isinstance(error, NotSupported)
    assert error.reason == "timeout"
    assert str(error).startswith("condition 101: ignored")


def test_what_is_silent_together_with_the_next_questions_is_gone() -> None:
    talk = OmegaTalk(("C0065",), ("A",), ("B",))
    assert isinstance(failure(talk, lambda station: station.read(C101)), StationSilent)


def test_where_only_a_is_known_its_own_silence_is_waited_out() -> None:
    """A controller that knows no other letter cannot be asked anything else: nothing is asked
    before its answer cannot come.
    """
    talk = OmegaTalk(("A", "a0"), ("A",), ("A", "a1"))
    assert talk.each(ask_a, ask_a) == ["normal", "solder shortage"]
    lost, again = talk.end.moments[1:]
    assert again - lost >= GONE_S - 1e-6


def test_a_late_answer_is_not_taken_for_the_next_to_the_same_question() -> None:
    """The first a1 was under way for half a second; a0 is what holds now."""
    talk = OmegaTalk(("B", "b0"), ("A", (0.5, "a1")), ("B", (0.2, "b0")), ("A", "a0"))
    assert talk.each(ask_b, ask_a) == ["ready or normal", "normal"]
    assert talk.station.strays == {"late": 1}


def test_an_answer_that_comes_while_nothing_is_asked_is_counted() -> None:
    talk = OmegaTalk(("A", "a0", (0.5, "a1"), (0.6, "h")))
    assert talk.each(ask_a, pause(1.0))[0] == "normal"  # type: ignore[arg-type]
    assert talk.station.strays == {"unasked": 1}
    assert [said.letter for said in talk.station.completions] == ["h"]


def test_a_wrong_sum_is_counted_and_asked_for_again() -> None:
    talk = OmegaTalk(("B", "b0"), ("A", b"\x02a0\x0390"), ("B", "b0"), ("A", "a0"))
    assert talk.each(ask_b, ask_a) == ["ready or normal", "normal"]
    assert talk.station.strays == {"sum": 1}


def test_a_good_answer_behind_a_damaged_one_is_taken() -> None:
    talk = OmegaTalk(("A", b"\x02a0\x0390" + framed("a3")))
    assert talk.do(ask_a) == "solder shortage and clogged"


@pytest.mark.parametrize("place", range(3))
def test_what_was_answered_once_although_badly_was_not_refused(place: int) -> None:
    """Only silence three times over means that: a frame with a wrong sum was an answer."""
    answers: list[Turn] = [("C0065",)] * 3
    answers[place] = ("C0065", b"\x02c0065\x0300")
    talk = OmegaTalk(*(turn for one in answers for turn in (one, ("A", "a0"))))
    error = failure(talk, lambda station: station.read(C101))
    assert isinstance(error, AnswerCorrupt if place == 2 else AnswerTimeout)
    assert not isinstance(error, Ignored)


def test_a_controller_that_answers_nothing_else_is_waited_for_and_then_gone() -> None:
    """003 prints A only. Nothing else was ever answered, so nothing else can prove the line: its
    silence is no refusal.
    """
    talk = OmegaTalk(("A", "a0"), ("A",), ("A",), ("A", (0.1, "a1")))
    assert talk.each(ask_a, ask_a) == ["normal", "solder shortage"]
    waits = [
        later - earlier
        for earlier, later in zip(talk.end.moments[1:], talk.end.moments[2:], strict=False)
    ]
    assert min(waits) >= GONE_S
    talk = OmegaTalk(("A", "a0"), ("A",), ("A",), ("A",))
    error = failure(talk, ask_a, ask_a)
    assert isinstance(error, StationSilent)
    assert not isinstance(error, Ignored)


def test_where_a_digit_comes_after_all_it_is_read() -> None:
    talk = OmegaTalk(("A", "a"), ("A", "a2"))
    assert talk.each(ask_a, ask_a) == [WITHOUT_DIGIT, "solder clogged"]
    assert talk.station.without_digit == {"a"}


# -- what is written -------------------------------------------------------------------------------


def test_a_condition_is_written_once_and_acknowledged() -> None:
    talk = OmegaTalk(("D" + ON_WIRE, "d"))
    talk.do(write)


def test_a_write_that_is_ignored_goes_out_once() -> None:
    talk = OmegaTalk(("D" + ON_WIRE,), ("A", "a0"))
    assert isinstance(failure(talk, write), Ignored)


def test_a_write_into_silence_goes_out_once() -> None:
    talk = OmegaTalk(("D" + ON_WIRE,), ("A",), ("B",))
    assert isinstance(failure(talk, write), StationSilent)


def test_an_acknowledgement_that_is_no_plain_d_is_none() -> None:
    talk = OmegaTalk(("D" + ON_WIRE, "d1"))
    assert isinstance(failure(talk, write), AnswerFormat)


# -- execution -------------------------------------------------------------------------------------


@pytest.mark.parametrize("letter", ["h", "i"])
def test_an_execution_is_over_when_the_controller_says_so(letter: str) -> None:
    """h when a point is done, i after the first stage of a slide; long after the 250 ms of other
    answers.
    """
    talk = OmegaTalk(("H0065", (3.3, letter)), ("A", "a0"), ("A", "a0"), ("A", "a0"))
    talk.do(run)
    assert [said.letter for said in talk.station.completions] == [letter]
    assert talk.end.heard.count("H0065") == 1


def test_an_execution_within_the_time_of_an_answer() -> None:
    talk = OmegaTalk(("H0065", (0.2, "h")))
    talk.do(run)
    assert [said.letter for said in talk.station.completions] == ["h"]


def test_an_execution_that_is_never_told_of_is_not_known() -> None:
    talk = OmegaTalk(("H0065",), always={"A": "a0"})
    begin = talk.clock.monotonic()
    with pytest.raises(AnswerTimeout, match="run condition 101: neither h nor i within 120 s"):
        talk.do(run)
    assert talk.end.heard.count("H0065") == 1
    # whether it is there was looked at all the time
    assert talk.end.heard.count("A") > COMPLETION_S / 2
    assert talk.clock.monotonic() - begin == pytest.approx(COMPLETION_S, abs=2)


def test_an_execution_into_silence_goes_out_once() -> None:
    talk = OmegaTalk(("H0065",), ("A",), ("B",))
    assert isinstance(failure(talk, run), StationSilent)


def test_what_is_said_late_is_kept_apart_and_answers_nothing() -> None:
    talk = OmegaTalk(("A", (0.05, "h"), "a0"), ("B", (0.3, "i"), (0.05, "b0")))
    assert talk.each(ask_a, ask_b, pause(1.0))[:2] == ["normal", "ready or normal"]  # type: ignore[arg-type,comparison-overlap]
    assert [said.letter for said in talk.station.completions] == ["h", "i"]
    assert talk.station.strays == {}


def test_moments_are_those_of_the_question_and_its_answer() -> None:
    talk = OmegaTalk(("A", "a0"), ("B", "b0"))
    begin = talk.clock.monotonic()
    talk.each(ask_a, ask_b)
    assert (talk.station.first_sent, talk.station.sent) == (begin, pytest.approx(begin + PROMPT_S))
    assert talk.station.heard == pytest.approx(begin + 2 * PROMPT_S)
    assert talk.station.exchanges == 2
