"""Joint after joint as small multiples: how far below its setpoint the tip begins, and how long it takes to be back.

The recovery has individuals and moving ranges with limits where `spc` allows them. Where it refuses (too few, alike to their
neighbours, a spread below the resolution), and where too many joints were followed by the next before the tip was back, the points
are drawn without limits, and the caption says why. A joint that was followed so stands at the time that it had, with an arrow: its
recovery is longer. Of more joints than can be told apart each stretch has its least and greatest; points that signal always are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.charts import too_many_late
from jbclog.analysis.spc import Chart, Refused, control_chart
from jbclog.report import style
from jbclog.report.drawing import Drawing, Stroke
from jbclog.report.panel import Panel
from jbclog.report.scale import Scale, round_marks
from jbclog.report.style import Format
from jbclog.report.trace import envelope

Floats = NDArray[np.float64]

LEFT, RIGHT, TOP, BOTTOM, BETWEEN = 36.0, 62.0, 12.0, 19.0, 15.0
UPPER_PT, LOWER_PT = 74.0, 34.0  # the heights of individuals, and of deficits and moving ranges
FEWEST: Final = 5  # joints from which on a chart says more than a row of numbers
MOST_DOTS: Final = 300
ARROW_PT: Final = 5.0
LIMIT = Stroke(style.ALARM, 0.9, (4.4, 1.7))
CENTRE = Stroke(style.INK, 0.7)
JOINED = Stroke(style.TEMPERATURE_BAND, 0.7)


@dataclass(frozen=True, slots=True, eq=False)
class Charted:
    """The recovery of those joints that have one, by their number; the chart, or why it has no limits.

    `deficits`: setpoint minus temperature at the start, of every joint (NaN: not known). `late`: the numbers of the joints that the
    next one followed before the tip was back, and the time in s that each had.
    """

    numbers: Floats
    seconds: Floats
    joints: int
    found: tuple[Chart, Chart] | Refused
    deficits: Floats
    late: tuple[Floats, Floats]

    @property
    def chart(self) -> tuple[Chart, Chart] | None:
        return None if isinstance(self.found, Refused) else self.found

    @property
    def why(self) -> tuple[str | None, str | None]:
        """Why it has no limits, as a sentence and in a word."""
        return (self.found.text, self.found.kind) if isinstance(self.found, Refused) else (None, None)

    @property
    def is_worth_it(self) -> bool:
        return len(self.seconds) + len(self.late[0]) >= FEWEST

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
        said = f"Deficit and recovery of one joint after the other. {self._have}"
        if self.chart is None:
            return f"{said} Without limits: {self.why[0]}"
        tests = list(dict.fromkeys(one.text for one in self.chart[0].signals))
        found = "No point is out of the ordinary" if not tests else f"{_points(len(self.signalling))} ({'; '.join(tests)})"
        chart = self.chart[0]
        limits = "three sigma" if chart.distribution == "normal" else f"percentiles 0.135 and 99.865 ({chart.distribution})"
        return f"{said} Individuals and moving ranges with limits at {limits} (I-MR, Nelson's tests 1, 2, 3 and 5). {found}."

    @property
    def _have(self) -> str:
        """How many joints have a recovery, and what the arrows are."""
        back, late = len(self.seconds), len(self.late[0])
        have = "All joints have a recovery." if back == self.joints else f"{back} of {self.joints} joints have a recovery."
        return f"{have}{' Arrows: longer, as the next joint came before the tip was back.' if late else ''}"


def _points(count: int) -> str:
    return f"{count} point{'s' * (count > 1)} out of the ordinary"


def charted(recovery: Floats, resolution: float | None, deficits: Floats | None = None, had: Floats | None = None) -> Charted:
    """The chart of these recoveries (NaN: none) in the order of their joints.

    `had`: the time in s until the next joint, where that came before the tip was back; NaN elsewhere.
    """
    none = np.full(len(recovery), np.nan)
    there, had = ~np.isnan(recovery), none if had is None else had
    seconds, numbers = recovery[there], np.flatnonzero(there).astype(np.float64) + 1
    late = ~np.isnan(had)
    waited = (np.flatnonzero(late).astype(np.float64) + 1, had[late])
    found = too_many_late(len(waited[0]), len(seconds)) or control_chart(seconds, resolution=resolution)
    return Charted(numbers, seconds, len(recovery), found, none if deficits is None else deficits, waited)


def draw_chart(one: Charted, form: Format) -> Drawing:
    """The drawing: the deficits where they are known, the recoveries, and where these have limits their moving ranges."""
    deficits = np.flatnonzero(~np.isnan(one.deficits))
    heights = [*([LOWER_PT] if len(deficits) else []), UPPER_PT, *([] if one.chart is None else [LOWER_PT])]
    drawing = Drawing(form.width_pt, TOP + sum(heights) + BETWEEN * (len(heights) - 1) + BOTTOM)
    last = max(float(one.joints), 2.0)
    x = Scale(0.5, last + 0.5, LEFT, form.width_pt - RIGHT)
    marks = [(mark, f"{mark:g}") for mark in round_marks(1, last, form.time_marks)]
    tops = [TOP + sum(heights[:row]) + BETWEEN * row for row in range(len(heights))]
    panels = [_panel(drawing, form, x, top, height) for top, height in zip(tops, heights, strict=True)]
    moments, rows = [mark for mark, _ in marks], iter(panels)
    if len(deficits):
        _deficits(next(rows), deficits.astype(np.float64) + 1, one.deficits[deficits], moments)
    _recoveries(next(rows), one, moments)
    if one.chart is not None:
        lower = next(rows)
        _row(lower, one.numbers[1:], one.chart[1].points, one.chart[1], [], moments)
        lower.headed("Difference to the one before in s")
    panels[-1].timed(marks)
    return drawing


def _deficits(place: Panel, numbers: Floats, celsius: Floats, marks: list[float]) -> None:
    """How far below its setpoint the tip began each joint; 0 is on the scale, so that a small one looks small."""
    panel = _grounded(place, np.append(celsius, [0.0, 5.0]), marks)
    middle = float(np.median(celsius))
    _level(panel, middle, CENTRE)
    panel.labelled([(middle, f"median {middle:.1f}", style.INK)])
    _points_of(panel, numbers, celsius, "deficit")
    panel.headed("Below the setpoint at the start in °C")


def _recoveries(place: Panel, one: Charted, marks: list[float]) -> None:
    limits = None if one.chart is None else one.chart[0]
    _row(place, one.numbers, one.seconds, limits, one.signalling, marks, one.late)
    place.headed("Recovery in s, by number of the joint")


def _panel(drawing: Drawing, form: Format, x: Scale, top: float, height: float) -> Panel:
    return Panel(drawing, form, LEFT, top, x.end - LEFT, height, x, Scale(0.0, 1.0, top + height, top))


def _row(
    place: Panel,
    numbers: Floats,
    values: Floats,
    chart: Chart | None,
    signalling: list[int],
    marks: list[float],
    late: tuple[Floats, Floats] = (np.empty(0), np.empty(0)),
) -> None:
    limits = np.empty(0) if chart is None else np.array([chart.lower[0], chart.upper[0]])
    arrows = late[1] + (1.5 * ARROW_PT / place.height * float(np.ptp(late[1])) if len(late[1]) else 0.0)
    panel = _grounded(place, np.concatenate([values, limits, late[1], arrows]), marks)
    if len(values):
        _lines(panel, values, chart)
        _points_of(panel, numbers, values, "recovery")
    _late(panel, *late)
    for where in signalling:
        panel.drawing.dots(panel.x.at([numbers[where]]), panel.y.at([values[where]]), 4.2, style.ALARM, "signal")


def _grounded(place: Panel, values: Floats, marks: list[float]) -> Panel:
    """The field with a scale that holds these values."""
    air = max(0.08 * float(np.ptp(values)), 0.02)
    panel = place.scaled(float(values.min()) - air, float(values.max()) + air)
    steps = round_marks(panel.y.low, panel.y.high, 4 if panel.height > LOWER_PT else 2, whole=False)
    panel.ruled(marks, steps)
    panel.numbered(steps)
    panel.framed()
    return panel


def _late(panel: Panel, numbers: Floats, seconds: Floats) -> None:
    """An arrow upwards from the time that each of these joints had."""
    if not len(numbers):
        return
    if len(numbers) > MOST_DOTS:
        curve = envelope(numbers, seconds, MOST_DOTS, float("inf"))
        numbers, seconds = curve.seconds, curve.low
    x, y = panel.x.at(numbers), panel.y.at(seconds)
    panel.drawing.bars(x, y, y - ARROW_PT, Stroke(style.ALARM, 0.9), "late")
    head = np.column_stack([x - 1.4, x, x + 1.4, np.full(len(x), np.nan)]).ravel()
    tips = np.column_stack([y - ARROW_PT + 1.6, y - ARROW_PT, y - ARROW_PT + 1.6, np.full(len(x), np.nan)]).ravel()
    panel.drawing.line(head, tips, Stroke(style.ALARM, 0.9), "late")


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


def _points_of(panel: Panel, numbers: Floats, values: Floats, of: str) -> None:
    if len(values) <= MOST_DOTS:
        panel.drawing.line(panel.x.at(numbers), panel.y.at(values), JOINED)
        panel.drawing.dots(panel.x.at(numbers), panel.y.at(values), 2.0, style.TEMPERATURE, of)
        return
    curve = envelope(numbers, values, MOST_DOTS, float("inf"))
    at = panel.x.at(curve.seconds)
    panel.drawing.bars(at, panel.y.at(curve.low), panel.y.at(curve.high), Stroke(style.TEMPERATURE_BAND, 1.0), of)
    panel.drawing.dots(at, panel.y.at(curve.mean), 1.6, style.TEMPERATURE, of)
