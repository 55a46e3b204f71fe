"""A campaign is long and not run by default: so each has a short slice of itself that is, and says
what it tried.
"""

from __future__ import annotations

import ast
from pathlib import Path

from support.campaigns.each_row import each_row
from support.readers.repository import parsed

TESTS = Path(__file__).parents[1]
MARK = "pytest.mark.campaign"
FILES = [
    path
    for path in sorted(TESTS.rglob("test_*.py"))
    if MARK in path.read_text(encoding="utf-8") and path != Path(__file__)
]
every_file = each_row((path.relative_to(TESTS).as_posix(), (path,)) for path in FILES)


def functions(path: Path) -> list[ast.FunctionDef]:
    return [
        one
        for one in parsed(path).body
        if isinstance(one, ast.FunctionDef) and one.name.startswith("test_")
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
