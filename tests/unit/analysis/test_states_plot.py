"""The plot of a station with states and without a temperature."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import jbclog
from jbclog.analysis.figures import style
from support.readers.drawn import parts
from support.records.sealed_run import samples, seal, station, table


def test_states_are_bars_for_as_long_as_they_held_and_gaps_are_hatched(tmp_path: Path) -> None:
    rows = 60
    columns = samples(rows, "omega-1", hz=1.0)
    for name in ("temperature_c", "power_permille", "setpoint_c", "alarm_high"):
        columns[name] = np.full(rows, np.nan)
    columns["status"] = np.full(rows, None, dtype=object)
    second = np.arange(rows)
    columns["solder_shortage"] = ((second >= 30) & (second < 40)).astype(float)
    columns["clogged"], columns["preparing"], columns["in_range"] = (
        np.zeros(rows),
        np.zeros(rows),
        np.ones(rows),
    )
    for name in ("solder_shortage", "clogged", "preparing", "in_range"):
        columns[name][50:55] = np.nan
    facts = station("omega-1", rows=rows, hz=1.0)
    facts.family, facts.signals = "omega", ["solder_shortage", "preparing", "in_range"]
    figure = jbclog.open_run(seal(tmp_path, [facts], table(columns))).plot()
    (axes,) = figure.axes
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        "solder",
        "control",
        "temperature",
        "no data",
    ]
    lengths = [np.ptp(part[:, 0]) * 86400 for part in parts(figure, "solder")]
    # two are the shortage, drawn over the rest again
    assert sorted(round(length) for length in lengths) == [5, 10, 10, 10, 30]
    (gap,) = parts(figure, "no data")
    assert np.ptp(gap[:, 0]) * 86400 == pytest.approx(6, abs=0.01)
    assert style.HATCH_ELSE in [patch.get_hatch() for patch in axes.patches]
