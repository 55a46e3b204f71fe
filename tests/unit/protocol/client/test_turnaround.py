"""How long a station takes to answer: what is made of twelve harmless reads, or of three and of
what was read anyway.
"""

from __future__ import annotations

from itertools import count

import pytest

from support.clients.talk import Answer, Talk
from support.product import (
    FAMILIES,
    LEAST_ANSWERED,
    LEAST_TIMED_READS,
    TIMED_READS,
    AnswerTime,
    LineFormat,
    ResponseTime,
    Station,
    Steps,
    response_time,
)

ANSWERS = {"RSER": "ASER00000", "RTT1": "ATT100183"}
Measured = tuple[ResponseTime | None, int]


def measure(station: Station) -> Steps[Measured]:
    return response_time(station, FAMILIES["dde"], 1)


def talk_with(late_s: list[float | None], line: LineFormat | None = None) -> Talk:
    """One whose answers take so much longer, in turn; None: no answer."""
    number = count()

    def replies(text: str) -> list[Answer]:
        after = late_s[next(number) % len(late_s)]
        return [] if after is None or text not in ANSWERS else [(0.02 + after, ANSWERS[text])]

    return Talk(replies=replies, line=line)


def measured(late_s: list[float | None], line: LineFormat | None = None) -> ResponseTime:
    found, answered = talk_with(late_s, line).do(measure)
    assert found is not None
    assert answered == len(found.took)
    return found


def test_the_shortest_comes_first_and_the_longest_last() -> None:
    """The last is what a rate is held against where answers vary."""
    found = measured([0.04, 0.0, 0.02, 0.01])
    assert len(found.took) == TIMED_READS
    assert list(found.took) == sorted(found.took)
    assert found.longest - found.took[0] == pytest.approx(40_000, abs=10_000)
    assert not found.is_faster


def test_a_line_that_is_too_bad_is_not_asked_on() -> None:
    """Once six of twelve can no more be answered; each question that is not costs a time-out and
    some probes.
    """
    talk = talk_with([None])
    assert talk.do(measure) == (None, 0)
    silent = len(talk.end.heard)
    assert TIMED_READS - LEAST_ANSWERED < silent < 20


def test_one_in_two_is_enough() -> None:
    assert len(measured([None, *5 * [0.0]]).took) >= LEAST_ANSWERED


def test_on_a_link_that_is_faster_than_its_stated_rate_it_is_zero() -> None:
    """20 ms for what takes 28 ms at 9600 bit/s: no station answers before it was asked."""
    found = measured([0.0], LineFormat(9600))
    assert set(found.took) == {0.0}
    assert (found.median, found.longest) == (0.0, 0.0)
    assert found.whole == pytest.approx(20_000, abs=1)
    said = found.faster_text(LineFormat(9600))
    assert (
        said
        == "the link is faster than its stated 9600 8N1: a question and its answer take 20.00 ms,"
        " 28.12 ms at that rate"
    )


def test_a_link_within_the_tolerance_of_two_clocks_is_not_called_faster() -> None:
    found = ResponseTime((0.0,), 13_700.0, 14_060.0)
    assert not found.is_faster
    assert found.faster_text(LineFormat()) is None
    assert ResponseTime((0.0,), 13_600.0, 14_060.0).is_faster


def test_one_late_answer_does_not_hide_a_faster_link() -> None:
    found = measured([0.0, 0.0, 0.05, 0.0, 0.0, 0.0], LineFormat(9600))
    assert found.is_faster
    assert found.median == 0.0
    assert found.longest == pytest.approx(42_000, abs=1_000)


# -- with signals that were read anyway ------------------------------------------------------------


def with_seen(late_s: list[float | None], seen_ms: list[float]) -> tuple[Measured, list[str]]:
    """What is measured by a client that has heard signals so many ms after their bytes, and what it
    asks.
    """
    seen = [AnswerTime((14 + one) * 1000, 14_000) for one in seen_ms]
    talk = talk_with(late_s)
    found = talk.do(lambda station: response_time(station, FAMILIES["dde"], 1, seen))
    return found, talk.end.heard


def test_three_reads_of_the_temperature_are_enough_where_other_signals_were_read() -> None:
    (found, answered), asked = with_seen([0.01], 20 * [16.0])
    assert asked == LEAST_TIMED_READS * ["RTT1"]
    assert answered == 20 + LEAST_TIMED_READS
    assert found is not None
    assert len(found.took) == 20 + LEAST_TIMED_READS
    assert found.median == pytest.approx(16_000, abs=100)


def test_a_station_that_takes_longer_to_measure_is_not_taken_for_a_fast_one() -> None:
    """However many settings it told before; two late answers of three make no slow station."""
    (slow, _), _ = with_seen([0.05], 20 * [6.0])
    (late, _), _ = with_seen([0.0, 0.05, 0.05], 20 * [6.0])
    assert slow is not None
    assert late is not None
    assert slow.median > 20_000
    assert late.median == pytest.approx(6000, abs=100)


def test_fewer_signals_before_mean_more_reads() -> None:
    assert with_seen([0.0], [1.0, 1.0])[1] == (TIMED_READS - 2) * ["RTT1"]
    assert with_seen([0.0], 5 * [1.0])[1] == (TIMED_READS - 5) * ["RTT1"]
    assert with_seen([0.0], LEAST_ANSWERED * [1.0])[1] == LEAST_TIMED_READS * ["RTT1"]


def test_a_station_that_knows_none_of_the_reads_has_answered_none() -> None:
    """Whatever was read before."""
    seen = 20 * [AnswerTime(15_000, 14_000)]
    talk = Talk(replies=lambda text: [(0.016, f"N{text[1:4]}00004")])
    found, answered = talk.do(lambda station: response_time(station, FAMILIES["dde"], 1, seen))
    assert answered == 0
    assert found is not None
    assert found.ignored == FAMILIES["dde"].harmless[::-1]
    assert found.median == 1000


def test_one_lost_answer_brings_all_reads_back() -> None:
    """What was read before proves nothing of a link that loses answers now."""
    (found, answered), _ = with_seen([0.0, *5 * [None], *40 * [0.0]], 6 * [1.0])
    assert found is not None
    assert LEAST_ANSWERED <= answered < TIMED_READS
    assert len(found.took) == answered + 6
    assert with_seen([None], 6 * [1.0])[0][1] == 0
