"""A drawing as PDF and as SVG: a file that readers open, text that can be searched, and nothing that acts."""

from __future__ import annotations

import io
import re
import zlib
from xml.etree import ElementTree

import pytest
from fontTools.ttLib import TTFont

from jbclog.report.drawing import Drawing, Stroke
from jbclog.report.letters import face
from jbclog.report.pdf_file import pdf_file
from jbclog.report.svg import svg_text


def drawn(text: str = "Tip 350 °C ✓") -> Drawing:
    one = Drawing(200, 100)
    one.line([10, 50, float("nan"), 60, 90], [10, 20, 0, 30, 40], Stroke("#0b4f8a", 0.9, (1.0, 2.0)))
    one.area([10, 20, 30], [50, 50, 50], [40, 30, 45], "#efc98a")
    one.hatched(100, 10, 40, 20, "xxx", Stroke("#8d99a6", 0.6))
    one.words(10, 90, text, 8, "#1c2733", bold=True)
    return one


def objects(data: bytes) -> dict[int, bytes]:
    """The objects where the file's own table says that they are."""
    start = int(data.rsplit(b"startxref", 1)[1].split()[0])
    assert data[start:].startswith(b"xref")
    places = [int(line[:10]) for line in data[start:].splitlines()[3:] if line.endswith(b" n ")]
    found = {number: data[place:].split(b"endobj", 1)[0] for number, place in enumerate(places, 1)}
    assert all(body.startswith(b"%d 0 obj" % number) for number, body in found.items())
    return found


def streams(data: bytes) -> list[bytes]:
    bodies = re.findall(rb"/Length (\d+)[^>]*>>\nstream\n", data)
    parts = re.findall(rb"stream\n(.*?)\nendstream", data, re.S)
    assert [len(part) for part in parts] == [int(length) for length in bodies]
    return [zlib.decompress(part) for part in parts]


def test_every_object_is_where_the_table_says() -> None:
    data = pdf_file([drawn(), drawn("two")], "a title ✓")
    bodies = objects(data)
    pages = [number for number, body in bodies.items() if b"/Type /Page\n" in body]
    (tree,) = (body for body in bodies.values() if b"/Type /Pages" in body)
    assert re.findall(rb"(\d+) 0 R", tree) == [b"%d" % number for number in pages]
    assert all(int(number) in bodies for body in bodies.values() for number in re.findall(rb"(\d+) 0 R", body))
    assert "a title ✓".encode("utf-16-be").hex().upper().encode() in data


def test_text_can_be_searched_and_is_drawn_with_its_own_glyphs() -> None:
    content, *rest = streams(pdf_file([drawn()], "title"))
    glyphs = re.findall(rb"<([0-9A-F]+)> Tj", content)[0]
    numbers = [int(glyphs[i : i + 4], 16) for i in range(0, len(glyphs), 4)]
    (table,) = (one for one in rest if b"beginbfchar" in one)
    letters = {int(a, 16): bytes.fromhex(b.decode()).decode("utf-16-be") for a, b in re.findall(rb"<(\w{4})> <(\w+)>\n", table)}
    assert "".join(letters[number] for number in numbers) == "Tip 350 °C ✓"
    font = TTFont(io.BytesIO(next(one for one in rest if one.startswith(b"\x00\x01\x00\x00"))))
    outlines = [font["glyf"][font.getGlyphName(number)] for number in numbers if letters[number] != " "]
    assert all(outline.numberOfContours for outline in outlines)
    assert font["hmtx"][font.getGlyphName(numbers[0])][0] == round(face(True).advance("T") * face(True).units / 1000)


def test_a_line_is_broken_where_nothing_is_known() -> None:
    (path, *_) = ElementTree.fromstring(svg_text(drawn())).findall("{*}path")
    assert path.attrib["d"] == "M10 10 50 20M60 30 90 40"
    content = streams(pdf_file([drawn()], "title"))[0]
    assert b"10.00 90.00 m 50.00 80.00 l\n60.00 70.00 m 90.00 60.00 l\nS" in content


@pytest.mark.parametrize("text", ["</text><script>alert(1)</script>", ") Tj (", "&<>\"'", "\x00\x1b"])
def test_no_text_becomes_anything_else(text: str) -> None:
    written = svg_text(drawn(text.strip("\x00\x1b") or "-"))
    assert [one.tag.rpartition("}")[2] for one in ElementTree.fromstring(written)] == ["rect", "path", "path", "path", "text"]
    objects(pdf_file([drawn(text)], text))


@pytest.mark.parametrize("pattern", ["xxx", "///", "---", "+++", "..."])
def test_hatching_stays_within_its_rectangle(pattern: str) -> None:
    one = Drawing(100, 100)
    one.hatched(10, 20, 30, 15, pattern, Stroke("#8d99a6", 0.6))
    points = [point for mark in one.marks for part in mark.parts for point in part.tolist()]  # type: ignore[union-attr]
    assert len(points) > 6
    assert all(10 - 1e-9 <= x <= 40 + 1e-9 and 20 - 1e-9 <= y <= 35 + 1e-9 for x, y in points)
