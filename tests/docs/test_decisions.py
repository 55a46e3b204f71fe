"""The decision records: numbered without a gap, all of one form, and everything that cites one
finds it.
"""

from __future__ import annotations

import re
from pathlib import Path

from support.campaigns.each_row import each_row
from support.readers.repository import TEXTS
from support.readers.texts import ROOT

FOLDER = ROOT / "docs" / "decisions"
TEMPLATE, *RECORDS = sorted(FOLDER.glob("[0-9]*.md"))
LONGEST = 60
"""Lines: one page."""
INDEX = FOLDER / "index.md"
WITHDRAWN = [
    int(number)
    for number in re.findall(r"^- (\d+): \S", INDEX.read_text(encoding="utf-8"), re.MULTILINE)
]

FORM = re.compile(
    r"# (?P<number>\d+)\. (?P<title>[^\n]+)\n\n"
    r"Date: (?P<date>\d{4}-\d\d-\d\d)\n\n"
    r"Status: accepted\n\n"
    r"## Context\n\n(?P<context>\S.*?)\n\n## Decision\n\n(?P<decision>\S.*?)\n\n##"
    r" Consequences\n\n- (?P<consequences>\S.*)\n",
    re.DOTALL,
)
CITED = re.compile(
    r"docs/decisions/(\d{4})(?:-[a-z0-9-]+\.md)?|\bdecisions?(?: records?)? (\d{1,4})\b"
)
every_record = each_row((path.stem, (path,)) for path in RECORDS)


def form_of(path: Path) -> re.Match[str]:
    form = FORM.fullmatch(path.read_text(encoding="utf-8"))
    assert form, f"{path.name} does not have the form of {TEMPLATE.name}"
    return form


def test_the_numbers_have_no_gap() -> None:
    """A withdrawn record keeps its number, as a line of the index."""
    numbers = [int(path.name[:4]) for path in (TEMPLATE, *RECORDS)]
    assert sorted([*numbers, *WITHDRAWN]) == list(range(len(numbers) + len(WITHDRAWN)))
    assert sorted(WITHDRAWN) == WITHDRAWN
    assert TEMPLATE.name == "0000-template.md"


@every_record
def test_a_record_has_the_templates_form(record: Path) -> None:
    form = form_of(record)
    assert int(form["number"]) == int(record.name[:4])
    assert re.fullmatch(r"\d{4}(?:-[a-z0-9]+)+\.md", record.name)
    assert len(record.read_text(encoding="utf-8").splitlines()) <= LONGEST
    headings = re.findall(r"^## .*$", TEMPLATE.read_text(encoding="utf-8"), re.MULTILINE)
    assert re.findall(r"^## .*$", record.read_text(encoding="utf-8"), re.MULTILINE) == headings


@every_record
def test_the_files_that_a_record_names_exist(record: Path) -> None:
    named = re.findall(
        r"`((?:jbclog|tests|docs|\.ci)/[\w./-]+)`", record.read_text(encoding="utf-8")
    )
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_every_citation_of_a_record_finds_it() -> None:
    numbers = {int(path.name[:4]) for path in RECORDS}
    for name in TEXTS:
        for cited in CITED.finditer((ROOT / name).read_text(encoding="utf-8")):
            assert int(cited[1] or cited[2]) in numbers or cited[1] == "0000", (
                f"{name} cites {cited[0]}"
            )
            if cited[0].endswith(".md"):
                assert (ROOT / cited[0]).exists(), f"{name} cites {cited[0]}"
