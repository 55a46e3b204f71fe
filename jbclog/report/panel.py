"""One field of a figure: where it lies, its scales, what is beneath its curves, numbers on the left and words on the right."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from jbclog.report import style
from jbclog.report.drawing import Drawing
from jbclog.report.scale import Scale, spread
from jbclog.report.spans import Span
from jbclog.report.style import Format

Label = tuple[float, str, str]
"""A value, the text beside it and its colour."""


@dataclass(frozen=True, slots=True)
class Panel:
    """A field on a drawing. `x` and `y` are its scales; `top`, `left`, `width` and `height` are in points."""

    drawing: Drawing
    form: Format
    left: float
    top: float
    width: float
    height: float
    x: Scale
    y: Scale

    @property
    def bottom(self) -> float:
        return self.top + self.height

    @property
    def right(self) -> float:
        return self.left + self.width

    def scaled(self, low: float, high: float, knee: float | None = None) -> Panel:
        """The same field with values from `low` to `high` upwards."""
        return replace(self, y=Scale(low, high, self.bottom, self.top, knee))

    def shaded(self, span: Span, fill: str, hatch: str | None = None, of: str = "") -> None:
        """A span over the full height."""
        a, b = self.x.at([span.start, span.end]).tolist()
        self.drawing.field(a, self.top, b - a, self.height, fill, of=of)
        if hatch is not None:
            self.drawing.hatched(a, self.top, b - a, self.height, hatch, style.HATCHING)

    def ruled(self, moments: Iterable[float], values: Iterable[float] = ()) -> None:
        """Upright and level hair lines."""
        ends = self.x.at(list(moments))
        self.drawing.bars(ends, [self.top] * len(ends), [self.bottom] * len(ends), style.HAIR, "grid")
        for y in self.y.at(list(values)).tolist():
            self.drawing.line([self.left, self.right], [y, y], style.HAIR, "grid")

    def framed(self) -> None:
        """The left and the lower edge."""
        self.drawing.line([self.left, self.left, self.right], [self.top, self.bottom, self.bottom], style.EDGE, "frame")

    def headed(self, text: str) -> None:
        self.drawing.words(self.left, self.top - 2.5, text, self.form.font_pt, style.QUIET)

    def numbered(self, values: Iterable[float]) -> None:
        """The numbers of the marks on the left."""
        for value in values:
            self.told_left(f"{value:g}".replace("-", "\u2212"), self.y.place(value))

    def told_left(self, text: str, y: float, points: float | None = None, colour: str = style.QUIET) -> None:
        """A text before the left edge, its middle at `y`."""
        size = points or self.form.font_pt
        self.drawing.words(self.left - 4, y + 0.36 * size, text, size, colour, align="right")

    def labelled(self, labels: Sequence[Label]) -> None:
        """Texts beside the right edge at the height of their values, pushed apart until none covers another."""
        ordered = sorted(labels, reverse=True)
        wished = [self.y.place(value) for value, _, _ in ordered]
        places = spread(wished, self.form.line_pt, self.top, self.bottom)
        for y, (_, text, colour) in zip(places, ordered, strict=True):
            self.drawing.words(self.right + 4, y + 0.36 * self.form.font_pt, text, self.form.font_pt, colour)

    def timed(self, marks: Iterable[tuple[float, str]], y: float | None = None) -> None:
        """The times beneath."""
        place = self.bottom + 1.35 * self.form.font_pt if y is None else y
        for second, label in marks:
            self.drawing.words(self.x.place(second), place, label, self.form.font_pt, style.QUIET, align="middle")
