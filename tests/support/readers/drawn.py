"""What lies on a drawing, read back: its texts and their boxes, and values from places by a panel's scale."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
from fontTools.ttLib import TTFont
from numpy.typing import NDArray

from jbclog.report.drawing import Drawing, Shape, Words
from jbclog.report.figure import panels
from jbclog.report.panel import Panel, lanes_of
from jbclog.report.scale import COARSE
from jbclog.report.style import Format
from jbclog.report.trace import Trace

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Box:
    """Where a text is, in points; `top` above `bottom`, which is smaller further up."""

    text: str
    left: float
    right: float
    top: float
    bottom: float


def texts(drawing: Drawing) -> list[str]:
    return [mark.text for mark in drawing.marks if isinstance(mark, Words)]


def shapes(drawing: Drawing, of: str) -> list[Shape]:
    return [mark for mark in drawing.marks if isinstance(mark, Shape) and mark.of == of]


def corners(drawing: Drawing, of: str) -> Floats:
    """Every corner of these shapes: a row of x and y each."""
    return np.concatenate([part for shape in shapes(drawing, of) for part in shape.parts] or [np.empty((0, 2))])


def boxes(drawing: Drawing) -> list[Box]:
    return [_box(mark) for mark in drawing.marks if isinstance(mark, Words)]


def _box(mark: Words) -> Box:
    wide = text_width(mark.text, mark.bold) * mark.points
    left = mark.x - {"left": 0.0, "middle": 0.5, "right": 1.0}[mark.align] * wide
    return Box(mark.text, left, left + wide, mark.y - 0.73 * mark.points, mark.y + 0.05 * mark.points)


def text_width(text: str, bold: bool) -> float:
    """How wide a text is in sizes of the font."""
    advances, units = _advances(bold)
    return sum(advances.get(ord(letter), 0) for letter in text) / units


@cache
def _advances(bold: bool) -> tuple[dict[int, int], int]:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    with TTFont(str(files("jbclog.report") / "vendor" / "dejavu" / name), lazy=True) as font:
        widths = font["hmtx"].metrics
        return {code: widths[glyph][0] for code, glyph in font.getBestCmap().items()}, font["head"].unitsPerEm


def fields(drawing: Drawing, trace: Trace, form: Format) -> tuple[Panel, Panel, Panel]:
    """The panels that a figure of this trace has: temperature, power, lanes."""
    return panels(drawing, trace, lanes_of(trace, form), form)


def values(panel: Panel, y: Floats) -> Floats:
    """The values that lie at these heights."""
    one = panel.y
    places, known = [one.start, one.end], [one.low, one.high]
    if one.knee is not None:
        places.insert(1, one.start + COARSE * (one.end - one.start))
        known.insert(1, one.knee)
    return np.interp(-y, [-place for place in places], known)
