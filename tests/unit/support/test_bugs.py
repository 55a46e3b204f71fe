"""The ledger of mended bugs: each can still be put back and names tests that exist; on a tree of
its own, what the tool reports.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

import pytest

from support.campaigns import bugs
from support.campaigns.bugs import Bug, Outcome
from support.campaigns.each_row import each_row
from support.readers.repository import parsed
from support.readers.texts import ROOT

LEAST_BUGS = 60
LEDGER = bugs.read_bugs()

every_bug = each_row((bug.name, (bug,)) for bug in LEDGER)


def test_there_are_enough_and_none_has_another_ones_name() -> None:
    assert len(LEDGER) >= LEAST_BUGS
    assert [name for name, times in Counter(bug.name for bug in LEDGER).items() if times > 1] == []


@every_bug
def test_a_bug_can_be_put_back(bug: Bug) -> None:
    """Where this fails the place is gone: express the bug in the new code (CONTRIBUTING, Test)."""
    assert bug.places(ROOT) == 1, f"{bug.file} has its text {bug.places(ROOT)} times"
    assert bug.new != bug.old
    code = (ROOT / bug.file).read_text(encoding="utf-8").replace(bug.old, bug.new)
    ast.parse(code)


@every_bug
def test_a_bug_says_what_it_was_and_who_must_notice(bug: Bug) -> None:
    assert bug.says.endswith(".")
    assert re.fullmatch("[0-9a-f]{8}", bug.mended)
    assert bug.tests
    for test in bug.tests:
        file, _, name = test.partition("::")
        functions = [one.name for one in ast.walk(parsed(ROOT / file)) if is_function(one)]
        assert name.partition("[")[0] in functions, test


def is_function(node: ast.AST) -> bool:
    return isinstance(node, ast.FunctionDef)


# -- a tree of its own -----------------------------------------------------------------------------

PRODUCT = "def double(number):\n    return number * 2\n"
TESTS = """
import subprocess
import sys
import pytest
from product import double

@pytest.mark.parametrize("number", [0, 3])
def test_double(number):
    assert double(number) == number + number

def test_zero():
    assert double(0) == 0

def test_started():
    script = "from product import double; print(double(3))"
    assert subprocess.check_output([sys.executable, "-c", script], env={}) == b"6\\n"
"""


def bug_of(tests: tuple[str, ...], old: str = "number * 2") -> Bug:
    return Bug("odd", "It was.", "0" * 8, "product.py", old, "number * 3", tests, "own.toml")


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tree = tmp_path_factory.mktemp("tree")
    (tree / "tests").mkdir()
    (tree / "product.py").write_text(PRODUCT)
    (tree / "tests" / "test_product.py").write_text(TESTS)
    bugs.make_environment(tree)
    return tree


def tried(bug: Bug, tree: Path) -> Outcome:
    outcome = bugs.try_bug(bug, tree)
    assert (tree / "product.py").read_text() == PRODUCT
    return outcome


DOUBLE, ZERO = "tests/test_product.py::test_double", "tests/test_product.py::test_zero"


def test_a_bug_is_noticed_by_one_row_of_a_test(tree: Path) -> None:
    outcome = tried(bug_of((DOUBLE,)), tree)
    assert outcome.result == bugs.NOTICED
    assert outcome.failed == (f"{DOUBLE}[3]",)


def test_what_a_test_starts_without_an_environment_has_the_bug(tree: Path) -> None:
    assert tried(bug_of(("tests/test_product.py::test_started",)), tree).result == bugs.NOTICED


def test_each_named_test_has_to_notice(tree: Path) -> None:
    outcome = tried(bug_of((DOUBLE, ZERO)), tree)
    assert (outcome.result, outcome.text) == (bugs.MISSED, f": by {ZERO}")


def test_a_test_that_is_not_there_has_noticed_nothing(tree: Path) -> None:
    outcome = tried(bug_of((DOUBLE, "tests/test_product.py::test_other")), tree)
    assert outcome.result == bugs.MISSED


def test_a_place_that_is_gone_is_named(tree: Path) -> None:
    outcome = tried(bug_of((DOUBLE,), old="number + number"), tree)
    assert outcome.result == bugs.GONE
    assert "stands 0 times in product.py" in outcome.text


def test_a_test_that_fails_by_itself_is_named(tree: Path) -> None:
    assert bugs.failing_unpatched(tree, [bug_of((DOUBLE, ZERO))]) == []
    (tree / "tests" / "test_own.py").write_text("def test_wrong():\n    assert not 1\n")
    wrong = "tests/test_own.py::test_wrong"
    assert bugs.failing_unpatched(tree, [bug_of((wrong, ZERO))]) == [wrong]


def test_a_slice_is_drawn_by_its_seed() -> None:
    first, other = (bugs.chosen(LEDGER, 6, seed) for seed in ("2026-11-29", "2026-11-30"))
    assert len(first) == len(other) == 6
    assert first == bugs.chosen(LEDGER, 6, "2026-11-29") != other
