"""The drawings of an audit's page: SVG written plainly, of numbers only, so that nothing from outside can be in it.

Colours after Okabe and Ito, told apart by the colour-blind and as greys on paper; none carries a meaning alone: known parts are
filled, possible parts are pale with an outline, and each drawing stands beside its figure in words.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import date
from math import ceil, isfinite, log10
from typing import Final

from markupsafe import Markup

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
FULL_AT, MOST = 100.0, 150.0  # pixels of a whole life; as far as a bar goes
AXIS: Final = (250, 14)
AHEAD_DAYS: Final = 365
MONTHS: Final = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def svg(width: float, height: float, label: str, parts: Iterable[str], style: str = "") -> Markup:
    """A drawing with what it says to those who do not see it."""
    head = f'<svg class="{style}" viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}" role="img" aria-label="'
    return Markup(head) + clean(label) + Markup('">' + "".join(parts) + "</svg>")  # escaped; the parts are our numbers


def _rect(x: float, y: float, width: float, height: float, fill: str, outline: str = "") -> str:
    edge = f' stroke="{outline}" stroke-width="0.8"' if outline else ""
    return f'<rect x="{x:.1f}" y="{y:.1f}" width="{max(width, 0):.1f}" height="{height:.1f}" fill="{fill}"{edge}/>'


def _line(x1: float, y1: float, x2: float, y2: float, colour: str, width: float = 1) -> str:
    return f'<path d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}" stroke="{colour}" stroke-width="{width:g}" fill="none"/>'


def _text(x: float, y: float, text: str, size: float, anchor: str = "start", colour: str = QUIET) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" text-anchor="{anchor}" fill="{colour}">{text}</text>'


def _arrow(x: float, y: float, colour: str) -> str:
    path = f"M{x - 6:.1f} {y - 5:.1f}L{x:.1f} {y:.1f}L{x - 6:.1f} {y + 5:.1f}"
    return f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="2"/>'


# -- how much of a life is used ----------------------------------------------------------------------------------------------


def bar(percent: Interval | None, state: State, label: str) -> Markup:
    """A life: filled as far as it is surely used, pale as far as it may be, a line where it is all used up."""
    width, height = BAR
    fill, pale = FILLS[state]
    if percent is None:
        return svg(
            width, height, label, [_rect(0.5, 3, FULL_AT, 8, "none", LINE), _text(FULL_AT / 2, 11, "?", 10, "middle")], "bar"
        )
    low, high = min(percent.low, MOST), min(percent.high, MOST)
    parts = [_rect(0.5, 3, FULL_AT, 8, PALE, LINE), _rect(low, 3, high - low, 8, pale, fill if high - low > 2 else "")]
    parts += [_rect(0, 3, low, 8, fill), _line(FULL_AT, 0, FULL_AT, height, INK, 1.4)]
    return svg(width, height, label, [*parts, _arrow(width - 1, height / 2, INK)] if percent.high > MOST else parts, "bar")


# -- when it is due ----------------------------------------------------------------------------------------------------------


def months(now: str) -> Markup:
    """The heads of the months ahead, for the column of due ranges."""
    width = AXIS[0]
    found = [
        _text(_ahead(first, now) * width + 2, 10, MONTHS[first.month - 1], 10.5) for first in _firsts(now) if first.month % 3 == 1
    ]
    return svg(width, 13, "the twelve months ahead", found, "axis")


def due(range_: Due | None, state: State, now: str, label: str) -> Markup:
    """From P10 to P90, the mark in it at P50; an arrow where it reaches beyond a year, an outline where there is no range."""
    width, height = AXIS
    marks = [_line(_ahead(first, now) * width, 0, _ahead(first, now) * width, height, LINE, 0.8) for first in _firsts(now)]
    parts = [_line(0, height / 2, width, height / 2, LINE, 0.8), *marks, _line(0.7, 0, 0.7, height, INK, 1.4)]
    if range_ is None or range_.p10 is None:
        return svg(width, height, label, parts, "axis")
    fill, pale = FILLS[state]
    begin, middle, end = (1.5 if one is None else _ahead(_date(one), now) for one in (range_.p10, range_.p50, range_.p90))
    left, right = (min(max(at, 0.0), 1.0) * width for at in (begin, end))
    if begin < 1:
        parts.append(_rect(left, 3, max(right - left, 3), 8, pale, fill))
    if 0 <= middle < 1:
        parts.append(_rect(middle * width - 1, 1.5, 2.4, 11, fill))
    return svg(width, height, label, [*parts, _arrow(width - 1, height / 2, fill)] if end > 1 else parts, "axis")


def _ahead(when: date, now: str) -> float:
    return (when - _date(now)).days / AHEAD_DAYS


def _date(text: str) -> date:
    return date.fromisoformat(text[:10])


def _firsts(now: str) -> list[date]:
    """The first of each month of the year ahead."""
    today = _date(now)
    begun = today.year * 12 + today.month
    return [date((begun + month) // 12, (begun + month) % 12 + 1, 1) for month in range(12)]


# -- how it was used ---------------------------------------------------------------------------------------------------------


def spent(work: float, sleep: float, no_tool: float, label: str) -> Markup:
    """What the hours plugged in were spent on, in per cent: worked, otherwise, slept, without a tool."""
    width, height = 170.0, 12.0
    shares = (work, max(100 - work - sleep - no_tool, 0.0), sleep, no_tool)
    scale, at, parts = width / max(sum(shares), 1.0), 0.0, []
    for share, fill in zip(shares, SPENT, strict=True):
        parts.append(_rect(at, 1, share * scale, height - 2, fill))
        at += share * scale
    return svg(width, height, label, [*parts, _rect(0.4, 1, width - 0.8, height - 2, "none", QUIET)], "spent")


def course(weeks: Sequence[Week], most: float, label: str) -> Markup:
    """A year of weeks as columns, `most` hours a day at the top; pale where long times without a reading were spread evenly."""
    width, height = 3.0 * len(weeks), 26.0
    columns = [_Column(3.0 * at, 2.2, week, height - 1, (height - 1) / most, height - 1) for at, week in enumerate(weeks)]
    return svg(width, height, label, [*_drawn(columns), _line(0, height - 0.5, width, height - 0.5, LINE)], "course")


@dataclass(frozen=True, slots=True)
class _Column:
    """A week's hours a day as a column that stands on `bottom`, `most` high at most; nothing where they are not known."""

    x: float
    width: float
    week: Week
    bottom: float
    scale: float
    most: float

    @property
    def path(self) -> str:
        if self.week.per_day is None:
            return ""
        tall = min(self.week.per_day.middle * self.scale, self.most)
        return f"M{self.x:.1f} {self.bottom:g}v{-tall:.1f}h{self.width:.1f}v{tall:.1f}z"

    @property
    def whisker(self) -> str:
        """How well it is known, where that can be seen."""
        hours = self.week.per_day
        if hours is None or hours.width * self.scale < 3:
            return ""
        low, high = (self.bottom - min(end * self.scale, self.most) for end in (hours.low, hours.high))
        return f"M{self.x + self.width / 2:.1f} {low:.1f}V{high:.1f}"


def _drawn(columns: Sequence[_Column]) -> list[str]:
    """All columns of a kind as one path, which is a fifth of as many rectangles."""
    kinds = (
        (WORK, [one for one in columns if not one.week.is_spread]),
        (WORK_PALE, [one for one in columns if one.week.is_spread]),
    )
    return [f'<path d="{path}" fill="{fill}"/>' for fill, ones in kinds if (path := "".join(one.path for one in ones))]


def fleet_course(weeks: Sequence[tuple[Week, int]], of: int, wide: bool) -> Markup:
    """The fleet's year: port hours a day, week by week, with an axis; pale where few of its stations are known.

    `weeks` are sums over the stations that are known that week, with how many those are.
    """
    width, height, left, bottom = (940.0, 190.0, 44.0, 160.0) if wide else (360.0, 190.0, 34.0, 160.0)
    size, room = 12.0, (width - left) / max(len(weeks), 1)
    most = scale_of(week for week, _ in weeks)
    parts = [part for share in (0.0, 0.5, 1.0) for part in _level(share * most, bottom - share * 145, left, width, size)]
    shown = [replace(week, is_spread=week.is_spread or known < 0.75 * of) for week, known in weeks]
    columns = [_Column(left + (at + 0.1) * room, room * 0.8, week, bottom, 145 / most, 150) for at, week in enumerate(shown)]
    parts += [*_drawn(columns), f'<path d="{"".join(one.whisker for one in columns)}" stroke="{INK}"/>']
    for at, week in enumerate(shown):
        parts += _month(left + at * room, bottom, week.begin, shown[max(at - 1, 0)].begin, size, wide)
    label = f"port hours worked a day, week by week, {len(weeks)} weeks"
    return svg(width, height, label, parts, "wide" if wide else "narrow")


def scale_of(weeks: Iterable[Week]) -> float:
    """A round number of hours a day above what was surely worked in any week; what may have been is cut off there."""
    return nice(1.1 * max((week.per_day.low for week in weeks if week.per_day is not None), default=1.0))


def _level(value: float, y: float, left: float, width: float, size: float) -> list[str]:
    return [_line(left, y, width, y, LINE, 0.8), _text(left - 5, y + 4, f"{value:g}", size, "end")]


def _month(x: float, bottom: float, begin: str, before: str, size: float, wide: bool) -> list[str]:
    month = int(begin[5:7])
    if begin[:7] == before[:7] or not (wide or month % 3 == 1):
        return []
    year = f" {begin[:4]}" if month == 1 else ""
    return [_line(x, bottom, x, bottom + 5, QUIET), _text(x + 2, bottom + 17, MONTHS[month - 1] + year, size)]


def nice(value: float) -> float:
    """The next round number above."""
    if not isfinite(value) or value <= 0:
        return 1.0
    ten = 10.0 ** ceil(log10(value) - 1)
    return next(step * ten for step in (1, 1.2, 1.6, 2, 3, 4, 5, 6, 8, 10) if step * ten >= value)
