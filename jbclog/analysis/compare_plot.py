"""Two runs in one picture: a panel a port, both temperatures over the seconds since the first reading was due."""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jbclog.analysis.compare import Comparison
from jbclog.analysis.plot import thinned
from jbclog.analysis.run import Run
from jbclog.analysis.verdict.idle import Floats
from jbclog.core.errors import UsageError

WIDE, HIGH = 9.5, 3.0  # inches of a panel
COLOURS: Final = ("#0072b2", "#e69f00")  # told apart by the colour-blind, and in grey by their lightness
COLUMNS: Final = ["time", "tick", "temperature_c", "set_c"]


def overlay(found: Comparison) -> Figure:
    """A panel for each port that both have. Raises `UsageError` where there is none."""
    places = [(one.station, one.port) for one in found.idle]
    if not places:
        raise UsageError(f"{found.first.name} and {found.second.name} have no port in common that tells a temperature")
    figure = Figure(figsize=(WIDE, HIGH * len(places)), layout="constrained")
    for axes, (station, port) in zip(figure.subplots(len(places), 1, squeeze=False)[:, 0], places, strict=True):
        for run, colour in zip((found.first, found.second), COLOURS, strict=True):
            _line(axes, run, station, port, colour)
        axes.set_title(f"{station} port {port}", loc="left", fontsize=10)
        axes.set_ylabel("°C")
        axes.set_xlabel("seconds since the first reading was due", fontsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), frameon=False, ncols=2, fontsize=8, borderaxespad=0.2)
    return figure


def _line(axes: Axes, run: Run, station: str, port: int, colour: str) -> None:
    rows = thinned(run.samples(station, port, columns=COLUMNS))
    if not len(rows):
        return
    seconds = _seconds(run, station, rows)
    celsius = rows["temperature_c"].to_numpy(dtype=np.float64, na_value=np.nan)
    axes.plot(seconds, celsius, color=colour, linewidth=0.9, alpha=0.85, label=run.name)


def _seconds(run: Run, station: str, rows: pd.DataFrame) -> Floats:
    """On the run's grid; with ``--rate max``, which has none, since the first row."""
    facts = run.manifest.station(station)
    if facts is not None and facts.period_s:
        return np.asarray(rows["tick"] * facts.period_s, dtype=np.float64)
    return np.asarray((rows["time"] - rows["time"].iloc[0]).dt.total_seconds(), dtype=np.float64)
