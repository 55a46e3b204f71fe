"""`jbclog run` as a user runs it: real pseudo-terminals, a real disk, real signals."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest

from support.command import RECIPE, WireLog, is_sampling, jbclog, only_run, started, until
from support.product import SAMPLE_COLUMNS, SimProcess, check_run, read_manifest

Bench = tuple[Path, WireLog]
STAND = "WPS100001"


def last_states(wire: WireLog, station: str) -> set[str]:
    """Return the last status word of each tool; the feeder may be stopped after it."""
    ordered = [text for text in wire.writes(station) if text.startswith("WPS")]
    return {*{text[3]: text[4:] for text in ordered}.values()}


def recording(line: Path, out: Path, options: str) -> list[str | Path]:
    """Return the arguments of a run with the shipped recipe. A rate in `options` is a requirement:
    at 5 Hz the feeder's station is refused if a busy machine takes 40 ms for its answers.
    """
    return ["run", RECIPE, "--line", line, "--out", out, *options.split()]


def test_a_run_leaves_the_folder_that_the_reference_describes(bench: Bench, tmp_path: Path) -> None:
    line, wire = bench
    ended = jbclog(*recording(line, tmp_path / "runs", "-d 4s -s ale-1 --rate 2"))
    folder = Path(ended.stdout.splitlines()[-1])
    assert folder == only_run(tmp_path / "runs")
    assert sorted(path.name for path in folder.iterdir()) == [
        "counters",
        "events",
        "line.toml",
        "manifest.json",
        "recipes",
        "samples",
        "settings",
    ]
    assert (folder / "recipes" / RECIPE.name).read_bytes() == RECIPE.read_bytes()
    samples = pd.read_parquet(folder / "samples")
    assert tuple(samples.columns) == ("run", "seq", *SAMPLE_COLUMNS)
    assert len(samples) == 8
    assert (samples["tick"].diff().dropna() == 1).all()
    assert str(samples["time"].dtype) == "datetime64[us, UTC]"
    assert check_run(folder) == []
    assert last_states(wire, "ale-1") == {STAND[4:]}
    assert wire.writes("dde-1") == []


def test_the_record_proves_each_setting(bench: Bench, tmp_path: Path) -> None:
    line, wire = bench
    ended = jbclog(*recording(line, tmp_path / "runs", "-d 2s -s ale-1 --rate 2"))
    settings = pd.read_parquet(Path(ended.stdout.split()[-1]) / "settings").set_index("setting")
    written = settings[settings["outcome"] == "confirmed"]
    assert (written["requested"] == written["readback"]).all()
    assert settings.loc["feeder_length", "readback"] == "5.00"
    assert settings.loc["sleep_delay", "outcome"] == "unchanged"
    # what already holds is not written
    assert not any(text.startswith("WD1") for text in wire.writes("ale-1"))


def test_json_gives_one_object_with_the_run(bench: Bench, tmp_path: Path) -> None:
    line, _ = bench
    ended = jbclog(*recording(line, tmp_path / "runs", "-d 2s -s ucr-1 --json"))
    told = json.loads(ended.stdout)
    assert told["folder"] == str(only_run(tmp_path / "runs"))
    assert told["exit_code"] == ended.returncode


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 143)]
)
def test_a_signal_cuts_a_stated_duration_short_and_leaves_the_tools_safe(
    bench: Bench, tmp_path: Path, number: signal.Signals, code: int
) -> None:
    line, wire = bench
    run = started(*recording(line, tmp_path / "runs", "-d 60s --rate auto"))
    assert until(lambda: is_sampling(tmp_path / "runs"))
    run.send_signal(number)
    run.send_signal(number)  # impatience changes nothing
    _, notes = run.communicate(timeout=200)
    assert run.returncode == code, notes
    for station in ("dde-1", "dde-2", "ucr-1", "ale-1"):
        assert last_states(wire, station) == {STAND[4:]}
    ale = wire.writes("ale-1")
    assert ale[ale.index(STAND) - 1] == "WSTP00000"  # the feeder first
    assert check_run(only_run(tmp_path / "runs")) == []


def test_signals_without_end_do_not_keep_a_record_from_being_sealed(
    bench: Bench, tmp_path: Path
) -> None:
    line, _ = bench
    run = started(*recording(line, tmp_path / "runs", "-d 60s -s ucr-1"))
    assert until(lambda: is_sampling(tmp_path / "runs"))
    while run.poll() is None:
        run.send_signal(signal.SIGINT)
        time.sleep(0.02)
    told, notes = run.communicate()
    assert run.returncode == 130, notes
    assert told.split()[-1] == str(only_run(tmp_path / "runs"))
    assert check_run(only_run(tmp_path / "runs")) == []


def test_ctrl_c_is_the_normal_end_of_a_run_without_duration(bench: Bench, tmp_path: Path) -> None:
    line, wire = bench
    recipe = tmp_path / "plain.toml"
    recipe.write_text(RECIPE.read_text().split("[acceptance]")[0])
    run = started("run", recipe, "--line", line, "--out", tmp_path / "runs", "-s", "ucr-1")
    assert until(lambda: is_sampling(tmp_path / "runs"))
    run.send_signal(signal.SIGINT)
    _, notes = run.communicate(timeout=200)
    assert run.returncode == 0, notes
    assert wire.writes("ucr-1")[-1] == STAND


def test_a_second_recorder_is_told_who_holds_the_port(bench: Bench, tmp_path: Path) -> None:
    line, _ = bench
    first = started(*recording(line, tmp_path / "runs", "-d 60s -s ucr-1"))
    assert until(lambda: is_sampling(tmp_path / "runs"))
    second = jbclog(*recording(line, tmp_path / "others", "-d 2s -s ucr-1"))
    first.terminate()
    first.communicate(timeout=200)
    assert second.returncode == 3
    (folder,) = (tmp_path / "runs").iterdir()
    assert (
        f"ucr-1: the run {folder} (process {first.pid}) holds this port; nothing was sent"
        in second.stderr
    )
    refused = only_run(tmp_path / "others")
    assert second.stdout == f"{refused}\n"
    assert (
        read_manifest(refused).exit_status,
        read_manifest(refused).exit_code,
        check_run(refused),
    ) == ("failed", 3, [])


def test_a_second_run_through_a_server_s_port_is_refused_too(tmp_path: Path) -> None:
    source = tmp_path / "source.toml"
    source.write_text(
        '[line]\nname = "l"\n[[station]]\nname = "ucr-1"\nurl = "ucr-1"\nfamily ='
        ' "ucr"\n[station.sim]\n'
    )
    with SimProcess(source, tmp_path / "bench", tcp="127.0.0.1:0") as stations:
        first = started(*recording(stations.line_path, tmp_path / "runs", "-d 60s"))
        try:
            assert until(lambda: is_sampling(tmp_path / "runs"))
            other = tmp_path / "other.toml"
            other.write_text(stations.line_path.read_text().replace("127.0.0.1", "localhost"))
            second = jbclog(*recording(other, tmp_path / "others", "-d 2s"))
        finally:
            first.terminate()
            first.communicate(timeout=200)
    assert second.returncode == 3
    assert f"the run {next((tmp_path / 'runs').iterdir())} " in second.stderr


def test_what_was_committed_before_a_kill_is_recovered(bench: Bench, tmp_path: Path) -> None:
    line, _ = bench
    run = started(*recording(line, tmp_path / "runs", "-d 60s -s ucr-1"))
    assert until(lambda: is_sampling(tmp_path / "runs"))
    run.kill()
    run.communicate(timeout=200)
    recovered = jbclog("recover", tmp_path / "runs")
    folder = only_run(tmp_path / "runs")
    manifest = (folder / "manifest.json").read_bytes()
    assert recovered.returncode == 0, recovered.stderr
    assert json.loads(manifest)["exit_status"] == "lost"
    assert len(pd.read_parquet(folder / "samples")) > 0
    assert jbclog("check", folder).returncode == 0
    jbclog("recover", tmp_path / "runs")
    assert (folder / "manifest.json").read_bytes() == manifest  # twice is as good as once


def test_a_folder_that_cannot_hold_a_record_stops_the_run_before_any_question(
    bench: Bench, tmp_path: Path
) -> None:
    line, wire = bench
    (tmp_path / "runs").write_text("a file, not a folder")
    ended = jbclog(*recording(line, tmp_path / "runs", "-d 2s"))
    assert ended.returncode == 4
    assert "No station was touched" in ended.stderr
    assert wire.questions("dde-1") == []


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Mount a disk of 8 MiB."""
    if shutil.which("mount") is None or os.geteuid() != 0:
        pytest.skip("mount (as root) is needed for a small disk")
    folder = tmp_path / "small"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", folder], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("mount is not allowed here")
    yield folder
    # a process that a run has left ends soon, and holds a file until then
    assert until(lambda: subprocess.run(["umount", folder], check=False).returncode == 0)


@pytest.mark.usefixtures("own_state")  # no other test is to name this disk
def test_a_full_disk_ends_the_run_with_the_tools_safe(
    bench: Bench, tmp_path: Path, small_disk: Path
) -> None:
    line, wire = bench
    run = started(*recording(line, small_disk, "-d 60s --rate auto"))
    assert until(lambda: is_sampling(small_disk))
    with (small_disk / "other-data").open("wb") as filler:
        while True:
            try:
                filler.write(b"x" * 65536)
                filler.flush()
            except OSError:
                break
        _, notes = run.communicate(timeout=200)
    assert run.returncode == 4, notes
    for station in ("dde-1", "dde-2", "ucr-1", "ale-1"):
        assert last_states(wire, station) == {STAND[4:]}
