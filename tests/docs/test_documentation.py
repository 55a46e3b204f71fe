"""The pages below docs/: all are in the navigation, their links lead somewhere, their commands
exist, and what they repeat of the code is what it says. `.ci/docs` builds the site, strictly."""

from __future__ import annotations

import re
from pathlib import Path

from support.campaigns.each_row import each_row
from support.product import PACKAGE, false_alarms
from support.readers.command_line import calls, wrong
from support.readers.texts import DOCS, FENCE, ROOT, text_of

TESTS = ROOT / "tests"
PAGES = sorted(DOCS.rglob("*.md"))
every_page = each_row((page.relative_to(DOCS).as_posix(), (page,)) for page in PAGES)


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub and MyST make them."""
    titles = re.findall(r"^#+ (.+)$", FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {
        re.sub(r"[^\w\- ]", "", re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", title).lower()).replace(
            " ", "-"
        )
        for title in titles
    }


def in_navigation(page: Path) -> set[Path]:
    """The pages that the navigation of a page leads to, and those that it leads to from there."""
    found: set[Path] = set()
    for name, block in FENCE.findall(page.read_text(encoding="utf-8")):
        if name == "{toctree}":
            for entry in block.partition("\n\n")[2].split():
                found |= set(page.parent.glob(f"{entry}.md"))
    return found.union(*(in_navigation(one) for one in found - {page}))


def test_every_page_is_in_the_navigation() -> None:
    assert set(PAGES) - in_navigation(DOCS / "index.md") == {DOCS / "index.md"}


@every_page
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\"\s]+)", FENCE.sub("", page.read_text(encoding="utf-8"))):
        if "://" not in link:
            path, _, anchor = link.partition("#")
            target = page.parent / path if path else page
            assert target.exists(), link
            assert not anchor or anchor in anchors(target), link


@every_page
def test_commands_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    typed = [block for language, block in FENCE.findall(text) if language.split()[:1] == ["sh"]]
    typed += re.findall(r"`([^`\n]+)`", FENCE.sub("", text))
    assert [fault for one in typed for words in calls(one) if (fault := wrong(words))] == []


@each_row(
    (name, (name,))
    for name in re.findall(r"`((?:\w+/)+\w+\.py)`", text_of("explanation/architecture.md"))
)
def test_a_file_that_the_architecture_names_is_there(name: str) -> None:
    assert (PACKAGE / name).is_file()


def test_every_campaign_has_its_row() -> None:
    named = set(re.findall(r"`([\w/]+/test_\w+\.py)`", text_of("reference/campaigns.md")))
    files = (
        path.relative_to(TESTS)
        for path in TESTS.rglob("test_*.py")
        if "docs" not in path.parts and has_campaign(path)
    )
    assert named == {path.as_posix() for path in files}


def has_campaign(path: Path) -> bool:
    """By its mark, or because it runs a slice of its trials by default."""
    text = path.read_text(encoding="utf-8")
    return any(
        sign in text for sign in ("pytest.mark.campaign", "pytest.mark.soak", "slices import")
    )


def test_the_false_alarms_are_those_that_charts_state() -> None:
    for all_tests, row in (
        (False, "1, 2, 3, 5 (default)"),
        (True, "all eight (`--all-tests`)"),
    ):
        figures = false_alarms(all_tests=all_tests)
        cells = f"| {row} | {figures[0]:g} | {figures[1]:g} points | {100 * figures[2]:.0f} % |"
        assert cells in text_of("explanation/capability.md")
