"""Whole runs, on a virtual clock, of an OMEGA that knows only its printed page: it answers A with
a, with or without a digit.
"""

from __future__ import annotations

import pytest

from support.command import PROFILES
from support.oracles.account import assert_account_holds, reasons_in
from support.oracles.printed_omega import PageOmega
from support.virtual.virtual_run import VirtualRun, prepare

LINE = '[line]\nname = "test"\n[[station]]\nname = "omega-1"\nurl = "omega-1"\nfamily = "omega"\n'
HEAD = '[recipe]\nname = "test"\nrevision = 1\nfamilies = ["omega"]\n'
LEFT_BY_JBC = b"\x020010RSMN\x03\x02"


def prepared(controller: PageOmega, recipe: str = HEAD, duration_s: float = 10.0) -> VirtualRun:
    return prepare(
        LINE, recipe, duration_s, pulled=lambda _order, session, _cable: (session, controller)
    )


def test_a_alone_is_an_answer_and_tells_no_state() -> None:
    run = prepared(PageOmega("a")).go()
    assert run.facts.outcome == "completed", run.facts.reason
    for name in ("solder_shortage", "clogged", "preparing", "in_range"):
        assert set(run.memory.column(name)) == {None}
    assert {tuple(reasons_in(row).items()) for row in run.memory.samples} == {
        (("solder_shortage", "no_digit"), ("clogged", "no_digit"))
    }
    due = run.facts.due["1"]
    assert due["solder_shortage"] == len(run.memory.samples) > 5
    assert not due.get("preparing")
    assert not due.get("in_range")
    assert sorted(run.facts.not_supported) == ["in_range", "preparing"]
    assert_account_holds(run)
    (ready,) = run.memory.of_kind("station.ready")
    assert (
        "does not answer temperature control, set temperature state, so the record does not have"
        " it." in ready.text
    )
    assert (
        "It answers A with a alone: whether solder is short or clogged is not known." in ready.text
    )
    assert [
        event.kind for event in run.memory.events if event.severity in ("error", "critical")
    ] == []


@pytest.mark.parametrize(
    ("answer", "short", "clogged"), [("a0", False, False), ("a1", True, False), ("a2", False, True)]
)
def test_with_its_digit_a_tells_both_flags(answer: str, short: bool, clogged: bool) -> None:
    run = prepared(PageOmega(answer)).go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert set(run.memory.column("solder_shortage")) == {short}
    assert set(run.memory.column("clogged")) == {clogged}
    assert not any(reasons_in(row) for row in run.memory.samples)
    assert not run.facts.due["1"].get("preparing")
    (ready,) = run.memory.of_kind("station.ready")
    assert "a alone" not in ready.text


def test_each_tick_asks_what_is_answered_and_nothing_else() -> None:
    """Each question without an answer at the start is asked three times, and then no more."""
    controller = PageOmega("a0")
    run = prepared(controller).go()
    assert {text: controller.texts.count(text) for text in ("B", "F")} == {"B": 3, "F": 3}
    assert [row[1] for row in run.memory.samples] == list(
        range(run.facts.first_tick or 0, (run.facts.last_tick or 0) + 1)
    )


def test_a_first_question_that_is_swallowed_is_asked_again() -> None:
    controller = PageOmega("a")
    controller.receive(LEFT_BY_JBC, 0.0)
    run = prepared(controller, duration_s=20.0).go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert len(run.memory.samples) > 5


def test_a_digit_that_is_missing_now_and_then_does_not_end_a_shortage() -> None:
    """A state holds until the controller sends another one; an answer without a digit is unknown,
    not normal.
    """
    controller = PageOmega("a1")
    run = prepared(controller, duration_s=20.0)
    run.at(8, lambda: setattr(controller, "answer", "a"))
    run.at(14, lambda: setattr(controller, "answer", "a1"))
    run.go()
    assert {True, None} == set(run.memory.column("solder_shortage"))
    assert len(run.memory.of_kind("solder.shortage")) == 1
    assert run.memory.of_kind("solder.shortage.ended") == []


def test_a_controller_that_falls_silent_is_lost_and_found_again() -> None:
    controller = PageOmega("a0")
    run = prepared(controller, duration_s=60.0)
    run.at(15, lambda: setattr(controller, "is_gone", True))
    run.at(30, lambda: setattr(controller, "is_gone", False))
    run.go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert run.facts.outages == 1
    assert [event.kind for event in run.memory.events if event.kind.startswith("link.")] == [
        "link.lost",
        "link.back",
    ]
    assert run.memory.column("solder_shortage")[-1] is False


def test_a_condition_that_cannot_be_proven_is_refused_and_not_written() -> None:
    controller = PageOmega("a0")
    run = prepared(controller, (PROFILES / "recipes" / "omega-point.toml").read_text()).go()
    assert run.facts.outcome == "refused"
    assert "it does not know condition 101: condition 101: ignored" in run.facts.reason
    assert not any(text.startswith("D") for text in controller.texts)
