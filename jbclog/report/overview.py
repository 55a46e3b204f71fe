"""The run at a glance: a strip for each port on one time axis, so that what stands out is seen from across the room.

Each strip shows how far the tip was from its setting, at most `REACH_C` either way, between its least and its greatest; what was
not read is hatched, alarms and errors are bars. Collected while the samples of a port are there; thinned curves are kept.
"""

from __future__ import annotations

import io
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from jbclog.judge.idle import setting_in_force
from jbclog.report import style
from jbclog.report.envelope import Envelope, envelope
from jbclog.report.figure import shorter
from jbclog.report.letters import drawable
from jbclog.report.spans import Span, merged, widened
from jbclog.report.style import Format
from jbclog.report.timescale import duration_text, time_marks
from jbclog.report.trace import JOINED_PERIODS, Mark, Trace

REACH_C = 40.0
STRETCHES = 400
STRIP_IN, ALL_IN, LEAST_IN, SHEET_IN = 0.24, 4.6, 0.12, 9.4  # a strip's height; that of all of them; where they are many
FEWEST = 2  # strips from which on a glance is worth more than the figures themselves
FIGURES_IN, TOP_IN, AXIS_IN = 1.0, 0.05, 0.24
LETTER_IN = 0.062  # the width of a letter of a strip's name
LONGEST_NAME = 16


@dataclass(frozen=True, slots=True)
class Strip:
    """One port: its curve as °C from the setting, what is hatched and marked, and two words on its right."""

    name: str
    curve: Envelope
    gaps: list[Span]
    marks: list[Mark]
    start: float
    end: float
    words: str
    is_bad: bool


@dataclass(slots=True)
class Overview:
    """The strips of a run, in the order of its stations."""

    t0_utc_us: int
    strips: list[Strip] = field(default_factory=list)

    def add(self, name: str, trace: Trace, coverage_percent: float | None) -> None:
        """One more port."""
        away = trace.temperature - setting_in_force(trace.seconds, trace.setting) if len(trace.seconds) else trace.temperature
        curve = envelope(trace.seconds, np.clip(away, -REACH_C, REACH_C), STRETCHES, JOINED_PERIODS * trace.period_s)
        alarms = sum(mark.kind == "alarm" for mark in trace.marks)
        read = "–" if coverage_percent is None else f"{np.floor(coverage_percent * 10) / 10:g} %"
        words = f"{read}, {alarms} alarm{'s' * (alarms > 1)}" if alarms else read
        name = drawable(name)
        shown = name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 7]}…{name[-6:]}"
        self.strips.append(Strip(shown, curve, trace.gaps, list(trace.marks), trace.start, trace.end, words, alarms > 0))

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
        return len(self.strips) * self.strip_in + TOP_IN + AXIS_IN

    @property
    def caption(self) -> str:
        """What the strips show."""
        length = duration_text(max(strip.end for strip in self.strips) - min(strip.start for strip in self.strips))
        return (
            f"{length}. Each strip: a tip's distance from its setting (grey), {REACH_C:g} °C up and down at most. "
            "Hatched: not read; red: alarm; violet: error. On the right: readings that are there."
        )

    def svg(self, form: Format) -> str:
        """The strips as an SVG document."""
        out = io.StringIO()
        with style.sized(form):
            figure = Figure(figsize=(form.width_in, self.height_in), facecolor="white")
            self.fill(figure, form, 0.0, 0.0)
            FigureCanvasSVG(figure)
            figure.savefig(out, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
        return shorter(out.getvalue())

    def fill(self, figure: Figure, form: Format, x: float, y: float) -> None:
        """Draw the strips onto a figure or sheet, their upper left corner at `x` and `y` inches from that of the sheet."""
        width, height = figure.get_size_inches()
        name_in = 0.12 + LETTER_IN * max(len(strip.name) for strip in self.strips)
        room, points = len(self.strips) * self.strip_in, min(form.font_pt, 0.72 * 72 * self.strip_in)
        axes = figure.add_axes(
            ((x + name_in) / width, 1 - (y + TOP_IN + room) / height, (form.width_in - name_in - FIGURES_IN) / width, room / height)
        )
        start, end = min(strip.start for strip in self.strips), max(strip.end for strip in self.strips)
        for row, strip in enumerate(self.strips):
            _draw(axes, row, strip, (end - start) / form.stretches * 1.5, points)
        axes.set_xlim(start, end)
        axes.set_ylim(len(self.strips), 0)
        marks = time_marks(self.t0_utc_us, start, end, max(4, form.time_marks - 2))
        axes.set_xticks([place for place, _ in marks], [label for _, label in marks])
        axes.set_yticks([row + 0.5 for row in range(len(self.strips))], [strip.name for strip in self.strips])
        axes.tick_params(length=0, labelcolor=style.INK, pad=4)
        axes.tick_params(axis="y", labelsize=points)
        axes.grid(axis="x", color=style.GRID, lw=0.6)
        axes.set_axisbelow(True)
        for side in axes.spines.values():
            side.set_visible(False)


def _draw(axes: Axes, row: int, strip: Strip, least_s: float, points: float) -> None:
    middle, curve = row + 0.5, strip.curve
    axes.hlines(middle, strip.start, strip.end, color=style.NO_DATA, lw=0.5, zorder=1)
    low, high = (middle - 0.42 * side / REACH_C for side in (curve.low, curve.high))
    axes.fill_between(curve.seconds, low, high, fc=style.TEMPERATURE, ec=style.TEMPERATURE, lw=0.5, zorder=2)
    for gap in merged((gap for gap in strip.gaps if gap.seconds >= least_s), least_s):
        _bar(axes, row, gap, style.NO_DATA_TINT, style.hatch(gap.word, gap.seconds > 4 * least_s), 1.0)
    for mark in strip.marks:
        _bar(axes, row, widened(mark.span, 2 * least_s), style.MARK_COLOURS[mark.kind], None, 0.85)
    axes.hlines(row + 1, strip.start, strip.end, color=style.GRID, lw=0.6, zorder=0)
    colour, weight = (style.ALARM, "bold") if strip.is_bad else (style.QUIET, "normal")
    axes.text(
        1.01, middle, strip.words, transform=axes.get_yaxis_transform(), va="center", color=colour, weight=weight, size=points
    )


def _bar(axes: Axes, row: int, span: Span, face: str, hatch: str | None, alpha: float) -> None:
    plain = hatch is None and face == style.NO_DATA_TINT
    place = Rectangle((span.start, row + 0.06), span.seconds, 0.88, lw=0, zorder=3, alpha=alpha)
    place.set(facecolor=style.NO_DATA if plain else face, edgecolor=style.NO_DATA, hatch=hatch)
    axes.add_patch(place)
