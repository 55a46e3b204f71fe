"""The overview of a run: a strip for each port on one time axis.

A strip shows how far the tip was from its setpoint, from minimum to maximum, up to `REACH_C`. Where
it was further away for `FAR_S`, a field with its temperature is drawn instead, so that a cold tip
is not a level line. Missing data are hatched, alarms and errors are bars. Strips are added port by
port and hold thinned curves only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jbclog.analysis.figures import style
from jbclog.analysis.figures.axes import BESIDE_PT, panel, rectangles, size_pt
from jbclog.analysis.figures.canvas import new_figure, styled
from jbclog.analysis.figures.curves import (
    Envelope,
    Readings,
    Span,
    blocks,
    coded,
    dates,
    envelope,
    merged,
    rows_before,
    runs,
    widened,
)
from jbclog.analysis.figures.style import Format, Look
from jbclog.analysis.figures.ticks import duration_text, time_marks
from jbclog.analysis.figures.trace import JOINED_PERIODS, Mark, MarkKind, Trace
from jbclog.analysis.port_data import setting_in_force
from jbclog.core.text import count_text

REACH_C = 40.0
FAR_S = 10.0
FAR_TINT = "#d9dde8"
STRETCHES = 400
# height of a strip; of all of them; of a strip if they are many
STRIP_IN, ALL_IN, LEAST_IN, SHEET_IN = 0.24, 4.6, 0.12, 9.4
FEWEST = 2  # strips from which on there is an overview
FIGURES_PT, TOP_PT, AXIS_PT = 72.0, 3.6, 17.3
LETTER_PT = 4.5  # width of a letter of a strip's name
LONGEST_NAME = 16


@dataclass(frozen=True, slots=True)
class Strip:
    """One port: its curve as °C from the setpoint, the hatched and marked spans, and the text at
    the right.
    """

    name: str
    curve: Envelope
    gaps: list[Span]
    marks: list[Mark]
    start: float
    end: float
    words: str
    is_bad: bool
    far: list[Span]  # with the text of each field
    is_cold: bool  # the tip never reached its setpoint


@dataclass(slots=True)
class Overview:
    """The strips of a run, in the order of its stations."""

    t0_utc_us: int
    strips: list[Strip] = field(default_factory=list)

    def add(
        self, name: str, trace: Trace, coverage_percent: float | None, cold: str | None = None
    ) -> None:
        """Add a port. `cold`: how it never reached its setpoint, in a word or two; None if it
        did.
        """
        away = _setpoint_error(trace)
        far = _far(trace, away)
        for span in far:
            away[_inside(trace, span)] = np.nan
        curve = envelope(
            trace.seconds,
            away.clip(-REACH_C, REACH_C, out=away),
            STRETCHES,
            JOINED_PERIODS * trace.period_s,
        )
        alarms = sum(mark.kind is MarkKind.ALARM for mark in trace.marks)
        read = "–" if coverage_percent is None else f"{np.floor(coverage_percent * 10) / 10:g} %"
        words = cold or (f"{read}, {count_text(alarms, 'alarm')}" if alarms else read)
        shown = name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 7]}…{name[-6:]}"
        self.strips.append(
            Strip(
                shown,
                curve,
                trace.gaps,
                list(trace.marks),
                trace.start,
                trace.end,
                words,
                bool(alarms or cold),
                far,
                bool(cold),
            )
        )

    @property
    def is_worth_it(self) -> bool:
        return len(self.strips) >= FEWEST

    @property
    def strip_in(self) -> float:
        """Height of one strip; all of them fit on a sheet."""
        count = len(self.strips)
        return min(STRIP_IN, max(ALL_IN / count, LEAST_IN), SHEET_IN / count)

    @property
    def height_in(self) -> float:
        return len(self.strips) * self.strip_in + (TOP_PT + AXIS_PT) / 72

    @property
    def caption(self) -> str:
        """The content of the strips."""
        length = duration_text(
            max(strip.end for strip in self.strips) - min(strip.start for strip in self.strips)
        )
        further = (
            f"; shaded: more than {REACH_C:g} °C away, with the temperature"
            if any(strip.far for strip in self.strips)
            else ""
        )
        cold = [strip.name for strip in self.strips if strip.is_cold]
        never = f" Never at the setpoint: {', '.join(cold)}." if cold else ""
        return (
            f"{length}. Each strip: deviation from the setpoint (grey), ±{REACH_C:g} °C. "
            f"Hatched: no data; red: alarm; violet: error{further}. Right: coverage.{never}"
        )

    def draw(self, form: Format) -> Figure:
        """Return the strips as a figure."""
        with styled():
            figure = new_figure(form.width_pt, 72 * self.height_in)
            axes, high = self._panel(figure, form), 72 * self.strip_in
            points = min(form.font_pt, 0.72 * high)
            axes.set_yticks(
                [row + 0.5 for row in range(len(self.strips))],
                [strip.name for strip in self.strips],
            )
            axes.tick_params(axis="y", labelsize=points, labelcolor=style.INK)
            for row, strip in enumerate(self.strips):
                _Row(axes, row, strip, self.t0_utc_us, form, points).draw()
        return figure

    def _panel(self, figure: Figure, form: Format) -> Axes:
        """Return the panel of all strips; a strip is 1 high, the first is at the top."""
        left = 9 + LETTER_PT * max(len(strip.name) for strip in self.strips)
        count = len(self.strips)
        axes = panel(
            figure, left, TOP_PT, form.width_pt - left - FIGURES_PT, 72 * count * self.strip_in
        )
        start = min(strip.start for strip in self.strips)
        end = max(strip.end for strip in self.strips)
        marks = time_marks(self.t0_utc_us, start, end, max(4, form.time_marks - 2))
        axes.set_xlim(*dates(self.t0_utc_us, [start, end]).tolist())
        axes.set_ylim(count, 0)
        axes.set_xticks(
            dates(self.t0_utc_us, [second for second, _ in marks]), [label for _, label in marks]
        )
        axes.grid(visible=False, axis="y")
        axes.spines[:].set_visible(False)
        axes.hlines(
            range(1, count + 1),
            0,
            1,
            transform=axes.get_yaxis_transform(),
            color=style.GRID,
            linewidth=0.6,
        )
        return axes


@dataclass(frozen=True, slots=True)
class _Row:
    """A strip in its row of the panel."""

    axes: Axes
    row: int
    strip: Strip
    t0_utc_us: int
    form: Format
    points: float

    def draw(self) -> None:
        strip, middle = self.strip, self.row + 0.5
        x = dates(self.t0_utc_us, strip.curve.seconds)
        low, high = (middle - 0.42 * side / REACH_C for side in (strip.curve.low, strip.curve.high))
        self.axes.plot(
            dates(self.t0_utc_us, [strip.start, strip.end]),
            [middle, middle],
            color=style.NO_DATA,
            linewidth=0.5,
        )
        look: Look = {
            "facecolor": style.TEMPERATURE,
            "edgecolor": style.TEMPERATURE,
            "linewidth": 0.5,
        }
        self.axes.fill_between(x, low, high, gid="strip", zorder=2.1, **look)
        self._far()
        self._gaps()
        for kind, colour in style.MARK_COLOURS.items():
            spans = [
                widened(mark.span, 2 * self._least_s) for mark in strip.marks if mark.kind == kind
            ]
            self._fill(spans, kind, facecolor=colour, zorder=2.6)
        look = {
            "color": style.ALARM if strip.is_bad else style.QUIET,
            "weight": "bold" if strip.is_bad else "normal",
        }
        place = (1 + BESIDE_PT / size_pt(self.axes)[0], middle)
        self.axes.text(
            *place,
            strip.words,
            fontsize=self.points,
            va="center_baseline",
            transform=self.axes.get_yaxis_transform(),
            **look,
        )

    @property
    def _least_s(self) -> float:
        """Shortest visible time, in s."""
        left, right = self.axes.get_xlim()
        return (right - left) * 86400 / self.form.stretches * 1.5

    def _fill(self, spans: Sequence[Span], of: str, **look: Any) -> None:
        places = [
            (
                *dates(self.t0_utc_us, [one.start, one.end]).tolist(),
                self.row + 0.06,
                self.row + 0.94,
            )
            for one in spans
        ]
        rectangles(self.axes, places, of, **look)

    def _gaps(self) -> None:
        gaps = merged(
            (gap for gap in self.strip.gaps if gap.seconds >= self._least_s), self._least_s
        )
        for gap in gaps:
            hatch = style.hatch(gap.word, gap.seconds > 4 * self._least_s)
            face = style.NO_DATA_TINT if hatch else style.NO_DATA
            self._fill(
                [gap], "gap", facecolor=face, edgecolor=style.NO_DATA, hatch=hatch, zorder=2.5
            )

    def _far(self) -> None:
        """Draw a field with the temperature in it, if that fits."""
        self._fill(self.strip.far, "far", facecolor=FAR_TINT, zorder=2.2)
        (left, right), wide = self.axes.get_xlim(), size_pt(self.axes)[0]
        for span in self.strip.far:
            if span.seconds / 86400 / (right - left) * wide > LETTER_PT * len(span.word):
                middle = float(dates(self.t0_utc_us, (span.start + span.end) / 2))
                look: Look = {
                    "fontsize": min(self.points, self.form.font_pt),
                    "ha": "center",
                    "va": "center_baseline",
                }
                self.axes.text(middle, self.row + 0.5, span.word, zorder=2.3, **look)


def _setpoint_error(trace: Trace) -> Readings:
    """Return how far the tip was from its setpoint in each row, NaN if not known."""
    away, last_s, last_c = trace.temperature.copy(), trace.start, np.nan
    for rows in blocks(len(away)):
        seconds = np.append(last_s, trace.seconds[rows])
        setting = np.append(last_c, trace.setting[rows])
        away[rows] -= setting_in_force(seconds, setting)[1:]
        known = np.flatnonzero(~np.isnan(setting))
        if len(known):
            last_s, last_c = float(seconds[known[-1]]), float(setting[known[-1]])
    return away


def _inside(trace: Trace, span: Span) -> slice:
    return rows_before(trace.seconds, span.start, span.end)


def _far(trace: Trace, away: Readings) -> list[Span]:
    """Return where the tip was outside the strip for long, each with its temperatures as text."""
    words = coded(np.where(np.abs(away) > REACH_C, 0, -1).astype(np.int8), ["far"])
    spans = [span for span in runs(trace.seconds, words, trace.period_s) if span.seconds >= FAR_S]
    return [span._replace(word=_celsius(trace, span)) for span in spans]


def _celsius(trace: Trace, span: Span) -> str:
    inside = trace.temperature[_inside(trace, span)]
    low, high = np.nanmin(inside), np.nanmax(inside)
    return f"{low:.0f} °C" if low == high else f"{low:.0f} to {high:.0f} °C"
