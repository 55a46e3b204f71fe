"""A recorded run served again on pseudo-terminals: the same decoded tables at its own pace, and at a faster one."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import pytest
from command import RECIPE, is_sampling, jbclog, started, until
from typer.testing import CliRunner

from jbclog.analysis.run import Run, open_run
from jbclog.cli.app import app
from jbclog.record.check import check
from jbclog.record.manifest import read_manifest
from jbclog.record.wire import read_rows, wire_path
from jbclog.sim.process import SimProcess

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
FAST = ["temperature_c", "power_permille", "status"]
SLOW = ["set_c", "tool", "port_error", "station_error", "alarm_high", "transformer_c", "transistor_c"]


def only_run(out: Path) -> Path:
    (folder,) = out.iterdir()
    return folder


@contextmanager
def served(run: Path, folder: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """`jbclog replay`, from its ports' appearing to Ctrl-C."""
    process = started("replay", run, "--dir", folder, *options)
    try:
        assert until((folder / "line.toml").exists)
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=10)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in the field: corrupt frames and an outage on one station, time-outs on the other."""
    place = tmp_path_factory.mktemp("field")
    (place / "line.toml").write_text(LINE)
    with SimProcess(place / "line.toml", place / "bench") as stations:
        options = ("--line", stations.line_path, "--out", place / "runs", "-d", f"{SECONDS}s", "--rate", str(HZ), "--order", "A 7")
        ended = jbclog("run", RECIPE, *options, "--wire")
    assert ended.returncode in (0, 1), ended.stderr
    return only_run(place / "runs")


def rows(run: Path, station: str) -> pd.DataFrame:
    samples = open_run(run).samples(station=station)
    return samples.assign(tick=samples["tick"] - samples["tick"].min()).set_index("tick")


def readings(samples: pd.DataFrame, column: str) -> list[object]:
    """What was read of a signal, or the reason why it was not, in order."""
    why = samples["reasons"].str.extract(rf"(?:^|;){column}=([^;]+)", expand=False)
    return samples[column].astype(object).fillna(why).dropna().to_list()


def test_every_byte_is_in_the_runs_folder(original: Path) -> None:
    assert check(original) == []
    manifest = read_manifest(original)
    assert manifest.wire == "whole"
    assert {file.path for file in manifest.files} >= {"wire/dde-1.tsv.gz", "wire/ucr-1.tsv.gz"}
    passed = list(read_rows(wire_path(original, "dde-1")))
    assert [row.what for row in passed if row.what in ("opened", "lost", "closed")] == ["opened", "lost", "opened", "closed"]
    assert any(row.what == "failed" for row in passed)
    (station,) = (facts for facts in manifest.stations if facts.name == "dde-1")
    assert station.outages == 1
    assert sum(row.what == "sent" for row in passed) > len(rows(original, "dde-1")) * 3


def test_lived_through_again_the_tables_are_the_same(original: Path, tmp_path: Path) -> None:
    ended = jbclog("replay", original, "--record", tmp_path / "again")
    again = only_run(tmp_path / "again")
    assert (ended.returncode, ended.stdout) == (0, f"{again}\n"), ended.stderr
    assert ended.stderr == "the same decoded tables\n"
    assert check(again) == []
    before, after = open_run(original).samples(), open_run(again).samples()
    pd.testing.assert_frame_equal(before.drop(columns="time"), after.drop(columns="time"))
    assert (before["time"] - after["time"]).abs().max() < pd.Timedelta("50ms")
    manifest = read_manifest(again)
    assert manifest.metadata.tags == {"replay_of": original.name}
    assert manifest.metadata.order == "A 7"
    assert manifest.verdict == read_manifest(original).verdict
    assert again.name[:16] == original.name[:16]


def test_recorded_again_at_its_own_pace(original: Path, tmp_path: Path) -> None:
    with served(original, tmp_path / "served") as replaying:
        assert replaying.stderr is not None
        replaying.stderr.readline()
        typed = shlex.split(replaying.stderr.readline())
        assert typed[:2] == ["jbclog", "run"]
        assert {"--rate", "--duration", "--order", "A 7"} < set(typed)
        ended = jbclog(*typed[1:], "--out", tmp_path / "runs")
        assert ended.returncode in (0, 1), ended.stderr
    again = only_run(tmp_path / "runs")
    first, second = open_run(original), open_run(again)
    for station in ("dde-1", "ucr-1"):
        ours, theirs = rows(original, station), rows(again, station)
        assert len(theirs) == len(ours) == HZ * SECONDS
        for column in FAST:
            assert readings(theirs, column) == readings(ours, column)
        for column in SLOW:  # when the wire has room for them is a matter of fractions of a millisecond
            mine, other = readings(ours, column), readings(theirs, column)
            assert mine[: len(other)] == other[: len(mine)]
            assert abs(len(mine) - len(other)) <= 1
        written = ["port", "setting", "requested", "written", "readback", "outcome"]
        pd.testing.assert_frame_equal(first.settings(station)[written], second.settings(station)[written])
        assert second.counters(station)["raw"].to_list() == first.counters(station)["raw"].to_list()
        assert kinds(second, station) == kinds(first, station)


def kinds(run: Run, station: str) -> list[str]:
    """What happened; that a slow signal was not read may fall behind the end."""
    return [kind for kind in run.events(station)["kind"] if not kind.startswith(("read.", "alarm."))]


def test_recorded_again_three_times_as_fast(original: Path, tmp_path: Path) -> None:
    with served(original, tmp_path / "served", "--speed", "3"):
        options = ("--line", tmp_path / "served" / "line.toml", "--out", tmp_path / "runs", "--rate", str(3 * HZ))
        ended = jbclog("run", *options, "-d", "0.8s", "-s", "ucr-1", "--order", "x")
    assert ended.returncode in (0, 1), ended.stderr
    ours, theirs = rows(original, "ucr-1"), rows(only_run(tmp_path / "runs"), "ucr-1")
    assert len(theirs) == 12
    for column in FAST:  # a silence is as long as the client's patience, and may well cost it a tick
        values = theirs[column].dropna().to_list()
        assert len(values) > 6
        assert values == ours[column].dropna().to_list()[: len(values)]


def test_a_recorder_that_was_killed_leaves_all_but_the_last_second(tmp_path: Path) -> None:
    (tmp_path / "line.toml").write_text(LINE.replace("dropout", "overheat"))
    with SimProcess(tmp_path / "line.toml", tmp_path / "bench") as stations:
        options = ("--line", stations.line_path, "--out", tmp_path / "runs", "--rate", str(HZ), "--wire")
        recorder = started("run", RECIPE, *options)
        assert until(lambda: is_sampling(tmp_path / "runs"))
        run = only_run(tmp_path / "runs")
        wire = wire_path(run, "dde-1")
        assert until(lambda: wire.stat().st_size > 5000)
        os.kill(recorder.pid, signal.SIGKILL)
        recorder.communicate()
    assert jbclog("recover", run).returncode == 0
    assert check(run) == []
    assert "At most the last 1 s" in (read_manifest(run).wire or "")
    last, samples = max(row.at_s for row in read_rows(wire)), open_run(run).samples(station="dde-1")
    t0 = read_manifest(run).t0_mono or 0.0
    assert samples["tick"].max() / HZ < last - t0 + 1.0
    again = jbclog("replay", run, "--record", tmp_path / "again", "--json")
    assert again.returncode == 0, again.stdout + again.stderr
    told = json.loads(again.stdout)
    assert (told["run"], told["same"], told["differences"]) == (str(only_run(tmp_path / "again")), True, [])
    assert re.search(r"dde-1: the recording ends [\d.]+ s after the run's start, before its session did", told["left"][0])


def test_wrong_usage(original: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    for arguments, why in (
        ([str(original), "--record", "again", "--speed", "2"], "--record serves nothing: leave out --dir, --tcp and --speed"),
        (["nowhere"], "there is no such folder"),
        (["empty"], "only a run with --wire can be replayed"),
        ([str(original), "--dir", str(original)], "would be overwritten"),
    ):
        ended = CliRunner().invoke(app, ["replay", *arguments])
        assert (ended.exit_code, ended.stdout) == (2, "")
        assert why in ended.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]
    assert check(original) == []
