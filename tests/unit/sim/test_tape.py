"""A station played from a tape: the same answers after the same time, and silence where nothing was
recorded.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import pytest

from jbclog.core.capture_rows import CaptureRow, LinkRow, LinkRowKind, ResultRow
from jbclog.sim.recorded_exchanges import RecordedGrid, exchanges, retry_groups
from jbclog.sim.replayed_station import ReplayedStation
from support.golden.form import with_check_byte

Q1, Q2, A1, A2, A3 = (
    b"\x02RTT1\x03a",
    b"\x02RPP1\x03b",
    b"\x02ATT100350\x03",
    b"\x02ATT100351\x03",
    b"\x02APP100100\x03",
)


def row(at_s: float, what: LinkRowKind, data: bytes = b"") -> LinkRow:
    return LinkRow(at_s, what, data)


def tape(*rows: CaptureRow) -> list[CaptureRow]:
    return [ResultRow(0.5, "told", "wait"), row(1.0, "opened"), *rows]


def station(
    rows: Sequence[CaptureRow], early_s: float = 0.0, ticks: RecordedGrid | None = None
) -> ReplayedStation:
    return ReplayedStation("dde-1", lambda: rows, early_s, ticks)


TWO = tape(
    row(2.0, "sent", Q1),
    row(2.015, "heard", A1),
    ResultRow(2.016, "told", "ask", 12, 2.0),
    row(2.02, "sent", Q2),
    row(2.034, "heard", A3[:4]),
    row(2.036, "heard", A3[4:]),
    row(3.0, "sent", Q1),
    row(3.4, "heard", A2),
)


def test_each_asking_gets_the_next_answer_after_the_same_time() -> None:
    one = station(TWO)
    assert one.receive(Q1, 100.0) == [(pytest.approx(100.015), A1)]
    assert one.receive(Q2, 100.1) == [
        (pytest.approx(100.114), A3[:4]),
        (pytest.approx(100.116), A3[4:]),
    ]
    assert one.receive(Q1, 101.0) == [(pytest.approx(101.4), A2)]
    assert (one.strange, one.repeated) == (0, {})


def test_asked_somewhat_more_often_it_says_the_same_again_and_then_nothing() -> None:
    one = station(TWO)
    answers = [[reply.data for reply in one.receive(Q1, float(second))] for second in range(7)]
    assert answers == [[A1], *[[A2]] * 4, [], []]
    assert one.repeated == {Q1: 5}


def test_another_order_gets_the_same_answers() -> None:
    one = station(TWO)
    assert [reply.data for question in (Q1, Q1, Q2) for reply in one.receive(question, 1.0)] == [
        A1,
        A2,
        A3[:4],
        A3[4:],
    ]


def test_a_capture_that_is_handed_over_answers_earlier() -> None:
    assert station(TWO, early_s=0.001).receive(Q1, 100.0) == [(pytest.approx(100.014), A1)]
    assert station(TWO, early_s=1.0).receive(Q1, 100.0) == [(100.0, A1)]


def test_silence_for_what_was_never_asked() -> None:
    one = station(TWO)
    assert one.receive(b"\x02RST1\x03c", 1.0) == []
    assert [reply.data for reply in one.receive(b"\xff\x00" + Q1, 2.0)] == [A1]
    assert (one.strange, one.repeated) == (2, {})


def test_a_question_in_pieces_and_two_at_once() -> None:
    one = station(TWO)
    assert one.receive(Q1[:3], 1.0) == []
    assert [reply.data for reply in one.receive(Q1[3:] + Q2 + Q1[:1], 1.1)] == [A1, A3[:4], A3[4:]]
    assert [reply.data for reply in one.receive(Q1[1:], 1.2)] == [A2]
    assert one.strange == 0


def test_half_a_question_is_forgotten_where_another_follows() -> None:
    one = station(TWO)
    one.receive(Q1[:3], 1.0)
    assert [reply.data for reply in one.receive(Q1, 2.0)] == [A1]


OUTAGE = tape(
    row(2.0, "sent", Q1),
    row(2.015, "heard", A1),
    row(2.5, "lost"),
    row(3.0, "failed"),
    row(4.0, "failed"),
    row(5.0, "opened"),
    row(5.1, "sent", Q2),
    row(5.2, "heard", A3),
)


def test_a_link_is_back_between_the_last_try_that_failed_and_the_first_that_did_not() -> None:
    one = station(OUTAGE)
    assert one.next_plugging(99.0) is None
    assert len(one.receive(Q1, 100.0)) == 1
    assert one.next_plugging(100.0) == pytest.approx(100.5)
    assert [one.is_unplugged(moment) for moment in (100.4, 100.6, 102.4, 102.6)] == [
        False,
        True,
        True,
        False,
    ]
    assert one.next_plugging(101.0) == pytest.approx(102.5)
    assert one.receive(Q2, 101.0) == []
    assert [reply.data for reply in one.receive(Q2, 103.0)] == [A3]
    assert one.next_plugging(103.0) is None


def test_a_link_that_never_came_back() -> None:
    one = station(tape(row(2.0, "sent", Q1), row(2.1, "lost"), row(2.5, "failed")))
    one.receive(Q1, 100.0)
    assert one.is_unplugged(1e6)
    assert one.next_plugging(101.0) is None


def test_two_losses_without_a_question_between_them_are_one() -> None:
    rows = tape(
        row(2.0, "sent", Q1),
        row(2.1, "lost"),
        row(3.0, "opened"),
        row(3.1, "lost"),
        row(3.5, "failed"),
        row(4.5, "opened"),
    )
    (one,) = exchanges(rows)
    assert (one.lost_s, one.back_s) == (pytest.approx(0.1), pytest.approx(2.0))


def test_what_came_before_the_first_question_belongs_to_none() -> None:
    (one,) = exchanges([row(1.0, "heard", b"noise"), row(1.5, "lost"), *TWO[:3]])
    assert (one.question, one.replies, one.lost_s, one.back_s) == (Q1, [], None, inf)


def many(count: int) -> list[CaptureRow]:
    """Q1 answered by its own number, Q2 every fourth time by that of the question before it."""
    rows: list[CaptureRow] = []
    for number in range(count):
        rows += [row(float(number), "sent", Q1), row(number + 0.01, "heard", b"%d" % number)]
        if number % 4 == 0:
            rows += [row(number + 0.5, "sent", Q2), row(number + 0.51, "heard", b"%d" % number)]
    return rows


def test_who_asks_something_less_often_gets_answers_of_the_time_that_it_is_at() -> None:
    one = station(many(400))
    for number in range(300):
        one.receive(Q1, float(number))
    (reply,) = one.receive(Q2, 300.0)
    assert 299 <= int(reply.data) <= 300


def test_who_asks_something_more_often_does_not_pull_the_tape_along() -> None:
    one = station(many(400))
    answers = []
    for number in range(200):
        answers += one.receive(Q1, float(number))
        one.receive(Q2, float(number))
    assert [int(reply.data) for reply in answers] == list(range(200))


def test_who_ends_earlier_finds_the_end_after_the_order_for_it() -> None:
    """The order is given only once; what is read after it must not be what was read before it."""
    order, rows = b"\x02WPS100001\x03", many(400)
    rows += [
        row(400.0, "sent", order),
        row(400.1, "heard", b"done"),
        row(401.0, "sent", Q1),
        row(401.1, "heard", b"safe"),
    ]
    one = station(rows)
    for number in range(100):
        one.receive(Q1, float(number))
    assert [reply.data for question in (order, Q1) for reply in one.receive(question, 100.0)] == [
        b"done",
        b"safe",
    ]


def test_what_lies_before_an_order_is_not_given_after_it() -> None:
    order, rows = b"\x02WPS100001\x03", many(20)
    one = station([*rows, row(400.0, "sent", order), row(400.1, "heard", b"done")])
    for number in range(18):
        one.receive(Q1, float(number))
    assert [reply.data for question in (order, Q1) for reply in one.receive(question, 100.0)] == [
        b"done",
        b"17",
    ]
    assert (one.repeated, one.left_out) == ({Q1: 1}, 7)


def test_a_loss_among_what_is_left_out_is_not() -> None:
    rows = many(200)
    place = next(place for place, one in enumerate(rows) if one.at_s == 48.5)
    rows[place + 2 : place + 2] = [row(48.6, "lost"), row(48.9, "opened")]
    one = station(rows)
    for number in range(150):
        one.receive(Q1, float(number))
    assert not one.is_unplugged(200.2)
    one.receive(Q2, 200.0)
    assert one.is_unplugged(200.2)


# -- writes, and what is behind them ---------------------------------------------------------------

ASKED, ASLEEP = b"\x020001RPS1\x03\x60", b"\x020001WPS100100\x03\x05"


def checked(question: bytes) -> bytes:
    """The question with its check byte, as the wire has it."""
    return with_check_byte(question[:-1])


def reading(number: int) -> bytes:
    """A tip temperature of so many degrees, as a station says it."""
    return checked(b"\x020100ATT1%05d\x03\x00" % number)


STATE, SLEEP = checked(ASKED), checked(ASLEEP)
ORDERED = tape(
    row(1.0, "sent", STATE),
    row(1.01, "heard", b"working"),
    row(2.0, "sent", SLEEP),
    row(2.01, "heard", b"done"),
    row(2.02, "sent", STATE),
    row(2.03, "heard", b"asleep"),
)


def said(one: ReplayedStation, *questions: bytes) -> list[bytes]:
    return [
        reply.data
        for number, question in enumerate(questions)
        for reply in one.receive(question, 10.0 + number)
    ]


def test_asked_however_often_it_answers_while_a_write_is_to_come() -> None:
    one = station(ORDERED)
    assert said(one, *[STATE] * 12) == [b"working"] * 12
    assert len(said(one, SLEEP, *[STATE] * 9)) == 1 + 1 + 3  # after the last write it may be over


def test_nothing_from_behind_a_recorded_write_comes_before_that_write() -> None:
    one = station(ORDERED)
    assert said(one, STATE, STATE, STATE) == [b"working"] * 3
    assert one.repeated == {STATE: 2}
    assert said(one, SLEEP, STATE) == [b"done", b"asleep"]


def test_nothing_from_before_a_write_comes_after_it() -> None:
    one = station(ORDERED)
    assert said(one, SLEEP, STATE, STATE) == [b"done", b"asleep", b"asleep"]
    assert (one.left_out, one.repeated) == (1, {STATE: 1})


def test_a_write_that_was_repeated_because_its_answer_was_lost_divides_nothing() -> None:
    """A client that hears the first answer does not write again, and comes as far all the same."""
    repeated = tape(
        row(1.0, "sent", SLEEP),
        row(1.5, "sent", SLEEP),
        row(1.51, "heard", b"done"),
        *ORDERED[-2:],
    )
    assert said(station(repeated), SLEEP, STATE) == [b"asleep"]
    assert said(station(repeated), SLEEP, SLEEP, STATE) == [b"done", b"asleep"]


def test_the_client_that_missed_a_tick_gets_the_values_of_the_one_it_is_at() -> None:
    question = checked(b"\x020001RTT1\x03\x00")
    rows = [
        one
        for number in range(60)
        for one in (
            row(5.0 + 0.1 * number, "sent", question),
            row(5.01 + 0.1 * number, "heard", reading(number)),
        )
    ]
    one = station(tape(*rows), ticks=RecordedGrid(5.0, 0.1))
    moments = [number for number in range(50) if number not in (20, 21, 35)]
    found = [
        int(reply.data[-7:-2])
        for number in moments
        for reply in one.receive(question, 70.0 + 0.1 * number)
    ]
    assert found == moments
    # once more within one tick: what stands there, and not the next
    (again,) = one.receive(question, 70.0 + 4.91)
    assert again.data == reading(49)
    assert (one.left_out, sum(one.repeated.values())) == (3, 1)


def test_what_a_host_loses_in_handing_over_it_gets_back_with_the_next_answer() -> None:
    one = station([*TWO[:5], *TWO[5:]])
    one.receive(Q1, 100.0)
    first, *_ = one.receive(Q2, 100.025)  # 5 ms later than then
    assert first.at == pytest.approx(100.034)


# -- a question and its second look ----------------------------------------------------------------

ERROR, FLAGS, MODEL = (
    checked(b"\x020001RSER\x03\x00"),
    checked(b"\x020001RTA1\x03\x00"),
    checked(b"\x020001RSMN\x03\x00"),
)


def answer(text: bytes) -> bytes:
    return checked(b"\x020100A%s\x03\x00" % text)


NONE, SOME, OTHER = answer(b"SER00000"), answer(b"SER00011"), answer(b"SER00022")


def asked(at_s: float, question: bytes, *answers: bytes) -> list[CaptureRow]:
    """One question after the other, each as soon as the one before it was answered."""
    found: list[CaptureRow] = []
    for number, one in enumerate(answers):
        found += [
            row(at_s + 0.02 * number, "sent", question),
            row(at_s + 0.02 * number + 0.015, "heard", one),
        ]
    return found


def with_model(
    turns: dict[float, tuple[bytes, ...]], question: bytes, seconds: int = 40
) -> ReplayedStation:
    """The model each second, where sampling began at the first, and half a second later what is
    given.
    """
    rows = [
        one for second in range(seconds) for one in asked(5.0 + second, MODEL, answer(b"SMN  DDE"))
    ]
    rows += [one for at_s, answers in turns.items() for one in asked(at_s, question, *answers)]
    return station(tape(*sorted(rows, key=lambda one: one.at_s)), ticks=RecordedGrid(5.0, 1.0))


def heard(one: ReplayedStation, question: bytes, *moments: float) -> list[bytes]:
    return [reply.data for moment in moments for reply in one.receive(question, moment)]


DOUBTED = {5.5: (NONE,), 15.5: (SOME, NONE), 25.5: (NONE,)}


def test_an_answer_that_came_too_late_then_does_not_come_in_time_now() -> None:
    question = checked(b"\x020001RTT1\x03\x00")
    late = tape(
        *asked(2.0, MODEL, answer(b"SMN  DDE")),
        row(2.02, "sent", question),
        ResultRow(2.156, "told", "ask", 0, 2.02),
        row(2.16, "heard", reading(320)),
        *asked(2.18, MODEL, answer(b"SMN  DDE")),
        *asked(2.2, question, reading(329)),
    )
    one = station(late, early_s=0.001)
    one.receive(MODEL, 100.0)
    # the client is 15 ms behind, its patience as long as then
    assert one.receive(question, 100.035) == [(pytest.approx(100.175), reading(320))]
    one.receive(MODEL, 100.195)
    assert one.receive(question, 100.215) == [(pytest.approx(100.229, abs=0.02), reading(329))]
    groups = [len(group.all) for group in retry_groups(exchanges(late))]
    assert max(groups) == 2  # the late one is replayed with its repetition, or not at all


def at_second(one: ReplayedStation, question: bytes, last: int) -> None:
    """Ask the model each second, and the other question behind the first."""
    for second in range(last + 1):
        one.receive(MODEL, 5.0 + second)
        if not second:
            one.receive(question, 5.5)


def lost_after(question: bytes) -> ReplayedStation:
    """The model each second, and another request before a loss of 2.5 s, after which it waits."""
    rows = [
        *(one for second in range(12) for one in asked(5.0 + second, MODEL, answer(b"SMN  DDE"))),
        *asked(16.5, question, NONE),
        row(16.6, "lost"),
        row(19.0, "failed"),
        row(19.2, "opened"),
        *(one for second in range(9) for one in asked(20.0 + second, MODEL, answer(b"SMN  DDE"))),
    ]
    return station(tape(*rows), ticks=RecordedGrid(5.0, 1.0))


@pytest.mark.parametrize("asks", [False, True])
def test_a_link_is_lost_once_whether_or_not_the_request_before_it_comes(asks: bool) -> None:
    one = lost_after(ERROR)
    at_second(one, MODEL, 11)
    if asks:
        one.receive(ERROR, 16.5)
        assert one.next_plugging(16.5) == pytest.approx(16.6)
    else:
        assert one.receive(MODEL, 17.0) == []  # no answer from before is repeated
        assert one.next_plugging(17.0) == pytest.approx(17.001)
    assert [one.is_unplugged(at) for at in (17.1, 18.9, 19.2)] == [True, True, False]
    assert all(len(one.receive(MODEL, 20.0 + second)) == 1 for second in range(9))
    one.receive(ERROR, 28.5)
    assert not one.is_unplugged(28.9)


def test_a_loss_before_the_client_s_place_is_none() -> None:
    ticks = (one for second in range(9) for one in asked(5.0 + second, MODEL, answer(b"SMN  DDE")))
    before = [*asked(2.0, ERROR, NONE), row(2.1, "lost"), row(4.0, "opened")]
    one = station(tape(*before, *ticks), ticks=RecordedGrid(5.0, 1.0))
    assert all(len(one.receive(MODEL, 5.0 + second)) == 1 for second in range(9))


def test_a_client_that_slept_through_a_loss_notices_it() -> None:
    one = lost_after(ERROR)
    at_second(one, MODEL, 11)
    assert one.receive(MODEL, 21.0) == []
    assert [one.is_unplugged(at) for at in (21.0, 21.01, 21.2)] == [False, True, False]


@pytest.mark.parametrize("early_s", [0.3, 0.05, 0.0, -0.05, -0.3])
def test_a_doubted_answer_is_followed_by_the_one_that_was_believed_and_that_stands(
    early_s: float,
) -> None:
    one = with_model(DOUBTED, ERROR)
    at_second(one, ERROR, 10)
    first = 15.5 - early_s
    assert heard(one, ERROR, first, first + 0.02, first + 0.04, first + 0.06) == [
        SOME,
        NONE,
        NONE,
        NONE,
    ]
    assert one.repeated == {ERROR: 2}


def test_who_is_well_behind_gets_neither_of_them() -> None:
    one = with_model(DOUBTED, ERROR)
    at_second(one, ERROR, 19)
    assert heard(one, ERROR, 24.9, 24.92) == [NONE, NONE]
    assert one.left_out == 2


def test_three_answers_of_which_none_bears_another_out_are_not_believed() -> None:
    one = with_model({5.5: (NONE,), 15.5: (SOME, OTHER, answer(b"SER00033"))}, ERROR)
    at_second(one, ERROR, 10)
    assert heard(one, ERROR, 15.5, 15.52, 15.54, 15.56)[1:] == [
        OTHER,
        answer(b"SER00033"),
        NONE,
    ]


def test_a_question_without_an_answer_is_no_look() -> None:
    """Asked, lost, asked for the model, asked twice more: of two answers the last was accepted."""
    turns = {5.5: (NONE,), 16.1: (SOME, OTHER), 25.5: (OTHER,)}
    rows = [
        *(one for second in range(30) for one in asked(5.0 + second, MODEL, answer(b"SMN  DDE"))),
        *(one for at_s, answers in turns.items() for one in asked(at_s, ERROR, *answers)),
        row(15.7, "sent", ERROR),
    ]
    one = station(tape(*sorted(rows, key=lambda one: one.at_s)), ticks=RecordedGrid(5.0, 1.0))
    at_second(one, ERROR, 10)
    assert heard(one, ERROR, 15.7) == []
    assert heard(one, MODEL, 16.0) == [answer(b"SMN  DDE")]
    assert heard(one, ERROR, 16.1, 16.12, 16.5) == [SOME, OTHER, OTHER]
    assert one.repeated == {ERROR: 1}


def test_flags_are_told_once_and_by_who_comes_late_all_the_same() -> None:
    unset, both = answer(b"TA100000"), answer(b"TA100011")
    turns = {5.5: (unset,), 15.5: (both,), 16.5: (unset,), 17.5: (unset,)}
    one = with_model(turns, FLAGS)
    at_second(one, FLAGS, 10)
    assert heard(one, FLAGS, 15.5, 15.52, 16.5) == [both, unset, unset]
    late = with_model(turns, FLAGS)
    at_second(late, FLAGS, 11)
    assert heard(late, FLAGS, 16.6, 17.5) == [both, unset]
