"""The plot of a station that tells states and no temperature."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import jbclog
from support.records.sealed_run import samples, seal, station, table


def test_states_are_bars_for_as_long_as_they_held_and_gaps_are_hatched(tmp_path: Path) -> None:
    rows = 60
    columns = samples(rows, "omega-1", hz=1.0)
    for name in ("temperature_c", "power_permille", "set_c", "alarm_high"):
        columns[name] = np.full(rows, np.nan)
    columns["status"] = np.full(rows, None, dtype=object)
    second = np.arange(rows)
    columns["solder_shortage"] = ((second >= 30) & (second < 40)).astype(float)
    columns["clogged"], columns["preparing"], columns["in_range"] = np.zeros(rows), np.zeros(rows), np.ones(rows)
    for name in ("solder_shortage", "clogged", "preparing", "in_range"):
        columns[name][50:55] = np.nan
    facts = station("omega-1", rows=rows, hz=1.0)
    facts.family, facts.signals = "omega", ["solder_shortage", "preparing", "in_range"]
    (axes,) = jbclog.open_run(seal(tmp_path, [facts], table(columns))).plot().axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["in range", "preparing", "clogged", "solder shortage"]
    spans = {
        round(path.vertices[:, 1].mean()): np.ptp(path.vertices[:, 0]) * 86400
        for one in axes.collections
        for path in one.get_paths()
    }
    assert round(spans[3], 2) == 10
    assert {*spans} == {0, 3}
    assert [patch.get_hatch() for patch in axes.patches] == ["///"]
