"""One outage has one length: in event, verdict, metrics, report.json, and `run.gaps()`."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from support.product import (
    COUNTED_SIGNALS,
    RunOptions,
    make_plan,
    open_run,
    read_manifest,
    write_report,
)
from support.records.verdict_corpus import StallingClock
from support.virtual.lines import fault
from support.virtual.recorded_run import RecordedRun, run_in
from support.virtual.virtual_run import RECIPE, line_text

LIMITS = "\n[acceptance]\nlongest_gap_s = 2\ncoverage_percent = 50\n"
HZ = 5.0
PERIOD_S = 1 / HZ
SCAN_S = PERIOD_S + 0.1
"""From an answer of one scan to the readings of the next one."""
FAULTS = {
    "dropout": fault("dropout", at_s=20, for_s=8),
    "silence": fault("silence", at_s=20, for_s=8),
    "robot_off": fault("nak", at_s=20, for_s=8, code=5),
}


@pytest.fixture(scope="module", params=FAULTS)
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of a minute in which the station was away for 8 s, with its report."""
    home = tmp_path_factory.mktemp("outage")
    line = line_text(FAULTS[request.param])
    run = run_in(home, line, RECIPE + LIMITS, duration_s=60, rate=HZ)
    write_report(run)
    return run


def longest(run: Any, port: int, signal: str = "temperature_c") -> Any:
    gaps = run.gaps("dde-1", port, signal)
    return gaps.loc[gaps["seconds"].idxmax()]


@pytest.mark.parametrize("port", [1, 2])
def test_one_outage_has_one_length(folder: Path, port: int) -> None:
    run = open_run(folder)
    gap = longest(run, port)
    assert 8 < gap["seconds"] < 12
    assert gap["seconds"] == (gap["stop"] - gap["start"]).total_seconds()
    assert not gap["at_least"]

    (event,) = run.events()[lambda rows: rows["kind"].isin(["link.back", "robot.on"])].itertuples()
    assert event.value == pytest.approx(gap["seconds"], abs=SCAN_S)
    assert (event.time - event.earliest).total_seconds() == pytest.approx(event.value, abs=1e-3)
    assert f"The station is back after {event.value:.1f} s;" in event.text

    rules = [one for one in run.manifest.verdict_rules if one["name"] == "longest_gap"]
    (rule,) = [one for one in rules if one["port"] == port]
    assert rule["observed"] == gap["seconds"]
    assert rule["result"] == "fail"
    told = f"{gap['seconds']:.1f}".removesuffix(".0")
    assert f"Longest gap in temperature {told} s, allowed 2 s and a period of 0.2 s" in rule["text"]

    report = json.loads((folder / "report.json").read_text("utf-8"))
    (facts,) = [one for one in report["stations"][0]["ports"] if one["port"] == port]
    listed = facts["recorded"]["gaps"]
    assert listed[0]["seconds"] == facts["recorded"]["longest_gap_s"] == gap["seconds"]
    assert listed[0]["reasons"] == gap["reasons"]
    assert len(listed) == len(run.gaps("dde-1", port, "temperature_c"))

    metrics = run.metrics()
    own = metrics[metrics["port"] == port].set_index("metric")
    power = longest(run, port, "power_permille")
    (refused,) = re.findall(r"no reading for (\d+\.\d) s", own.loc["energy_permille_s", "why"])
    assert refused == f"{power['seconds']:.1f}"


def test_what_is_missing_in_the_gaps_is_what_the_accounting_lacks(folder: Path) -> None:
    run = open_run(folder)
    missing = run.gaps().groupby(["station", "port", "signal"])["missing"].sum()
    ledger = read_manifest(folder).ledger
    lost = {
        (station, int(port), signal): counts["due"] - counts["ok"]
        for station, ports in ledger.items()
        for port, signals in ports.items()
        for signal, counts in signals.items()
        if signal in COUNTED_SIGNALS and counts["due"] > counts["ok"]
    }
    assert missing.to_dict() == lost


def test_reasons_are_in_order_and_the_second_port_has_its_own(folder: Path) -> None:
    run = open_run(folder)
    first, second = (longest(run, port)["reasons"].split(";") for port in (1, 2))
    assert first[-1] == second[-1] in ("disconnected", "robot_off")


def test_the_gap_before_a_late_answer_is_as_long_as_nothing_was_read(tmp_path: Path) -> None:
    """The computer was busy for 3 s while it waited for an answer. The ticks that it had no time
    for were due before that answer, although their rows follow it.
    """
    (tmp_path / "line.toml").write_text(line_text())
    (tmp_path / "recipe.toml").write_text(RECIPE + LIMITS)
    options = RunOptions(tmp_path / "line.toml", tmp_path / "recipe.toml", duration_s=30, rate=HZ)
    clock = StallingClock([10.0], 3.0)
    run = open_run(RecordedRun(make_plan(options), tmp_path / "runs", clock).result.folder)
    (busy,) = run.events()[lambda rows: rows["kind"] == "host.busy"].itertuples()
    for port in (1, 2):
        (gap,) = run.gaps("dde-1", port, "temperature_c").itertuples()
        assert (gap.reasons, gap.missing) == ("skipped", busy.value)
        assert gap.seconds == pytest.approx(3.0 + PERIOD_S, abs=0.1)
        samples = run.samples("dde-1", port, gap.start, gap.stop)
        assert samples["temperature_c"].count() == 1  # the one at its start
        metrics = run.metrics("dde-1").query("port == @port").set_index("metric")
        assert "no reading for 3.2 s; 0.4 s are allowed" in metrics.loc["energy_permille_s", "why"]
