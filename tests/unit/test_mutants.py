"""The tool that makes mutants: each is one change that can be loaded, the sample is always the same, the interval Wilson's."""

from __future__ import annotations

import ast
import random
from pathlib import Path

import mutants
import pytest

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
    places = mutants.Places()
    places.visit(ast.parse(BEFORE))
    plain = ast.unparse(ast.parse(BEFORE)).splitlines()
    changed = [mutants.mutated(path, node, which).splitlines() for _, _, node, which in places.found]
    lines = [line.strip() for text in changed for line in text if line not in plain]
    assert set(lines) == AFTER
    assert len(changed) == len(AFTER) + 1  # two statements that are left out look alike


@pytest.mark.parametrize("package", mutants.PACKAGES)
def test_mutants_of_the_product_can_be_loaded_and_are_the_same_each_time(package: str) -> None:
    assert mutants.sample(package) == mutants.sample(package)
    for name, _, _, node, which in random.Random(1).sample(mutants.sample(package), 20):
        before = ast.unparse(ast.parse((mutants.HERE / name).read_text()))
        after = mutants.mutated(mutants.HERE / name, node, which)
        compile(after, name, "exec")
        assert after != before


def test_the_interval_of_a_share() -> None:
    """Wilson 1927; the values are those of Newcombe 1998, table I."""
    assert mutants.wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert mutants.wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)


def test_tests_are_taken_quickest_first_for_so_long() -> None:
    known = {
        "took": {"a": 30.0, "b": 1.0, "c": 20.0, "d": 1e6},
        "lines": {"x.py": {"1": [], "5": ["a", "b", "c", "d"], "9": ["b"]}},
    }
    assert mutants.covering(known, "x.py", 5) == ["b", "c"]
    assert mutants.covering(known, "x.py", 7) == ["b", "c"]  # of the same statement
    assert mutants.covering(known, "x.py", 1) == ["b", "c"]  # runs when the file is loaded
    assert mutants.covering(known, "other.py", 5) == []
