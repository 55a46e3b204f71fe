"""Every contradiction of the manuals is decided, and what shows on the wire can be played and is
reported.
"""

from __future__ import annotations

import re

import pytest

from support.campaigns.each_row import each_row
from support.product import (
    FAMILIES,
    ManualContradiction,
    contradictions,
    odd_form,
    omega_quirks,
    robot_quirks,
    tolerated,
)

ROWS = 55
CONTRADICTIONS = contradictions()
UNDECIDED = {20, 33, 35, 51, 55}  # what no evidence can decide: the raw value is kept, and marked
# what only who seeks a station meets, and nobody can tell from another's refusal
ONLY_SOUGHT = {14}

decisions = each_row((f"B-{one.number}", (one,)) for one in CONTRADICTIONS.values())


def test_every_row_has_a_decision() -> None:
    assert list(CONTRADICTIONS) == [*range(1, ROWS + 1)]


@decisions
def test_a_decision_says_what_is_done_and_why(decision: ManualContradiction) -> None:
    assert min(len(decision.title), len(decision.reason)) > 10
    assert decision.reading
    told = decision.number in UNDECIDED or (
        bool(decision.quirks) and decision.number not in ONLY_SOUGHT
    )
    assert bool(decision.met) == told
    assert decision.doubtful or decision.number not in UNDECIDED
    assert decision.met == "" or decision.met.endswith(".")


def test_every_quirk_belongs_to_the_row_that_names_it() -> None:
    named = {
        quirk: decision.number for decision in CONTRADICTIONS.values() for quirk in decision.quirks
    }
    assert named == robot_quirks() | omega_quirks()


def test_what_is_taken_beside_the_recommended_form_is_told() -> None:
    assert all(CONTRADICTIONS[number].met for _, number in tolerated())


def test_what_is_tolerated_are_commands() -> None:
    commands = {name for family in FAMILIES.values() for name in family.commands}
    assert {command for command, _ in tolerated()} <= commands


def test_notes_of_commands_cite_rows_that_are_there() -> None:
    notes = [command.note for family in FAMILIES.values() for command in family.commands.values()]
    cited = {int(number) for note in notes for number in re.findall(r"B-(\d+)", note)}
    assert cited <= set(CONTRADICTIONS)
    assert len(cited) > 10


PRINTED = [
    ("adjust", "-0050"),
    ("alarm_flags", "00011"),
    ("alarm_high_delay", "01.60"),
    ("alarm_high_delay", "99999"),
    ("dispensed_length", "003E8"),
    ("model", "  DDR"),
    ("port_error", "00004"),
    ("power", "00840"),
]


@pytest.mark.parametrize(("command", "data"), PRINTED)
def test_what_the_manuals_print_is_not_odd(command: str, data: str) -> None:
    assert odd_form(command, data) is None
