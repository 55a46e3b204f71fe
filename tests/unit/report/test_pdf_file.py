"""A drawing as PDF and as SVG: a file that readers open, text that can be searched, and nothing that acts."""

from __future__ import annotations

import io
import re
import zlib
from datetime import UTC, datetime
from xml.etree import ElementTree

import numpy as np
import pytest
from fontTools.ttLib import TTFont

from jbclog.report.drawing import Drawing, Stroke
from jbclog.report.pdf_file import pdf_file
from jbclog.report.svg import svg_text
from jbclog.report.text_metrics import LACKING, face

ENDED = datetime(2026, 9, 21, 14, 17, 22, tzinfo=UTC)


def drawn(text: str = "Tip 350 °C ✓") -> Drawing:
    one = Drawing(200, 100)
    one.line([10, 50, float("nan"), 60, 90], [10, 20, 0, 30, 40], Stroke("#0b4f8a", 0.9, (1.0, 2.0)))
    one.area([10, 20, 30], [50, 50, 50], [40, 30, 45], "#efc98a")
    one.hatched(100, 10, 40, 20, "xxx", Stroke("#8d99a6", 0.6))
    one.words(10, 90, text, 8, "#1c2733", bold=True)
    return one


def made(*drawings: Drawing, title: str = "title") -> bytes:
    return pdf_file(drawings or [drawn()], title, ENDED)


def objects(data: bytes) -> dict[int, bytes]:
    """The objects where the file's own table says that they are."""
    start = int(data.rsplit(b"startxref", 1)[1].split()[0])
    assert data[start:].startswith(b"xref")
    places = [int(line[:10]) for line in data[start:].splitlines()[3:] if line.endswith(b" n ")]
    found = {number: data[place:].split(b"endobj", 1)[0] for number, place in enumerate(places, 1)}
    assert all(body.startswith(b"%d 0 obj" % number) for number, body in found.items())
    return found


def streams(data: bytes) -> list[bytes]:
    """What they hold, unpacked where it is packed."""
    found = []
    for body in objects(data).values():
        if b"stream\n" in body:
            head, _, rest = body.partition(b"stream\n")
            packed = rest[: int(re.findall(rb"/Length (\d+)", head)[0])]
            assert rest[len(packed) :].split() == [b"endstream"]
            found.append(zlib.decompress(packed) if b"/FlateDecode" in head else packed)
    return found


def letters_of(shown: bytes) -> list[int]:
    """The numbers in the brackets of a text operator (ISO 32000-1, 7.3.4.2)."""
    bare = re.sub(rb"\\(.)", lambda found: {b"r": b"\r"}.get(found[1], found[1]), shown, flags=re.S)
    return [int.from_bytes(bare[i : i + 2]) for i in range(0, len(bare), 2)]


def texts_of(data: bytes) -> list[str]:
    """What a search in the first page would find, by each font's own table."""
    content, *rest = streams(data)
    tables = [dict(re.findall(rb"<(\w{4})> <(\w+)>\n", one)) for one in rest if b"beginbfchar" in one]
    found = re.findall(rb"/F(\d) [\d.]+ Tf|\(((?:[^\\)]|\\.)*)\) Tj", content, re.S)
    texts, font = [], 0
    for named, shown in found:
        font = int(named) - 1 if named else font
        if not named:
            codes = [tables[font][b"%04X" % number] for number in letters_of(shown)]
            texts.append("".join(bytes.fromhex(code.decode()).decode("utf-16-be") for code in codes))
    return texts


def test_every_object_is_where_the_table_says() -> None:
    data = made(drawn(), drawn("two"), title="a title ✓")
    bodies = objects(data)
    pages = [number for number, body in bodies.items() if re.search(rb"/Type /Page\b", body)]
    (tree,) = (body for body in bodies.values() if b"/Type /Pages" in body)
    assert re.findall(rb"(\d+) 0 R", tree) == [b"%d" % number for number in pages]
    assert all(int(number) in bodies for body in bodies.values() for number in re.findall(rb"(\d+) 0 R", body))
    assert ("\ufeffa title ✓".encode("utf-16-be").hex()).encode() in data.lower()
    assert b"/Lang (en)" in data


def test_a_page_has_the_drawing_s_size_whichever_side_is_longer() -> None:
    boxes = re.findall(rb"/MediaBox \[([^]]+)]", made(drawn(), Drawing(100, 300)))
    assert {tuple(map(float, box.split())) for box in boxes} >= {(0, 0, 200, 100), (0, 0, 100, 300)}


@pytest.mark.parametrize("text", ["Tip 350 °C ✓", "a (b) \\ c", "{nb} of {nb}", "".join(map(chr, range(0x391, 0x3A0)))])
def test_text_can_be_searched(text: str) -> None:
    one = drawn(text)
    one.words(10, 20, f"{text}!", 8, "#1c2733")
    assert texts_of(made(one)) == [text, f"{text}!"]


def test_letters_are_drawn_with_their_own_outlines() -> None:
    (program, *_) = [one for one in streams(made(drawn("Tip"))) if one.startswith(b"\x00\x01\x00\x00")][1:]
    font, whole = TTFont(io.BytesIO(program)), TTFont(face(True).path)
    for letter in "Tip":
        kept = whole.getBestCmap()[ord(letter)]
        assert font["glyf"][kept].getCoordinates(font["glyf"])[0] == whole["glyf"][kept].getCoordinates(whole["glyf"])[0]
        assert font["hmtx"][kept] == whole["hmtx"][kept]


def test_a_line_is_broken_where_nothing_is_known() -> None:
    (path, *_) = ElementTree.fromstring(svg_text(drawn())).findall("{*}path")
    assert path.attrib["d"] == "M10 10 50 20M60 30 90 40"
    steps = streams(made())[0].split()
    assert b"10.00 90.00 m 50.00 80.00 l S 60.00 70.00 m 90.00 60.00 l S" in b" ".join(steps)


def test_dashes_of_two_lengths_are_drawn_in_turn() -> None:
    one = Drawing(100, 100)
    one.line([0, 100], [50, 50], Stroke("#0b4f8a", 0.9, (4.4, 1.7, 1.1, 1.7)))
    told = re.findall(rb"\[([\d.]+) ([\d.]+)] ([\d.]+) d", streams(made(one))[0])
    inked = [
        place
        for place in np.arange(0.05, 50, 0.1)
        if any((place + float(c)) % (float(a) + float(b)) < float(a) for a, b, c in told)
    ]
    wanted = [place for place in np.arange(0.05, 50, 0.1) if place % 8.9 < 4.4 or 6.1 < place % 8.9 < 7.2]
    assert inked == pytest.approx(wanted)


def test_a_line_after_a_dashed_one_is_whole_again() -> None:
    one = drawn()
    one.line([0, 100], [50, 50], Stroke("#0b4f8a", 0.9))
    assert b"[] 0 d" in streams(made(one))[0].split(b"[1.000 2.000]")[1]


def test_the_file_bears_the_date_that_it_is_given_and_the_same_drawings_give_the_same_bytes() -> None:
    assert b"/CreationDate (D:20260921141722Z)" in made()
    assert made() == made()


@pytest.mark.parametrize("text", ["</text><script>alert(1)</script>", ") Tj (", "&<>\"'", "\x00\x1b"])
def test_no_text_becomes_anything_else(text: str) -> None:
    written = svg_text(drawn(text.strip("\x00\x1b") or "-"))
    assert [one.tag.rpartition("}")[2] for one in ElementTree.fromstring(written)] == ["rect", "path", "path", "path", "text"]
    data = made(drawn(text), title=text)
    assert not re.search(rb"/(JavaScript|Launch|URI|EmbeddedFile)", data)
    assert texts_of(data) == [re.sub("[\x00\x1b]", LACKING, text)]


@pytest.mark.parametrize("pattern", ["xxx", "///", "---", "+++", "..."])
def test_hatching_stays_within_its_rectangle(pattern: str) -> None:
    one = Drawing(100, 100)
    one.hatched(10, 20, 30, 15, pattern, Stroke("#8d99a6", 0.6))
    points = [point for mark in one.marks for part in mark.parts for point in part.tolist()]  # type: ignore[union-attr]
    assert len(points) > 6
    assert all(10 - 1e-9 <= x <= 40 + 1e-9 and 20 - 1e-9 <= y <= 35 + 1e-9 for x, y in points)
