"""The trace of a port from its rows, and the figure of some ports, one below the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from matplotlib.figure import Figure

from jbclog.analysis.figures.canvas import new_figure, styled
from jbclog.analysis.figures.from_samples import gap_spans, has_air, has_only_states, trace
from jbclog.analysis.figures.lanes import lanes_of
from jbclog.analysis.figures.port import draw_at, height_pt
from jbclog.analysis.figures.style import INK, WIDE, Look
from jbclog.analysis.figures.trace import Grid, Trace
from jbclog.analysis.port_data import SETPOINT, PortData
from jbclog.analysis.verdict import judged_signals
from jbclog.core.errors import UsageError

HEADING_PT: Final = 17.0
DPI: Final = 130  # resolution of the picture in a notebook


def figure_of(data: PortData) -> Figure:
    """Draw a port with its gaps. Raises `UsageError` without a row."""
    if not len(data):
        raise UsageError(f"{data.facts.name} port {data.port} has no samples")
    signal, *_ = judged_signals(data.facts)
    drawn = replace(trace_of(data), gaps=gap_spans(data.gaps(signal), data.t0_us))
    return figure_of_traces([(f"{data.facts.name} port {data.port}", drawn)])


def trace_of(data: PortData) -> Trace:
    """Return the trace of a port, without its gaps."""
    rows = data.frame().assign(**{SETPOINT: data.setpoint_read})
    return trace(
        rows,
        Grid(data.t0_us, data.period_s),
        of_states=has_only_states(data.facts),
        of_air=has_air(data.facts),
    )


def figure_of_traces(ports: Sequence[tuple[str, Trace]]) -> Figure:
    """Draw each port below its title. Each panel has one linear scale over its whole range."""
    drawn = [(title, port, lanes_of(port, WIDE)) for title, port in ports]
    heights = [HEADING_PT + height_pt(port, lanes, WIDE) for _, port, lanes in drawn]
    height_of_all = sum(heights)
    look: Look = {"fontsize": WIDE.font_pt + 1.5, "weight": "bold", "color": INK, "va": "top"}
    with styled():
        figure = new_figure(WIDE.width_pt, height_of_all, DPI)
        top = 0.0
        for height, (title, port, lanes) in zip(heights, drawn, strict=True):
            figure.text(3 / WIDE.width_pt, 1 - (top + 4) / height_of_all, title, **look)
            for axes in draw_at(figure, top + HEADING_PT, port, lanes, WIDE, has_knee=False):
                axes.set_label(title)
            top += height
    return figure
