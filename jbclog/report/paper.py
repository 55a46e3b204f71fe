"""Sheets of A4 that are filled from top to bottom: text, tables and figures, for `report.pdf`.

Inches from the sheet's upper left corner; text is measured with the font that draws it, so nothing runs over an edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Final

from jbclog.report import style
from jbclog.report.drawing import Align, Drawing, Stroke, Words
from jbclog.report.pdf_file import pdf_file
from jbclog.report.text_metrics import LACKING, drawable, width_in

WIDTH, HEIGHT = 8.27, 11.69
SIDE, TOP, BOTTOM = 0.6, 0.55, 0.65
INNER: Final = WIDTH - 2 * SIDE
LEADING = 1.35  # of a line, in font sizes
GAP_IN = 0.1  # between columns
LAST = 0.27  # of the width, for the column of sentences


@dataclass(frozen=True, slots=True)
class Type:
    """A size and weight of letters."""

    points: float
    bold: bool = False
    colour: str = style.INK

    @property
    def line_in(self) -> float:
        return self.points * LEADING / 72


@dataclass(frozen=True, slots=True)
class Cell:
    """A text in a table, and how it is set."""

    text: str
    type: Type
    right: bool = False


def wrapped(text: str, type_: Type, room_in: float) -> list[str]:
    """The text in lines that fit; a word that is longer than a line is cut into pieces."""
    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines[-1] else word
        if width_in(longer, type_.points, type_.bold) <= room_in:
            lines[-1] = longer
            continue
        pieces = _pieces(word, type_, room_in)
        lines = [*lines, *pieces] if lines[-1] else pieces if len(lines) == 1 else [*lines[:-1], *pieces]
    return lines


def _pieces(word: str, type_: Type, room_in: float) -> list[str]:
    pieces = [""]
    for letter in word:
        if pieces[-1] and width_in(pieces[-1] + letter, type_.points, type_.bold) > room_in:
            pieces.append("")
        pieces[-1] += letter
    return pieces


@dataclass(slots=True)
class Paper:
    """Sheets, and how far the last one is filled."""

    sheets: list[Drawing] = field(default_factory=list)
    y: float = HEIGHT

    @property
    def sheet(self) -> Drawing:
        return self.sheets[-1]

    def need(self, inches: float) -> None:
        """Go on to a new sheet where there is not that much left."""
        if self.y + inches > HEIGHT - BOTTOM:
            self.sheets.append(Drawing(72 * WIDTH, 72 * HEIGHT))
            self.y = TOP

    def skip(self, inches: float) -> None:
        self.y += inches

    def put(self, text: str, x: float, type_: Type, *, right: bool = False, down: float = 0.0) -> None:
        """One line at `x`, as high as the sheet is filled; it does not fill it."""
        base, shown = 72 * (self.y + down) + type_.points, drawable(text, bold=type_.bold)
        align: Align = "right" if right else "left"
        self.sheet.words(72 * x, base, shown, type_.points, type_.colour, bold=type_.bold, align=align)

    def draw(self, drawing: Drawing, x: float = SIDE) -> None:
        """A figure, as high as the sheet is filled; it fills it."""
        self.sheet.add(drawing, 72 * x, 72 * self.y)
        self.skip(drawing.height / 72)

    def say(self, text: str, type_: Type, x: float = SIDE, room: float = INNER) -> None:
        """A paragraph."""
        for line in wrapped(text, type_, room):
            self.need(type_.line_in)
            self.put(line, x, type_)
            self.skip(type_.line_in)

    def rule(self, colour: str = style.INK, points: float = 0.6, start: float = SIDE, end: float = WIDTH - SIDE) -> None:
        """A line across, as high as the sheet is filled."""
        y = 72 * self.y
        self.sheet.line([72 * start, 72 * end], [y, y], Stroke(colour, points))

    def block(self, x: float, width: float, height: float, face: str, edge: Stroke | None = None) -> None:
        """A coloured field behind all that is on the sheet, below where that is filled to."""
        ground = Drawing(self.sheet.width, self.sheet.height)
        ground.field(72 * x, 72 * self.y, 72 * width, 72 * height, face, edge)
        self.sheet.marks[:0] = ground.marks

    def heading(self, text: str, keep_in: float = 1.0) -> None:
        """A headline with a rule above it, kept together with what follows."""
        type_ = Type(11, bold=True)
        self.need(type_.line_in + 0.2 + keep_in)
        self.skip(0.14)
        self.rule()
        self.skip(0.07)
        self.put(text, SIDE, type_)
        self.skip(type_.line_in + 0.04)

    def table(self, head: Sequence[Cell], rows: Sequence[Sequence[Cell]]) -> None:
        """A table whose last column takes what room is left and is wrapped; its head is set again on each sheet."""
        edges = _columns([head, *rows])
        self._row(head, edges, style.INK)
        for row in rows:
            height = max(
                len(wrapped(cell.text, cell.type, room)) * cell.type.line_in for cell, (_, room) in zip(row, edges, strict=True)
            )
            before = len(self.sheets)
            self.need(height + 0.05)
            if len(self.sheets) > before:
                self._row(head, edges, style.INK)
            self._row(row, edges, style.GRID)

    def _row(self, row: Sequence[Cell], edges: Sequence[tuple[float, float]], colour: str) -> None:
        most = 0.0
        for cell, (x, room) in zip(row, edges, strict=True):
            for number, line in enumerate(wrapped(cell.text, cell.type, room)):
                down = 0.02 + number * cell.type.line_in
                self.put(line, x + room if cell.right else x, cell.type, right=cell.right, down=down)
                most = max(most, down + cell.type.line_in)
        self.skip(most + 0.02)
        self.rule(colour, 0.5)


def _columns(rows: Sequence[Sequence[Cell]]) -> list[tuple[float, float]]:
    """Left edge and width of each: as wide as its texts, the widest no wider than there is room for; the last has the rest."""
    wishes = [max(width_in(row[i].text, row[i].type.points, row[i].type.bold) for row in rows) for i in range(len(rows[0]))]
    room = INNER - GAP_IN * (len(wishes) - 1) - min(wishes[-1], LAST * INNER)
    most = _widest(wishes[:-1], room)
    edges, x = [], SIDE
    for wish in wishes[:-1]:
        edges.append((x, min(wish, most) + 0.01))
        x += min(wish, most) + 0.01 + GAP_IN
    return [*edges, (x, WIDTH - SIDE - x)]


def _widest(wishes: Sequence[float], room: float) -> float:
    """How wide a column may be so that all of them fit: only the widest give something up."""
    left = room
    for number, wish in enumerate(sorted(wishes)):
        share = left / (len(wishes) - number)
        if wish > share:
            return share
        left -= wish
    return max(wishes, default=room)


def lacks_letters(sheets: Sequence[Drawing]) -> bool:
    """Whether anything on them stands for a letter that could not be drawn."""
    return any(isinstance(mark, Words) and LACKING in mark.text for sheet in sheets for mark in sheet.marks)


def pdf_bytes(sheets: Sequence[Drawing], foot: str, title: str, dated: datetime) -> bytes:
    """The sheets as a PDF, each with its foot and number: the same sheets give the same bytes."""
    type_ = Type(6.5, colour=style.QUIET)
    for number, sheet in enumerate(sheets, 1):
        paper = Paper([sheet], HEIGHT - 0.45)
        paper.put(foot, SIDE, type_)
        paper.put(f"{number} of {len(sheets)}", WIDTH - SIDE, type_, right=True)
    return pdf_file(sheets, title, dated)
