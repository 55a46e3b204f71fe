"""Runs on pseudo-terminals, reproduced from their captures: the decoded tables are equal."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

from jbclog.analysis.run import open_run
from jbclog.app.reproduce import compare_from_capture
from jbclog.core.errors import UsageError
from jbclog.record.check import check
from jbclog.record.manifest import read_manifest
from jbclog.sim.process import SimProcess
from support.campaigns.awaited import CAPTURE_LACKS, RECORDING_ENDS
from support.command import RECIPE, is_sampling, jbclog, only_run, started, until
from support.product import captured_rows, cut_capture

LINE = """
[line]
name = "field"

[[station]]
name = "dde-1"
url = "dde-1"
family = "dde"
ports = [1]
[station.sim]
noise_c = 0.5
[[station.sim.fault]]
kind = "flip"
bits = 1
at_s = 0.6
every = 9
[[station.sim.fault]]
kind = "dropout"
at_s = 3.2
for_s = 0.7

[[station]]
name = "ucr-1"
url = "ucr-1"
family = "ucr"
[station.sim]
noise_c = 0.5
[[station.sim.fault]]
kind = "silence"
at_s = 0.6
every = 23
"""
HZ, SECONDS = 5, 3
EXIT_STATION, EXIT_SAFETY = 3, 5


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in the field: corrupt frames and an outage on one station, time-outs on the other.

    The cable is out at a fixed time after the station's start. On a busy machine the run may be
    starting then, or over; another run is made, with the cable out later or sooner. It is also made
    again if the host was late: such a host loses answers for longer than a station may be silent.
    """
    cable_out_at_s = 3.2
    for _ in range(12):
        place = tmp_path_factory.mktemp("field")
        ended = recorded_in(place, cable_out_at_s)
        run = only_run(place / "runs")
        if ended.returncode == EXIT_STATION:
            cable_out_at_s += 1.0
            continue
        if ended.returncode == EXIT_SAFETY:  # a host so late that no answer proved a safe state
            continue
        assert ended.returncode in (0, 1), ended.stderr
        if lost_while_sampling(run) == {"dde-1": 1, "ucr-1": 0}:
            passed = passed_in(run)
            if passed == WITH_OUTAGE and counters_were_read(run):
                return run
        elif "lost" in passed_in(run):
            cable_out_at_s += 1.0
        else:
            cable_out_at_s -= 0.3
    pytest.fail(f"no run of twelve had the cable out while it sampled: {ended.stderr}")


WITH_OUTAGE = ["opened", "lost", "failed", "opened", "closed"]


def lost_while_sampling(run: Path) -> dict[str, int]:
    """Return how often the link of each station was lost during sampling."""
    return {one.name: one.outages for one in read_manifest(run).stations}


def passed_in(run: Path) -> list[str]:
    """Return what happened to the port, in order and without repetitions. During the outage it is
    tried at least once.
    """
    of_port = ("opened", "lost", "failed", "closed")
    passed = [row.what for row in captured_rows(run, "dde-1") if row.what in of_port]
    return [what for number, what in enumerate(passed) if what not in passed[:number][-1:]]


LATE, AT_START = "<timeout>", 8
"""Raw text of a counter without an answer; number of counters read before the first sample."""


def raw_counters(run: Path, station: str) -> list[str]:
    return list(open_run(run).counters(station)["raw"])


def in_time(raw: list[str]) -> int:
    """Return how many counters were read before the first one without an answer."""
    return [*raw, LATE].index(LATE)


def counters_were_read(run: Path) -> bool:
    """Whether all counters before the first sample were answered."""
    return all(in_time(raw_counters(run, name)) >= AT_START for name in ("dde-1", "ucr-1"))


def recorded_in(place: Path, cable_out_at_s: float) -> subprocess.CompletedProcess[str]:
    (place / "line.toml").write_text(LINE.replace("at_s = 3.2", f"at_s = {cable_out_at_s}"))
    with SimProcess(place / "line.toml", place / "bench") as stations:
        options = (
            "--line",
            stations.line_path,
            "--out",
            place / "runs",
            "-d",
            f"{SECONDS}s",
            "--rate",
            str(HZ),
            "--order",
            "A 7",
        )
        return jbclog("run", RECIPE, *options, "--capture")


def test_every_byte_is_in_the_runs_folder(original: Path) -> None:
    assert check(original) == []
    manifest = read_manifest(original)
    assert manifest.wire == "whole"
    assert "wire/part-0000.parquet" in {file.path for file in manifest.files}
    assert not [*original.glob("*.journal")]
    passed = captured_rows(original, "dde-1")
    assert any(row.what == "failed" for row in passed)
    ticks = len(open_run(original).samples(station="dde-1"))
    assert sum(row.what == "sent" for row in passed) > ticks * 3


def test_lived_through_again_the_tables_are_the_same(original: Path) -> None:
    before = sorted(original.rglob("*"))
    ended = jbclog("check", original, "--from-capture")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    compared, last = ended.stdout.splitlines()
    samples = len(open_run(original).samples())
    assert compared.startswith(
        f"compared from the capture: {samples} of {samples} rows of samples, "
    )
    assert ": no differences" in last
    assert sorted(original.rglob("*")) == before


CALM = re.sub(r"\[\[station.sim.fault\]\].*?(?=\n\n|\Z)", "", LINE, flags=re.DOTALL)


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two stations without faults, each with its own period."""
    place = tmp_path_factory.mktemp("calm")
    (place / "line.toml").write_text(
        CALM.replace("noise_c = 0.5", "noise_c = 0.5\nturnaround_ms = 60.0", 1)
    )
    with SimProcess(place / "line.toml", place / "bench") as stations:
        ended = jbclog(
            "run",
            RECIPE,
            "--line",
            stations.line_path,
            "--out",
            place / "runs",
            "-d",
            "6s",
            "--rate",
            "fit",
            "--capture",
        )
    assert ended.returncode in (0, 1), ended.stderr
    return only_run(place / "runs")


# -- nothing compared is no success ----------------------------------------------------------------


@pytest.fixture
def copied(calm: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(calm, tmp_path / calm.name))


def test_each_station_has_its_own_rate_again(calm: Path) -> None:
    ended = jbclog("check", calm, "--from-capture")
    assert ended.returncode == 0, ended.stdout + ended.stderr


@pytest.mark.parametrize("share", [0.4, 0.8])
def test_a_capture_that_was_cut_is_reported_with_its_share_and_no_success(
    copied: Path, share: float
) -> None:
    cut_capture(copied, "dde-1", share)
    comparison = compare_from_capture(copied)
    assert comparison.differences == []
    compared, recorded = comparison.compared["samples"]
    assert compared < recorded
    assert comparison.uncompared


@pytest.mark.campaign
def test_a_recorder_that_was_killed_leaves_all_but_the_last_second(tmp_path: Path) -> None:
    (tmp_path / "line.toml").write_text(LINE.replace("dropout", "overheat"))
    with SimProcess(tmp_path / "line.toml", tmp_path / "bench") as stations:
        options = (
            "--line",
            stations.line_path,
            "--out",
            tmp_path / "runs",
            "--rate",
            str(HZ),
            "--capture",
        )
        recorder = started("run", RECIPE, *options)
        assert until(lambda: is_sampling(tmp_path / "runs"))
        run = only_run(tmp_path / "runs")
        (segment,) = run.glob("wire-*.journal")
        assert until(lambda: segment.stat().st_size > 20_000)
        os.kill(recorder.pid, signal.SIGKILL)
        recorder.communicate()
    assert jbclog("recover", run).returncode == 0
    assert check(run) == []
    assert CAPTURE_LACKS in (read_manifest(run).wire or "")
    last = max(row.at_s for row in captured_rows(run, "dde-1"))
    samples = open_run(run).samples(station="dde-1")
    t0 = read_manifest(run).t0_mono or 0.0
    assert samples["tick"].max() / HZ < last - t0 + 1.0
    again = jbclog("check", run, "--from-capture", "--json")
    assert again.returncode == 0, again.stdout + again.stderr
    told = json.loads(again.stdout)
    assert told["findings"] == []
    assert re.search(
        rf"dde-1: {RECORDING_ENDS} [\d.]+ s after the run's start, before its session",
        told["notes"][0],
    )
    shown = jbclog("check", run, "--from-capture").stdout
    assert "no differences in what is covered; " in shown
    assert "the capture ends early (fingerprint" in shown


def test_a_run_without_a_capture(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="only a run recorded with --capture can be reproduced"):
        compare_from_capture(tmp_path)
