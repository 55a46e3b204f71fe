"""Limits about joints from a recorded run to its verdict: recorder, report and `check` come to
the same from the same files.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from jbclog import __version__
from jbclog.analysis.joints import evidence as evidence_of
from jbclog.analysis.joints.evidence import feeds_of, joint_evidence
from jbclog.analysis.joints.joints import find_joints
from jbclog.analysis.joints.series import Cycles, Series
from jbclog.analysis.rejudge import check_verdict, judge_again
from jbclog.analysis.run import open_run
from jbclog.analysis.verdict import Feeds
from jbclog.record.manifest import Manifest, read_manifest, write_manifest
from jbclog.record.parts import part_paths
from jbclog.report.write import write_report
from support.readers.run_files import differing_files
from support.records import made_series
from support.records.made_series import joints_at
from support.virtual.recorded_run import run_in
from support.virtual.virtual_run import RECIPE, line_text

FEEDER = "\n[feeder]\nmode = 'discontinuous'\nlength_mm = 5.0\nspeed_mm_s = 10.0\n"
ASKED = "\n[acceptance]\nrecovery_p95_s = 2.0\njoints_against_counter_percent = 2\n"
SIM = "joints_per_minute = 24\njoint_seconds = 0.8\nfeed_each_joint = true"


def run_of(home: Path, recipe: str, seconds: float, sim: str = SIM, family: str = "ale") -> Path:
    return run_in(home, line_text(sim).replace('"dde"', f'"{family}"'), recipe, seconds)


@pytest.fixture(scope="module")
def soldered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_of(tmp_path_factory.mktemp("soldered"), RECIPE + FEEDER + ASKED, 230.0)


def rules(manifest: Manifest) -> dict[object, dict[str, object]]:
    return {
        rule["name"]: rule
        for rule in manifest.verdict_rules
        if "joint" in str(rule["name"]) or "recov" in str(rule["name"])
    }


def test_the_recorder_judges_joints(soldered: Path) -> None:
    manifest = read_manifest(soldered)
    recovery, counted = rules(manifest)["recovery_p95"], rules(manifest)["joints_against_counter"]
    joints = open_run(soldered).joints()
    assert len(joints) > 60
    assert manifest.verdict == "ACCEPT"
    observed = np.sort(joints["recovery_s"].dropna())[
        int(np.ceil(0.95 * joints["recovery_s"].notna().sum())) - 1
    ]
    assert recovery["observed"] == pytest.approx(observed, abs=1e-3)
    bound = recovery["bound"]
    assert isinstance(bound, dict)
    assert bound["n"] == len(joints) - 1  # with the last one the record ended
    assert (counted["observed"], counted["result"]) == (0, "pass")
    assert str(counted["text"]).startswith(
        f"{len(joints)} joints found, {len(joints)} feeds counted: "
    )


def test_the_joints_judged_are_those_of_the_table(
    soldered: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    manifest, joints = read_manifest(soldered), open_run(soldered).joints()
    found = joint_evidence(soldered, manifest.stations, manifest.t0_utc)
    back = [one.seconds for one in found["dde-1", 1].recoveries if one is not None and one.back]
    assert back == pytest.approx(list(joints["recovery_s"].dropna()), abs=1e-3)
    monkeypatch.setattr("jbclog.analysis.joints.port_reader.MOST_ROWS", 1)
    twice = [*manifest.stations, replace(manifest.stations[0], name="not there")]
    assert joint_evidence(soldered, twice, manifest.t0_utc)["dde-1", 1] == found["dde-1", 1]


def test_evidence_does_not_depend_on_row_groups_and_is_what_the_joints_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sim = "joints_per_minute = 24\njoint_seconds = 0.8"
    folder = run_of(
        tmp_path, RECIPE + "\n[acceptance]\nrecovery_p95_s = 2.0\n", 60.0, sim, family="dde"
    )
    manifest, joints = read_manifest(folder), open_run(folder).joints()
    found = joint_evidence(folder, manifest.stations, manifest.t0_utc)
    told = [one.seconds for one in found["dde-1", 1].recoveries if one is not None and one.back]
    assert told == pytest.approx(list(joints[joints["port"] == 1]["recovery_s"].dropna()), abs=1e-3)
    assert len(told) > 10
    part = part_paths(folder, "samples")[0]
    pq.write_table(pq.read_table(part, partitioning=None), part, row_group_size=37)
    # so that each sweep reads the row groups anew
    monkeypatch.setattr("jbclog.analysis.joints.port_reader.MOST_ROWS", 100)
    assert joint_evidence(folder, manifest.stations, manifest.t0_utc) == found


def test_report_comes_to_the_same_and_says_where_it_does_not(
    soldered: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(soldered, tmp_path / soldered.name)
    manifest = read_manifest(folder)
    assert judge_again(folder, manifest).rules_as_dicts() == manifest.verdict_rules
    write_report(folder)
    assert differing_files(folder) == []
    rules(manifest)["recovery_p95"]["result"] = "missing"
    manifest.verdict = "INCONCLUSIVE"
    write_manifest(folder, manifest)
    assert check_verdict(folder, manifest).differing == [
        "verdict: was INCONCLUSIVE, its record gives ACCEPT",
        "verdict, recovery_p95 of dde-1 port 1: was missing, its record gives pass",
    ]
    manifest.host["jbclog"] = "0.0.1"
    assert (
        check_verdict(folder, manifest)
        .differing[0]
        .endswith("gives ACCEPT; it was judged by jbclog 0.0.1")
    )
    manifest.host["jbclog"] = __version__


def test_too_few_joints_are_not_accepted_and_slow_ones_rejected(tmp_path: Path) -> None:
    few, slow = tmp_path / "few", tmp_path / "slow"
    for home in (few, slow):
        home.mkdir()
    assert read_manifest(run_of(few, RECIPE + FEEDER + ASKED, 40.0)).verdict == "INCONCLUSIVE"
    strict = ASKED.replace("2.0", "0.5")
    assert (
        rules(read_manifest(run_of(slow, RECIPE + FEEDER + strict, 40.0)))["recovery_p95"]["result"]
        == "fail"
    )


def test_what_this_program_cannot_do_ends_no_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("for the test")

    monkeypatch.setattr(evidence_of, "find_joints", broken)
    manifest = read_manifest(run_of(tmp_path, RECIPE + FEEDER + ASKED, 5.0))
    assert (manifest.state, manifest.verdict) == ("sealed", "INCONCLUSIVE")
    assert "ZeroDivisionError: for the test" in str(rules(manifest)["recovery_p95"]["text"])


# -- joints and feeds between two readings of the counter ------------------------------------------


def feeds(series: Series, times: list[float], counts: list[float], stepped_s: float = 0.0) -> Feeds:
    series = replace(series, cycles=Cycles(np.array(times), np.array(counts)))
    return feeds_of(series, find_joints(series).by_heat, stepped_s)


def made(lose: tuple[float, float] = (0.0, 0.0)) -> Series:
    """Two minutes of a tip at 10 Hz that gives heat away for 1.5 s each six seconds, from 10 s on,
    and is fed: 18 joints.
    """
    series = made_series.made(120, *joints_at([10.0 + 6 * number for number in range(18)]))
    busy = ((series.seconds % 6 >= 4.2) & (series.seconds % 6 < 4.9) & (series.seconds > 9)).astype(
        np.float64
    )
    return made_series.lose(replace(series, feeding=busy), lose)


def test_feeds_are_counted_between_the_first_and_the_last_reading() -> None:
    assert feeds(made(), [0.0, 120.0], [5, 23]).counted == 18
    whole = feeds(made(), [0.0, 121.0], [5, 23])
    # one may begin with the last row, and shows no heat yet
    assert (whole.at_edges, whole.beyond, whole.lost_s) == (0, 1, 0)
    half = feeds(made(), [0.0, 62.0, 119.0], [5, 14, 23])
    assert half.found == whole.found
    assert feeds(made(), [0.0, 62.0], [5, 14]).found == sum(
        5 < start < 62 for start in range(10, 120, 6)
    )


@pytest.mark.parametrize(("last", "at_edges", "beyond"), [(62.0, 0, 0), (65.5, 1, 0), (63.5, 0, 1)])
def test_joints_at_a_reading_are_on_neither_side(last: float, at_edges: int, beyond: int) -> None:
    found = feeds(made(), [0.0, last], [0, 9])
    assert (found.at_edges, found.beyond) == (at_edges, beyond)
    assert feeds(made(), [0.0, 62.0], [0, 9], stepped_s=3.0).at_edges == 1


def test_gaps_and_resets_are_reported() -> None:
    assert feeds(made((50.0, 60.0)), [0.0, 121.0], [0, 18]).lost_s == pytest.approx(10, abs=0.2)
    assert feeds(made((50.0, 50.1)), [0.0, 121.0], [0, 18]).lost_s == 0
    reset = feeds(made(), [0.0, 60.0, 121.0], [9, 18, 3])
    assert (reset.counted, reset.why) == (None, "The counter went down: it was reset.")
    assert feeds(made(), [0.0], [9]).counted is None
