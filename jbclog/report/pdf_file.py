"""Drawings as a PDF file, a page each: what ISO 32000-1 asks for and no more, with the letters that are used inside.

Text is set in our font by the numbers of its glyphs and can be searched and copied (`ToUnicode`). There is no time, no random name
and no machine in it: the same drawings give the same bytes.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from jbclog.report.drawing import Drawing, Floats, Mark, Shape, Stroke, Words
from jbclog.report.letters import drawable, face, font_program

COMPRESSION: Final = 6
FONT_NAMES: Final = {False: "F1", True: "F2"}
BASE_NAMES: Final = {False: "JBCLOG+DejaVuSans", True: "JBCLOG+DejaVuSans-Bold"}
MAPPED_AT_ONCE: Final = 100  # lines of a bfchar block (Adobe 5411)


@dataclass(slots=True)
class _File:
    """Objects by their number, from 1, and the letters of each weight that were used."""

    objects: list[bytes] = field(default_factory=list)
    used: dict[bool, set[str]] = field(default_factory=lambda: {False: set(), True: set()})

    def put(self, body: bytes | str) -> int:
        """Keep an object; give its number."""
        self.objects.append(body.encode("latin-1") if isinstance(body, str) else body)
        return len(self.objects)

    def stream(self, data: bytes, said: str = "") -> int:
        packed = zlib.compress(data, COMPRESSION)
        head = f"<< /Length {len(packed)} /Filter /FlateDecode {said}>>\nstream\n"
        return self.put(head.encode("latin-1") + packed + b"\nendstream")

    def written(self, root: int, info: int) -> bytes:
        """The whole file with the table of its objects."""
        out, places = bytearray(b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n"), []
        for number, body in enumerate(self.objects, 1):
            places.append(len(out))
            out += b"%d 0 obj\n" % number + body + b"\nendobj\n"
        table = len(out)
        out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(places) + 1)
        out += b"".join(b"%010d 00000 n \n" % place for place in places)
        out += b"trailer\n<< /Size %d /Root %d 0 R /Info %d 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(places) + 1, root, info, table)
        return bytes(out)


def pdf_file(pages: Sequence[Drawing], title: str) -> bytes:
    """The pages as a file."""
    file = _File()
    contents = [file.stream(_content(page, file.used)) for page in pages]
    fonts = {bold: _font(file, bold, letters) for bold, letters in file.used.items() if letters}
    resources = file.put(f"<< /Font << {' '.join(f'/{FONT_NAMES[bold]} {number} 0 R' for bold, number in fonts.items())} >> >>")
    tree = len(file.objects) + len(pages) + 1
    numbers = [
        file.put(
            f"<< /Type /Page\n/Parent {tree} 0 R /MediaBox [0 0 {page.width:.2f} {page.height:.2f}] "
            f"/Resources {resources} 0 R /Contents {content} 0 R >>"
        )
        for page, content in zip(pages, contents, strict=True)
    ]
    file.put(f"<< /Type /Pages /Kids [{' '.join(f'{number} 0 R' for number in numbers)}] /Count {len(pages)} >>")
    root = file.put(f"<< /Type /Catalog /Pages {tree} 0 R /Lang (en) >>")
    return file.written(root, file.put(f"<< /Title <{_utf16(title)}> /Creator (jbclog) >>"))


def _utf16(text: str) -> str:
    return "FEFF" + text.encode("utf-16-be").hex().upper()


# -- what a page shows ------------------------------------------------------------------------------------------------------


def _content(page: Drawing, used: Mapping[bool, set[str]]) -> bytes:
    marks = (_mark(mark, page.height, used) for mark in page.marks)
    return "\n".join(["1 j", *marks]).encode("ascii")


def _mark(mark: Mark, height: float, used: Mapping[bool, set[str]]) -> str:
    return _words(mark, height, used) if isinstance(mark, Words) else _shape(mark, height)


def _words(mark: Words, height: float, used: Mapping[bool, set[str]]) -> str:
    one, text = face(mark.bold), drawable(mark.text, bold=mark.bold)
    used[mark.bold].update(text)
    before = {"left": 0.0, "middle": 0.5, "right": 1.0}[mark.align] * one.width(text) * mark.points
    glyphs = "".join(f"{one.glyph(letter):04X}" for letter in text)
    size = f"/{FONT_NAMES[mark.bold]} {mark.points:.2f} Tf {mark.x - before:.2f} {height - mark.y:.2f} Td"
    return f"BT {_colour(mark.colour)} rg {size} <{glyphs}> Tj ET"


def _shape(mark: Shape, height: float) -> str:
    closed = mark.fill is not None
    paint = ("B" if mark.stroke else "f") if closed else "S"
    path = "\n".join(_path(part, height, closed) for part in mark.parts)
    return "\n".join([*_look(mark.fill, mark.stroke), path, paint])


def _look(fill: str | None, stroke: Stroke | None) -> Iterable[str]:
    if fill is not None:
        yield f"{_colour(fill)} rg"
    if stroke is not None:
        yield f"{_colour(stroke.colour)} RG {stroke.points:.2f} w [{' '.join(f'{one:.2f}' for one in stroke.dashes)}] 0 d"


def _path(part: Floats, height: float, closed: bool) -> str:
    rows = [f"{x:.2f} {height - y:.2f}" for x, y in part.tolist()]
    return f"{rows[0]} m {' l '.join(rows[1:])} l{' h' if closed else ''}"


def _colour(colour: str) -> str:
    return " ".join(f"{int(colour[i : i + 2], 16) / 255:.3f}" for i in (1, 3, 5))


# -- the letters ------------------------------------------------------------------------------------------------------------


def _font(file: _File, bold: bool, letters: set[str]) -> int:
    """A composite font of the glyphs in use, by their own numbers (ISO 32000-1, 9.7)."""
    one, name = face(bold), BASE_NAMES[bold]
    packed = font_program(bold, frozenset(letters))
    program = file.stream(packed, f"/Length1 {len(packed)} ")
    box = " ".join(str(one.scaled(edge)) for edge in one.box)
    descriptor = file.put(
        f"<< /Type /FontDescriptor /FontName /{name} /Flags 32 /FontBBox [{box}] /ItalicAngle 0 /Ascent {one.scaled(one.ascent)} "
        f"/Descent {one.scaled(one.descent)} /CapHeight 729 /StemV {140 if bold else 80} /FontFile2 {program} 0 R >>"
    )
    glyphs = {one.glyph(letter): letter for letter in sorted(letters)}
    widths = " ".join(f"{glyph} [{one.advance(letter):.1f}]" for glyph, letter in sorted(glyphs.items()))
    within = file.put(
        f"<< /Type /Font /Subtype /CIDFontType2 /BaseFont /{name} /CIDSystemInfo << /Registry (Adobe) /Ordering (Identity) "
        f"/Supplement 0 >> /FontDescriptor {descriptor} 0 R /CIDToGIDMap /Identity /W [{widths}] >>"
    )
    unicode = file.stream(_to_unicode(glyphs).encode("ascii"))
    return file.put(
        f"<< /Type /Font /Subtype /Type0 /BaseFont /{name} /Encoding /Identity-H /DescendantFonts [{within} 0 R] "
        f"/ToUnicode {unicode} 0 R >>"
    )


def _to_unicode(glyphs: Mapping[int, str]) -> str:
    """Which letter a glyph stands for, so that text can be searched and copied."""
    lines = [f"<{glyph:04X}> <{letter.encode('utf-16-be').hex().upper()}>" for glyph, letter in sorted(glyphs.items())]
    blocks = [lines[i : i + MAPPED_AT_ONCE] for i in range(0, len(lines), MAPPED_AT_ONCE)]
    told = "\n".join(f"{len(block)} beginbfchar\n{chr(10).join(block)}\nendbfchar" for block in blocks)
    return (
        "/CIDInit /ProcSet findresource begin\n12 dict begin\nbegincmap\n"
        "/CIDSystemInfo << /Registry (Adobe) /Ordering (UCS) /Supplement 0 >> def\n/CMapName /Adobe-Identity-UCS def\n"
        "/CMapType 2 def\n1 begincodespacerange\n<0000> <FFFF>\nendcodespacerange\n"
        f"{told}\nendcmap\nCMapName currentdict /CMap defineresource pop\nend\nend"
    )
