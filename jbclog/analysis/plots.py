"""Figures of comparisons, trends and charts, in the common style."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jbclog.analysis import spc
from jbclog.analysis.charts import Charted
from jbclog.analysis.clock_steps import nominal_period
from jbclog.analysis.compare import Comparison
from jbclog.analysis.count_charts import Counted, Ranked
from jbclog.analysis.figures.canvas import styled
from jbclog.analysis.figures.curves import Floats, envelope
from jbclog.analysis.figures.style import ALARM, EXTERNAL, INK, QUIET, TEMPERATURE, WIDE, Look
from jbclog.analysis.figures.trace import JOINED_PERIODS
from jbclog.analysis.run import Run
from jbclog.analysis.trend import Trend, title_of
from jbclog.core.errors import UsageError
from jbclog.core.text import count_text

HIGH_IN: Final = 2.3  # height of a panel
PARETO_IN: Final = 3.2
DPI: Final = 130
COLOURS: Final = (TEMPERATURE, ALARM)  # first and second run
COLUMNS: Final = ["time", "tick", "temperature_c"]
MOST_NAMES: Final = 12
REASON_LETTERS: Final = 90  # in a line of a reason
MOST_BARS: Final = 12
# a stated limit
LIMIT: Final[Look] = {"color": ALARM, "linewidth": 1.1, "linestyle": (0, (4.4, 1.7))}
# a limit computed from the values
EDGE: Final[Look] = {"color": QUIET, "linewidth": 0.8, "linestyle": (0, (2, 2))}
RING: Final[Look] = {
    "linestyle": "none",
    "marker": "o",
    "markerfacecolor": "none",
    "markeredgecolor": ALARM,
    "zorder": 4,
}


def _panels(count: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(WIDE.width_in, HIGH_IN * count + 0.2), layout="constrained", dpi=DPI)
    return figure, list(figure.subplots(count, 1, squeeze=False)[:, 0])


def overlay(found: Comparison) -> Figure:
    """Draw both runs, a panel for each common port: mean and min–max over seconds since the first
    tick.

    Raises `UsageError` if the runs have no port with a temperature in common.
    """
    places = [(one.station, one.port) for one in found.idle]
    if not places:
        raise UsageError(
            f"{found.first.name} and {found.second.name} have no port with a temperature in common"
        )
    with styled():
        figure, panels = _panels(len(places))
        for axes, (station, port) in zip(panels, places, strict=True):
            axes.margins(y=0.06)
            for run, colour in zip((found.first, found.second), COLOURS, strict=True):
                _line(axes, run, station, port, colour)
            axes.set_title(f"{station} port {port}: temperature in °C")
            axes.set_xlabel("seconds since the first reading was due")
            axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0.2)
    return figure


def _line(axes: Axes, run: Run, station: str, port: int, colour: str) -> None:
    rows = run.samples(station, port, columns=COLUMNS)
    if not len(rows):
        return
    seconds = _seconds(run, station, rows)
    celsius = rows["temperature_c"].to_numpy(dtype=np.float64, na_value=np.nan)
    step = nominal_period(seconds) or 1.0  # 1 s for a single row
    curve = envelope(
        seconds, np.asarray(celsius, dtype=np.float64), WIDE.stretches, JOINED_PERIODS * step
    )
    if not curve.whole:
        axes.fill_between(
            curve.seconds, curve.low, curve.high, color=colour, alpha=0.3, linewidth=0
        )
    axes.plot(curve.seconds, curve.mean, color=colour, label=run.name)


def _seconds(run: Run, station: str, rows: pd.DataFrame) -> Floats:
    """Return times on the run's grid, in s; with ``--rate max``, which has none, since the first
    row.
    """
    facts = run.manifest.station(station)
    if facts is not None and facts.period_s:
        return np.asarray(rows["tick"] * facts.period_s, dtype=np.float64)
    return np.asarray((rows["time"] - rows["time"].iloc[0]).dt.total_seconds(), dtype=np.float64)


def trend_figure(
    trends: Sequence[Trend], lower: float | None = None, upper: float | None = None
) -> Figure:
    """Draw a panel for each trend: points, control limits, stated limits, signals ringed.

    Raises `UsageError` without trends.
    """
    if not trends:
        raise UsageError("no run has this metric; nothing to show")
    with styled():
        figure, panels = _panels(len(trends))
        for axes, trend in zip(panels, trends, strict=True):
            _trend(axes, trend, lower, upper)
    return figure


def _trend(axes: Axes, trend: Trend, lower: float | None, upper: float | None) -> None:
    at = np.array(
        [place for place, point in enumerate(trend.points) if point.value is not None],
        dtype=np.float64,
    )
    for limit in (lower, upper):
        if limit is not None:
            axes.axhline(limit, **LIMIT)
            axes.text(
                1.005,
                limit,
                "limit",
                transform=axes.get_yaxis_transform(),
                color=ALARM,
                va="center",
            )
    chart = None if isinstance(trend.chart, spc.Refused) else trend.chart[0]
    _points(axes, at, trend.values, chart)
    note = (
        f"No control limits. {trend.chart.text}"
        if isinstance(trend.chart, spc.Refused)
        else _note(trend.chart[0])
    )
    axes.set_title(f"{trend.station} port {trend.port}: {title_of(trend.metric)} in {trend.uom}")
    axes.text(0.0, -0.24, note, transform=axes.transAxes, color=QUIET, va="top", wrap=True)
    missing = [place for place, point in enumerate(trend.points) if point.value is None]
    axes.plot(
        missing,
        np.full(len(missing), 0.02),
        "x",
        color=QUIET,
        markersize=4,
        transform=axes.get_xaxis_transform(),
    )
    _names(axes, trend)


def _note(chart: spc.Chart) -> str:
    ringed = len(_signals(chart))
    found = f"{count_text(ringed, 'point')} with a signal (ringed)" if ringed else "no signal"
    return f"Grey: mean {chart.centre:.3g} and control limits (individuals, moving range); {found}."


def _names(axes: Axes, trend: Trend) -> None:
    """Label at most `MOST_NAMES` of the runs with their start."""
    count = len(trend.points)
    places = range(0, count, max(1, -(-count // MOST_NAMES)))
    starts = [trend.points[place].start for place in places]
    axes.set_xticks(
        places, ["" if start is None else f"{start:%m-%d}\n{start:%H:%M}" for start in starts]
    )
    axes.set_xlim(-0.5, count - 0.5)


def _points(axes: Axes, at: Floats, values: Floats, chart: spc.Chart | None) -> None:
    """Draw values in order; with a chart also its centre, limits and ringed signals."""
    axes.margins(x=0.01, y=0.08)
    axes.plot(at, values, color=TEMPERATURE, marker="o", markersize=2.5, linewidth=0.7)
    if chart is None:
        return
    axes.axhline(chart.centre, color=QUIET, linewidth=0.8)
    for edge in (chart.lower, chart.upper):
        axes.step(at, edge, where="mid", **EDGE)
    signals = _signals(chart)
    axes.plot(at[signals], values[signals], markersize=7, **RING)


def _signals(chart: spc.Chart) -> list[int]:
    return sorted({one.last for one in chart.signals})


def chart_figure(found: Sequence[Charted | Counted | Ranked]) -> Figure:
    """Draw all charts, one below the other. Raises `UsageError` without charts."""
    if not found:
        raise UsageError("there are no values of this metric; nothing to show")
    with styled():
        figure = Figure(
            figsize=(WIDE.width_in, PARETO_IN * len(found)), layout="constrained", dpi=DPI
        )
        for part, one in zip(
            figure.subfigures(len(found), 1, squeeze=False)[:, 0], found, strict=True
        ):
            if isinstance(one, Charted):
                _values(part.subplots(2, 2, width_ratios=(3, 1)), one)
            elif isinstance(one, Counted):
                _counts(part.subplots(), one)
            else:
                _bars(part.subplots(), one)
    return figure


def _counts(axes: Axes, one: Counted) -> None:
    axes.set_title(f"{one.metric} ({one.kind})")
    _points(
        axes,
        _numbers(one.counts),
        one.counts / one.sizes,
        None if isinstance(one.chart, spc.Refused) else one.chart,
    )


def _numbers(values: Floats) -> Floats:
    return np.arange(1, len(values) + 1, dtype=np.float64)


def _values(panels: np.ndarray, one: Charted) -> None:
    series, charts = one.series, () if isinstance(one.charts, spc.Refused) else one.charts
    title = f"{series.station} port {series.port}: {series.metric} in {one.scale or series.uom}"
    for place in range(2):
        axes = panels[place, 0]
        if place < len(charts):
            _points(axes, _numbers(charts[place].points), charts[place].points, charts[place])
            axes.set_title(f"{title}, {charts[place].name}" if place == 0 else charts[place].name)
        elif place == 0:
            _points(axes, _numbers(series.values), series.values, None)
            axes.set_title(title)
        else:
            axes.set_axis_off()
    if isinstance(one.charts, spc.Refused):
        _reason(panels[1, 0], f"No control limits. {one.charts.text}")
    if one.fixed is not None and one.kind == "imr":
        for edge in (one.fixed.lower[0], one.fixed.upper[0]):
            panels[0, 0].axhline(edge, **LIMIT)
    panels[1, 1].set_axis_off()
    _probability(panels[0, 1], one)


def _reason(axes: Axes, text: str) -> None:
    """Write why there is no chart into the axes in which it would be."""
    lines = fill(text, REASON_LETTERS)
    axes.text(0.0, 1.0, lines, transform=axes.transAxes, color=INK, va="top")


def _probability(axes: Axes, one: Charted) -> None:
    """Draw ordered values against normal scores, and the line of the fitted distribution."""
    if len(one.series.values) < 2:
        axes.set_axis_off()
        return
    axes.margins(0.05)
    plot = spc.probability_plot(one.series.values, resolution=one.series.resolution)
    axes.plot(plot.scores, plot.values, ".", color=TEMPERATURE, markersize=3)
    if plot.line is not None:
        axes.plot(plot.scores, plot.line, color=ALARM, linewidth=1)
    axes.set_title(plot.distribution or "no distribution fits")
    axes.set_xlabel("normal score")


def _bars(axes: Axes, one: Ranked) -> None:
    """Draw counts as bars, the most frequent first, and their cumulative share as a line."""
    rows = one.rows[:MOST_BARS]
    axes.bar(range(len(rows)), [count for _, count, _, _ in rows], color=TEMPERATURE)
    axes.set_xticks(range(len(rows)), [name for name, *_ in rows], rotation=30, ha="right")
    axes.set_title(f"{one.metric}, {one.total}")
    axes.grid(visible=False, axis="x")
    shares = axes.twinx()
    shares.plot(
        range(len(rows)), [so_far for *_, so_far in rows], color=EXTERNAL, marker="o", markersize=3
    )
    shares.set_ylim(0, 105)
    shares.set_ylabel("cumulative %")
    shares.grid(visible=False)
