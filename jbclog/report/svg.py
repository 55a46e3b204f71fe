"""A drawing as an SVG document: text stays text, numbers are to a hundredth of a point, and nothing can run in it."""

from __future__ import annotations

from html import escape
from typing import Final

from jbclog.report.drawing import Drawing, Floats, Mark, Shape, Stroke, Words

FONTS: Final = "'DejaVu Sans',Verdana,'Bitstream Vera Sans',Roboto,Arial,sans-serif"
ANCHORS: Final = {"left": "", "middle": ' text-anchor="middle"', "right": ' text-anchor="end"'}


def svg_text(drawing: Drawing) -> str:
    """The document. The same drawing gives the same text."""
    size = f'width="{_n(drawing.width)}pt" height="{_n(drawing.height)}pt" viewBox="0 0 {_n(drawing.width)} {_n(drawing.height)}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="{FONTS}" fill="none" stroke-linejoin="round">'
    ground = f'<rect width="{_n(drawing.width)}" height="{_n(drawing.height)}" fill="#fff"/>'
    return "\n".join([head, ground, *map(_mark, drawing.marks), "</svg>\n"])


def _mark(mark: Mark) -> str:
    return _words(mark) if isinstance(mark, Words) else _shape(mark)


def _words(mark: Words) -> str:
    weight = ' font-weight="bold"' if mark.bold else ""
    place = f'x="{_n(mark.x)}" y="{_n(mark.y)}" font-size="{_n(mark.points)}" fill="{mark.colour}"'
    return f"<text {place}{weight}{ANCHORS[mark.align]}>{escape(mark.text)}</text>"


def _shape(mark: Shape) -> str:
    closed = mark.fill is not None
    fill = f' fill="{mark.fill}"' if closed else ""
    path = "".join(_path(part, closed) for part in mark.parts)
    return f'<path d="{path}"{fill}{"" if mark.stroke is None else _stroke(mark.stroke)}/>'


def _stroke(stroke: Stroke) -> str:
    dashes = f' stroke-dasharray="{" ".join(map(_n, stroke.dashes))}"' if stroke.dashes else ""
    return f' stroke="{stroke.colour}" stroke-width="{_n(stroke.points)}"{dashes}'


def _path(part: Floats, closed: bool) -> str:
    """``M x y x y ...``: pairs behind the first are lines to them."""
    numbers = f"{' '.join(map(repr, part.round(2).ravel().tolist()))} ".replace(".0 ", " ")
    return f"M{numbers.removesuffix(' ')}{'Z' if closed else ''}"


def _n(number: float) -> str:
    """To a hundredth, without a zero behind."""
    return repr(round(number, 2)).removesuffix(".0")
