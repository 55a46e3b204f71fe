"""Figures as matplotlib objects in one style, and as SVG. Never pyplot, which keeps figures for the
whole process.

The style is matplotlib's defaults plus `figures.mplstyle`, so that a user's matplotlibrc does not
change a report.
"""

from __future__ import annotations

import re
import warnings
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from importlib.resources import files
from io import StringIO
from typing import Any, Final

from matplotlib import rc_context, rc_params_from_file, rcParams
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

STYLE: Final = "figures.mplstyle"
NOT_OURS: Final = ("backend", "backend_fallback", "interactive", "timezone", "toolbar", "webagg")
FONTS: Final = "'DejaVu Sans',Verdana,'Bitstream Vera Sans',Roboto,Arial,sans-serif"
# a date would change the bytes
NO_METADATA: Final = dict.fromkeys(("Creator", "Date", "Format", "Type"))

DEFAULT_STYLE_ENDS: Final = "</defs>"
SHORTER: Final = (
    (re.compile(r"</?g[^>]*>"), ""),
    (re.compile(r' transform="rotate\(-?0 [^"]*\)"'), ""),
    (re.compile(r"font-family: [^;\"]*(; )?"), ""),  # the root element has the font
    (re.compile(r">\s+<"), ">\n<"),
    (re.compile(r"xlink:href"), "href"),  # SVG 2 needs no namespace
)
PATH: Final = re.compile(r' d="([^"]*)"')
LATER_DIGITS: Final = re.compile(r"(?<=\.\d\d)\d+")


def styled() -> AbstractContextManager[None]:
    """Apply the style while a figure is made or written. Sets only what differs: setting all takes
    matplotlib 2 ms.
    """
    others = {name: value for name, value in _style().items() if rcParams[name] != value}
    return rc_context(others) if others else nullcontext()


@cache
def _style() -> dict[Any, Any]:
    values = rc_params_from_file(str(files("jbclog.analysis.figures") / STYLE))
    return {name: value for name, value in values.items() if not name.startswith(NOT_OURS)}


def new_figure(width_pt: float, height_pt: float, dpi: float = 72) -> Figure:
    """Return an empty figure of this size in points; `dpi` is for raster pictures."""
    return Figure(figsize=(width_pt / 72, height_pt / 72), dpi=dpi)


def svg_text(figure: Figure) -> str:
    """Return the figure as an SVG document. The same figure gives the same text."""
    width, height = figure.get_size_inches() * 72
    size = f'width="{width:g}pt" height="{height:g}pt"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="{FONTS}"{svg_body(figure)}'


def svg_body(figure: Figure) -> str:
    """Return the SVG from its viewBox to the end of the element, without what only editors need:
    groups, ids and defaults.
    """
    text = StringIO()
    with styled(), warnings.catch_warnings():
        # letters missing in the font: the reader's fonts have them
        warnings.simplefilter("ignore", UserWarning)
        FigureCanvasSVG(figure).print_svg(text, metadata=NO_METADATA)  # type: ignore[no-untyped-call]  # it has no types
    body = text.getvalue().partition(DEFAULT_STYLE_ENDS)[2].removesuffix("</svg>\n")
    for pattern, instead in SHORTER:
        body = pattern.sub(instead, body)
    width, height = figure.get_size_inches() * 72
    return (
        f' viewBox="0 0 {width:g} {height:g}"'
        f' stroke-linejoin="round">{PATH.sub(_shorter, body)}</svg>\n'
    )


def _shorter(path: re.Match[str]) -> str:
    """Return path data to a hundredth of a point, without the line commands that SVG implies."""
    data = LATER_DIGITS.sub("", path[1])
    return (
        f' d="{" ".join((data if "C" in data or "Q" in data else data.replace("L ", "")).split())}"'
    )
