"""The figure of one port: temperature against its setting and limits, power below, and lanes for what held when.

Drawn with matplotlib's objects only; pyplot keeps global state. Nothing in a figure comes from outside but numbers and
words of our own lists, so that no name can become a formula or markup.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator

from jbclog.report import style
from jbclog.report.envelope import Envelope, envelope, lone
from jbclog.report.lanes import Lane, draw_lanes, lanes_of, least_seen_s
from jbclog.report.spans import merged, widened
from jbclog.report.style import Format
from jbclog.report.timescale import time_marks
from jbclog.report.trace import JOINED_PERIODS, SETTING_JOINED_S, Floats, Trace

PATH = re.compile(r'(?<= d=")[^"]+')
LONG_NUMBER = re.compile(r"\d+\.\d{3,}")
LANE_IN = 0.155  # height of a lane
STATE_LANE_IN = 0.26  # where there is nothing but lanes
SHORT_S = 1.0
ROUND = [1, 2, 2.5, 5, 10]  # steps of an axis that people count in
RARE, COARSE = 0.02, 0.2  # samples that may lie in the coarse part of a scale, and its share of the height


def figure_svg(trace: Trace, form: Format) -> str:
    """The figure as an SVG document: the same trace gives the same bytes."""
    out = io.StringIO()
    with style.sized(form):
        figure = draw(trace, form)
        FigureCanvasSVG(figure)
        figure.savefig(out, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    return shorter(out.getvalue())


def shorter(svg: str) -> str:
    """The same drawing in half the bytes: its paths on one line each and to a hundredth of a point."""
    return PATH.sub(lambda path: LONG_NUMBER.sub(_hundredths, " ".join(path[0].split())), svg)


def _hundredths(number: re.Match[str]) -> str:
    return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")


def draw(trace: Trace, form: Format) -> Figure:
    """The figure, not yet rendered."""
    lanes = lanes_of(trace, form)
    height = height_in(trace, lanes, form)
    figure = Figure(figsize=(form.width_in, height), facecolor="white")
    fill(figure, trace, lanes, form, 0.0, 0.0)
    return figure


def height_in(trace: Trace, lanes: list[Lane], form: Format) -> float:
    """How high a figure of this trace is."""
    return STATE_LANE_IN * len(lanes) + 0.42 if trace.states else form.height_in + LANE_IN * len(lanes)


def fill(figure: Figure, trace: Trace, lanes: list[Lane], form: Format, x: float, y: float) -> None:
    """Draw the trace into a figure or a larger sheet, its upper left corner at `x` and `y` inches from that of the sheet."""
    width, height = figure.get_size_inches()
    own = height_in(trace, lanes, form)
    place = _Place(x / width, 1 - (y + own) / height, form.width_in / width, own / height, form.width_in, own)
    if trace.states:
        axes = figure.add_axes(place.within(0.78, 0.22, 0.1, 0.26))
        draw_lanes(axes, lanes, trace, form)
        _time_axis(axes, trace, form, labelled=True)
        return
    left, bottom, wide, high = place.within(0.5, 0.68, 0.16, 0.26)
    lane_in, edge_in = LANE_IN * len(lanes), 0.62
    heights = [0.7 * (form.height_in - edge_in), 0.3 * (form.height_in - edge_in), lane_in]
    room = figure.add_gridspec(
        3, 1, height_ratios=heights, left=left, right=left + wide, top=bottom + high, bottom=bottom, hspace=0.16
    )
    temperature, power, lane = (figure.add_subplot(room[row]) for row in range(3))
    _temperature(temperature, trace, form)
    _power(power, trace, form)
    draw_lanes(lane, lanes, trace, form)
    for axes in (temperature, power, lane):
        _time_axis(axes, trace, form, labelled=axes is lane)


@dataclass(frozen=True, slots=True)
class _Place:
    """A field of a sheet, in parts of the sheet and in inches."""

    x: float
    y: float
    width: float
    height: float
    width_in: float
    height_in: float

    def within(self, left: float, right: float, top: float, bottom: float) -> tuple[float, float, float, float]:
        """Left, bottom, width and height of what is left of it inside margins in inches."""
        across, up = self.width / self.width_in, self.height / self.height_in
        return (
            self.x + left * across,
            self.y + bottom * up,
            self.width - (left + right) * across,
            self.height - (top + bottom) * up,
        )


def _temperature(axes: Axes, trace: Trace, form: Format) -> None:
    _curve(axes, _thinned(trace, trace.temperature, form), style.TEMPERATURE, style.TEMPERATURE_BAND)
    labels: list[tuple[float, str, str]] = []
    known = trace.setting[~np.isnan(trace.setting)]
    if len(known):
        _setting(axes, trace, form)
        labels.append((float(known[-1]), f"set {known[-1]:g}", style.SETTING))
    for limit in trace.limits:
        seconds, celsius = [*limit.seconds, max(trace.end, limit.seconds[-1])], [*limit.celsius, limit.celsius[-1]]
        axes.plot(seconds, celsius, color=style.ALARM, lw=1.1, ls=style.DASHES[limit.side], drawstyle="steps-post")
        if not np.isnan(limit.celsius[-1]):
            labels.append((limit.celsius[-1], f"{limit.side} {limit.celsius[-1]:g}", style.ALARM))
    external = _external(axes, trace, form, labels)
    limits = [np.array(limit.celsius) for limit in trace.limits]
    low, high = _range([trace.temperature, external, known, *limits], least=20)
    knee = _knee(np.concatenate([trace.temperature, external]), [known, *limits], low, high)
    if knee is not None:
        _bend(axes, knee, low, high)
    else:
        axes.yaxis.set_major_locator(MaxNLocator(5, integer=True, steps=ROUND))
    axes.set_ylim(low, high)
    _headline(axes, f"{'Tip' if trace.air is None else 'Air'} temperature in °C{', and that of the work' * bool(len(external))}")
    _label_right(axes, labels, form)


def _external(axes: Axes, trace: Trace, form: Format, labels: list[tuple[float, str, str]]) -> Floats:
    """The thermocouple on the work of hot air, where there is one; what is drawn of it."""
    if trace.air is None or np.isnan(trace.air.external).all():
        return np.empty(0)
    known = trace.air.external[~np.isnan(trace.air.external)]
    _curve(axes, _thinned(trace, trace.air.external, form), style.EXTERNAL, style.EXTERNAL_BAND)
    labels.append((float(known[-1]), "work", style.EXTERNAL))
    return known


def _setting(axes: Axes, trace: Trace, form: Format) -> None:
    """A dot at each reading, and a thin line between two that are equal; nothing beyond the last, nor across an outage."""
    curve = envelope(trace.seconds, trace.setting, form.stretches, SETTING_JOINED_S)
    if not curve.whole:
        axes.plot(curve.seconds, curve.high, color=style.SETTING, lw=0.6, ls=style.DASHES["set"], drawstyle="steps-post")
        return
    outages = np.array([gap.start for gap in trace.gaps if gap.seconds >= SHORT_S])
    over = np.diff(np.searchsorted(outages, curve.seconds)) > 0  # nothing was read in between
    changes = np.flatnonzero((np.diff(curve.mean) != 0) | over) + 1  # NaN differs from everything
    seconds, celsius = np.insert(curve.seconds, changes, np.nan), np.insert(curve.mean, changes, np.nan)
    axes.plot(seconds, celsius, color=style.SETTING, lw=0.6, ls=style.DASHES["set"])
    dots = "." if np.count_nonzero(~np.isnan(curve.mean)) <= form.most_dots else "none"
    axes.plot(curve.seconds, curve.mean, color=style.SETTING, ls="none", marker=dots, ms=3.2)


def _power(axes: Axes, trace: Trace, form: Format) -> None:
    curve = _thinned(trace, trace.power, form)
    if curve.whole:
        axes.fill_between(curve.seconds, 0, curve.high, color=style.POWER_BAND, lw=0)
    _curve(axes, curve, style.POWER, style.POWER_BAND)
    known = trace.power[~np.isnan(trace.power)]
    axes.set_ylim(0, max(100.0, 1.08 * float(known.max())) if len(known) else 1000)
    axes.yaxis.set_major_locator(MaxNLocator(3, integer=True, steps=ROUND))
    _headline(axes, "Power in ‰")
    if len(known):
        _label_right(axes, [(float(known.max()), f"max {known.max():g}", style.POWER)], form)


def _thinned(trace: Trace, values: Floats, form: Format) -> Envelope:
    return envelope(trace.seconds, values, form.stretches, JOINED_PERIODS * trace.period_s)


def _curve(axes: Axes, curve: Envelope, colour: str, band: str) -> None:
    """The mean as a line within the band from least to greatest; what stands alone as a dot or a bar."""
    if not curve.whole:
        axes.fill_between(curve.seconds, curve.low, curve.high, fc=band, ec=colour, lw=0.25)
    axes.plot(curve.seconds, curve.mean, color=colour, lw=0.9, solid_joinstyle="round")
    alone = lone(curve)
    axes.plot(alone.seconds, alone.mean, color=colour, ls="none", marker=".", ms=2)
    if not curve.whole:
        axes.vlines(alone.seconds, alone.low, alone.high, color=band, lw=0.8)


def _range(parts: Sequence[Floats], least: float) -> tuple[float, float]:
    """Bottom and top that hold every value, with a little air."""
    values = np.concatenate([part[~np.isnan(part)] for part in parts])
    if not len(values):
        return 0.0, 400.0
    low, high = float(values.min()), float(values.max())
    air = max(0.06 * (high - low), (least - (high - low)) / 2, 2.0)
    return low - air, high + air


def _knee(temperature: Floats, lines: Sequence[Floats], low: float, high: float) -> float | None:
    """The temperature under which a coarser scale does no harm: few samples, no line, and most of the height."""
    known = temperature[~np.isnan(temperature)]
    if not len(known):
        return None
    floor = min(float(part[~np.isnan(part)].min()) for part in (np.quantile(known, [RARE]), *lines) if not np.isnan(part).all())
    knee = 10 * np.floor((floor - 5) / 10)
    return float(knee) if high - knee < 0.5 * (high - low) else None


def _bend(axes: Axes, knee: float, low: float, high: float) -> None:
    """A scale that is coarser below `knee`, and says so: the whole lower part has `COARSE` of the height."""
    finer = (1 - COARSE) / COARSE * (knee - low) / (high - knee)
    axes.set_yscale(
        "function",
        functions=(
            lambda c: np.where(c < knee, c, knee + (c - knee) * finer),
            lambda y: np.where(y < knee, y, knee + (y - knee) / finer),
        ),
    )
    axes.axhspan(low, knee, fc="#f1f3f5", lw=0, zorder=0)
    place = axes.get_yaxis_transform()
    axes.text(0.995, (low + knee) / 2, "coarser scale", transform=place, ha="right", va="center", color=style.QUIET, style="italic")
    axes.yaxis.set_major_locator(FixedLocator([*_round_between(low, knee - 0.3 * (knee - low), 2), *_round_between(knee, high, 5)]))


def _round_between(low: float, high: float, most: int) -> list[float]:
    return [float(place) for place in MaxNLocator(most, integer=True, steps=ROUND).tick_values(low, high) if low <= place <= high]


def _headline(axes: Axes, text: str) -> None:
    axes.text(0, 1.015, text, transform=axes.transAxes, va="bottom", ha="left", color=style.QUIET, clip_on=False)


def _label_right(axes: Axes, labels: list[tuple[float, str, str]], form: Format) -> None:
    """Labels beside the right edge at their height, pushed apart until none covers another."""
    bottom, top = axes.get_ylim()
    sheet = axes.get_figure(root=True)
    assert sheet is not None
    height_pt = axes.get_position().height * float(sheet.get_size_inches()[1]) * 72
    places = spread([value for value, _, _ in sorted(labels)], 1.25 * form.font_pt / height_pt * (top - bottom), bottom, top)
    for place, (_, text, colour) in zip(places, sorted(labels), strict=True):
        axes.text(1.008, place, text, transform=axes.get_yaxis_transform(), va="center", color=colour, clip_on=False)


def spread(places: Sequence[float], least: float, bottom: float, top: float) -> list[float]:
    """`places` (ascending) moved as little as needed to lie at least `least` apart, within bottom and top if they fit."""
    out: list[float] = []
    for place in places:
        out.append(max(place, out[-1] + least) if out else max(place, bottom))
    if out and out[-1] > top:
        out[-1] = top
        for i in range(len(out) - 2, -1, -1):
            out[i] = min(out[i], out[i + 1] - least)
    return out


def _time_axis(axes: Axes, trace: Trace, form: Format, labelled: bool) -> None:
    axes.set_xlim(trace.start, trace.end)
    marks = time_marks(trace.grid.t0_utc_us, trace.start, trace.end, form.time_marks)
    axes.set_xticks([place for place, _ in marks], [label for _, label in marks] if labelled else [])
    if not labelled:
        _shade(axes, trace, form)
    axes.grid(axis="x", color=style.GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(length=2, width=0.6, color=style.QUIET, labelcolor=style.QUIET, pad=2)
    for side in axes.spines.values():
        side.set_color(style.NO_DATA)
        side.set_linewidth(0.6)
    for edge in ("top", "right"):
        axes.spines[edge].set_visible(False)
    if not labelled:
        axes.grid(axis="y", color=style.GRID, lw=0.6)


def _shade(axes: Axes, trace: Trace, form: Format) -> None:
    """Gaps over the full height of the curves, alarms and errors shaded; wide enough to be seen, never less.

    A gap that is shorter than both `SHORT_S` and what can be seen is left to the lane below: a hundred single lost
    readings would hide the curve that they leave nearly whole.
    """
    least = least_seen_s(trace, form)
    for gap in merged((gap for gap in trace.gaps if gap.seconds >= min(SHORT_S, least)), least):
        wide, hatch = widened(gap, least), style.hatch(gap.word, gap.seconds > 4 * least)
        axes.axvspan(
            wide.start, wide.end, fc=style.NO_DATA_TINT if hatch else style.NO_DATA, ec=style.NO_DATA, hatch=hatch, lw=0, zorder=1.5
        )
    for mark in trace.marks:
        wide = widened(mark.span, least)
        axes.axvspan(wide.start, wide.end, fc=style.MARK_COLOURS[mark.kind], alpha=0.16, lw=0, zorder=0.5)
