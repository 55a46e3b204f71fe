"""The ledger of promises (`tests/data/promises.toml`): each row of the fault catalogue, invariant,
contradiction of the manuals, exit code and kind of event has a test that exists and names it.
"""

from __future__ import annotations

import ast
import re
import tomllib
from functools import cache

import pytest

from support.readers.repository import parsed
from support.readers.texts import ROOT

LEDGER = tomllib.loads((ROOT / "tests" / "data" / "promises.toml").read_text(encoding="utf-8"))
CELLS = {  # the first cell of a row, by section of the ledger: page and pattern
    "invariants": ("docs/reference/faults.md", r"^\| (I\d) \|"),
    "faults": ("docs/reference/faults.md", r"^\| (F-\d+) \|"),
    "contradictions": ("docs/reference/contradictions.md", r"^\| (B-\d+)\b"),
    "exit_codes": ("docs/reference/exit-codes.md", r"^\| (\d+) \|"),
    "events": ("docs/reference/events.md", r"^\| (`.+?`) \|"),
}
every_section = pytest.mark.parametrize("section", CELLS)


def promised(section: str) -> list[str]:
    """The promises of a page, in its order."""
    page, pattern = CELLS[section]
    text = (ROOT / page).read_text(encoding="utf-8")
    cells = re.findall(pattern, text, re.MULTILINE)
    if section != "events":
        return cells
    kinds = [kind for cell in cells for kind in re.findall(r"`([a-z_.]+?)…?`", cell)]
    return [kind for kind in dict.fromkeys(kinds) if "." in kind]


@cache
def functions_in(file: str) -> dict[str, str]:
    """The source of each function of a file, decorators included."""
    lines = (ROOT / file).read_text(encoding="utf-8").splitlines()
    sources = {}
    for node in ast.walk(parsed(ROOT / file)):
        if isinstance(node, ast.FunctionDef):
            first = min([node.lineno, *(one.lineno for one in node.decorator_list)])
            sources[node.name] = "\n".join(lines[first - 1 : node.end_lineno])
    return sources


def names_kind(file: str, kind: str) -> bool:
    """Whether a file has this kind in its text: as it is, or its last word behind the others."""
    text = (ROOT / file).read_text(encoding="utf-8")
    begin, _, end = kind.rpartition(".")
    return kind in text or (f"{begin}." in text and f'"{end}"' in text)


@every_section
def test_every_promise_has_an_entry_and_every_entry_a_promise(section: str) -> None:
    assert len(promised(section)) > 5
    assert sorted(LEDGER[section]) == sorted(promised(section))


@every_section
def test_every_named_test_is_there(section: str) -> None:
    for promise, tests in LEDGER[section].items():
        assert tests, promise
        for test in tests:
            file, _, name = test.partition("::")
            assert name.partition("[")[0] in functions_in(file), f"{promise}: {test}"


def test_the_file_of_an_event_s_test_names_its_kind() -> None:
    unnamed = [
        f"{kind}: {test}"
        for kind, tests in LEDGER["events"].items()
        for test in tests
        if not names_kind(test.partition("::")[0], kind)
    ]
    assert unnamed == []


def test_a_test_of_an_exit_code_names_it() -> None:
    for code, tests in LEDGER["exit_codes"].items():
        for test in tests:
            file, _, name = test.partition("::")
            assert re.search(rf"\b{code}\b", functions_in(file)[name]), test
