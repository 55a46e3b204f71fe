"""`jbclog batch` as a person starts it: real pseudo-terminals, real processes, killed and started again."""

from __future__ import annotations

import json
import os
import random
import signal
from pathlib import Path

import pytest
from batch_trial import JOBS, Trial, disturbed, faults, running, write_batch
from command import WireLog, is_sampling, jbclog, started, until

Bench = tuple[Path, WireLog]
STAND = "WPS100001"


def test_killed_and_started_again_every_job_is_done_once(bench: Bench, tmp_path: Path) -> None:
    """A job is killed, then the foreman, then both are let be: nothing is lost, nothing done twice."""
    line, wire = bench
    jobs = write_batch(tmp_path, line, seconds=2.5)
    out = tmp_path / "runs"
    first = started("batch", jobs, "--out", out)
    assert until(lambda: is_sampling(out))
    victim = running(out)[0]
    os.kill(victim, signal.SIGKILL)
    first.kill()
    first.communicate()
    again = jbclog("batch", jobs, "--out", out, "--resume", "--json", timeout=90)
    told = json.loads(again.stdout)
    assert again.returncode == 0, again.stderr
    assert "is recovered and recorded as half done, and the job is done again" in again.stderr
    assert {job["name"]: job["state"] for job in told["jobs"]} == {name: "done" for name, _, _ in JOBS}
    assert [run["state"] for job in told["jobs"] for run in job["runs"]].count("half done") == 1
    assert faults(Trial(out)) == []
    for station in ("dde-1", "ucr-1", "ale-1"):
        assert STAND in wire.writes(station)[-2:]
    anew = jbclog("batch", jobs, "--out", out, "--resume")
    assert anew.returncode == 2
    assert "there is no batch to go on with, the last one was finished at" in anew.stderr


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", range(40))
def test_whatever_is_killed_when_every_job_is_done_once(bench: Bench, tmp_path: Path, seed: int) -> None:
    trial = disturbed(tmp_path, bench[0], random.Random(seed), kills=4)
    assert trial.wrong == []
