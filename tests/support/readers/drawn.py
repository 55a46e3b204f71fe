"""What is in a figure, read back from its artists: texts and their boxes, lines and areas in the
units of their axes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.text import Text
from numpy.typing import NDArray

from jbclog.analysis.figures.canvas import styled

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Box:
    """Where a text is, in points from the lower left corner."""

    text: str
    left: float
    right: float
    bottom: float
    top: float


def texts(figure: Figure) -> list[str]:
    return [one.get_text() for one in _texts(figure)]


def boxes(figure: Figure) -> list[Box]:
    """The letters of each text, without the space above and below them."""
    return [_box(one) for one in _texts(figure)]


def _texts(figure: Figure) -> Iterator[Text]:
    with styled():
        FigureCanvasAgg(figure).draw()
    for one in figure.findobj(Text):
        assert isinstance(one, Text)
        if one.get_text() and one.get_visible() and _is_shown(one):
            yield one


def _is_shown(one: Text) -> bool:
    """Labels of ticks outside the axis and of an axis that is left out are there and not drawn."""
    axes = one.axes
    if axes is None:
        return True
    for axis in (axes.xaxis, axes.yaxis):
        ticks = axis.get_major_ticks()
        if any(one in (tick.label1, tick.label2) for tick in ticks):
            shown = axis._update_ticks() if axis.get_visible() else []  # type: ignore[attr-defined]  # no public list of them
            return any(one is tick.label1 and tick.label1.get_visible() for tick in shown)
    return True


def _box(one: Text) -> Box:
    extent, points = one.get_window_extent(), one.get_fontsize()
    middle = (extent.y0 + extent.y1) / 2
    return Box(one.get_text(), extent.x0, extent.x1, middle - 0.4 * points, middle + 0.4 * points)


def artists(figure: Figure, of: str) -> list[Artist]:
    return [one for one in figure.findobj() if one.get_gid() == of and not isinstance(one, Text)]


def parts(figure: Figure, of: str) -> list[Floats]:
    """Each line between two breaks, each rectangle or area: a row of x and y for each corner, in
    the units of its axes.
    """
    return [part for one in artists(figure, of) for part in _parts(one)]


def corners(figure: Figure, of: str) -> Floats:
    return np.concatenate(parts(figure, of) or [np.empty((0, 2))])


def _parts(one: Artist) -> list[Floats]:
    if isinstance(one, Line2D):
        points = np.asarray(one.get_xydata(), dtype=np.float64)
        known = (~np.isnan(points).any(axis=1)).astype(np.int8)
        edges = np.flatnonzero(np.diff(known, prepend=0, append=0)).reshape(-1, 2)
        return [points[a:b] for a, b in edges if b - a > 1]
    if isinstance(one, PathPatch):
        return list(np.asarray(one.get_path().vertices, dtype=np.float64).reshape(-1, 5, 2))
    assert isinstance(one, PolyCollection)
    return [np.asarray(path.vertices, dtype=np.float64) for path in one.get_paths()]


def panel(figure: Figure, place: int) -> Axes:
    """A panel, the uppermost first."""
    return figure.axes[place]


def seconds(t0_utc_us: int, days: Floats) -> Floats:
    """Days since 1970 as seconds of a run."""
    return days * 86400 - t0_utc_us / 1e6
