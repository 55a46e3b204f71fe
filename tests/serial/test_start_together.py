"""Stations that start together, on real pseudo-terminals: the writes of `jbclog run` if one of them
does not start.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from support.command import RECIPE, WireLog, jbclog
from support.product import Manifest, SimProcess, check_run, read_manifest
from support.virtual.captured_run import relived

STATION = """
[[station]]
name = "{name}"
url = "{name}"
family = "dde"
ports = [1]
[station.sim]
turnaround_ms = 1.0
settings = {{sleep_delay = 9, selected_temperature = 300}}
"""
LINE = '[line]\nname = "bench"\n' + STATION.format(name="a") + STATION.format(name="b")
REFUSES = (
    '\n[[station.sim.fault]]\nkind = "nak"\ncode = 3\ncommand = "alarm_high_limit"\nonly ='
    ' "write"\n'
)
MISSING = '\n[[station]]\nname = "c"\nurl = "c"\nfamily = "dde"\nports = [1]\n'
HEATS = ("WST", "WA1", "WS1", "WPS100000")


def run_of(
    tmp_path: Path, sim: str = "", missing: str = "", *options: str
) -> tuple[int, str, Manifest, WireLog]:
    """Run with these stations; return exit code, notes, manifest and the stations' log. The line
    file also has the stations in `missing`, which are not served.
    """
    (tmp_path / "sim.toml").write_text(LINE + sim)
    log = tmp_path / "wire.jsonl"
    with SimProcess(tmp_path / "sim.toml", tmp_path / "bench", log=log) as stations:
        stations.line_path.write_text(stations.line_path.read_text() + missing)
        ended = jbclog(
            "run",
            RECIPE,
            "--line",
            stations.line_path,
            "--out",
            tmp_path / "runs",
            "-d",
            "3s",
            "--rate",
            "4",
            *options,
        )
        (folder,) = (tmp_path / "runs").iterdir()
        assert check_run(folder) == []
        return ended.returncode, ended.stderr, read_manifest(folder), WireLog(log)


def test_where_one_is_missing_nothing_is_written_to_any(tmp_path: Path) -> None:
    code, said, manifest, wire = run_of(tmp_path, "", MISSING)
    assert code == 3
    assert "exit 3: c: " in said
    assert [wire.writes(name) for name in "ab"] == [[], []]
    assert [one.outcome for one in manifest.stations] == ["not_started", "not_started", "gone"]
    assert "did not start because of c" in manifest.stations[0].reason


def test_where_one_refuses_a_setting_that_cannot_heat_none_is_heated_and_what_was_written_is_named(
    tmp_path: Path,
) -> None:
    code, said, manifest, wire = run_of(tmp_path, REFUSES)
    assert code == 3
    assert "exit 3: b: alarm high limit of port 1" in said
    assert [text for name in "ab" for text in wire.writes(name) if text.startswith(HEATS)] == []
    # they rest, and are spared
    assert [text for name in "ab" for text in wire.writes(name) if text.startswith("WPS")] == []
    assert all("sleep delay of port 1 5 min (was 9 min)" in one.reason for one in manifest.stations)
    assert all(one.safe_state == {1: "verified"} for one in manifest.stations)


@pytest.mark.parametrize(
    ("sim", "missing"), [("", MISSING), (REFUSES, "")], ids=["missing", "refused"]
)
def test_the_others_run_without_it_where_that_is_allowed(
    tmp_path: Path, sim: str, missing: str
) -> None:
    code, said, manifest, _ = run_of(tmp_path, sim, missing, "--allow-missing")
    assert "exit 3" not in said
    assert [one.outcome for one in manifest.stations if one.outcome == "left_out"] == ["left_out"]
    left_out = [rule for rule in manifest.verdict_rules if rule["observed"] == "left_out"]
    assert [rule["result"] for rule in left_out] == ["deviation"]
    assert manifest.verdict != "ACCEPT"
    assert code != 3
    samples = pd.read_parquet(next((tmp_path / "runs").iterdir()) / "samples")
    assert set(samples["station"]) == ({"a", "b"} if missing else {"a"})


@pytest.mark.parametrize(
    ("sim", "missing"),
    [("", ""), ("", MISSING), (REFUSES, "")],
    ids=["all well", "missing", "refused"],
)
def test_a_kept_start_is_lived_through_again_by_each_station_alone(
    tmp_path: Path, sim: str, missing: str
) -> None:
    _, _, manifest, _ = run_of(tmp_path, sim, missing, "--capture")
    folder = next((tmp_path / "runs").iterdir())
    kept = pd.read_parquet(folder / "settings").astype(object)
    again, left = relived(folder)
    assert left == {}
    assert {name: (one.outcome, one.reason) for name, one in again.stations.items()} == {
        one.name: (one.outcome, one.reason) for one in manifest.stations
    }
    mine = {(row.station, row.setting, row.outcome, row.readback) for row in again.settings}
    assert mine == {
        (row.station, row.setting, row.outcome, row.readback)
        for row in kept.where(kept.notna(), None).itertuples()
    }
