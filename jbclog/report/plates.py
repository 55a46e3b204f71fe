"""The figures of a run on paper: each port's heading, figures in a row and drawing, set onto sheets as they come.

They are drawn while the samples of a port are there, so that only one station's samples are in memory;
what is kept are thinned curves.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from jbclog.report import style
from jbclog.report.drawing import Drawing
from jbclog.report.overview import Overview
from jbclog.report.paper import INNER, SIDE, Paper, Type, wrapped

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

    def add(self, heading: str, caption: str, drawing: Drawing) -> None:
        """A figure with what stands above it, all on one sheet."""
        lines = wrapped(caption, TEXT, INNER)
        self.paper.need(HEAD.line_in + len(lines) * TEXT.line_in + drawing.height / 72 + 0.2)
        self.paper.put(heading, SIDE, HEAD)
        self.paper.skip(HEAD.line_in)
        self.paper.say(caption, TEXT)
        self.paper.draw(drawing)
        self.paper.skip(0.16)
