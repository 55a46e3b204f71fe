"""A drawing as SVG: lines broken where nothing is known, and no text that becomes anything else."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest

from jbclog.report.drawing import Drawing, Stroke
from jbclog.report.svg import svg_text


def drawn(text: str = "Tip 350 °C ✓") -> Drawing:
    one = Drawing(200, 100)
    one.line([10, 50, float("nan"), 60, 90], [10, 20, 0, 30, 40], Stroke("#0b4f8a", 0.9, (1.0, 2.0)))
    one.area([10, 20, 30], [50, 50, 50], [40, 30, 45], "#efc98a")
    one.hatched(100, 10, 40, 20, "xxx", Stroke("#8d99a6", 0.6))
    one.words(10, 90, text, 8, "#1c2733", bold=True)
    return one


def test_a_line_is_broken_where_nothing_is_known() -> None:
    (path, *_) = ElementTree.fromstring(svg_text(drawn())).findall("{*}path")
    assert path.attrib["d"] == "M10 10 50 20M60 30 90 40"


@pytest.mark.parametrize("text", ["</text><script>alert(1)</script>", ") Tj (", "&<>\"'"])
def test_no_text_becomes_anything_else(text: str) -> None:
    (*shapes, words) = ElementTree.fromstring(svg_text(drawn(text)))
    assert [one.tag.rpartition("}")[2] for one in (*shapes, words)] == ["rect", "path", "path", "path", "text"]
    assert words.text == text


@pytest.mark.parametrize("pattern", ["xxx", "///", "---", "+++", "..."])
def test_hatching_stays_within_its_rectangle(pattern: str) -> None:
    one = Drawing(100, 100)
    one.hatched(10, 20, 30, 15, pattern, Stroke("#8d99a6", 0.6))
    points = [point for mark in one.marks for part in mark.parts for point in part.tolist()]  # type: ignore[union-attr]
    assert len(points) > 6
    assert all(10 - 1e-9 <= x <= 40 + 1e-9 and 20 - 1e-9 <= y <= 35 + 1e-9 for x, y in points)
