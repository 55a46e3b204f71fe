"""The plain plot of a run, for a notebook or a quick look; the report draws its own figures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from jbclog.errors import UsageError

if TYPE_CHECKING:
    from jbclog.analysis.run import Run

COLUMNS: Final = ["time", "tick", "station", "port", "quality", "temperature_c", "set_c", "power_permille"]
PANEL_CM: Final = (24.0, 9.0)
CM: Final = 1 / 2.54
POINTS: Final = 4000  # a panel shows no more; each of them stands for its bin's least and greatest


def plot(run: Run, station: str | None = None, port: int | None = None) -> Figure:
    """A figure with a panel for each port: °C against the setting, ‰ of power, what was not read shaded.

    Raises `UsageError` where there is nothing to show.
    """
    samples = run.samples(station, port, columns=COLUMNS)
    tools = [(key, rows) for key, rows in samples.groupby(["station", "port"], sort=True)]
    if not tools:
        raise UsageError(f"{run.name} has no samples of station {station or 'any'}, port {port or 'any'}")
    figure = Figure(figsize=(PANEL_CM[0] * CM, PANEL_CM[1] * CM * len(tools)), layout="constrained")
    panels = figure.subplots(len(tools), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (key, rows) in zip(panels, tools, strict=True):
        _panel(axes, rows)
        axes.set_title(f"{key[0]} port {key[1]}", loc="left")
    return figure


def _panel(axes: Axes, rows: pd.DataFrame) -> None:
    seen = thinned(rows)
    temperature = seen["temperature_c"].astype("float64")
    axes.plot(seen["time"], temperature, color="tab:red", linewidth=0.8, label="temperature")
    setting = rows[["time", "set_c"]].dropna()
    axes.step(setting["time"], setting["set_c"].astype("float64"), where="post", color="black", linewidth=0.8, label="set")
    _shade_missing(axes, rows)
    axes.set_ylabel("°C")
    axes.legend(loc="upper right", frameon=False, ncols=2)
    power = axes.twinx()
    power.plot(seen["time"], seen["power_permille"].astype("float64"), color="tab:blue", linewidth=0.5, alpha=0.6)
    power.set_ylim(0, 3000)  # the lower third
    power.set_yticks([0, 500, 1000])
    power.set_ylabel("power ‰", color="tab:blue", loc="bottom")
    locator = AutoDateLocator()  # type: ignore[no-untyped-call]  # matplotlib has no types there
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]


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
