"""An answer that two flipped bits turned into another one decides nothing: no setting, no counter,
no alarm, no write, no end.

Each question of a run, on a station of each kind of family, gets one wrong answer whose bytes
really pass. The run must then leave the same settings, counters and writes as one on a clean link,
and report nothing but its doubts. The campaign tries every such corruption::

    pytest -m campaign tests/faults/test_nothing_is_decided.py
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from support.faults.altered_answers import (
    BENCHES,
    asked,
    clean,
    corruptions,
    decided,
    places,
    spoilt,
)
from support.oracles.account import assert_account_holds
from support.virtual.virtual_run import VirtualRun

TELLING_OF_DOUBT = {"read.doubted", "read.implausible", "protocol.anomaly"}
"""An answer with two bits of its addresses turned over is one in their other order
(docs/reference/contradictions.md, B-6).
"""
TELLING_OF_FLAGS = {"alarm.unconfirmed", "alarm.before_run"} | {
    f"alarm.{side}.{what}" for side in ("high", "low") for what in ("not_working", "ended")
}
"""What a flag that no temperature bears out may be told as; it is cleared by reading, so it is not
asked for twice.
"""
ALONE = {"RTA1": TELLING_OF_FLAGS}
QUESTIONS = [(family, question) for family in BENCHES for question in asked(family)]


def wrong(family: str, question: str, place: int, which: int) -> tuple[int, list[str]]:
    """Play a run with this answer corrupted; return how many were (0 or 1), and what it decided."""
    run, spoiler = spoilt(family, question, place, which)
    return spoiler.spoilt, [
        f"{family}, {question}, asking {place}, corruption {which}: {one}"
        for one in _faults(run, family, question)
    ]


def _faults(run: VirtualRun, family: str, question: str) -> Iterator[str]:
    usual = clean(family)[0]
    expected = decided(usual)
    yield from (
        f"{what} {found} instead of {expected[what]}"
        for what, found in decided(run).items()
        if found != expected[what]
    )
    told = (
        set(run.memory.kinds())
        - set(usual.memory.kinds())
        - TELLING_OF_DOUBT
        - ALONE.get(question, set())
    )
    yield from (f"{kind} was told" for kind in sorted(told))
    if run.facts.unconfirmed_alarms > (question == "RTA1"):
        yield f"{run.facts.unconfirmed_alarms} unconfirmed alarms"
    assert_account_holds(run)


@pytest.mark.parametrize("family", BENCHES)
def test_the_run_on_a_clean_line_is_a_whole_one(family: str) -> None:
    run, _ = clean(family)
    assert (run.facts.outcome, run.facts.doubted) == ("completed", {})
    assert len(run.memory.samples) >= 6
    assert len(asked(family)) >= 4


def some(family: str, question: str) -> list[int]:
    """A third of the places of a question on a DDE and on an OMEGA; one of each other family, in
    turn, because they ask most questions alike.
    """
    found = places(family, question)
    begin = sum(question.encode("ascii"))
    return (
        found[begin % min(len(found), 3) :: 3]
        if family in ("dde", "omega")
        else [found[begin % len(found)]]
    )


@pytest.mark.parametrize(("family", "question"), QUESTIONS)
def test_a_wrong_answer_decides_nothing(family: str, question: str) -> None:
    """With one of the corruptions that pass."""
    spoilt_ones = 0
    for place in some(family, question):
        count, faults = wrong(family, question, place, which=7 * place)
        spoilt_ones += count
        assert faults == []
    assert spoilt_ones or not _choices(family, question)


def _choices(family: str, question: str) -> int:
    """Return the number of corruptions that pass; none if only one value can be read."""
    return len(corruptions(family, question, clean(family)[1].first[question]))


@pytest.mark.campaign
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("family", BENCHES)
def test_no_wrong_answer_decides_anything(family: str, counted: Callable[..., None]) -> None:
    """Every corruption that passes, at each of the places."""
    runs, faults = 0, []
    for question in asked(family):
        for place in places(family, question):
            for which in range(_choices(family, question)):
                count, found = wrong(family, question, place, which)
                runs += count
                faults += found
    counted(
        families=1,
        questions=len(asked(family)),
        runs_with_one_answer_spoilt=runs,
        decisions_by_it=len(faults),
    )
    assert faults[:20] == []
