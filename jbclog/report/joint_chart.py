"""Deficit and recovery joint by joint: how far below its setpoint the tip begins, and how long it
takes to recover.

Recoveries are individuals and moving ranges, with limits if `spc` allows them. If it refuses (too
few values, autocorrelation, a spread below the resolution), or if the next joint too often began
before the tip recovered, there are no limits, and the caption states why. Such a joint has an arrow
at the time until the next joint: its recovery is longer. If there are too many joints to see each,
minimum and maximum of each interval are drawn, and always the points with a signal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jbclog.analysis.charts import too_many_late
from jbclog.analysis.figures import style
from jbclog.analysis.figures.axes import Label, bars, dots, labelled, panel, size_pt, ticked, valued
from jbclog.analysis.figures.canvas import new_figure, styled
from jbclog.analysis.figures.curves import Floats, envelope
from jbclog.analysis.figures.style import Format, Look
from jbclog.analysis.figures.ticks import round_values
from jbclog.analysis.spc import Chart, Refused, control_chart
from jbclog.core.text import count_text

LEFT, RIGHT, TOP, BOTTOM, BETWEEN = 38.0, 62.0, 12.0, 19.0, 15.0
UPPER_PT, LOWER_PT = 74.0, 34.0  # heights of individuals, and of deficits and moving ranges
FEWEST: Final = 5  # joints from which on a chart is drawn
MOST_DOTS: Final = 300
ARROW_PT: Final = 5.0
LIMIT: Final[Look] = {"color": style.ALARM, "linewidth": 0.9, "dashes": (4.4, 1.7)}
CENTRE: Final[Look] = {"color": style.INK, "linewidth": 0.7}
JOINED: Final[Look] = {"color": style.TEMPERATURE_BAND, "linewidth": 0.7}
ARROW: Final[Look] = {"color": style.ALARM, "linewidth": 0.9}


@dataclass(frozen=True, slots=True, eq=False)
class RecoveryChart:
    """The recoveries by the number of their joint; the chart, or why it has no limits.

    `deficits`: setpoint minus temperature at the start, of every joint (NaN: not known). `late`:
    the numbers of the joints that the next one followed before the tip recovered, and the time in s
    that each had.
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
        """Why it has no limits, as a sentence and as a word."""
        return (
            (self.found.text, self.found.kind) if isinstance(self.found, Refused) else (None, None)
        )

    @property
    def is_worth_it(self) -> bool:
        return len(self.seconds) + len(self.late[0]) >= FEWEST

    @property
    def signals(self) -> int | None:
        """Number of individuals with a signal; None without limits."""
        return None if self.chart is None else len(self.signalling)

    @property
    def signalling(self) -> list[int]:
        """Indices of the individuals with a signal."""
        return [] if self.chart is None else sorted({one.last for one in self.chart[0].signals})

    @property
    def caption(self) -> str:
        """Content of the chart, and why it has no limits."""
        shown = f"Deficit and recovery, joint by joint. {self._coverage_text}"
        if self.chart is None:
            return f"{shown} Without limits: {self.why[0]}"
        tests = list(dict.fromkeys(one.text for one in self.chart[0].signals))
        found = (
            "No point is out of the ordinary"
            if not tests
            else (
                f"{count_text(len(self.signalling), 'point')} out of the ordinary"
                f" ({'; '.join(tests)})"
            )
        )
        chart = self.chart[0]
        limits = (
            "three sigma"
            if chart.distribution == "normal"
            else f"percentiles 0.135 and 99.865 ({chart.distribution})"
        )
        return (
            f"{shown} Individuals and moving ranges with limits at {limits} (I-MR, Nelson's tests"
            f" 1, 2, 3 and 5). {found}."
        )

    @property
    def _coverage_text(self) -> str:
        """How many joints have a recovery, and the meaning of the arrows."""
        back, late = len(self.seconds), len(self.late[0])
        have = (
            "All joints have a recovery."
            if back == self.joints
            else f"{back} of {self.joints} joints have a recovery."
        )
        arrows = " Arrows: longer, as the next joint came before the tip was back."
        return f"{have}{arrows if late else ''}"


def recovery_chart(
    recovery: Floats,
    resolution: float | None,
    deficits: Floats | None = None,
    had: Floats | None = None,
) -> RecoveryChart:
    """Return the chart of these recoveries (NaN: none) in the order of their joints.

    `had`: the time in s until the next joint, if that came before the tip recovered; else NaN.
    """
    none = np.full(len(recovery), np.nan)
    there, had = ~np.isnan(recovery), none if had is None else had
    seconds, numbers = recovery[there], np.flatnonzero(there).astype(np.float64) + 1
    late = ~np.isnan(had)
    waited = (np.flatnonzero(late).astype(np.float64) + 1, had[late])
    found = too_many_late(len(waited[0]), len(seconds)) or control_chart(
        seconds, resolution=resolution
    )
    return RecoveryChart(
        numbers, seconds, len(recovery), found, none if deficits is None else deficits, waited
    )


def draw_chart(one: RecoveryChart, form: Format) -> Figure:
    """Draw deficits if known, recoveries, and moving ranges if there are limits."""
    deficits = np.flatnonzero(~np.isnan(one.deficits))
    heights = [
        *([LOWER_PT] if len(deficits) else []),
        UPPER_PT,
        *([] if one.chart is None else [LOWER_PT]),
    ]
    with styled():
        figure = new_figure(
            form.width_pt, TOP + sum(heights) + BETWEEN * (len(heights) - 1) + BOTTOM
        )
        panels = _panels(figure, heights, max(float(one.joints), 2.0), form)
        rows = iter(panels)
        if len(deficits):
            _deficits(next(rows), deficits.astype(np.float64) + 1, one.deficits[deficits], form)
        _recoveries(next(rows), one, form)
        if one.chart is not None:
            _ranges(next(rows), one, one.chart[1], form)
    return figure


def _panels(figure: Figure, heights: list[float], last: float, form: Format) -> list[Axes]:
    """Return the panels, one below the other, with the number of the joint on their axis."""
    tops = [TOP + sum(heights[:row]) + BETWEEN * row for row in range(len(heights))]
    width = form.width_pt - LEFT - RIGHT
    panels = [
        panel(figure, LEFT, top, width, height) for top, height in zip(tops, heights, strict=True)
    ]
    numbers = round_values(1, last, form.time_marks)
    for axes in panels:
        axes.set_xlim(0.5, last + 0.5)
        ticked(
            axes,
            np.array(numbers),
            [f"{number:g}" for number in numbers],
            is_lowest=axes is panels[-1],
        )
    return panels


def _deficits(axes: Axes, numbers: Floats, celsius: Floats, form: Format) -> None:
    """Draw how far below its setpoint the tip began each joint; 0 is on the scale, so that a small
    deficit looks small.
    """
    _scale(axes, np.append(celsius, [0.0, 5.0]))
    _median(axes, celsius, 1, form)
    _points_of(axes, numbers, celsius, "deficit")
    axes.set_title("Below the setpoint at the start in °C")


def _recoveries(axes: Axes, one: RecoveryChart, form: Format) -> None:
    limits = None if one.chart is None else one.chart[0]
    late = one.late[1]
    arrows = late + (1.5 * ARROW_PT / size_pt(axes)[1] * float(np.ptp(late)) if len(late) else 0.0)
    _scale(axes, np.concatenate([one.seconds, _edges(limits), late, arrows]))
    if len(one.seconds):
        _lines(axes, one.seconds, limits, form)
        _points_of(axes, one.numbers, one.seconds, "recovery")
    _late(axes, *one.late)
    dots(axes, one.numbers[one.signalling], one.seconds[one.signalling], 4.2, style.ALARM, "signal")
    axes.set_title("Recovery in s, by number of the joint")


def _ranges(axes: Axes, one: RecoveryChart, chart: Chart, form: Format) -> None:
    _scale(axes, np.concatenate([chart.points, _edges(chart)]))
    _lines(axes, chart.points, chart, form)
    _points_of(axes, one.numbers[1:], chart.points, "recovery")
    axes.set_title("Difference to the one before in s")


def _edges(chart: Chart | None) -> Floats:
    return np.empty(0) if chart is None else np.array([chart.lower[0], chart.upper[0]])


def _scale(axes: Axes, values: Floats) -> None:
    margin = max(0.08 * float(np.ptp(values)), 0.02)
    axes.set_ylim(float(values.min()) - margin, float(values.max()) + margin)
    is_high = size_pt(axes)[1] > 1.5 * LOWER_PT
    valued(axes, round_values(*axes.get_ylim(), 4 if is_high else 2, whole=False))


def _late(axes: Axes, numbers: Floats, seconds: Floats) -> None:
    """Draw an arrow upwards from the time that each of these joints had."""
    if not len(numbers):
        return
    if len(numbers) > MOST_DOTS:
        curve = envelope(numbers, seconds, MOST_DOTS, float("inf"))
        numbers, seconds = curve.seconds, curve.low
    (wide, high), (left, right), (low, top) = size_pt(axes), axes.get_xlim(), axes.get_ylim()
    # size of a point in units of the axes
    across, up, none = (right - left) / wide, (top - low) / high, np.full(len(numbers), np.nan)
    tips = seconds + ARROW_PT * up
    bars(axes, numbers, seconds, tips, "late", **ARROW)
    x = np.column_stack([numbers - 1.4 * across, numbers, numbers + 1.4 * across, none])
    y = np.column_stack([tips - 1.6 * up, tips, tips - 1.6 * up, none])
    axes.plot(x.ravel(), y.ravel(), gid="late", **ARROW)


def _lines(axes: Axes, values: Floats, chart: Chart | None, form: Format) -> None:
    """Draw centre and limits with their values; without limits the median."""
    if chart is None:
        _median(axes, values, 2, form)
        return
    middle = "mean" if chart.distribution == "normal" or chart.name != "individuals" else "median"
    ends = [
        (float(chart.upper[0]), "limit"),
        (chart.centre, middle),
        (float(chart.lower[0]), "limit"),
    ]
    labels: list[Label] = []
    for value, name in ends:
        axes.axhline(value, gid="limit", **(LIMIT if name == "limit" else CENTRE))
        if value > 0 or name != "limit":
            labels.append(
                (value, f"{name} {value:.2f}", style.ALARM if name == "limit" else style.INK)
            )
    labelled(axes, labels, form.font_pt)


def _median(axes: Axes, values: Floats, digits: int, form: Format) -> None:
    middle = float(np.median(values))
    axes.axhline(middle, gid="limit", **CENTRE)
    labelled(axes, [(middle, f"median {middle:.{digits}f}", style.INK)], form.font_pt)


def _points_of(axes: Axes, numbers: Floats, values: Floats, of: str) -> None:
    """Draw each point, or if there are too many, minimum, maximum and mean of each interval."""
    if len(values) <= MOST_DOTS:
        axes.plot(numbers, values, gid="joined", **JOINED)
        dots(axes, numbers, values, 2.0, style.TEMPERATURE, of)
        return
    curve = envelope(numbers, values, MOST_DOTS, float("inf"))
    bars(
        axes, curve.seconds, curve.low, curve.high, of, color=style.TEMPERATURE_BAND, linewidth=1.0
    )
    dots(axes, curve.seconds, curve.mean, 1.6, style.TEMPERATURE, of)
