"""The figures of a run on paper: each port's heading, figures in a row and drawing, set onto sheets as they come.

They are drawn while the samples of a port are there, so that only one station's samples are in memory;
what is kept are thinned curves.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from jbclog.report import style
from jbclog.report.figure import fill, height_in
from jbclog.report.lanes import lanes_of
from jbclog.report.overview import Overview
from jbclog.report.paper import INNER, SIDE, Paper, Type, printing, wrapped
from jbclog.report.trace import Trace

HEAD, TEXT = Type(10, bold=True), Type(7, colour=style.QUIET)


@dataclass(slots=True)
class Plates:
    """Sheets of figures."""

    paper: Paper = field(default_factory=Paper)
    overview: Overview | None = None

    def overview_from(self, t0_utc_s: float) -> Overview:
        """The run at a glance, still empty."""
        self.overview = Overview(round(t0_utc_s * 1e6))
        return self.overview

    def add(self, heading: str, caption: str, trace: Trace) -> None:
        """A figure with what stands above it, all on one sheet."""
        with printing():
            lanes = lanes_of(trace, style.PRINT)
            height = height_in(trace, lanes, style.PRINT)
            lines = wrapped(caption, TEXT, INNER)
            self.paper.need(HEAD.line_in + len(lines) * TEXT.line_in + height + 0.2)
            self.paper.put(heading, SIDE, HEAD)
            self.paper.skip(HEAD.line_in)
            self.paper.say(caption, TEXT)
            fill(self.paper.sheet, trace, lanes, style.PRINT, SIDE, self.paper.y)
            self.paper.skip(height + 0.16)
