"""A drawing as plain marks: lines, areas, fields and words, in points from the upper left corner, in the order in which they lie.

What a figure shows is collected here once; `svg.py` writes it down. Ours and not a plotting library's,
because that took nine tenths of a report's time and its figures need nothing but these four. NaN breaks a line.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jbclog.report.hatching import hatching

Floats = NDArray[np.float64]
Align = Literal["left", "middle", "right"]


@dataclass(frozen=True, slots=True)
class Stroke:
    """How a line is drawn; `dashes` are lengths in points, drawn and left out in turn."""

    colour: str
    points: float
    dashes: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """Parts of the same look: each a row of corners (x, y), closed where they are `fill`-ed. `of` says what it shows."""

    parts: list[Floats]
    fill: str | None = None
    stroke: Stroke | None = None
    of: str = ""


@dataclass(frozen=True, slots=True)
class Words:
    """One line of text; `y` is its base line."""

    x: float
    y: float
    text: str
    points: float
    colour: str
    bold: bool = False
    align: Align = "left"
    of: str = ""


Mark = Shape | Words


@dataclass(slots=True)
class Drawing:
    """A figure."""

    width: float
    height: float
    marks: list[Mark] = field(default_factory=list)

    def line(self, x: ArrayLike, y: ArrayLike, stroke: Stroke, of: str = "") -> None:
        """A line through these points; in parts where one is NaN."""
        parts = pieces(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        self._add([part for part in parts if len(part) > 1], None, stroke, of)

    def area(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, fill: str, edge: Stroke | None = None, of: str = "") -> None:
        """What lies between two curves over the same `x`; in parts where one is NaN."""
        top, bottom = (np.broadcast_to(np.asarray(one, dtype=np.float64), np.shape(x)) for one in (high, low))
        upper, lower = (np.column_stack(one) for one in ((x, top), (x, bottom)))
        runs = [run for run in _runs(upper + lower) if run.stop - run.start > 1]
        self._add([np.vstack([upper[run], lower[run][::-1]]) for run in runs], fill, edge, of)

    def fields(self, places: Iterable[tuple[float, float, float, float]], fill: str | None, of: str = "") -> None:
        """Upright rectangles: left, top, width and height of each."""
        self._add([_corners(*place) for place in places], fill, None, of)

    def field(
        self, x: float, y: float, width: float, height: float, fill: str | None, edge: Stroke | None = None, of: str = ""
    ) -> None:
        """One of them, with an edge if wanted."""
        self._add([_corners(x, y, width, height)], fill, edge, of)

    def hatched(self, x: float, y: float, width: float, height: float, pattern: str, stroke: Stroke) -> None:
        """The hatching of such a rectangle; its strokes end at its edges."""
        self._add(hatching(x, y, width, height, pattern), None, stroke, f"hatch {pattern}")

    def dots(self, x: ArrayLike, y: ArrayLike, size: float, fill: str, of: str = "") -> None:
        """A square of `size` at each point that is known."""
        places = np.column_stack([np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)])
        known, half = places[~np.isnan(places).any(axis=1)], size / 2
        self.fields(((float(a) - half, float(b) - half, size, size) for a, b in known), fill, of)

    def bars(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, stroke: Stroke, of: str = "") -> None:
        """An upright line at each x."""
        ends = np.column_stack([np.asarray(one, dtype=np.float64) for one in (x, low, x, high)])
        self._add([row.reshape(2, 2) for row in ends if not np.isnan(row).any()], None, stroke, of)

    def words(
        self, x: float, y: float, text: str, points: float, colour: str, *, bold: bool = False, align: Align = "left", of: str = ""
    ) -> None:
        """One line of text on the base line `y`."""
        if text:
            self.marks.append(Words(x, y, text, points, colour, bold, align, of))

    def _add(self, parts: Sequence[Floats], fill: str | None, stroke: Stroke | None, of: str) -> None:
        if parts:
            self.marks.append(Shape(list(parts), fill, stroke, of))


def _corners(x: float, y: float, width: float, height: float) -> Floats:
    return np.array([(x, y), (x + width, y), (x + width, y + height), (x, y + height)])


def pieces(x: Floats, y: Floats) -> list[Floats]:
    """The runs of points that are known."""
    points = np.column_stack([x, y])
    return [points[run] for run in _runs(points)]


def _runs(points: Floats) -> list[slice]:
    """Where points that follow each other are known."""
    there = (~np.isnan(points).any(axis=1)).astype(np.int8)
    edges = np.flatnonzero(np.diff(there, prepend=0, append=0))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
