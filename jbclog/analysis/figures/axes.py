"""Elements of figures: panels placed in points, ticks, labels at the right, dots and bars."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from numpy.typing import ArrayLike

from jbclog.analysis.figures import style
from jbclog.analysis.figures.curves import Floats
from jbclog.analysis.figures.ticks import spread

Label = tuple[float, str, str]
"""Value, text beside it, colour."""

SQUARE: Final = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5)])
BESIDE_PT: Final = 4.0  # distance of a panel's edge from its labels
LINE: Final = 1.25  # line height, in font sizes
LETTER: Final = 0.62  # width of a letter, in font sizes


def panel(figure: Figure, left: float, top: float, width: float, height: float) -> Axes:
    """Add a panel to a figure; position (upper left corner) and size in points."""
    wide, high = figure.get_size_inches() * 72
    axes = figure.add_axes((left / wide, 1 - (top + height) / high, width / wide, height / high))
    axes.set_autoscale_on(False)
    axes.patch.set_visible(False)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_label_coords(0, 0)  # no axis labels: placing them takes a fifth of the time
    return axes


def size_pt(axes: Axes) -> tuple[float, float]:
    """Return width and height of a panel in points."""
    return axes.bbox.width / _dot_pt(axes), axes.bbox.height / _dot_pt(axes)


def _dot_pt(axes: Axes) -> float:
    figure = axes.get_figure(root=True)
    return 1.0 if figure is None else figure.dpi / 72


def ticked(axes: Axes, places: Floats, labels: Sequence[str], *, is_lowest: bool) -> None:
    """Set the ticks of the x axis. Panels above the lowest get only a grid, drawn as one line,
    which is four times as fast.
    """
    if is_lowest:
        axes.set_xticks(places, labels)
        return
    axes.xaxis.set_visible(False)
    look = {
        "color": style.GRID,
        "linewidth": 0.6,
        "zorder": 0.5,
        "transform": axes.get_xaxis_transform(),
    }
    bars(axes, places, np.zeros(len(places)), np.ones(len(places)), "grid", **look)


def valued(axes: Axes, values: Sequence[float]) -> None:
    """Set the ticks on the left."""
    axes.set_yticks(values, [f"{value:g}".replace("-", "\u2212") for value in values])


def labelled(axes: Axes, labels: Sequence[Label], points: float) -> None:
    """Write texts right of the plot at the height of their values, moved apart where they
    overlap.
    """
    wide, high = size_pt(axes)
    ordered = sorted(labels)
    wished = [float(y) * high for y in _share_of_height(axes, [value for value, _, _ in ordered])]
    for y, (_, text, colour) in zip(spread(wished, LINE * points, 0.0, high), ordered, strict=True):
        place = (1 + BESIDE_PT / wide, y / high)
        axes.text(
            *place,
            text,
            color=colour,
            fontsize=points,
            va="center_baseline",
            transform=axes.transAxes,
        )


def _share_of_height(axes: Axes, values: Sequence[float]) -> Floats:
    """Return the height of values in the panel, from 0 at the bottom to 1 at the top."""
    if not len(values):
        return np.empty(0)
    left = axes.get_xlim()[0]
    places = axes.transLimits.transform(
        axes.transScale.transform([(left, value) for value in values])
    )
    return np.asarray(np.clip(places[:, 1], 0.0, 1.0), dtype=np.float64)


def rectangles(
    to: Axes | Figure, places: Iterable[tuple[float, float, float, float]], of: str, **look: Any
) -> None:
    """Draw rectangles (left, right, bottom, top) of one look as one patch."""
    corners = [((a, low), (b, low), (b, high), (a, high), (a, low)) for a, b, low, high in places]
    if corners:
        _add(to, np.array(corners, dtype=np.float64), of, look)


def dots(axes: Axes, x: ArrayLike, y: ArrayLike, points: float, colour: str, of: str) -> None:
    """Draw a square of `points` at each known place, all as one patch."""
    places = np.column_stack([np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)])
    known = places[~np.isnan(places).any(axis=1)]
    if not len(known):
        return
    corners = axes.transData.transform(known)[:, None, :] + points * _dot_pt(axes) * SQUARE
    inside = axes.transData.inverted().transform(corners.reshape(-1, 2)).reshape(-1, 5, 2)
    # also complete at the edge
    _add(axes, inside, of, {"facecolor": colour, "zorder": 2.4, "clip_on": False})


def _add(to: Axes | Figure, corners: Floats, of: str, look: dict[str, Any]) -> None:
    codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY] * len(corners)
    look = {"linewidth": 0, "zorder": 1.0, **look}
    to.add_artist(PathPatch(Path(corners.reshape(-1, 2), codes), gid=of, **look))


def bars(axes: Axes, x: ArrayLike, low: ArrayLike, high: ArrayLike, of: str, **look: Any) -> None:
    """Draw vertical lines as one line with breaks."""
    at = np.asarray(x, dtype=np.float64)
    ends = np.column_stack(
        [
            np.asarray(low, dtype=np.float64),
            np.asarray(high, dtype=np.float64),
            np.full(len(at), np.nan),
        ]
    )
    if len(at):
        axes.plot(np.repeat(at, 3), ends.ravel(), gid=of, **look)


def steps(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return a step line on which each value holds until the next."""
    return np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
