"""`jbclog batch` as a user starts it: real pseudo-terminals and processes, killed and started
again.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from support import program
from support.command import WireLog, is_sampling, jbclog, started, until
from support.faults.batch_trial import Trial, disturbed, faults, recording, write_batch
from support.product import check_run

Bench = tuple[Path, WireLog]
STAND = "WPS100001"
LINE = """
[line]
name = "bench"

[[station]]
name = "dde-1"
url = "nowhere"
family = "dde"
"""


def test_killed_and_started_again_every_job_is_done_once(bench: Bench, tmp_path: Path) -> None:
    """First a job is killed, then the executor: nothing is lost, nothing is done twice, and the
    incomplete job is reported.
    """
    line, wire = bench
    jobs = write_batch(tmp_path, line, seconds=4.0, count=3)
    out = tmp_path / "runs"
    first = started("batch", jobs, "--out", out)
    assert until(lambda: bool(recording(out)))
    first.send_signal(signal.SIGSTOP)  # so that it does not see how the job ends
    os.kill(recording(out)[0], signal.SIGKILL)
    first.kill()
    first.communicate()
    again = jbclog("batch", jobs, "--out", out, "--resume", "--json", timeout=200)
    told = json.loads(again.stdout)
    assert again.returncode == 0, again.stderr
    assert "is recovered and recorded as half done, and the job is done again" in again.stderr
    assert {job["name"]: job["state"] for job in told["jobs"]} == dict.fromkeys(
        ("a1", "a2", "b1"), "done"
    )
    assert [run["state"] for job in told["jobs"] for run in job["runs"]].count("half done") == 1
    assert faults(Trial(out)) == []
    for station in ("dde-1", "ucr-1"):
        assert STAND in wire.writes(station)[-2:]
    anew = jbclog("batch", jobs, "--out", out, "--resume")
    assert anew.returncode == 2
    assert "no batch to resume, the last one finished at" in anew.stderr


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 143)]
)
def test_a_signal_ends_what_runs_with_its_tools_safe(
    bench: Bench, tmp_path: Path, number: signal.Signals, code: int
) -> None:
    line, wire = bench
    out = tmp_path / "runs"
    batch = started("batch", write_batch(tmp_path, line, seconds=60.0), "--out", out, "--json")
    assert until(lambda: is_sampling(out) and len(recording(out)) == 2)
    batch.send_signal(number)
    batch.send_signal(number)  # impatience changes nothing
    said, notes = batch.communicate(timeout=200)
    told = json.loads(said)
    assert (batch.returncode, told["exit_code"], told["finished"]) == (code, code, False), notes
    states = {job["name"]: job["state"] for job in told["jobs"]}
    assert states == {
        "a1": "half done",
        "a2": "not started",
        "b1": "half done",
        "c1": "not started",
    }
    for job in told["jobs"]:
        for run in job["runs"]:
            assert check_run(Path(run["folder"])) == []
    for station in ("dde-1", "ucr-1"):
        assert STAND in wire.writes(station)[-2:]
    assert wire.writes("ale-1") == []


def test_killed_while_its_folder_is_made_it_has_started_nothing(tmp_path: Path) -> None:
    """One step of the campaign below, which needs no station."""
    line, out = tmp_path / "line.toml", tmp_path / "runs"
    line.write_text(LINE)
    jobs = write_batch(tmp_path, line, count=1)
    killed = program("faults.killed_batch", 12, "batch", jobs, "--out", out)
    done = subprocess.run(killed, capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert out.is_dir()
    assert list(out.glob("*.batch/*/jobs")) == []


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("step", range(1, 150, 4))
def test_killed_at_each_step_every_job_is_done_once(
    bench: Bench, tmp_path: Path, step: int, counted: Callable[..., None]
) -> None:
    jobs, out = write_batch(tmp_path, bench[0], seconds=1.0, count=3), tmp_path / "runs"
    killed = program("faults.killed_batch", step, "batch", jobs, "--out", out)
    first = subprocess.run(killed, capture_output=True, text=True, timeout=200, check=False)
    if first.returncode >= 0:
        pytest.fail(f"it was finished before step {step}")
    is_told = "a2" in first.stdout  # the table of the jobs: from there on a new start is one
    again = jbclog("batch", jobs, "--out", out, *(["--resume"] if is_told else []), timeout=200)
    assert again.returncode == 0 or (is_told and "finished at" in again.stderr), again.stderr
    wrong = faults(Trial(out))
    counted(executors_killed=1, wrong=len(wrong))
    assert wrong == []


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", range(40))
def test_whatever_is_killed_when_every_job_is_done_once(
    bench: Bench, tmp_path: Path, seed: int, counted: Callable[..., None]
) -> None:
    trial = disturbed(tmp_path, bench[0], random.Random(seed), kills=4)
    kills, runs = trial.kills, trial.runs()
    counted(
        batches=1,
        sittings=trial.sittings,
        executors_killed=kills["executor"],
        jobs_killed=kills["job"],
        terminated=kills["term"],
    )
    not_once = sum(" was done " in fault for fault in trial.wrong)
    counted(
        runs=len(runs),
        runs_half_done=runs.count("half done"),
        jobs_not_done_once=not_once,
        wrong=len(trial.wrong),
    )
    assert trial.wrong == []
