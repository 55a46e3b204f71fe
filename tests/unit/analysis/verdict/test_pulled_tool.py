"""A run in which a tool is pulled: neither its verdict nor its metrics take what is read then for
an idle tip.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.analysis.run import open_run
from support.virtual.recorded_run import run_in
from support.virtual.virtual_run import RECIPE, line_text

LIMITS = "\n[acceptance]\nidle_error_c = 5\nidle_sd_c = 5\n"
FAULT = '[[station.sim.fault]]\nat_s = {at_s}\nkind = "tool"\nport = 1\ncode = {code}\n'


def run_of(home: Path, *faults: tuple[float, int]) -> Path:
    sim = "joints_per_minute = 0\n" + "".join(
        FAULT.format(at_s=at_s, code=code) for at_s, code in faults
    )
    return run_in(home, line_text(sim, "ports = [1]"), RECIPE + LIMITS, 60.0)


@pytest.mark.parametrize("faults", [[(33.3, 0), (44.0, 2)], [(60.0, 0)]])
def test_what_a_pulled_tool_reads_is_no_idle_tip(
    tmp_path: Path, faults: list[tuple[float, int]]
) -> None:
    run = open_run(run_of(tmp_path, *faults))
    samples = run.samples(columns=["temperature_c", "status"])
    at_work = samples[samples["status"] == "working"].iloc[100:]
    assert not (at_work["temperature_c"] < 100).any()
    assert at_work["temperature_c"].isna().any()
    rules = {rule["name"]: rule for rule in run.manifest.verdict_rules}
    assert abs(rules["idle_error"]["observed"]) < 1  # type: ignore[arg-type]
    assert rules["idle_sd"]["observed"] < 2  # type: ignore[operator]
    metrics = run.metrics().set_index("metric")["value"]
    assert metrics["idle_range_c"] < 5
    assert len(run.joints()) == 0
    assert len(run.alarms()) == 0
