"""The run at a glance: a strip for each port on one time axis, so that what stands out is seen from across the room.

Each strip shows how far the tip was from its setting, at most `REACH_C` either way, between its least and its greatest. Where it
was further away for `FAR_S`, no curve is drawn but a field with its temperature: a cold tip is no level line. What was not read
is hatched, alarms and errors are bars. Collected while the samples of a port are there; thinned curves are kept.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from jbclog.analysis.verdict.idle import setting_in_force
from jbclog.report import style
from jbclog.report.drawing import Drawing, Stroke
from jbclog.report.panel import Panel
from jbclog.report.scale import Scale, duration_text, time_marks
from jbclog.report.style import Format
from jbclog.report.trace import JOINED_PERIODS, Envelope, Floats, Mark, Span, Trace, envelope, merged, runs, widened

REACH_C = 40.0
FAR_S = 10.0
FAR_TINT = "#d9dde8"
STRETCHES = 400
STRIP_IN, ALL_IN, LEAST_IN, SHEET_IN = 0.24, 4.6, 0.12, 9.4  # a strip's height; that of all of them; where they are many
FEWEST = 2  # strips from which on a glance is worth more than the figures themselves
FIGURES_PT, TOP_PT, AXIS_PT = 72.0, 3.6, 17.3
LETTER_PT = 4.5  # the width of a letter of a strip's name
LONGEST_NAME = 16


@dataclass(frozen=True, slots=True)
class Strip:
    """One port: its curve as °C from the setting, what is hatched and marked, and some words on its right."""

    name: str
    curve: Envelope
    gaps: list[Span]
    marks: list[Mark]
    start: float
    end: float
    words: str
    is_bad: bool
    far: list[Span]  # with what to write into the field
    is_cold: bool  # it never came to its setting


@dataclass(slots=True)
class Overview:
    """The strips of a run, in the order of its stations."""

    t0_utc_us: int
    strips: list[Strip] = field(default_factory=list)

    def add(self, name: str, trace: Trace, coverage_percent: float | None, cold: str | None = None) -> None:
        """One more port. `cold`: in a word or two how it never came to its setting; None where it did."""
        away = trace.temperature - setting_in_force(trace.seconds, trace.setting) if len(trace.seconds) else trace.temperature
        far = _far(trace, away)
        for span in far:
            away = np.where((trace.seconds >= span.start) & (trace.seconds < span.end), np.nan, away)
        curve = envelope(trace.seconds, np.clip(away, -REACH_C, REACH_C), STRETCHES, JOINED_PERIODS * trace.period_s)
        alarms = sum(mark.kind == "alarm" for mark in trace.marks)
        read = "–" if coverage_percent is None else f"{np.floor(coverage_percent * 10) / 10:g} %"
        words = cold or (f"{read}, {alarms} alarm{'s' * (alarms > 1)}" if alarms else read)
        shown = name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 7]}…{name[-6:]}"
        self.strips.append(
            Strip(shown, curve, trace.gaps, list(trace.marks), trace.start, trace.end, words, bool(alarms or cold), far, bool(cold))
        )

    @property
    def is_worth_it(self) -> bool:
        return len(self.strips) >= FEWEST

    @property
    def strip_in(self) -> float:
        """The height of one strip; all of them fit on a sheet."""
        count = len(self.strips)
        return min(STRIP_IN, max(ALL_IN / count, LEAST_IN), SHEET_IN / count)

    @property
    def height_in(self) -> float:
        return len(self.strips) * self.strip_in + (TOP_PT + AXIS_PT) / 72

    @property
    def caption(self) -> str:
        """What the strips show."""
        length = duration_text(max(strip.end for strip in self.strips) - min(strip.start for strip in self.strips))
        further = (
            f"; shaded: more than {REACH_C:g} °C away, with the temperature" if any(strip.far for strip in self.strips) else ""
        )
        cold = [strip.name for strip in self.strips if strip.is_cold]
        never = f" Never at its setting: {', '.join(cold)}." if cold else ""
        return (
            f"{length}. Each strip: a tip's distance from its setting (grey), {REACH_C:g} °C up and down at most. "
            f"Hatched: not read; red: alarm; violet: error{further}. On the right: readings that are there.{never}"
        )

    def draw(self, form: Format) -> Drawing:
        """The strips."""
        drawing = Drawing(form.width_pt, 72 * self.height_in)
        panel, high = self._panel(drawing, form), 72 * self.strip_in
        marks = time_marks(self.t0_utc_us, panel.x.low, panel.x.high, max(4, form.time_marks - 2))
        panel.ruled([second for second, _ in marks])
        points = min(form.font_pt, 0.72 * high)
        for row, strip in enumerate(self.strips):
            _draw(panel, panel.top + row * high, high, strip, points)
        panel.timed(marks)
        return drawing

    def _panel(self, drawing: Drawing, form: Format) -> Panel:
        left = 9 + LETTER_PT * max(len(strip.name) for strip in self.strips)
        width, high = form.width_pt - left - FIGURES_PT, 72 * len(self.strips) * self.strip_in
        start, end = min(strip.start for strip in self.strips), max(strip.end for strip in self.strips)
        x, y = Scale(start, end, left, left + width), Scale(0.0, 1.0, TOP_PT + high, TOP_PT)
        return Panel(drawing, form, left, TOP_PT, width, high, x, y)


def _draw(panel: Panel, top: float, high: float, strip: Strip, points: float) -> None:
    middle, curve, drawing = top + high / 2, strip.curve, panel.drawing
    least_s = (panel.x.high - panel.x.low) / panel.form.stretches * 1.5
    drawing.line(panel.x.at([strip.start, strip.end]), [middle, middle], Stroke(style.NO_DATA, 0.5))
    low, high_y = (middle - 0.42 * high * side / REACH_C for side in (curve.low, curve.high))
    drawing.area(panel.x.at(curve.seconds), low, high_y, style.TEMPERATURE, Stroke(style.TEMPERATURE, 0.5), strip.name)
    for span in strip.far:
        _far_field(panel, top, high, span)
    for gap in merged((gap for gap in strip.gaps if gap.seconds >= least_s), least_s):
        hatch = style.hatch(gap.word, gap.seconds > 4 * least_s)
        _bar(panel, top, high, gap, style.NO_DATA_TINT if hatch else style.NO_DATA, hatch)
    for mark in strip.marks:
        _bar(panel, top, high, widened(mark.span, 2 * least_s), style.MARK_COLOURS[mark.kind], None)
    drawing.line([panel.left, panel.right], [top + high, top + high], style.HAIR)
    base = middle + 0.36 * points
    panel.told_left(strip.name, middle, points, style.INK)
    drawing.words(panel.right + 4, base, strip.words, points, style.ALARM if strip.is_bad else style.QUIET, bold=strip.is_bad)


def _far(trace: Trace, away: Floats) -> list[Span]:
    """Where the tip was out of the strip's reach for long, each with its temperatures in words."""
    words = np.array(["far" if abs(one) > REACH_C else None for one in away], dtype=np.object_)
    spans = [span for span in runs(trace.seconds, words, trace.period_s) if span.seconds >= FAR_S]
    return [replace(span, word=_celsius(trace, span)) for span in spans]


def _celsius(trace: Trace, span: Span) -> str:
    inside = trace.temperature[(trace.seconds >= span.start) & (trace.seconds < span.end)]
    low, high = np.nanmin(inside), np.nanmax(inside)
    return f"{low:.0f} °C" if low == high else f"{low:.0f} to {high:.0f} °C"


def _far_field(panel: Panel, top: float, high: float, span: Span) -> None:
    """A field with the temperature in it, where there is room for that."""
    a, b = panel.x.at([span.start, span.end]).tolist()
    points = min(panel.form.font_pt, 0.6 * high)
    panel.drawing.field(a, top + 0.06 * high, b - a, 0.88 * high, FAR_TINT)
    if b - a > LETTER_PT * len(span.word):
        panel.drawing.words((a + b) / 2, top + high / 2 + 0.36 * points, span.word, points, style.INK, align="middle")


def _bar(panel: Panel, top: float, high: float, span: Span, face: str, hatch: str | None) -> None:
    a, b = panel.x.at([span.start, span.end]).tolist()
    place = (a, top + 0.06 * high, b - a, 0.88 * high)
    panel.drawing.field(*place, face)
    if hatch is not None:
        panel.drawing.hatched(*place, hatch, style.HATCHING)
