"""The architecture page walks three values through the code; a traced run compares the walks. The
questions of newcomers are answered by files and functions that exist.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from support.walk import MAKE, PACKAGE, PAGE, WALKS, listed_in, rows_of

QUESTIONS = PAGE.with_name("newcomers.md")
ANSWER = re.compile(r"`([\w/]+\.py)`: `([\w.]+)`")


@pytest.mark.parametrize("name", WALKS)
def test_the_page_walks_where_the_value_goes(name: str, tmp_path: Path) -> None:
    listed = listed_in(PAGE.read_text(encoding="utf-8"), name)
    assert len(listed) > 3
    rows = rows_of(name, tmp_path, listed)
    assert listed == [handling for _, handling in rows], f"the code has changed: {MAKE}"


def test_each_question_is_answered_by_functions_that_are_there() -> None:
    questions = QUESTIONS.read_text(encoding="utf-8").split("\n## ")[1:]
    assert len(questions) == 10
    for question in questions:
        answers = ANSWER.findall(question)
        assert answers, question
        for file, function in answers:
            assert function in functions_of(PACKAGE / file), (file, function)


def functions_of(path: Path) -> set[str]:
    """The functions and methods of a file."""
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ClassDef):
            members = [each for each in node.body if isinstance(each, FUNCTIONS)]
            found |= {f"{node.name}.{member.name}" for member in members}
        elif isinstance(node, FUNCTIONS):
            found.add(node.name)
    return found


FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
