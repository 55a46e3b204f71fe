"""The figures of a run on paper: each port's heading, words and drawing, kept until the sheets are filled.

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
BELOW_IN = 0.16


@dataclass(frozen=True, slots=True)
class Plate:
    """A figure with what stands above it."""

    heading: str
    caption: str
    drawing: Drawing

    def set_on(self, paper: Paper) -> None:
        """All of it on one sheet."""
        lines = wrapped(self.caption, TEXT, INNER)
        paper.need(HEAD.line_in + len(lines) * TEXT.line_in + self.drawing.height / 72)
        paper.put(self.heading, SIDE, HEAD)
        paper.skip(HEAD.line_in)
        paper.say(self.caption, TEXT)
        paper.draw(self.drawing)
        paper.skip(BELOW_IN)


@dataclass(slots=True)
class Plates:
    """The figures in their order."""

    plates: list[Plate] = field(default_factory=list)
    overview: Overview | None = None

    def overview_from(self, t0_utc_s: float) -> Overview:
        """The run at a glance, still empty."""
        self.overview = Overview(round(t0_utc_s * 1e6))
        return self.overview

    def add(self, heading: str, caption: str, drawing: Drawing) -> None:
        """One more figure."""
        self.plates.append(Plate(heading, caption, drawing))

    def set_on(self, paper: Paper) -> None:
        """All figures, where the paper is filled to."""
        paper.skip(BELOW_IN)
        for plate in self.plates:
            plate.set_on(paper)
