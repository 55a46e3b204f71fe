"""One field of a figure: its axes, and the lanes below its curves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from jbclog.report import style
from jbclog.report.drawing import Drawing
from jbclog.report.scale import Scale, duration_text, spread
from jbclog.report.style import Format
from jbclog.report.trace import Span, Trace, merged, widened, within

# -- panel --------------------------------------------------------------------------------------------------------------------

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


# -- lanes --------------------------------------------------------------------------------------------------------------------
# The lanes under the curves: one row each for status, missing data, alarms and errors, with words where there is room.

LANE_PT = 11.2  # height of a lane
CHARACTER = 0.62  # width of a character, in font sizes
LANES = (("no data", None), ("alarm", "alarm"), ("doubtful", "unconfirmed"), ("error", "error"))
MARKED = frozenset(name for name, _ in LANES)


@dataclass(frozen=True, slots=True)
class Lane:
    """A row: its name and its spans."""

    name: str
    spans: list[Span]


def least_seen_s(trace: Trace, form: Format) -> float:
    """The shortest time that is wide enough to be seen in a figure of this size."""
    return (trace.end - trace.start) / form.stretches * 1.5


def lanes_of(trace: Trace, form: Format) -> list[Lane]:
    """Status or states always; the others where there is something to show. Spans that cannot be told apart are one."""
    least = least_seen_s(trace, form)
    states = trace.states or {"status": trace.status} | ({} if trace.air is None else trace.air.lanes)
    lanes = [Lane(name, _seen(spans, least)) for name, spans in states.items()]
    for name, kind in LANES:
        spans = trace.gaps if kind is None else [mark.span for mark in trace.marks if mark.kind == kind]
        seen = within((widened(span, least) for span in merged(spans, least)), trace.start, trace.end)
        if seen:
            lanes.append(Lane(name, seen))
    return lanes


def _seen(spans: list[Span], least: float) -> list[Span]:
    """A state's spans, and over them, wide enough to be seen, those that are short and count."""
    graver = [widened(span, least) for span in spans if span.word in style.ALWAYS_SEEN]
    return [*merged(spans, least), *graver]


def draw_lanes(panel: Panel, lanes: list[Lane], trace: Trace) -> None:
    """Draw the lanes from top to bottom, each with its name before it."""
    if not lanes:
        return
    high = panel.height / len(lanes)
    for row, lane in enumerate(lanes):
        top = panel.top + row * high
        panel.told_left(lane.name, top + 0.52 * high)
        for span in lane.spans:
            _bar(panel, top, high, lane.name, span, hatched=span.seconds > 4 * least_seen_s(trace, panel.form))
            _word(panel, top, high, lane.name, span)


def _bar(panel: Panel, top: float, high: float, name: str, span: Span, hatched: bool) -> None:
    a, b = panel.x.at([span.start, span.end]).tolist()
    place = (a, top + 0.14 * high, b - a, 0.72 * high)
    hatch = style.hatch(span.word, hatched) if name == "no data" else None
    panel.drawing.field(*place, _face(name, span.word, hatch), of=name)
    if hatch is not None:
        panel.drawing.hatched(*place, hatch, style.HATCHING)


def _face(name: str, word: str, hatch: str | None) -> str:
    if word in style.GRAVE_STATES:
        return style.ERROR
    if name not in MARKED:
        return style.STATUS_SHADES.get(word, style.OTHER_SHADE)
    if name == "no data":
        return style.NO_DATA_TINT if hatch else style.NO_DATA
    return style.MARK_COLOURS["unconfirmed" if name == "doubtful" else name]


def _word(panel: Panel, top: float, high: float, name: str, span: Span) -> None:
    """The span's word in the middle of it, with its duration where data are missing, if there is room for it."""
    a, b = panel.x.at([span.start, span.end]).tolist()
    size, is_gap = panel.form.font_pt - 1, name == "no data"
    longest = [f"{span.word} {duration_text(span.seconds)}"] if is_gap else []
    fitting = ((text, len(text) * CHARACTER * size) for text in (*longest, span.word))
    text, wide = next(((text, wide) for text, wide in fitting if wide + CHARACTER * size <= b - a), ("", 0.0))
    if not text:
        return
    middle, base = (a + b) / 2, top + 0.5 * high + 0.36 * size
    if is_gap:
        panel.drawing.field(middle - wide / 2, top + 0.1 * high, wide, 0.8 * high, "#ffffff")
    light = (name in MARKED and not is_gap) or span.word in style.DARK_STATUS
    panel.drawing.words(middle, base, text, size, "#ffffff" if light else style.INK, align="middle", of=name)
