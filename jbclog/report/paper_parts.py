"""Parts of a section of `report.pdf`, as `templates/report.typ` takes them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from jbclog.core.text import together
from jbclog.report.facts import FigureFacts

Part = dict[str, object]
T = TypeVar("T")


def section(title: str, *parts: Part) -> Part:
    return {"title": title, "parts": list(parts)}


def paragraph(text: str, look: str = "") -> Part:
    return {"kind": "text", "text": together(text), "look": look}


def bullets(items: Sequence[str]) -> Part:
    return {"kind": "list", "items": [together(item) for item in items]}


def drawing(figure: FigureFacts, heading: str | None = None) -> Part:
    """Return a figure. `heading`: that of the first figure of a port, empty for its others, None
    for a figure of the whole run.
    """
    return {
        "kind": "figure",
        "file": figure.file,
        "caption": figure.caption,
        "alt": figure.alt,
        "heading": heading,
    }


def cells(words: Sequence[str], look: str = "") -> Part:
    """Return the cells of a row; `look` names a colour of the template, such as the result of a
    rule.
    """
    return {
        "look": look,
        "cells": [together(word).replace(" port ", " port\u00a0") for word in words],
    }


@dataclass(frozen=True, slots=True)
class Table(Generic[T]):
    """A table: its heads, of which ">" aligns a column right; the conversion of a fact to a row;
    and the file with the facts after the first `most`. Without such a file it has them all.
    """

    heads: Sequence[str]
    row: Callable[[T], Part]
    file: str = ""
    most: int = 120

    def of(self, facts: Iterable[T]) -> Part:
        """Return the table of all these facts."""
        columns = [
            {"title": title.removeprefix(">"), "right": title.startswith(">")}
            for title in self.heads
        ]
        return {"kind": "table", "columns": columns, "rows": [self.row(one) for one in facts]}

    def first(self, facts: Sequence[T]) -> list[Part]:
        """Return the table of the first facts, and where the others are; nothing without facts."""
        if not facts:
            return []
        shown = facts[: self.most] if self.file else facts
        left = len(facts) - len(shown)
        more = [paragraph(f"{left} more are in {self.file}.", "quiet")] if left else []
        return [self.of(shown), *more]
