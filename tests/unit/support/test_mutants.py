"""The tool that makes mutants: each is one change, known by what does not move with the lines;
covering tests are taken cheapest first, the interval is Wilson's.
"""

from __future__ import annotations

import ast
import os
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import pytest

from support.campaigns import mutants

BEFORE = """
LIMIT_S = 2.0

def is_late(seconds, parts):
    '''A text that stays.'''
    if not parts and seconds > LIMIT_S:
        raise ValueError("late")
    note(parts)
    return max(seconds, 0) + 1
"""
AFTER = {
    "LIMIT_S = 3.0",
    "LIMIT_S = 0.0",
    "if False:",
    "if True:",
    "if not parts or seconds > LIMIT_S:",
    "if parts and seconds > LIMIT_S:",
    "if not parts and seconds >= LIMIT_S:",
    "pass",
    "return None",
    "return max(seconds, 0) - 1",
    "return min(seconds, 0) + 1",
    "return max(seconds, 1) + 1",
    "return max(seconds, 0) + 2",
    "return max(seconds, 0) + 0",
}


def test_each_change_is_made_once(tmp_path: Path) -> None:
    path = tmp_path / "code.py"
    path.write_text(BEFORE)
    plain = ast.unparse(ast.parse(BEFORE)).splitlines()
    changed = [
        ast.unparse(mutants.mutated(BEFORE, mutant.node, mutant.change)).splitlines()
        for mutant in mutants.mutants_of(tmp_path, path)
    ]
    lines = [line.strip() for text in changed for line in text if line not in plain]
    assert set(lines) == AFTER
    assert len(changed) == len(AFTER) + 1  # two statements that are left out look alike


METHODS = """
class Tool:
    limit_s: float = 2.0

    def is_late(self, seconds=1):
        def over():
            return seconds > 3
        return over() and seconds > 4

async def send(self):
    await self.order()
"""


def test_a_mutant_is_known_by_function_operator_and_number(tmp_path: Path) -> None:
    path = tmp_path / "code.py"
    path.write_text(METHODS)
    before = [mutant.identity for mutant in mutants.mutants_of(tmp_path, path)]
    assert {
        identity[1:] for identity in before if identity[2] in ("plus 1", "GtE", "left out")
    } == {
        ("Tool.limit_s", "plus 1", "1"),
        *(("Tool.is_late", "plus 1", number) for number in "123"),
        *(("Tool.is_late", "GtE", number) for number in "12"),
        ("send", "left out", "1"),
    }
    path.write_text(f"LINES = 1\n\n{METHODS}")
    after = [mutant.identity for mutant in mutants.mutants_of(tmp_path, path)]
    assert [identity for identity in after if identity[1] != "LINES"] == before


def test_the_sample_of_tomorrow_is_that_of_today_but_for_what_is_new(tmp_path: Path) -> None:
    path = tmp_path / "jbclog/sim/code.py"
    path.parent.mkdir(parents=True)
    path.write_text("TIMES = (" + "7, " * 200 + ")\n")
    today = {mutant.identity for mutant in mutants.sample(tmp_path, "sim")}
    path.write_text("LEVEL = 1\nTIMES = (" + "7, " * 205 + ")\n")
    tomorrow = {mutant.identity for mutant in mutants.sample(tmp_path, "sim")}
    assert len(today) == len(tomorrow) == 100
    assert len(today & tomorrow) > 90


def test_outcomes_are_kept_sorted_and_survivors_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mutants, "DATA", tmp_path)
    rows: mutants.Rows = {
        ("a.py", "f", "zero", "10"): ("survived", ""),
        ("a.py", "f", "zero", "2"): ("noticed", "test_a.py::test_f"),
    }
    mutants.keep("guard", rows)
    assert (tmp_path / "guard.csv").read_text().splitlines()[1:] == [
        "a.py,f,zero,2,noticed,test_a.py::test_f",
        "a.py,f,zero,10,survived,",
    ]
    assert mutants.kept("guard") == rows
    mutants.forget("guard", "survivors")
    assert [*mutants.kept("guard")] == [("a.py", "f", "zero", "2")]
    mutants.forget("guard", "all")
    assert mutants.kept("guard") == {}


def test_the_interval_of_a_share() -> None:
    """Wilson 1927; the values are those of Newcombe 1998, table I."""
    assert mutants.wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert mutants.wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)


CODE = """LIMIT_S = 2.0

def is_late(seconds):
    return is_over(
        seconds,
        LIMIT_S,
    )

def other(seconds):
    return seconds
"""
NAME = "jbclog/session/run/code.py"


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    path = tmp_path / NAME
    path.parent.mkdir(parents=True)
    path.write_text(CODE)
    return tmp_path


def first_mutant(tree: Path, line: int) -> mutants.Mutant:
    """The first change of this line."""
    return next(change for change in mutants.mutants_of(tree, tree / NAME) if change.line == line)


def test_tests_are_taken_cheapest_first_and_parameters_of_another_later(tree: Path) -> None:
    took = {
        "a[1]": [0.1, 0.1],
        "a[2]": [0.15, 0.15],
        "b": [0.2, 0.2],
        "slow": [1.0, 99.0],
        "waits": [1.2, 0.1],
        "c": [0.1, 0.1],
    }
    known = {
        "took": took,
        "lines": {NAME: {4: ["a[1]", "a[2]", "b", "slow", "waits"], 6: ["b"], 10: ["c"]}},
    }
    # b runs more of the file
    assert mutants.covering(known, tree, first_mutant(tree, 4), Counter()) == [
        "b",
        "a[1]",
        "a[2]",
        "waits",
    ]
    # it has noticed much
    assert mutants.covering(known, tree, first_mutant(tree, 4), Counter(waits=99))[0] == "waits"
    # it noticed this one before
    assert mutants.covering(known, tree, first_mutant(tree, 4), Counter(waits=99), "a")[0] == "a[1]"
    assert mutants.covering(known, tree, first_mutant(tree, 10), Counter()) == ["c"]
    # where the constant is used
    assert mutants.covering(known, tree, first_mutant(tree, 1), Counter()) == ["b"]
    assert mutants.covering({"took": {}, "lines": {}}, tree, first_mutant(tree, 4), Counter()) == []


def test_a_table_shows_where_what_is_made_from_it_is_used(tree: Path) -> None:
    table = "jbclog/session/run/table.py"
    (tree / table).write_text("TABLE = (1, 2)\nTABLES = {0: TABLE}\n")
    (tree / NAME).write_text("def of(family):\n    return TABLES[family]\n")
    of_table = [(table, 1), (table, 2)]
    assert mutants.lines_of(tree, table, 1, {table: {2: ["a"]}}) == of_table
    assert {*mutants.lines_of(tree, table, 1, {NAME: {2: ["a"]}})} == {*of_table, (NAME, 2)}


def test_a_class_shows_in_its_file_or_where_it_is_used(tree: Path) -> None:
    kinds = "jbclog/session/run/kinds.py"
    (tree / kinds).write_text("class Kind(Enum):\n    HOT = 1\n")
    (tree / NAME).write_text("def is_hot(kind):\n    return kind is Kind.HOT\n")
    mine = [(kinds, 1), (kinds, 2)]
    assert mutants.lines_of(tree, kinds, 2, {kinds: {2: ["a"]}}) == mine
    assert {*mutants.lines_of(tree, kinds, 2, {NAME: {2: ["a"]}})} == {*mine, (NAME, 2)}


def test_what_is_changed_in_a_function_is_known_by_its_name(tree: Path) -> None:
    assert mutants.function_at(CODE, first_mutant(tree, 4).node) == ("is_late", 3)
    assert mutants.function_at(CODE, first_mutant(tree, 1).node) is None


def test_only_some_parameters_of_each_test_are_used() -> None:
    items = [SimpleNamespace(nodeid=f"x.py::a[{number}]") for number in range(30)] + [
        SimpleNamespace(nodeid="x.py::b")
    ]
    names = [item.nodeid for item in mutants.chosen(items)]
    assert (len(names), names[0], names[-1]) == (mutants.SIBLINGS + 1, "x.py::a[0]", "x.py::b")


def test_a_mutant_of_each_package_is_tried_in_turn(tree: Path) -> None:
    first, second, third = (first_mutant(tree, line) for line in (1, 4, 10))
    assert [*mutants.in_turn({"a": [first, second], "b": [third]})] == [
        ("a", first),
        ("b", third),
        ("a", second),
    ]


def test_the_next_command_puts_right_what_a_killed_one_has_left(tmp_path: Path) -> None:
    path, rows = tmp_path / "tree" / NAME, tmp_path / "cover.jsonl"
    path.parent.mkdir(parents=True)
    path.write_text(CODE)
    os.utime(path, (1, 1))
    rows.write_text('{"a": 1}\n{"b')
    killed = mutants.changed(tmp_path, NAME, "pass\n")
    killed.__enter__()  # and never left
    assert path.read_text() == "pass\n"
    mutants.begin(tmp_path)
    assert (path.read_text(), path.stat().st_mtime) == (CODE, 1)
    assert rows.read_text() == '{"a": 1}\n'
