"""The recovery of joint after joint as a small chart: individuals and moving ranges with limits where `spc` allows them.

Where it refuses (too few, alike to their neighbours, a spread below the resolution) the points are drawn without limits, and the
caption says why. Of more joints than can be told apart each stretch has its least and greatest; points that signal always are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.report import style
from jbclog.report.drawing import Drawing, Stroke
from jbclog.report.envelope import envelope
from jbclog.report.panel import Panel
from jbclog.report.scale import Scale, round_marks
from jbclog.report.style import Format
from jbclog.spc import Chart, Refused, control_chart

Floats = NDArray[np.float64]

LEFT, RIGHT, TOP, BOTTOM, BETWEEN = 36.0, 62.0, 12.0, 19.0, 15.0
UPPER_PT, LOWER_PT = 74.0, 34.0  # the heights of individuals and of moving ranges
FEWEST: Final = 5  # joints from which on a chart says more than a row of numbers
MOST_DOTS: Final = 300
LIMIT = Stroke(style.ALARM, 0.9, (4.4, 1.7))
CENTRE = Stroke(style.INK, 0.7)
JOINED = Stroke(style.TEMPERATURE_BAND, 0.7)


@dataclass(frozen=True, slots=True, eq=False)
class Charted:
    """The recovery of those joints that have one, by their number; the chart, or why it has no limits."""

    numbers: Floats
    seconds: Floats
    joints: int
    found: tuple[Chart, Chart] | Refused

    @property
    def chart(self) -> tuple[Chart, Chart] | None:
        return None if isinstance(self.found, Refused) else self.found

    @property
    def why(self) -> tuple[str | None, str | None]:
        """Why it has no limits, as a sentence and in a word."""
        return (self.found.text, self.found.kind) if isinstance(self.found, Refused) else (None, None)

    @property
    def is_worth_it(self) -> bool:
        return len(self.seconds) >= FEWEST

    @property
    def signals(self) -> int | None:
        """How many points of the individuals are out of the ordinary; None where the chart has no limits."""
        return None if self.chart is None else len(self.signalling)

    @property
    def signalling(self) -> list[int]:
        """The places of these points."""
        return [] if self.chart is None else sorted({one.last for one in self.chart[0].signals})

    @property
    def caption(self) -> str:
        """What it shows, and what it refuses to."""
        have = "all" if len(self.seconds) == self.joints else f"{len(self.seconds)} of {self.joints}"
        said = f"Recovery of one joint after the other; {have} {'have' if len(self.seconds) != 1 else 'has'} one."
        if self.chart is None:
            return f"{said} Without limits: {self.why[0]}"
        tests = list(dict.fromkeys(one.text for one in self.chart[0].signals))
        found = "No point is out of the ordinary" if not tests else f"{_points(len(self.signalling))} ({'; '.join(tests)})"
        chart = self.chart[0]
        limits = "three sigma" if chart.distribution == "normal" else f"percentiles 0.135 and 99.865 ({chart.distribution})"
        return f"{said} Individuals and moving ranges with limits at {limits} (I-MR, Nelson's tests 1, 2, 3 and 5). {found}."


def _points(count: int) -> str:
    return f"{count} point{'s' * (count > 1)} out of the ordinary"


def charted(recovery: Floats, resolution: float | None) -> Charted:
    """The chart of these recoveries (NaN: none) in the order of their joints."""
    there = ~np.isnan(recovery)
    seconds, numbers = recovery[there], np.flatnonzero(there).astype(np.float64) + 1
    return Charted(numbers, seconds, len(recovery), control_chart(seconds, resolution=resolution))


def draw_chart(one: Charted, form: Format) -> Drawing:
    """The drawing; the moving ranges are below where there are limits."""
    lower = 0.0 if one.chart is None else BETWEEN + LOWER_PT
    drawing = Drawing(form.width_pt, TOP + UPPER_PT + lower + BOTTOM)
    last = max(float(one.joints), 2.0)
    x = Scale(0.5, last + 0.5, LEFT, form.width_pt - RIGHT)
    marks = [(mark, f"{mark:g}") for mark in round_marks(1, last, form.time_marks)]
    top = _panel(drawing, form, x, TOP, UPPER_PT)
    _row(top, one.numbers, one.seconds, None if one.chart is None else one.chart[0], one.signalling, [mark for mark, _ in marks])
    top.headed("Recovery in s, by number of the joint")
    bottom = top
    if one.chart is not None:
        bottom = _panel(drawing, form, x, TOP + UPPER_PT + BETWEEN, LOWER_PT)
        _row(bottom, one.numbers[1:], one.chart[1].points, one.chart[1], [], [mark for mark, _ in marks])
        bottom.headed("Difference to the one before in s")
    bottom.timed(marks)
    return drawing


def _panel(drawing: Drawing, form: Format, x: Scale, top: float, height: float) -> Panel:
    return Panel(drawing, form, LEFT, top, x.end - LEFT, height, x, Scale(0.0, 1.0, top + height, top))


def _row(place: Panel, numbers: Floats, values: Floats, chart: Chart | None, signalling: list[int], marks: list[float]) -> None:
    limits = np.empty(0) if chart is None else np.array([chart.lower[0], chart.upper[0]])
    all_of_it = np.concatenate([values, limits])
    air = max(0.08 * float(np.ptp(all_of_it)), 0.02)
    panel = place.scaled(float(all_of_it.min()) - air, float(all_of_it.max()) + air)
    steps = round_marks(panel.y.low, panel.y.high, 4 if panel.height > LOWER_PT else 2, whole=False)
    panel.ruled(marks, steps)
    panel.numbered(steps)
    panel.framed()
    _lines(panel, values, chart)
    _points_of(panel, numbers, values)
    for where in signalling:
        panel.drawing.dots(panel.x.at([numbers[where]]), panel.y.at([values[where]]), 4.2, style.ALARM, "signal")


def _lines(panel: Panel, values: Floats, chart: Chart | None) -> None:
    """Centre and limits with their figures; without limits the median."""
    if chart is None:
        middle = float(np.median(values))
        _level(panel, middle, CENTRE)
        panel.labelled([(middle, f"median {middle:.2f}", style.INK)])
        return
    middle_name = "mean" if chart.distribution == "normal" or chart.name != "individuals" else "median"
    ends = [(float(chart.upper[0]), "limit"), (chart.centre, middle_name), (float(chart.lower[0]), "limit")]
    for value, name in ends:
        _level(panel, value, LIMIT if name == "limit" else CENTRE)
    told = [one for one in ends if one[0] > 0 or one[1] != "limit"]
    panel.labelled([(value, f"{name} {value:.2f}", style.ALARM if name == "limit" else style.INK) for value, name in told])


def _level(panel: Panel, value: float, stroke: Stroke) -> None:
    y = panel.y.place(value)
    panel.drawing.line([panel.left, panel.right], [y, y], stroke, "limit")


def _points_of(panel: Panel, numbers: Floats, values: Floats) -> None:
    if len(values) <= MOST_DOTS:
        panel.drawing.line(panel.x.at(numbers), panel.y.at(values), JOINED)
        panel.drawing.dots(panel.x.at(numbers), panel.y.at(values), 2.0, style.TEMPERATURE, "recovery")
        return
    curve = envelope(numbers, values, MOST_DOTS, float("inf"))
    at = panel.x.at(curve.seconds)
    panel.drawing.bars(at, panel.y.at(curve.low), panel.y.at(curve.high), Stroke(style.TEMPERATURE_BAND, 1.0), "recovery")
    panel.drawing.dots(at, panel.y.at(curve.mean), 1.6, style.TEMPERATURE, "recovery")
