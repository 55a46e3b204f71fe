"""The panel of a station that tells states and no temperature: a bar for each state, for as long as it held."""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.dates import date2num
from numpy.typing import NDArray

STATES: Final = ("in_range", "preparing", "clogged", "solder_shortage")
"""From the bottom up."""

Floats = NDArray[np.float64]


def states_panel(axes: Axes, rows: pd.DataFrame) -> None:
    """Draw the states of one port; where nothing was read there is nothing, and a hatching over the whole height."""
    starts: Floats = date2num(rows["time"])  # type: ignore[no-untyped-call]  # matplotlib has no types there
    ends = np.append(starts[1:], starts[-1])
    for place, name in enumerate(STATES):
        held = rows[name].fillna(False).to_numpy(dtype=bool)
        for start, end in _episodes(starts, ends, held):
            axes.fill_betweenx([place - 0.35, place + 0.35], start, end, color="tab:red" if place > 1 else "tab:blue", linewidth=0)
    for start, end in _episodes(starts, ends, rows[list(STATES)].isna().all(axis=1).to_numpy()):
        axes.axvspan(start, end, facecolor="0.85", edgecolor="0.6", hatch="///", zorder=0, linewidth=0)
    axes.set_yticks(range(len(STATES)), [name.replace("_", " ") for name in STATES])
    axes.set_ylim(-0.6, len(STATES) - 0.4)


def _episodes(starts: Floats, ends: Floats, held: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Begin and end of each stretch of rows in which it held, as matplotlib counts days."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], held, [False])).astype(np.int8)))
    return [(float(starts[first]), float(ends[last - 1])) for first, last in zip(edges[::2], edges[1::2], strict=True)]
