"""Charts, comparisons and trends drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jbclog.analysis import spc
from jbclog.analysis.charts import Charted, Counted, Ranked
from jbclog.analysis.compare import Comparison
from jbclog.analysis.plot import thinned
from jbclog.analysis.run import Run
from jbclog.analysis.trend import Trend, title_of
from jbclog.analysis.verdict.idle import Floats
from jbclog.core.errors import UsageError

# -- compare plot -------------------------------------------------------------------------------------------------------------
# Two runs in one picture: a panel a port, both temperatures over the seconds since the first reading was due.

COMPARE_WIDE, COMPARE_HIGH = 9.5, 3.0  # inches of a panel
COLOURS: Final = ("#0072b2", "#e69f00")  # told apart by the colour-blind, and in grey by their lightness
COLUMNS: Final = ["time", "tick", "temperature_c", "set_c"]


def overlay(found: Comparison) -> Figure:
    """A panel for each port that both have. Raises `UsageError` where there is none."""
    places = [(one.station, one.port) for one in found.idle]
    if not places:
        raise UsageError(f"{found.first.name} and {found.second.name} have no port in common that tells a temperature")
    figure = Figure(figsize=(COMPARE_WIDE, COMPARE_HIGH * len(places)), layout="constrained")
    for axes, (station, port) in zip(figure.subplots(len(places), 1, squeeze=False)[:, 0], places, strict=True):
        for run, colour in zip((found.first, found.second), COLOURS, strict=True):
            _line(axes, run, station, port, colour)
        axes.set_title(f"{station} port {port}", loc="left", fontsize=10)
        axes.set_ylabel("°C")
        axes.set_xlabel("seconds since the first reading was due", fontsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), frameon=False, ncols=2, fontsize=8, borderaxespad=0.2)
    return figure


def _line(axes: Axes, run: Run, station: str, port: int, colour: str) -> None:
    rows = thinned(run.samples(station, port, columns=COLUMNS))
    if not len(rows):
        return
    seconds = _seconds(run, station, rows)
    celsius = rows["temperature_c"].to_numpy(dtype=np.float64, na_value=np.nan)
    axes.plot(seconds, celsius, color=colour, linewidth=0.9, alpha=0.85, label=run.name)


def _seconds(run: Run, station: str, rows: pd.DataFrame) -> Floats:
    """On the run's grid; with ``--rate max``, which has none, since the first row."""
    facts = run.manifest.station(station)
    if facts is not None and facts.period_s:
        return np.asarray(rows["tick"] * facts.period_s, dtype=np.float64)
    return np.asarray((rows["time"] - rows["time"].iloc[0]).dt.total_seconds(), dtype=np.float64)


# -- trend plot ---------------------------------------------------------------------------------------------------------------
# Trends as a picture: a panel a port, the points, the control limits, the stated limits, signals ringed.

TREND_WIDE, TREND_HIGH = 9.5, 2.9  # inches of a panel
BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#595959"  # told apart by the colour-blind, and in grey by their lightness
MOST_NAMES: Final = 12


def trend_figure(trends: Sequence[Trend], lower: float | None = None, upper: float | None = None) -> Figure:
    """A panel for each trend. Raises `UsageError` where there is nothing to show."""
    if not trends:
        raise UsageError("there is no run with this metric; nothing to show")
    figure = Figure(figsize=(TREND_WIDE, TREND_HIGH * len(trends) + 0.2), layout="constrained")
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


# -- chart plot ---------------------------------------------------------------------------------------------------------------
# Charts drawn: a panel for each, capability's probability plot beside the values; a Pareto as bars.

MOST_BARS = 12


def chart_figure(found: Sequence[Charted | Counted | Ranked]) -> Figure:
    """All of it, one below the other. Raises `UsageError` where there is nothing to show."""
    if not found:
        raise UsageError("there are no values of this metric; nothing to show")
    figure = Figure(figsize=(TREND_WIDE, (TREND_HIGH + 1.2) * len(found)), layout="constrained")
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
