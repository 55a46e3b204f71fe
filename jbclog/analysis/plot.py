"""The plain plot of a run, for a notebook or a quick look."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jbclog.analysis.verdict import judged_signals
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.analysis.run import Run

# -- states plot --------------------------------------------------------------------------------------------------------------
# The panel of a station that tells states and no temperature: a bar for each state, for as long as it held.

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


# -- plot ---------------------------------------------------------------------------------------------------------------------

COLUMNS: Final = ["time", "tick", "station", "port", "quality", "temperature_c", "set_c", "power_permille"]
PANEL_CM: Final = (24.0, 9.0)
CM: Final = 1 / 2.54
POINTS: Final = 4000  # a panel shows no more; each of them stands for its bin's least and greatest

MOST_DOTS: Final = 200  # readings of the setting that can still be told apart


def plot(run: Run, station: str | None = None, port: int | None = None) -> Figure:
    """A figure with a panel for each port: °C against the setting, ‰ of power, what was not read shaded.

    A station that tells no temperature has its states instead. Raises `UsageError` where there is nothing to show.
    """
    samples = run.samples(station, port, columns=[*COLUMNS, *STATES])
    of_states = {facts.name for facts in run.manifest.stations if "temperature_c" not in judged_signals(facts)}
    tools = sorted(samples.groupby(["station", "port"]), key=lambda tool: _place(run, str(tool[0][0])))
    if not tools:
        raise UsageError(f"{run.name} has no samples of station {station or 'any'}, port {port or 'any'}")
    figure = Figure(figsize=(PANEL_CM[0] * CM, PANEL_CM[1] * CM * len(tools)), layout="constrained")
    panels = figure.subplots(len(tools), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (key, rows) in zip(panels, tools, strict=True):
        if key[0] in of_states:
            states_panel(axes, rows)
        else:
            _panel(axes, rows)
        _time_axis(axes)
        axes.set_title(f"{key[0]} port {key[1]}", loc="left")
    return figure


def _place(run: Run, station: str) -> int:
    """Stations in the order of the line file, as everywhere."""
    names = [facts.name for facts in run.manifest.stations]
    return names.index(station) if station in names else len(names)


def _panel(axes: Axes, rows: pd.DataFrame) -> None:
    seen = thinned(rows)
    temperature = seen["temperature_c"].astype("float64")
    axes.plot(seen["time"], temperature, color="tab:red", linewidth=0.8, label="temperature")
    setting = rows[["time", "set_c"]].assign(outages=(rows["quality"] == "disconnected").cumsum()).dropna()
    dots = "." if len(setting) <= MOST_DOTS else ""
    axes.plot(*set_line(setting), color="black", linewidth=0.6, marker=dots, markersize=3, label="set, as read")
    _shade_missing(axes, rows)
    axes.set_ylabel("°C")
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0.2, frameon=False, ncols=2)
    power = axes.twinx()
    power.plot(seen["time"], seen["power_permille"].astype("float64"), color="tab:blue", linewidth=0.5, alpha=0.6)
    power.set_ylim(0, 3000)  # the lower third
    power.set_yticks([0, 500, 1000])
    power.set_ylabel("power ‰", color="tab:blue", loc="bottom")


def _time_axis(axes: Axes) -> None:
    locator = AutoDateLocator()  # type: ignore[no-untyped-call]  # matplotlib has no types there
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]


def set_line(setting: pd.DataFrame) -> tuple[pd.Series[pd.Timestamp], pd.Series[float]]:
    """Times and °C of the readings, with a break before each that differs from the one before it, or follows an outage."""
    celsius = setting["set_c"].astype("float64")
    changed = (celsius.diff().fillna(0) != 0) | (setting["outages"].diff().fillna(0) != 0)
    breaks = pd.DataFrame({"time": setting["time"][changed], "set_c": float("nan")})
    line = pd.concat([breaks, setting.assign(set_c=celsius)]).sort_index(kind="stable")
    return line["time"], line["set_c"]


def thinned(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows, or of each bin the ones with the least and the greatest temperature, so that no excursion disappears."""
    if len(rows) <= 2 * POINTS:
        return rows
    missing = rows["temperature_c"].isna()
    there = rows["temperature_c"][~missing].astype("float64")
    by_bin = there.groupby(pd.Series(range(len(there)), index=there.index) * POINTS // max(len(there), 1))
    breaks = rows.index[missing & ~missing.shift(fill_value=False)]  # one row of each gap interrupts the line
    return rows.loc[sorted({*by_bin.idxmin(), *by_bin.idxmax(), *breaks})]


def _shade_missing(axes: Axes, rows: pd.DataFrame) -> None:
    """Shade the times of the rows that have no temperature."""
    missing = rows["temperature_c"].isna()
    episode = (missing != missing.shift()).cumsum()[missing]
    for _, gap in rows[missing].groupby(episode):
        axes.axvspan(
            gap["time"].iloc[0], gap["time"].iloc[-1], facecolor="0.85", edgecolor="0.6", hatch="///", zorder=0, linewidth=0
        )
