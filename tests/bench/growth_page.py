"""The page that `bench_growth.py` writes: a table and a picture for each part, and where a line is
not straight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import log
from pathlib import Path
from typing import Final, NamedTuple

from matplotlib.ticker import LogFormatter

from jbclog.analysis.figures.canvas import new_figure, styled, svg_text

STRAIGHT: Final = 0.15  # by which an exponent may differ from 0 (constant) or 1 (proportional)
COLUMNS: Final = 3
UNITS: Final = {
    "stations": "stations",
    "rates": "Hz",
    "lengths": "s",
    "folders": "runs",
    "stores": "rows",
}
WHY: Final[Mapping[tuple[str, str], str]] = {}
"""(part, figure) -> why its line is not straight; written by who measured it."""

HEAD: Final = """# How cost grows

Made by `python tests/bench/bench_growth.py --page`. Each part varies one thing and keeps
the rest. Figures that neither stay the same nor grow in proportion are listed with the exponent of
each step: 0 is constant, 1 proportional, 2 quadratic. In the pictures both axes are logarithmic,
and the dashed line is proportional to the first point.
"""


class Point(NamedTuple):
    """What was measured at one size of one part; `machine` and `day` say where and when."""

    part: str
    size: float
    figures: dict[str, float]
    machine: str
    day: str


def write_page(points: Sequence[Point], parts: Mapping[str, str], docs: Path) -> list[Path]:
    """Write `reference/growth.md` and a picture for each part below `docs`; return what was
    written.
    """
    pictures, page = docs / "pictures", docs / "reference" / "growth.md"
    for folder in (pictures, page.parent):
        folder.mkdir(parents=True, exist_ok=True)
    written, sections = [page], list[str]()
    for name, about in parts.items():
        series = sorted(
            (point for point in points if point.part == name), key=lambda point: point.size
        )
        if series:
            picture = pictures / f"growth-{name}.svg"
            picture.write_text(drawing(name, series))
            written.append(picture)
            sections.append(section(name, about, series))
    page.write_text(HEAD + "\n" + "\n".join(sections))
    return written


def section(name: str, about: str, series: Sequence[Point]) -> str:
    """A part: what it is, where and when, the picture, the table, and what is not straight."""
    where = sorted({f"{point.day}, {point.machine}" for point in series})
    bent = [
        f"- {figure}: {exponents(series, figure)}. {why(name, figure)}"
        for figure in series[0].figures
        if is_bent(series, figure)
    ]
    lines = [
        f"## {name}\n",
        f"{about} ({'; '.join(where)})\n",
        f"![{name}](../pictures/growth-{name}.svg)\n",
        *rows(name, series),
        "",
    ]
    return "\n".join([*lines, *bent, ""])


def why(name: str, figure: str) -> str:
    return WHY.get((name, figure), "Not explained yet.")


def rows(name: str, series: Sequence[Point]) -> list[str]:
    """The table: a column for each size."""
    head = f"| {UNITS[name]} | {' | '.join(f'{point.size:,.0f}' for point in series)} |"
    cells = [
        [f"{point.figures.get(figure, float('nan')):.3g}" for point in series]
        for figure in series[0].figures
    ]
    body = [
        f"| {figure} | {' | '.join(values)} |"
        for figure, values in zip(series[0].figures, cells, strict=True)
    ]
    return [head, "|---" * (len(series) + 1) + "|", *body]


def steps(series: Sequence[Point], figure: str) -> list[tuple[float, float, float]]:
    """Size, next size, and the exponent between them, where both values are above 0."""
    found = []
    for one, two in pairwise(series):
        before, behind = one.figures.get(figure, 0.0), two.figures.get(figure, 0.0)
        if before > 0 and behind > 0:
            found.append((one.size, two.size, log(behind / before) / log(two.size / one.size)))
    return found


def is_bent(series: Sequence[Point], figure: str) -> bool:
    """Whether a line is neither constant nor proportional throughout."""
    powers = [power for _, _, power in steps(series, figure)]
    return bool(powers) and not any(
        all(abs(power - straight) <= STRAIGHT for power in powers) for straight in (0, 1)
    )


def exponents(series: Sequence[Point], figure: str) -> str:
    return ", ".join(
        f"{one:,.0f} to {two:,.0f}: {power:.2f}" for one, two, power in steps(series, figure)
    )


def drawing(name: str, series: Sequence[Point]) -> str:
    """A small picture for each figure, as SVG."""
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
                (size, value), last = known[0], known[-1][0]
                axes.plot(
                    [size, last],
                    [value, value * last / size],
                    linestyle="--",
                    linewidth=0.6,
                    color="0.5",
                )
        return svg_text(drawn)
