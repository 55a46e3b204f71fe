"""The figure of a run for notebooks: each port as in the report, one below the other."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from matplotlib.figure import Figure

from jbclog.analysis.figures.canvas import new_figure, styled
from jbclog.analysis.figures.from_samples import columns_of, has_air, has_only_states, trace
from jbclog.analysis.figures.lanes import lanes_of
from jbclog.analysis.figures.marks import happenings, limits_of, marks_of
from jbclog.analysis.figures.port import draw_at, height_pt
from jbclog.analysis.figures.style import INK, WIDE, Look
from jbclog.analysis.figures.trace import Grid, Trace
from jbclog.analysis.run_joints import OF_SPANS, joints_of_port, spans_of
from jbclog.analysis.run_metrics import joints_of
from jbclog.analysis.run_tables import RunTables
from jbclog.core.errors import UsageError

HEADING_PT: Final = 17.0
DPI: Final = 130  # resolution of the picture in a notebook


def plot(run: RunTables, station: str | None = None, port: int | None = None) -> Figure:
    """Draw each port: temperature, power, status, joints, missing data, alarms and errors, over
    days (UTC).

    Each panel has one linear scale over its whole range. Raises `UsageError` without samples.
    """
    ports = [(f"{name} port {number}", one) for name, number, one in _traces(run, station, port)]
    if not ports:
        raise UsageError(
            f"{run.name} has no samples of station {station or 'any'}, port {port or 'any'}"
        )
    drawn = [(title, one, lanes_of(one, WIDE)) for title, one in ports]
    heights = [HEADING_PT + height_pt(one, lanes, WIDE) for _, one, lanes in drawn]
    with styled():
        figure, top = new_figure(WIDE.width_pt, sum(heights), DPI), 0.0
        for height, (title, one, lanes) in zip(heights, drawn, strict=True):
            look: Look = {
                "fontsize": WIDE.font_pt + 1.5,
                "weight": "bold",
                "color": INK,
                "va": "top",
            }
            figure.text(3 / WIDE.width_pt, 1 - (top + 4) / sum(heights), title, **look)
            for axes in draw_at(figure, top + HEADING_PT, one, lanes, WIDE, has_knee=False):
                axes.set_label(title)
            top += height
    return figure


def _traces(run: RunTables, station: str | None, port: int | None) -> list[tuple[str, int, Trace]]:
    """Return the ports that have samples, in the order of the line file."""
    t0_utc_us = run.manifest.t0_utc_us
    events = happenings(run.events(), t0_utc_us)
    limits = limits_of(run.settings(), t0_utc_us)
    joints = joints_of(run, station)
    found = []
    for facts in run.manifest.stations:
        if station not in (None, facts.name):
            continue
        columns = ["port", *columns_of(facts)]
        of_states, of_air = has_only_states(facts), has_air(facts)
        for number, rows in run.samples(facts.name, port, columns=columns).groupby("port"):
            own, grid = int(str(number)), Grid(t0_utc_us, facts.period_s)
            one = trace(rows, grid, of_states=of_states, of_air=of_air)
            marks = marks_of(events, facts.name, own)
            spans = spans_of(joints_of_port(joints, facts.name, own, OF_SPANS))
            in_force = limits.get((facts.name, own), [])
            drawn = replace(one, limits=in_force, marks=marks, joints=spans)
            found.append((facts.name, own, drawn))
    return found
