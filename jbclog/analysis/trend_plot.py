"""Trends as a picture: a panel a port, the points, the control limits, the stated limits, signals ringed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jbclog.analysis import spc
from jbclog.analysis.trend import Floats, Trend, title_of
from jbclog.core.errors import UsageError

WIDE, HIGH = 9.5, 2.9  # inches of a panel
BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#595959"  # told apart by the colour-blind, and in grey by their lightness
MOST_NAMES: Final = 12


def trend_figure(trends: Sequence[Trend], lower: float | None = None, upper: float | None = None) -> Figure:
    """A panel for each trend. Raises `UsageError` where there is nothing to show."""
    if not trends:
        raise UsageError("there is no run with this metric; nothing to show")
    figure = Figure(figsize=(WIDE, HIGH * len(trends) + 0.2), layout="constrained")
    panels = figure.subplots(len(trends), 1, squeeze=False, sharex=False)
    for axes, trend in zip(panels[:, 0], trends, strict=True):
        _panel(axes, trend, lower, upper)
    return figure


def _panel(axes: Axes, trend: Trend, lower: float | None, upper: float | None) -> None:
    at = np.array([place for place, point in enumerate(trend.points) if point.value is not None], dtype=np.float64)
    values = trend.values
    axes.plot(at, values, color=BLUE, marker="o", markersize=3.5, linewidth=0.9, zorder=3)
    for limit in (lower, upper):
        if limit is not None:
            axes.axhline(limit, color=ORANGE, linewidth=1.2, linestyle=(0, (6, 3)))
            axes.text(1.005, limit, "limit", transform=axes.get_yaxis_transform(), color=ORANGE, fontsize=8, va="center")
    if isinstance(trend.chart, spc.Refused):
        note = f"No control limits. {trend.chart.text}"
    else:
        note = _limits(axes, trend, trend.chart[0], at)
    axes.set_title(f"{trend.station} port {trend.port}: {title_of(trend.metric)}", loc="left", fontsize=10)
    axes.text(0.0, -0.24, note, transform=axes.transAxes, fontsize=8, color=GREY, va="top", wrap=True)
    axes.set_ylabel(trend.unit)
    missing = [place for place, point in enumerate(trend.points) if point.value is None]
    axes.plot(missing, np.zeros(len(missing)) + 0.02, "x", color=GREY, markersize=4, transform=axes.get_xaxis_transform())
    _names(axes, trend)
    axes.spines[["top", "right"]].set_visible(False)


def _limits(axes: Axes, trend: Trend, chart: spc.Chart, at: Floats) -> str:
    axes.axhline(chart.centre, color=GREY, linewidth=0.8)
    for edge in (chart.lower, chart.upper):
        axes.plot(at, edge, color=GREY, linewidth=0.8, linestyle=(0, (2, 2)))
    ringed = sorted({one.last for one in chart.signals})
    axes.plot(at[ringed], trend.values[ringed], "o", markersize=9, markerfacecolor="none", markeredgecolor=ORANGE, zorder=4)
    told = f"{len(ringed)} point{'s' * (len(ringed) > 1)} with a signal (ringed)" if ringed else "no signal"
    return f"Grey: mean {chart.centre:.3g} and control limits (individuals, moving range); {told}."


def _names(axes: Axes, trend: Trend) -> None:
    """Some of the runs by their start, as many as can be read."""
    count = len(trend.points)
    places = range(0, count, max(1, -(-count // MOST_NAMES)))
    starts = [trend.points[place].started for place in places]
    axes.set_xticks(places, ["" if start is None else f"{start:%m-%d}\n{start:%H:%M}" for start in starts], fontsize=7)
    axes.set_xlim(-0.5, count - 0.5)
