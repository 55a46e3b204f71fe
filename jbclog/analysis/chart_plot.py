"""Charts drawn: a panel for each, capability's probability plot beside the values; a Pareto as bars."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jbclog.analysis import spc
from jbclog.analysis.charts import Charted, Counted, Ranked
from jbclog.analysis.trend_plot import BLUE, GREY, HIGH, ORANGE, WIDE
from jbclog.core.errors import UsageError

MOST_BARS = 12


def chart_figure(found: Sequence[Charted | Counted | Ranked]) -> Figure:
    """All of it, one below the other. Raises `UsageError` where there is nothing to show."""
    if not found:
        raise UsageError("there are no values of this metric; nothing to show")
    figure = Figure(figsize=(WIDE, (HIGH + 1.2) * len(found)), layout="constrained")
    for part, one in zip(figure.subfigures(len(found), 1, squeeze=False)[:, 0], found, strict=True):
        if isinstance(one, Charted):
            panels = part.subplots(2, 2, width_ratios=(3, 1))
            _values(panels, one)
        elif isinstance(one, Counted):
            axes = part.subplots()
            axes.set_title(f"{one.metric} ({one.kind})", loc="left", fontsize=10)
            _points(axes, one.counts / one.sizes, None if isinstance(one.chart, spc.Refused) else one.chart)
        else:
            _bars(part.subplots(), one)
    return figure


def _values(panels: np.ndarray, one: Charted) -> None:
    series, charts = one.series, () if isinstance(one.charts, spc.Refused) else one.charts
    title = f"{series.station} port {series.port}: {series.metric}"
    for place in range(2):
        axes = panels[place, 0]
        if place < len(charts):
            _points(axes, charts[place].points, charts[place])
            axes.set_title(f"{title}, {charts[place].name}" if place == 0 else charts[place].name, loc="left", fontsize=10)
        elif place == 0:
            _points(axes, series.values, None)
            axes.set_title(f"{title}. No limits", loc="left", fontsize=10)
        else:
            axes.set_axis_off()
        axes.set_ylabel(one.scale or series.unit, fontsize=8)
    if one.fixed is not None and one.kind == "imr":
        for edge in (one.fixed.lower[0], one.fixed.upper[0]):
            panels[0, 0].axhline(edge, color=ORANGE, linewidth=1.2, linestyle=(0, (6, 3)))
    panels[1, 1].set_axis_off()
    _probability(panels[0, 1], one)


def _points(axes: Axes, points: np.ndarray, chart: spc.Chart | None) -> None:
    at = np.arange(1, len(points) + 1)
    axes.plot(at, points, color=BLUE, marker="o", markersize=2.5, linewidth=0.7)
    axes.spines[["top", "right"]].set_visible(False)
    if chart is None:
        return
    axes.axhline(chart.centre, color=GREY, linewidth=0.8)
    for edge in (chart.lower, chart.upper):
        axes.step(at, edge, where="mid", color=GREY, linewidth=0.8, linestyle=(0, (2, 2)))
    ringed = sorted({one.last for one in chart.signals})
    axes.plot(at[ringed], points[ringed], "o", markersize=7, markerfacecolor="none", markeredgecolor=ORANGE)


def _probability(axes: Axes, one: Charted) -> None:
    """Ordered values against normal scores, and the line of the distribution that fits."""
    if len(one.series.values) < 2:
        axes.set_axis_off()
        return
    plot = spc.probability_plot(one.series.values, resolution=one.series.resolution)
    axes.plot(plot.scores, plot.values, ".", color=BLUE, markersize=3)
    if plot.line is not None:
        axes.plot(plot.scores, plot.line, color=ORANGE, linewidth=1)
    axes.set_title(plot.distribution or "no distribution fits", loc="left", fontsize=8)
    axes.set_xlabel("normal score", fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _bars(axes: Axes, one: Ranked) -> None:
    rows = one.rows[:MOST_BARS]
    axes.bar(range(len(rows)), [count for _, count, _, _ in rows], color=BLUE)
    axes.set_xticks(range(len(rows)), [name for name, *_ in rows], rotation=30, ha="right", fontsize=7)
    axes.set_title(f"{one.metric}, {one.total}", loc="left", fontsize=10)
    beside = axes.twinx()
    beside.plot(range(len(rows)), [so_far for *_, so_far in rows], color=ORANGE, marker="o", markersize=3)
    beside.set_ylim(0, 105)
    beside.set_ylabel("% up to here", fontsize=8)
