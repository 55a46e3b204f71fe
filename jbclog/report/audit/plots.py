"""The drawings of an audit's page; they contain numbers only, no foreign text.

Colours follow Okabe and Ito, which colour-blind readers and grey printers can distinguish. No
colour carries a meaning alone: known parts are filled, possible parts are pale with an outline, and
each drawing stands beside its figure in words.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from math import ceil, isfinite, log10
from typing import Final

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import Affine2D

from jbclog.analysis.figures.axes import bars, panel, rectangles, valued
from jbclog.analysis.figures.canvas import new_figure, styled, svg_body
from jbclog.core.text import clean
from jbclog.maintenance.counter_totals.span import Interval
from jbclog.maintenance.due import Due, State
from jbclog.maintenance.fleet import Week

INK, QUIET, LINE, PALE = "#1c2733", "#5d6b7a", "#c3ced8", "#eef1f4"
WORK, WORK_PALE = "#0b4f8a", "#b5d2ec"
FILLS: Final = {
    State.OVERDUE: ("#a3260b", "#f0c4b8"),
    State.DUE: ("#c8400a", "#f6cfbb"),
    State.SOON: ("#b37700", "#f2dcae"),
    State.UNKNOWN: (QUIET, "#dfe4e9"),
    State.FINE: (WORK, WORK_PALE),
}
SPENT: Final = (WORK, "#7da7cd", "#d6e4f1", "#ffffff")
"""Worked, otherwise, slept, no tool: each a lighter grey than the one before."""

BAR: Final = (150, 14)
FULL_AT, MOST = 100.0, 150.0  # pixels of a whole interval; longest bar
AXIS: Final = (250, 14)
AHEAD_DAYS: Final = 365
MONTHS: Final = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


@dataclass(slots=True)
class _Sketch:
    """A small drawing in pixels, the first row at the top."""

    width: float
    height: float
    figure: Figure = field(init=False)
    pixels: Affine2D = field(init=False)

    def __post_init__(self) -> None:
        with styled():
            self.figure = new_figure(self.width, self.height)
        self.pixels = Affine2D().scale(1, -1).translate(0, self.height)

    def fill(
        self,
        places: Iterable[tuple[float, float, float, float]],
        colour: str,
        outline: str = "none",
    ) -> None:
        """Fill rectangles: left, top, width and height of each."""
        ends = [(x, x + max(width, 0), y + height, y) for x, y, width, height in places]
        edge = 0.8 if outline != "none" else 0
        rectangles(
            self.figure,
            ends,
            "",
            facecolor=colour,
            edgecolor=outline,
            linewidth=edge,
            transform=self.pixels,
        )

    def line(self, x: Sequence[float], y: Sequence[float], colour: str, width: float = 1) -> None:
        drawn = Line2D(
            x, y, color=colour, linewidth=width, solid_capstyle="projecting", transform=self.pixels
        )
        drawn.set_zorder(1)  # same as the areas
        self.figure.add_artist(drawn)

    def text(self, x: float, y: float, text: str, points: float, align: str = "left") -> None:
        self.figure.text(x, y, text, fontsize=points, ha=align, color=QUIET, transform=self.pixels)

    def arrow(self, x: float, y: float, colour: str) -> None:
        self.line([x - 6, x, x - 6], [y - 5, y, y + 5], colour, 2)

    def svg(self, label: str, look: str) -> Markup:
        return _svg(self.figure, label, look)


def _svg(figure: Figure, label: str, look: str) -> Markup:
    """Return a drawing as an element, with its description for screen readers."""
    figure.patch.set_visible(False)
    width, height = figure.get_size_inches() * 72
    head = f'<svg class="{look}" width="{width:g}" height="{height:g}" role="img" aria-label="'
    # the label is escaped; the rest are our numbers
    return Markup(head) + clean(label) + Markup('"' + svg_body(figure))


# -- the used part of a service interval -----------------------------------------------------------


def bar(percent: Interval | None, state: State, label: str) -> Markup:
    """Return a service interval: filled as far as certainly used, pale as far as possibly used, a
    line at its end.
    """
    width, height = BAR
    sketch, (fill, pale) = _Sketch(width, height), FILLS[state]
    if percent is None:
        sketch.fill([(0.5, 3, FULL_AT, 8)], "none", LINE)
        sketch.text(FULL_AT / 2, 11, "?", 10, "center")
        return sketch.svg(label, "bar")
    low, high = min(percent.low, MOST), min(percent.high, MOST)
    sketch.fill([(0.5, 3, FULL_AT, 8)], PALE, LINE)
    sketch.fill([(low, 3, high - low, 8)], pale, fill if high - low > 2 else "none")
    sketch.fill([(0, 3, low, 8)], fill)
    sketch.line([FULL_AT, FULL_AT], [0, height], INK, 1.4)
    if percent.high > MOST:
        sketch.arrow(width - 1, height / 2, INK)
    return sketch.svg(label, "bar")


# -- when it is due --------------------------------------------------------------------------------


def months(now: str) -> Markup:
    """Return the names of the months ahead, for the head of the column of due ranges."""
    sketch = _Sketch(AXIS[0], 13)
    for first in _firsts(now):
        if first.month % 3 == 1:
            sketch.text(_ahead(first, now) * AXIS[0] + 2, 10, MONTHS[first.month - 1], 10.5)
    return sketch.svg("the twelve months ahead", "axis")


def due(range_: Due | None, state: State, now: str, label: str) -> Markup:
    """Return the range from P10 to P90 with a mark at P50; an arrow if it reaches beyond a year, no
    bar without a range.
    """
    width, height = AXIS
    sketch = _Sketch(width, height)
    sketch.line([0, width], [height / 2, height / 2], LINE, 0.8)
    firsts = [_ahead(first, now) * width for first in _firsts(now)]
    sketch.line(*_vertical_lines(firsts, [0.0] * len(firsts), [height] * len(firsts)), LINE, 0.8)
    sketch.line([0.7, 0.7], [0, height], INK, 1.4)
    if range_ is None or range_.p10 is None:
        return sketch.svg(label, "axis")
    fill, pale = FILLS[state]
    begin, middle, end = (
        1.5 if one is None else _ahead(_date(one), now)
        for one in (range_.p10, range_.p50, range_.p90)
    )
    left, right = (min(max(at, 0.0), 1.0) * width for at in (begin, end))
    if begin < 1:
        sketch.fill([(left, 3, max(right - left, 3), 8)], pale, fill)
    if 0 <= middle < 1:
        sketch.fill([(middle * width - 1, 1.5, 2.4, 11)], fill)
    if end > 1:
        sketch.arrow(width - 1, height / 2, fill)
    return sketch.svg(label, "axis")


def _vertical_lines(
    x: Sequence[float], low: Sequence[float], high: Sequence[float]
) -> tuple[list[float], list[float]]:
    """Return vertical lines as one line with breaks."""
    none = float("nan")
    ends = [(a, b, none) for a, b in zip(low, high, strict=True)]
    return [at for at in x for _ in range(3)], [y for end in ends for y in end]


def _ahead(when: date, now: str) -> float:
    return (when - _date(now)).days / AHEAD_DAYS


def _date(text: str) -> date:
    return date.fromisoformat(text[:10])


def _firsts(now: str) -> list[date]:
    """Return the first of each month of the year ahead."""
    today = _date(now)
    begun = today.year * 12 + today.month
    return [date((begun + month) // 12, (begun + month) % 12 + 1, 1) for month in range(12)]


# -- use -------------------------------------------------------------------------------------------


def spent(work: float, sleep: float, no_tool: float, label: str) -> Markup:
    """Return the hours plugged in, in per cent: worked, otherwise, slept, without a tool."""
    width, height = 170.0, 12.0
    shares = (work, max(100 - work - sleep - no_tool, 0.0), sleep, no_tool)
    sketch, scale, at = _Sketch(width, height), width / max(sum(shares), 1.0), 0.0
    for share, fill in zip(shares, SPENT, strict=True):
        sketch.fill([(at, 1, share * scale, height - 2)], fill)
        at += share * scale
    sketch.fill([(0.4, 1, width - 0.8, height - 2)], "none", QUIET)
    return sketch.svg(label, "spent")


def course(weeks: Sequence[Week], most: float, label: str) -> Markup:
    """Return a year of weeks as columns, `most` hours a day at the top; pale where long times
    without a reading were spread.
    """
    height = 26.0
    sketch = _Sketch(3.0 * len(weeks), height)
    for colour, places in _columns(weeks, most):
        scale = (height - 1) / most
        sketch.fill(
            [(3 * at, height - 1 - hours * scale, 2.2, hours * scale) for at, hours in places],
            colour,
        )
    sketch.line([0, sketch.width], [height - 0.5, height - 0.5], LINE)
    return sketch.svg(label, "course")


def _columns(weeks: Sequence[Week], most: float) -> list[tuple[str, list[tuple[int, float]]]]:
    """Return known weeks' hours a day with their number, by colour; `most` at most."""
    known = [
        (at, min(week.per_day.middle, most), week.is_spread)
        for at, week in enumerate(weeks)
        if week.per_day is not None
    ]
    kinds = ((WORK, False), (WORK_PALE, True))
    return [
        (colour, [(at, hours) for at, hours, spread in known if spread == pale])
        for colour, pale in kinds
    ]


def fleet_course(weeks: Sequence[tuple[Week, int]], of: int, wide: bool) -> Markup:
    """Return the year of the fleet: port hours a day, week by week, with an axis; pale where few of
    its stations are known.

    `weeks` are sums over the stations known in that week, with their number.
    """
    width, left = (940.0, 44.0) if wide else (360.0, 34.0)
    most = scale_of(week for week, _ in weeks)
    shown = [replace(week, is_spread=week.is_spread or known < 0.75 * of) for week, known in weeks]
    with styled():
        figure = new_figure(width, 190)
        axes = panel(figure, left, 15, width - left, 145)
        axes.set_xlim(0, max(len(weeks), 1))
        axes.set_ylim(0, most)
        axes.spines[:].set_visible(False)
        valued(axes, [0.0, most / 2, most])
        axes.grid(axis="y", color=LINE, linewidth=0.8, clip_on=False)
        axes.grid(visible=False, axis="x")
        axes.tick_params(labelsize=12)
        for colour, places in _columns(shown, most):
            rectangles(
                axes,
                [(at + 0.1, at + 0.9, 0, hours) for at, hours in places],
                "weeks",
                facecolor=colour,
                clip_on=False,
            )
        middles, low, high = np.array(_doubtful(shown, most), dtype=np.float64).reshape(-1, 3).T
        bars(axes, middles, low, high, "doubt", color=INK, linewidth=1, clip_on=False)
        begins = _month_begins(shown, wide)
        axes.set_xticks(list(begins), list(begins.values()), ha="left")
        bars(
            axes,
            list(begins),
            [0.0] * len(begins),
            [-5 / 145 * most] * len(begins),
            "month",
            color=QUIET,
            clip_on=False,
        )
    return _svg(
        figure,
        f"working hours per day of all ports, {len(weeks)} weeks",
        "wide" if wide else "narrow",
    )


def _doubtful(weeks: Sequence[Week], most: float) -> list[tuple[float, float, float]]:
    """Return place, least and greatest hours a day of the weeks that are not known well, if the
    difference is visible.
    """
    known = [(at + 0.5, week.per_day) for at, week in enumerate(weeks) if week.per_day is not None]
    return [
        (at, min(hours.low, most), min(hours.high, most))
        for at, hours in known
        if hours.width >= 3 / 145 * most
    ]


def _month_begins(weeks: Sequence[Week], wide: bool) -> dict[int, str]:
    """Return the weeks in which a month begins, with its name; narrow: each third month."""
    found = {}
    for at, week in enumerate(weeks):
        month = int(week.start[5:7])
        if week.start[:7] != weeks[max(at - 1, 0)].start[:7] and (wide or month % 3 == 1):
            found[at] = f" {MONTHS[month - 1]}{f' {week.start[:4]}' if month == 1 else ''}"
    return found


def scale_of(weeks: Iterable[Week]) -> float:
    """Return a round number of hours a day above the certain work of any week; possible work above
    it is cut off.
    """
    return nice(
        1.1 * max((week.per_day.low for week in weeks if week.per_day is not None), default=1.0)
    )


def nice(value: float) -> float:
    """Return the next round number above."""
    if not isfinite(value) or value <= 0:
        return 1.0
    ten = 10.0 ** ceil(log10(value) - 1)
    return next(step * ten for step in (1, 1.2, 1.6, 2, 3, 4, 5, 6, 8, 10) if step * ten >= value)
