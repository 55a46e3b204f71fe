"""What came of a process that was told to end before its run began: the work of who told it, and no
failure of the record.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from jbclog.app.batch.child import SPEC
from jbclog.app.batch.job_dir import JobDir, JobResult
from jbclog.app.batch.job_spec import JobSpec
from jbclog.app.batch.processes import AttemptResult, SystemProcesses, result_of, tagged
from jbclog.app.batch.state import State
from jbclog.app.run.options import RunOptions
from jbclog.app.run.runner import Job
from jbclog.record.check import check
from jbclog.record.manifest import Manifest, Metadata, read_manifest, write_manifest
from jbclog.record.recover import recover
from jbclog.record.segments import segment_name
from support.records import few_rows

# not `signal.pause()`: a SIGINT just before it would only be seen after the next signal
WAITS = "import time\nwhile True: time.sleep(0.2)"


def came(processes: SystemProcesses) -> AttemptResult:
    while processes.runs("a", 1) or (came := processes.result("a", 1)) is None:
        time.sleep(0.005)
    return came


def processes_with(folder: Path, process: subprocess.Popen[bytes]) -> SystemProcesses:
    processes = SystemProcesses(folder, {})
    processes._children[processes.job_dir("a", 1).folder] = process
    return processes


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 143)]
)
def test_told_to_end_before_its_run_began(
    tmp_path: Path, number: signal.Signals, code: int
) -> None:
    processes = processes_with(tmp_path, subprocess.Popen([sys.executable, "-S", "-c", WAITS]))
    assert processes.request_end("a", 1, number)
    text = f"{number.name} ended it before its run began; no station was touched"
    assert came(processes) == AttemptResult(State.HALF, code, text)


def test_a_job_that_was_started_under_nohup_ends_with_a_batch_that_is_hung_up(
    tmp_path: Path,
) -> None:
    deaf = (
        "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN); print(flush=True);"
        " signal.pause()"
    )
    with subprocess.Popen([sys.executable, "-S", "-c", deaf], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        processes = processes_with(tmp_path, process)
        assert processes.request_end("a", 1, signal.SIGHUP)
        assert came(processes).exit_code == 143


def test_dead_by_itself_before_its_run_began(tmp_path: Path) -> None:
    processes = processes_with(
        tmp_path, subprocess.Popen([sys.executable, "-S", "-c", "raise SystemExit(1)"])
    )
    assert came(processes) == AttemptResult(
        State.FAILED, 4, "its process ended before its run began"
    )


def cut_off(home: Path) -> tuple[JobDir, Path]:
    """An attempt whose process died when its run had a folder and its papers did not name it yet;
    the run.
    """
    papers = JobDir(home / "night.batch" / "20261122T004342Z" / "jobs" / "a-1")
    run = few_rows.abandoned(home)
    order = tagged(JobSpec(Job(RunOptions(home / "line.toml"), run.parent, "a")), papers)
    os.close(papers.make(SPEC.dump_json(order)))
    assert order.job.wanted.metadata is not None
    write_manifest(
        run, Manifest(run.name, metadata=Metadata(tags=dict(order.job.wanted.metadata.tags)))
    )
    return papers, run


def test_a_run_that_its_papers_do_not_name_yet_is_found_and_recorded_as_half_done(
    tmp_path: Path,
) -> None:
    papers, run = cut_off(tmp_path)
    came = result_of(papers)
    assert (came.state, came.run) == (State.HALF, run)
    assert read_manifest(run).state == "sealed"
    assert check(run) == []


def test_another_attempts_run_is_not_taken_for_its_own(tmp_path: Path) -> None:
    papers, _ = cut_off(tmp_path)
    other = JobDir(papers.folder.with_name("a-2"))
    os.close(other.make(papers.spec()))
    assert result_of(other).run is None


def test_a_run_whose_process_died_before_it_had_cleared_up_is_cleared_up(tmp_path: Path) -> None:
    papers, run = cut_off(tmp_path)
    live = run / segment_name(0)
    kept = live.read_bytes()
    recover(run)
    live.write_bytes(kept)
    papers.set_run(run)
    result_of(papers)
    assert not live.exists()
    assert check(run) == []


def test_what_somebody_else_recovered_is_half_done(tmp_path: Path) -> None:
    papers, run = cut_off(tmp_path)
    papers.set_run(run)
    recover(run)
    came = result_of(papers)
    assert (came.state, came.exit_code, came.text) == (
        State.HALF,
        4,
        "its process died while it ran",
    )


@pytest.mark.parametrize("has_said", [True, False])
@pytest.mark.parametrize(
    ("code", "state"),
    [
        (0, State.DONE),
        (1, State.NOT_FINE),
        (3, State.FAILED),
        (4, State.FAILED),
        (5, State.FAILED),
        (130, State.HALF),
        (143, State.HALF),
    ],
)
def test_only_what_ended_by_itself_and_well_is_done(
    tmp_path: Path, code: int, state: State, has_said: bool
) -> None:
    papers, run = cut_off(tmp_path)
    papers.set_run(run)
    recover(run)
    write_manifest(run, replace(read_manifest(run), exit_status="success", exit_code=code))
    if has_said:
        papers.set_result(JobResult(code, run=str(run)))
    assert result_of(papers).state is state
