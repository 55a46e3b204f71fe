"""README.md in pieces: its fenced blocks, links, headings and tables."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")

_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PROSE = _FENCE.sub("", README)


def blocks(language: str) -> list[str]:
    """The fenced blocks of a language, in order."""
    return [text for name, text in _FENCE.findall(README) if name == language]


def section(heading: str) -> str:
    """What stands below a heading of the second rank."""
    found = re.search(rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", README, re.DOTALL | re.MULTILINE)
    assert found, f"README has no section {heading}"
    return found[1]


def rows(heading: str) -> list[list[str]]:
    """The rows of the table below a heading, without its head, as cells."""
    lines = [line for line in section(heading).splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def commands() -> list[str]:
    """What a reader could type: the shell blocks, and every piece of code in the prose."""
    return [*blocks("sh"), *re.findall(r"`([^`\n]+)`", PROSE)]


def links() -> list[str]:
    """Where the links and pictures of the prose lead."""
    return re.findall(r"(?:\]\(|<img src=\")([^)\"\s]+)", PROSE)


def headings() -> set[str]:
    """The anchors of all headings, as GitHub makes them."""
    titles = re.findall(r"^#+ (.+)$", PROSE, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
