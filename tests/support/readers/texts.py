"""README.md and the pages below docs/ in pieces: fenced blocks, links, headings and tables."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"
README = (ROOT / "README.md").read_text(encoding="utf-8")

FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PROSE = FENCE.sub("", README)


def text_of(name: str) -> str:
    """The text of a page below docs/."""
    return (DOCS / name).read_text(encoding="utf-8")


def blocks(language: str, text: str = README) -> list[str]:
    """The fenced blocks of a language, in order."""
    return [block for name, block in FENCE.findall(text) if name.split()[:1] == [language]]


def section(heading: str, text: str = README) -> str:
    """What stands below a heading of the second rank."""
    found = re.search(
        rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", text, re.DOTALL | re.MULTILINE
    )
    assert found, f"there is no section {heading}"
    return found[1]


def rows(text: str) -> list[list[str]]:
    """The rows of the only table in a text, without its head, as cells."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def commands() -> list[str]:
    """What a reader of README could type: shell blocks, and every piece of code in the prose."""
    return [*blocks("sh"), *re.findall(r"`([^`\n]+)`", PROSE)]


def links() -> list[str]:
    """Where the links and pictures of README lead."""
    return re.findall(r"(?:\]\(|<img src=\")([^)\"\s]+)", PROSE)


class Demo(NamedTuple):
    """A demo that was run: where it was started, what it said, and the run's folder."""

    place: Path
    said: str
    run: Path
