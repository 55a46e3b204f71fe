"""A batch on real ports that is disturbed: its executor and its jobs are killed, it is started
again until it is finished.

What must hold is looked for in the runs' own manifests, not in the batch's journal: every job done
exactly once, what was cut off told as half done, no two runs of a station at the same time.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from jbclog.app.batch.job_dir import JobDir
from jbclog.app.batch.journal import entries_in
from jbclog.app.batch.state import RECORDED, BatchState, State, batch_state
from jbclog.record.check import check
from jbclog.record.find_runs import Found, find
from jbclog.record.manifest import read_manifest
from support.command import recipe_text, started

RECIPE = recipe_text("quick", "dde", "ucr", "ale", more="[sampling]\nrate_hz = 2\n")
JOBS = (("a1", "dde-1", ""), ("a2", "dde-1", ""), ("b1", "ucr-1", ""), ("c1", "ale-1", "b1"))
MOST_SITTINGS = 25
ENDS_S = 90.0


def write_batch(folder: Path, line: Path, seconds: float = 2.0, count: int = len(JOBS)) -> Path:
    """A jobs file of short jobs, with a recipe that judges nothing."""
    (folder / "quick.toml").write_text(RECIPE)
    text = f'[batch]\nline = "{line}"\non_failure = "stop"\n'
    for name, station, after in JOBS[:count]:
        text += (
            f'[[job]]\nname = "{name}"\nrecipe = "quick.toml"\nstations = ["{station}"]\nduration ='
            f' "{seconds}s"\n'
        )
        text += f'after = ["{after}"]\n' if after else ""
    path = folder / "quick-night.toml"
    path.write_text(text)
    return path


@dataclass
class Trial:
    """What was done to a batch, and what is wrong with what it came to."""

    out: Path
    sittings: int = 0
    kills: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    codes: list[int] = field(default_factory=list)

    @property
    def journal(self) -> Path:
        return sorted(path for path in (self.out / "quick-night.batch").iterdir() if path.is_dir())[
            -1
        ]

    def state(self) -> BatchState:
        return batch_state(entries_in(self.journal))

    def runs(self) -> list[str]:
        """How each attempt came out."""
        return [
            attempt.state.value for job in self.state().jobs.values() for attempt in job.attempts
        ]


def disturbed(folder: Path, line: Path, dice: random.Random, kills: int) -> Trial:
    """Carry a batch out, with so many kills at random moments, until it is finished."""
    jobs = write_batch(folder, line)
    trial = Trial(folder / "runs")
    while trial.sittings < MOST_SITTINGS:
        trial.sittings += 1
        batch = started(
            "batch",
            jobs,
            "--out",
            trial.out,
            "--json",
            *(["--resume"] if trial.sittings > 1 and dice.random() < 0.5 else []),
        )
        if kills > 0:
            kills -= 1
            time.sleep(dice.uniform(0.3, 9.0))
            _strike(trial, batch, dice)
        said, notes = batch.communicate(timeout=ENDS_S)
        trial.codes.append(batch.returncode)
        if batch.returncode == 2 and "no batch to resume" not in notes:
            trial.wrong.append(notes)
        if batch.returncode >= 0 and said and json.loads(said).get("finished"):
            break
    trial.wrong += faults(trial)
    return trial


def _strike(trial: Trial, batch: subprocess.Popen[str], dice: random.Random) -> None:
    what = dice.choice(["executor", "executor", "job", "both", "term"])
    if what in ("job", "both"):
        victims = list(running(trial.out))
        if victims:
            with suppress(ProcessLookupError):
                os.kill(dice.choice(victims), signal.SIGKILL)
            trial.kills["job"] += 1
    if batch.poll() is None and what in ("executor", "both"):
        batch.kill()
        trial.kills["executor"] += 1
    elif batch.poll() is None and what == "term":
        batch.send_signal(signal.SIGTERM)
        trial.kills["term"] += 1


def running(out: Path) -> list[int]:
    """The processes of jobs that run now."""
    papers = [JobDir(path) for path in out.glob("*.batch/*/jobs/*")]
    return [
        process for one in papers if one.is_running() and (process := one.process()) is not None
    ]


def recording(out: Path) -> list[int]:
    """Those whose run has a folder."""
    papers = [JobDir(path) for path in sorted(out.glob("*.batch/*/jobs/*"))]
    return [
        process
        for one in papers
        if one.is_running() and one.run() and (process := one.process()) is not None
    ]


def faults(trial: Trial) -> list[str]:
    """Everything that must not be. The runs themselves are the witnesses."""
    state, found = trial.state(), []
    if not state.is_finished:
        found.append(f"not finished after {trial.sittings} sittings: {trial.codes}")
    runs = [one for one in find(trial.out) if isinstance(one, Found)]
    told = {
        attempt.run: (job.name, attempt)
        for job in state.jobs.values()
        for attempt in job.attempts
        if attempt.run
    }
    for run in runs:
        if run.folder.name not in told:
            found.append(f"{run.folder.name} is in no line of the journal")
            continue
        name, attempt = told[run.folder.name]
        is_whole = run.state == "sealed" and run.exit_status == "success"
        if run.tags.get("job") != name:
            found.append(f"{run.folder.name} is of {run.tags.get('job')}, told of {name}")
        if is_whole != (attempt.state in RECORDED):
            found.append(
                f"{name}: {run.folder.name} is {run.state}, {run.exit_status}, told as"
                f" {attempt.state.value}"
            )
        if run.state != "sealed":
            found.append(f"{run.folder.name} was left {run.state}")
        found += [f"{run.folder.name}: {fault}" for fault in check(run.folder)]
    whole = Counter(run.tags["job"] for run in runs if run.exit_status == "success")
    found += [f"{name} was done {whole[name]} times" for name in state.jobs if whole[name] != 1]
    found += [
        f"{job.name} is {job.state.value}"
        for job in state.jobs.values()
        if job.state is not State.DONE
    ]
    found += _overlaps(runs)
    found += [f"process {process} still runs" for process in running(trial.out)]
    return found


def _overlaps(runs: list[Found]) -> list[str]:
    """Runs that had a station at the same time, by their manifests."""
    spans = sorted(
        (run.start, _end(run), run.stations, run.folder.name) for run in runs if run.start
    )
    return [
        f"{first[3]} and {second[3]} had {set(first[2]) & set(second[2])} at the same time"
        for place, first in enumerate(spans)
        for second in spans[place + 1 :]
        if set(first[2]) & set(second[2]) and second[0] < first[1]
    ]


def _end(run: Found) -> str:
    return read_manifest(run.folder).stop or run.start or ""
