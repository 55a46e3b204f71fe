"""The threat model names tests that there are, and is linked from where people look."""

from __future__ import annotations

import re

import pytest

from support.readers.texts import ROOT

PAGE = (ROOT / "docs" / "explanation" / "threat-model.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`([\w/]+/test_\w+\.py)`", PAGE)))


@pytest.mark.parametrize("name", NAMED)
def test_a_test_that_it_names_is_there(name: str) -> None:
    assert (ROOT / "tests" / name).is_file()


def test_each_row_has_a_mitigation_with_a_test_or_says_what_remains() -> None:
    rows = [
        line.strip("|").split("|")
        for line in PAGE.splitlines()
        if line.startswith("|") and not line.startswith("|---")
    ]
    threats = [
        [cell.strip() for cell in row]
        for row in rows
        if len(row) == 3 and row[1].strip() != "mitigation"
    ]
    assert len(threats) > 30
    assert [row[0] for row in threats if not (re.search(r"test_\w+\.py", row[1]) or row[2])] == []


@pytest.mark.parametrize(
    "page", ["SECURITY.md", "docs/explanation/threat-model.md", "docs/how-to/releasing.md"]
)
def test_its_links_lead_somewhere(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)#\s]+)", text):
        assert (ROOT / page).parent.joinpath(link).exists(), link


def test_the_threshold_of_the_unit_is_the_one_that_the_page_states() -> None:
    from support.readers.unit_file import MOST_EXPOSED

    assert f"at most {MOST_EXPOSED / 10:.1f} by a test" in PAGE
