"""Starts and short runs on stations that somebody else wrote from the manuals (`outside_bench`), on bad wires and with bad ones.

Beside `test_starts.py`: here an answer that is late keeps the station busy, so that all that is asked meanwhile is answered
later, too; stations keep a setting for up to 0.3 s; and each has habits of its own where the manuals are silent.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from outside_bench import FAMILIES, KINDS, Cable, cable
from outside_runs import Outcome, eight, virtual, wrong_values
from sane import assert_memory_is_bounded

FOUR = ("dde", "nae", "hde", "jtse")
HOW_OFTEN = re.compile(r"in \d+ (try|tries|writes?)\b|only \d+ of 12 questions|silent for 10 s in step \d|not start because")
HEATS = re.compile(r"W(ST\d|S\d\d|PS\d000[^0]0|PS\d00000|SF1|SE1|WM1|A\d\d)")
"""Writes of step three on stations for soldering."""


def ordered(one: Cable) -> list[str]:
    """Writes that the station took in, whether it carried them out or not."""
    return [f"W{write.code}{write.data}" for write in one.written]


def is_hot(one: Cable) -> bool:
    """Whether it was left in a state that heats for good."""
    if one.station.family == "jtse":
        return one.station.read("PS1", one.rows[-1].at)[-2:] == "01"  # type: ignore[index]  # it is known
    return any(port.tool and port.units == 0 and not port.extractor for port in one.station.ports.values())


def silent_from(one: Cable, question: str) -> None:
    """It answers nothing any more once it is asked that."""
    fallen: list[bool] = []

    def is_silent(text: str) -> bool:
        if text.startswith(question):
            fallen.append(True)
        return bool(fallen)

    one.is_silent_to = is_silent


def assert_true(outcome: Outcome, number: object) -> None:
    assert list(wrong_values(outcome)) == [], number
    assert [name for name, one in outcome.cables.items() if is_hot(one)] == [], number


# -- bad wires ------------------------------------------------------------------------------------------------------------------


def test_the_bench_is_sound() -> None:
    """On good wires everything starts, is recorded as it was said, and rests in the end."""
    outcome = virtual(eight(0, 0.0))
    assert outcome.not_started == {}
    assert_true(outcome, 0)
    rows = [row for row in outcome.memory.settings if row.outcome == "confirmed"]
    assert {row.station for row in rows} == set(FAMILIES)
    assert len(outcome.memory.samples) > 100


def test_a_false_value_is_found() -> None:
    """The bench would notice: one cell that its station never said."""
    outcome = virtual({"dde": cable("dde", 1)})
    outcome.memory.samples[3][8] = 999
    outcome.cables["dde"].station.ports[1].selected = 345
    found = list(wrong_values(outcome))
    assert len(found) == 2
    assert "00345" in found[0]
    assert "999" in found[1]


def test_a_station_that_is_busy_for_a_moment_starts() -> None:
    """1.4 s before one answer, in each step in turn; what is asked meanwhile is answered later."""
    for number in (3, 14, 25, 40, 60, 75):
        one = cable("dde", 7)
        one.script = {number: "late"}
        one.rng.uniform = lambda _low, high: high  # type: ignore[method-assign]  # as late as any
        outcome = virtual({"dde": one})
        assert outcome.not_started == {}, number
        assert_true(outcome, number)
        assert one.faults == {}


@pytest.mark.parametrize("number", range(3))
def test_no_start_is_refused_at_one_percent_of_each(number: int) -> None:
    outcome = virtual(eight(number, 0.01))
    assert outcome.not_started == {}
    assert_true(outcome, number)


@pytest.mark.parametrize("number", range(3))
def test_no_value_is_wrong_at_five_percent_of_each(number: int) -> None:
    outcome = virtual(eight(number, 0.05, FOUR))
    assert_true(outcome, number)
    for reason in outcome.not_started.values():
        assert HOW_OFTEN.search(reason), reason


@pytest.mark.campaign
@pytest.mark.parametrize("block", range(20))
def test_two_hundred_starts_at_one_percent_of_each(block: int, counted: Callable[..., None]) -> None:
    for number in range(100 + 10 * block, 110 + 10 * block):
        outcome = virtual(eight(number, 0.01))
        assert outcome.not_started == {}, number
        assert_true(outcome, number)
        assert_memory_is_bounded()
        counted(**tally(outcome))


@pytest.mark.campaign
@pytest.mark.parametrize("block", range(10))
def test_a_hundred_starts_at_five_percent_of_each(block: int, counted: Callable[..., None]) -> None:
    for number in range(1000 + 10 * block, 1010 + 10 * block):
        outcome = virtual(eight(number, 0.05))
        assert_true(outcome, number)
        for reason in outcome.not_started.values():
            assert HOW_OFTEN.search(reason), reason
        counted(**{f"at_5_percent_{name}": count for name, count in tally(outcome).items()})


def tally(outcome: Outcome) -> dict[str, int]:
    struck = [sum(one.faults.values()) for one in outcome.cables.values()]
    asked = sum(row.what == "asked" for one in outcome.cables.values() for row in one.rows)
    refused = sum("not start because" not in reason for reason in outcome.not_started.values())
    told = {"starts": 1, "stations": len(outcome.cables), "frames": asked, "disturbed": sum(struck), "refused": refused}
    return told | {"rows": len(outcome.memory.samples), "wrong_values": 0}


def test_every_kind_of_accident_happens() -> None:
    cables = eight(5, 0.05)
    virtual(cables)
    assert set().union(*(one.faults for one in cables.values())) == set(KINDS)


# -- one of several does not start ------------------------------------------------------------------------------------------------

BAD = {
    "silent in step one": (lambda one: silent_from(one, "RHA1"), 1),
    "silent from the first question": (lambda one: silent_from(one, "R"), 1),
    "refuses in step two": (lambda one: setattr(one, "refuses", lambda text: 3 * text.startswith("WH12")), 2),
    "silent in step two": (lambda one: silent_from(one, "WHA1"), 2),
    "refuses in step three": (lambda one: setattr(one, "refuses", lambda text: 3 * text.startswith("WST1")), 3),
    "refuses to work": (lambda one: setattr(one, "refuses", lambda text: 3 * text.startswith("WPS100000")), 3),
    "silent in step three": (lambda one: silent_from(one, "WST1"), 3),
}


@pytest.mark.parametrize("how", BAD)
def test_what_is_written_where_when_one_fails(how: str) -> None:
    spoil, step = BAD[how]
    cables = eight(0, 0.0, FOUR)
    bad = cables["hde"]
    spoil(bad)
    outcome = virtual(cables)
    assert set(outcome.not_started) == set(FOUR)
    assert outcome.memory.samples == []
    orders = {name: ordered(one) for name, one in cables.items()}
    if step == 1:
        assert [one for name in FOUR for one in orders[name]] == []
    if step == 2:
        assert [one for name in FOUR for one in orders[name] if HEATS.match(one)] == []
        assert "WD1200004" in orders["dde"]
        assert "sleep delay of port 1 4 min (was 5 min)" in outcome.not_started["hde"]  # named, and not rolled back
    if step == 3:
        assert [one.station.name for name, one in cables.items() if is_hot(one) and (name != "hde" or "silent" not in how)] == []
    others = {outcome.desks[name].facts.outcome for name in FOUR if name != "hde"}
    assert others == {"not_started"}
    assert all("hde" in outcome.not_started[name] for name in FOUR)


@pytest.mark.parametrize("how", BAD)
def test_a_silent_station_delays_the_others_by_ten_seconds_at_the_most(how: str) -> None:
    spoil, _ = BAD[how]
    alone = virtual(eight(0, 0.0, ("dde", "nae", "jtse")), duration_s=0.5)
    cables = eight(0, 0.0, FOUR)
    spoil(cables["hde"])
    outcome = virtual(cables, duration_s=0.5, goes_on=True)
    assert set(outcome.not_started) == {"hde"}
    assert outcome.desks["hde"].facts.outcome == "left_out"
    assert begun(outcome) - begun(alone) < 10.5
    assert_true(outcome, how) if "silent" not in how else None
    assert {row[2] for row in outcome.memory.samples} == {"dde", "nae", "jtse"}


def begun(outcome: Outcome) -> float:
    return min(one.taken("PS")[0].at for one in outcome.cables.values() if one.taken("PS"))
