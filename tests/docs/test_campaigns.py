"""A campaign is long and not run by default: so each has a short slice of itself that is, and says
what it tried.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
MARK = "pytest.mark.campaign"
FILES = [
    path
    for path in sorted(TESTS.rglob("test_*.py"))
    if MARK in path.read_text(encoding="utf-8") and path != Path(__file__)
]
every_file = pytest.mark.parametrize(
    "path", FILES, ids=lambda path: path.relative_to(TESTS).as_posix()
)


def functions(path: Path) -> list[ast.FunctionDef]:
    body = ast.parse(path.read_text(encoding="utf-8")).body
    return [
        one for one in body if isinstance(one, ast.FunctionDef) and one.name.startswith("test_")
    ]


def is_campaign(function: ast.FunctionDef) -> bool:
    return any(ast.unparse(one).startswith(MARK) for one in function.decorator_list)


def repeats(function: ast.FunctionDef) -> bool:
    """Whether it tries a number of times, and not only each of a few cases."""
    return "range(" in " ".join(ast.unparse(one) for one in (*function.decorator_list, function))


def test_there_are_campaigns() -> None:
    assert len(FILES) > 8


@every_file
def test_a_slice_of_it_runs_by_default(path: Path) -> None:
    assert [one.name for one in functions(path) if not is_campaign(one)] != []


@every_file
def test_it_says_what_it_tried(path: Path) -> None:
    """By `counted`, whose sums stand at the end of the session, or in words of its own."""
    silent = [
        one.name
        for one in functions(path)
        if is_campaign(one)
        and repeats(one)
        and not {"counted", "capsys"} & {argument.arg for argument in one.args.args}
    ]
    assert silent == []
