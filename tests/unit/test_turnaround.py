"""How long a station takes to answer: what is made of twelve harmless reads."""

from __future__ import annotations

from itertools import count

import pytest
from talk import Answer, Talk

from jbclog.commands.family import FAMILIES
from jbclog.effects import Steps
from jbclog.station.robot import Station
from jbclog.station.turnaround import LEAST_ANSWERED, READS, turnarounds_us

ANSWERS = {"RSER": "ASER00000", "RTT1": "ATT100183"}


def measure(station: Station) -> Steps[list[float]]:
    return turnarounds_us(station, FAMILIES["dde"], 1)


def talk_with(late_s: list[float | None]) -> Talk:
    """One whose answers take so much longer, in turn; None: no answer."""
    number = count()

    def replies(text: str) -> list[Answer]:
        after = late_s[next(number) % len(late_s)]
        return [] if after is None or text not in ANSWERS else [(0.02 + after, ANSWERS[text])]

    return Talk(replies=replies)


def test_the_shortest_comes_first_and_the_longest_last() -> None:
    """The last is what a rate is held against where answers vary."""
    took = talk_with([0.04, 0.0, 0.02, 0.01]).do(measure)
    assert len(took) == READS
    assert took == sorted(took)
    assert took[-1] - took[0] == pytest.approx(40_000, abs=10_000)


def test_a_line_that_is_too_bad_is_not_asked_on() -> None:
    """Once six of twelve can no more be answered; each question that is not costs a time-out and some probes."""
    talk = talk_with([None])
    assert talk.do(measure) == []
    silent = len(talk.end.heard)
    assert READS - LEAST_ANSWERED < silent < 20


def test_one_in_two_is_enough() -> None:
    assert len(talk_with([None, *5 * [0.0]]).do(measure)) >= LEAST_ANSWERED
