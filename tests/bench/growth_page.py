"""The page of `bench_growth.py`: a table and a picture for each part, and where a curve is not
straight.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.ticker import LogFormatter

from jbclog.analysis.figures.canvas import new_figure, styled, svg_text

STRAIGHT: Final = 0.25  # share by which a value may differ from the line
COLUMNS: Final = 3
UNITS: Final = {
    "stations": "stations",
    "rates": "Hz",
    "lengths": "s",
    "folders": "runs",
}
SHARED: Final = "At small sizes, fewer exchanges or rows share the fixed cost of a run."
LATE: Final = (
    "A tick asks all stations, so a few ticks before which the program waited longest for a"
    " processor decide the figure, whatever the size: four recordings of the same ten stations,"
    " one after another, gave 7.7 to 17.3 ms, and the program had waited that long before 10 of"
    " their 15 latest ticks (schedstat of Linux; 25 November 2026, busy machine)."
)
REPORT: Final = (
    "Two costs reach their limit within an hour: the figures, one of a minute and two from ten"
    " minutes on (0.7 and 1.4 s), and the identification of the tool, which reads at most twenty"
    " minutes (0.5 and 1.0 s). Beyond that each row costs the same (profiles of a minute, ten"
    " minutes, an hour and eight hours, 25 November 2026)."
)
HELD: Final = (
    "Rows stay in memory up to 300 000, eight hours here, so that a port's rows are written in"
    " one stretch. Eight hours, a day and three days took 475, 503 and 511 MB; with 36 000 rows,"
    " 344, 366 and 367 MB (25 November 2026)."
)
WHY: Final[Mapping[tuple[str, str], str]] = {
    **{
        (part, figure): SHARED
        for part in ("stations", "rates")
        for figure in ("CPU of an exchange, µs", "bytes of a row")
    },
    **{
        (part, figure): LATE
        for part in ("stations", "rates")
        for figure in ("late, 99 %, ms", "late, 99 % of the worst tenth, ms")
    },
    ("lengths", "report, s of CPU"): REPORT,
    ("lengths", "export mf4, MB"): HELD,
}
"""(part, figure) -> why its line is not straight; written by who measured it."""

HEAD: Final = """# How cost grows

Made by `python tests/bench/bench_growth.py --page`. Each part varies one thing and keeps the rest.
The last two columns are a straight line through the values: the fixed part, and what each unit adds
(least squares of relative errors, none below 0). Below a table are the figures of which a value
differs from its line by more than 25 %. In the pictures both axes are logarithmic and the line is
dashed.
"""


class Point(NamedTuple):
    """The values of one size of one part; `about`, `machine` and `day` say how, where and when."""

    part: str
    size: float
    figures: dict[str, float]
    machine: str
    day: str
    about: str


def write_page(points: Sequence[Point], parts: Iterable[str], docs: Path) -> list[Path]:
    """Write `reference/growth.md` and a picture for each part below `docs`; return the files."""
    pictures, page = docs / "pictures", docs / "reference" / "growth.md"
    for folder in (pictures, page.parent):
        folder.mkdir(parents=True, exist_ok=True)
    written, by_part = [page], series_of(points, parts)
    for name, series in by_part.items():
        picture = pictures / f"growth-{name}.svg"
        picture.write_text(drawing(name, series))
        written.append(picture)
    page.write_text(text_of(by_part))
    return written


def series_of(points: Sequence[Point], parts: Iterable[str]) -> dict[str, list[Point]]:
    """Return the points of each part that has some, by size."""
    by_part = {
        name: sorted((one for one in points if one.part == name), key=lambda one: one.size)
        for name in parts
    }
    return {name: series for name, series in by_part.items() if series}


def text_of(by_part: Mapping[str, Sequence[Point]]) -> str:
    """The page."""
    return HEAD + "\n" + "\n".join(section(name, series) for name, series in by_part.items())


def section(name: str, series: Sequence[Point]) -> str:
    """Write a part: what it is, where and when, picture, table, and what is not straight."""
    how = sorted({f"{point.about} ({point.day}, {point.machine})" for point in series})
    bent = [
        f"- {figure}: up to {100 * line.departure:.0f} % from its line. {why(name, figure)}"
        for figure in series[0].figures
        if (line := line_of(series, figure)).departure > STRAIGHT
    ]
    lines = [
        f"## {name}\n",
        f"{' '.join(how)}\n",
        f"![{name}](../pictures/growth-{name}.svg)\n",
        *rows(name, series),
        "",
    ]
    return "\n".join([*lines, *bent, ""])


def why(name: str, figure: str) -> str:
    return WHY.get((name, figure), "Not explained yet.")


def rows(name: str, series: Sequence[Point]) -> list[str]:
    """The table: a column for each size."""
    sizes = [f"{point.size:,.0f}" for point in series]
    head = f"| {UNITS[name]} | {' | '.join(sizes)} | fixed | each |"
    body = []
    for figure in series[0].figures:
        line = line_of(series, figure)
        values = [f"{point.figures.get(figure, float('nan')):.3g}" for point in series]
        body.append(f"| {figure} | {' | '.join(values)} | {line.fixed:.2g} | {line.each:.2g} |")
    return [head, "|---" * (len(series) + 3) + "|", *body]


class Line(NamedTuple):
    """A straight line through the values of a figure; `departure` is the largest relative
    deviation.
    """

    fixed: float
    each: float
    departure: float


def line_of(series: Sequence[Point], figure: str) -> Line:
    """Fit the line to the values above 0."""
    from scipy.optimize import nnls  # slow to import, and tests import this file

    known = [
        (point.size, point.figures[figure])
        for point in series
        if point.figures.get(figure, 0.0) > 0
    ]
    if not known:
        return Line(0.0, 0.0, 0.0)
    sizes, values = np.array(known).T
    if np.ptp(values) == 0:
        return Line(values[0], 0.0, 0.0)
    (fixed, each), _ = nnls(np.column_stack([1 / values, sizes / values]), np.ones(len(known)))
    return Line(fixed, each, float(np.abs((fixed + each * sizes) / values - 1).max()))


def drawing(name: str, series: Sequence[Point]) -> str:
    """Draw a small picture for each figure, as SVG."""
    figures = list(series[0].figures)
    lines = -(-len(figures) // COLUMNS)
    with styled():
        drawn = new_figure(190.0 * COLUMNS, 150.0 * lines)
        drawn.set_layout_engine("constrained")
        for place, figure in enumerate(figures, 1):
            axes = drawn.add_subplot(lines, COLUMNS, place)
            known = [
                (point.size, point.figures[figure])
                for point in series
                if point.figures.get(figure, 0.0) > 0
            ]
            axes.set_title(figure, fontsize=8)
            axes.set_xlabel(UNITS[name], fontsize=7)
            axes.tick_params(which="both", labelsize=6)
            if known:
                axes.set(xscale="log", yscale="log")
                # the style parses no formulas, in which ticks would stand
                for axis in (axes.xaxis, axes.yaxis):
                    axis.set_major_formatter(LogFormatter())
                    axis.set_minor_formatter(LogFormatter(minor_thresholds=(1, 0.4)))
                axes.plot(*zip(*known, strict=True), marker="o", markersize=3)
                line = line_of(series, figure)
                sizes = np.geomspace(known[0][0], known[-1][0], 50)
                axes.plot(
                    sizes,
                    line.fixed + line.each * sizes,
                    linestyle="--",
                    linewidth=0.6,
                    color="0.5",
                )
        return svg_text(drawn)
