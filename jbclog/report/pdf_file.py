"""Drawings as a PDF file, a page each, by fpdf2, with the letters that are used inside.

Text can be searched and copied. There is no time of making, no random name and no machine in it: with the same fpdf2 and matplotlib
the same drawings give the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Final

from fpdf import FPDF
from fpdf.enums import StrokeCapStyle, StrokeJoinStyle

from jbclog.report.drawing import Drawing, Mark, Shape, Stroke, Words
from jbclog.report.text_metrics import drawable, face

FAMILY: Final = "report"
STYLES: Final = {False: "", True: "B"}
BEFORE: Final = {"left": 0.0, "middle": 0.5, "right": 1.0}  # of a text's width, left of its place


def pdf_file(pages: Sequence[Drawing], title: str, dated: datetime) -> bytes:
    """The pages as a file that bears a date, as fpdf2 writes none without."""
    file = FPDF(unit="pt")
    file.set_title(title)
    file.set_lang("en")
    file.set_creator("jbclog")
    file.set_creation_date(dated)
    file.alias_nb_pages("")  # a text that holds "{nb}" keeps it
    for bold, style in STYLES.items():
        file.add_font(FAMILY, style, face(bold).path)
    for page in pages:
        _page(file, page)
    return bytes(file.output())


def _page(file: FPDF, page: Drawing) -> None:
    file.add_page(format=(page.width, page.height))
    with file.local_context(stroke_cap_style=StrokeCapStyle.BUTT, stroke_join_style=StrokeJoinStyle.ROUND):
        for mark in page.marks:
            _mark(file, mark)


def _mark(file: FPDF, mark: Mark) -> None:
    if isinstance(mark, Words):
        _words(file, mark)
    else:
        _shape(file, mark)


def _words(file: FPDF, mark: Words) -> None:
    text = drawable(mark.text, bold=mark.bold)
    before = BEFORE[mark.align] * face(mark.bold).width(text) * mark.points
    file.set_font(FAMILY, STYLES[mark.bold], mark.points)
    file.set_text_color(mark.colour)
    file.text(mark.x - before, mark.y, text)


def _shape(file: FPDF, mark: Shape) -> None:
    if mark.fill is not None:
        file.set_fill_color(mark.fill)
    if mark.stroke is not None:
        file.set_draw_color(mark.stroke.colour)
        file.set_line_width(mark.stroke.points)
    how = "D" if mark.fill is None else "F" if mark.stroke is None else "DF"
    for dash, gap, phase in _dashes(mark.stroke):
        file.set_dash_pattern(dash, gap, phase)
        for part in mark.parts:
            file.polyline(part.tolist(), polygon=mark.fill is not None, style=how)


def _dashes(stroke: Stroke | None) -> Iterator[tuple[float, float, float]]:
    """Dash, gap and phase of each time that it is drawn: fpdf2 knows one dash, so a dash and a dot are drawn after each other."""
    dashes = stroke.dashes if stroke is not None else ()
    if not dashes:
        yield 0, 0, 0
    for number in range(0, len(dashes), 2):
        yield dashes[number], sum(dashes) - dashes[number], (sum(dashes) - sum(dashes[:number])) % sum(dashes)
