"""Prepares a batch from a jobs file: resumes an unfinished one, else begins a new one."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from jbclog.app.batch.executor import BatchExecutor, BatchObserver, NullObserver, Timing
from jbclog.app.batch.job_spec import BatchPlan
from jbclog.app.batch.journal import JOBS_FILE, Journal, begin, home_of, iso, newest
from jbclog.app.batch.processes import SystemProcesses
from jbclog.app.batch.state import BatchState, Entry, EntryKind, JobState, State
from jbclog.config.job_order import Turn, due_times, in_turn
from jbclog.core.errors import Problem, Problems, UsageError
from jbclog.core.text import count_text

ANEW: Final = "--anew"
SHOWN_CHANGES: Final = 20


@dataclass(frozen=True, slots=True)
class PreparedBatch:
    """A batch, ready to be carried out. `is_new`: it begins; else it is resumed."""

    plan: BatchPlan
    journal: Journal
    processes: SystemProcesses
    turns: tuple[Turn, ...]
    is_new: bool

    @property
    def state(self) -> BatchState:
        return self.journal.state

    def executor(self, observer: BatchObserver, timing: Timing) -> BatchExecutor:
        return BatchExecutor(self.turns, self.journal, self.processes, observer, timing)

    def next_steps(self) -> Iterator[tuple[JobState, str]]:
        """Yield each job with its next step, in the order of the jobs file; changes nothing."""
        for name in self.plan.specs:
            job = self.state.jobs[name]
            yield job, self._next_step(job)

    def _next_step(self, job: JobState) -> str:
        if job.last is None or job.state in (State.WAITING, State.SKIPPED):
            return "stays skipped" if job.state is State.SKIPPED else "waits for its turn"
        if job.state is State.RUNNING:
            return self.processes.next_step(job.name, job.last.number)
        if job.last.again:
            return f"was {job.state.value}: it is done again, as a new run"
        return f"stays {job.state.value}"


def prepare(
    plan: BatchPlan, out: Path, timing: Timing, *, resume: bool, anew: bool
) -> PreparedBatch:
    """Return the batch of this jobs file below `out`; the caller holds its lock (`hold`).

    Raises `UsageError` if the jobs file has changed since an unfinished batch began, or if there is
    none to resume; `Problems` if a date has passed; `RecordError`.
    """
    home = home_of(out, plan.file.path)
    last = newest(home, timing.utc)
    if last is not None and not last.state.is_finished:
        if not anew:
            _expect_same(plan, last)
            return _prepared(plan, last, is_new=False)
        _prepared(plan, last, is_new=False).executor(NullObserver(), timing).discard()
    if resume:
        ended = "none has begun" if last is None else f"the last one finished at {last.state.last}"
        raise UsageError(
            f"{plan.file.path}: no batch to resume, {ended}; leave out --resume to start a new one"
        )
    return _prepared(plan, _begin(plan, home, timing), is_new=True)


def _prepared(plan: BatchPlan, journal: Journal, *, is_new: bool) -> PreparedBatch:
    processes = SystemProcesses(journal.folder, plan.specs)
    for job in journal.state.running():
        if job.last is not None and job.last.run is not None:
            processes.set_recorded_run(
                job.name, job.last.number, journal.folder.parent.parent / job.last.run
            )
    return PreparedBatch(plan, journal, processes, tuple(in_turn(plan.turns)), is_new)


def _begin(plan: BatchPlan, home: Path, timing: Timing) -> Journal:
    """Begin a batch: the journal gets each job's settings and start time, which stay fixed."""
    file, turns = plan.file, in_turn(plan.turns)
    due = due_times(turns, timing.utc())
    problems = [
        file.problem(place, ("at",), f'"{job.at}" has passed; give a later time, or none')
        for place, job in enumerate(file.jobs)
        if job.name in due and due[job.name] is None
    ]
    if problems:
        raise Problems(problems)
    journal = begin(home, file.source.text, timing.utc)
    path = os.path.realpath(file.path)
    journal.note(
        Entry(
            "",
            EntryKind.BEGIN,
            f"A batch of {count_text(len(turns), 'job')}.",
            asked=path,
        )
    )
    for job in file.jobs:
        moment = due.get(job.name)
        entry = Entry(
            "",
            EntryKind.JOB,
            "",
            job.name,
            asked=file.asked(job),
            on_failure=file.policy(job).value,
        )
        journal.note(replace(entry, due=None if moment is None else iso(moment)))
    return journal


# -- changes of the jobs file ----------------------------------------------------------------------


def _expect_same(plan: BatchPlan, journal: Journal) -> None:
    """Raise `UsageError` if the jobs file differs from that of the unfinished batch."""
    file, before = plan.file, journal.state
    kept = journal.folder / JOBS_FILE
    way = (
        f"`{ANEW}` discards it and starts a new one; or restore the jobs file:"
        f" {shlex.quote(str(kept))}"
    )
    if before.file != os.path.realpath(file.path):
        held = f"{journal.folder.parent} has an unfinished batch of {before.file}"
        raise UsageError(f"{held}. {ANEW} discards it; or use another --out")
    now = {job.name: file.asked(job) for job in file.jobs}
    changes = list(_changes({name: job.asked for name, job in before.jobs.items()}, now))
    if changes:
        head = f"the batch of {before.begun} is not finished, and its jobs file has changed since"
        texts = [head, *changes[:SHOWN_CHANGES], f"Nothing was started. {way}"]
        raise Problems([Problem(str(file.path), None, "", text) for text in texts])


def _changes(before: dict[str, str], now: dict[str, str]) -> Iterator[str]:
    for name in [*before, *(name for name in now if name not in before)]:
        if name not in now:
            yield f"job {name} was removed"
        elif name not in before:
            yield f"job {name} is new"
        else:
            yield from _differences(name, json.loads(before[name]), json.loads(now[name]))
    if [*before] != [*now] and set(before) == set(now):
        yield "the order of the jobs has changed"


def _differences(name: str, before: dict[str, object], now: dict[str, object]) -> Iterator[str]:
    for key in [*before, *(key for key in now if key not in before)]:
        if before.get(key) != now.get(key):
            yield f"job {name}: {key} was {_shown(before.get(key))} and is {_shown(now.get(key))}"


def _shown(value: object) -> str:
    return "not given" if value is None else json.dumps(value, ensure_ascii=False)
