"""From a jobs file to an executor at work: resumes a batch that was not finished, else begins a new one."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from jbclog.app.batch.executor import BatchExecutor, Means, Shown, Unseen
from jbclog.app.batch.job_spec import Orders
from jbclog.app.batch.journal import JOBS_FILE, Journal, begin, home_of, iso, newest
from jbclog.app.batch.processes import SystemProcesses
from jbclog.app.batch.state import BatchState, Entry, JobState, Kind, State
from jbclog.config.job_order import Turn, Zone, due_times, in_turn
from jbclog.core.errors import Problem, Problems, UsageError

ANEW: Final = "--anew"
SHOWN_CHANGES: Final = 20


@dataclass(frozen=True, slots=True)
class Shift:
    """A batch, ready to be carried out. `is_new`: it begins; else it is gone on with."""

    orders: Orders
    journal: Journal
    hands: SystemProcesses
    turns: tuple[Turn, ...]
    is_new: bool

    @property
    def standing(self) -> BatchState:
        return self.journal.standing

    def executor(self, shown: Shown, means: Means) -> BatchExecutor:
        return BatchExecutor(self.turns, self.journal, self.hands, shown, means)

    def what_will_be_done(self) -> Iterator[tuple[JobState, str]]:
        """Each job and what becomes of it, in the file's order. Nothing is done about any of it."""
        for name in self.orders.orders:
            job = self.standing.jobs[name]
            yield job, self._of(job)

    def _of(self, job: JobState) -> str:
        if job.last is None or job.state in (State.WAITING, State.SKIPPED):
            return "stays skipped" if job.state is State.SKIPPED else "waits for its turn"
        if job.state is State.RUNNING:
            return self.hands.peek(job.name, job.last.number)
        if job.last.again:
            return f"was {job.state.value}: it is done again, as a new run"
        return f"stays {job.state.value}"


def take(orders: Orders, out: Path, means: Means, zone: Zone, *, resume: bool, anew: bool) -> Shift:
    """The batch of this jobs file below `out`, which the caller holds (`hold`).

    Raises `UsageError` where the one that is not finished was asked for otherwise than the file asks now, or where there is none
    that could be gone on with; `Problems` where a date is over; `RecordError`.
    """
    home = home_of(out, orders.file.path)
    last = newest(home, means.utc)
    if last is not None and not last.standing.is_finished:
        if not anew:
            _expect_same(orders, last)
            return _shift(orders, last, is_new=False)
        _shift(orders, last, is_new=False).executor(Unseen(), means).abandon()
    if resume:
        ended = "none was begun" if last is None else f"the last one was finished at {last.standing.last}"
        raise UsageError(f"{orders.file.path}: there is no batch to go on with, {ended}; without --resume a new one begins")
    return _shift(orders, _begin(orders, home, means, zone), is_new=True)


def _shift(orders: Orders, journal: Journal, *, is_new: bool) -> Shift:
    hands = SystemProcesses(journal.folder, orders.orders)
    for job in journal.standing.running():
        if job.last is not None and job.last.run is not None:
            hands.remember(job.name, job.last.number, journal.folder.parent.parent / job.last.run)
    return Shift(orders, journal, hands, tuple(in_turn(orders.turns)), is_new)


def _begin(orders: Orders, home: Path, means: Means, zone: Zone) -> Journal:
    """Everything that is asked goes into the journal, with the moments that jobs wait for: they stay what they are."""
    file, turns = orders.file, in_turn(orders.turns)
    due = due_times(turns, means.utc(), zone)
    problems = [
        file.problem(place, ("at",), f'"{job.at}" is over; give a later time, or none')
        for place, job in enumerate(file.jobs)
        if job.name in due and due[job.name] is None
    ]
    if problems:
        raise Problems(problems)
    journal = begin(home, file.source.text, means.utc)
    path = os.path.realpath(file.path)
    journal.note(Entry("", Kind.BEGIN, f"A batch of {len(turns)} job{'' if len(turns) == 1 else 's'}.", asked=path))
    for job in file.jobs:
        moment = due.get(job.name)
        entry = Entry("", Kind.JOB, "", job.name, asked=file.asked(job), on_failure=file.policy(job).value)
        journal.note(replace(entry, due=None if moment is None else iso(moment)))
    return journal


# -- a file that was changed meanwhile ----------------------------------------------------------------------------------------


def _expect_same(orders: Orders, journal: Journal) -> None:
    """Raise `UsageError` where what is to be gone on with is not what the file asks for now."""
    file, before = orders.file, journal.standing
    kept = journal.folder / JOBS_FILE
    way = f"`{ANEW}` gives it up and begins anew with the file as it is; or put the file back as it was: {shlex.quote(str(kept))}"
    if before.file != os.path.realpath(file.path):
        held = f"{journal.folder.parent} holds a batch of {before.file} that is not finished"
        raise UsageError(f"{held}. {ANEW} gives it up; or take another --out")
    now = {job.name: file.asked(job) for job in file.jobs}
    changes = list(_changes({name: job.asked for name, job in before.jobs.items()}, now))
    if changes:
        head = f"the batch of {before.begun} is not finished, and what it was asked for has changed since"
        texts = [head, *changes[:SHOWN_CHANGES], f"Nothing was started. {way}"]
        raise Problems([Problem(str(file.path), None, "", text) for text in texts])


def _changes(before: dict[str, str], now: dict[str, str]) -> Iterator[str]:
    """A sentence for each difference."""
    for name in [*before, *(name for name in now if name not in before)]:
        if name not in now:
            yield f"job {name} is gone"
        elif name not in before:
            yield f"job {name} is new"
        else:
            yield from _between(name, json.loads(before[name]), json.loads(now[name]))
    if [*before] != [*now] and set(before) == set(now):
        yield "the jobs are in another order"


def _between(name: str, before: dict[str, object], now: dict[str, object]) -> Iterator[str]:
    for key in [*before, *(key for key in now if key not in before)]:
        if before.get(key) != now.get(key):
            yield f"job {name}: {key} was {_said(before.get(key))} and is {_said(now.get(key))}"


def _said(value: object) -> str:
    return "not given" if value is None else json.dumps(value, ensure_ascii=False)
