"""The state of a batch from its journal, and which jobs may start now."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum

from jbclog.config.job_order import OnFailure, Turn

# -- journal entries -------------------------------------------------------------------------------
# An entry is written before its action is taken.


class EntryKind(StrEnum):
    """The kind of a journal entry."""

    BEGIN = "begin"  # the batch: its jobs file
    JOB = "job"  # a job: its settings and its start time
    # a process carries out the batch; jobs that were cut off or held back are open again
    EXECUTION = "sitting"
    START = "start"  # a job is about to be started
    RUN = "run"  # its run has a folder
    END = "end"  # it ended, with its result
    SKIP = "skip"  # it is not started, because a job it waits for failed
    SIGNAL = "signal"  # a signal ends the batch
    CLOSE = "close"  # the process ends, and jobs are left
    FINISH = "finish"  # all jobs have ended


class State(StrEnum):
    """The state of a job, as shown to people."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    NOT_FINE = "not fine"  # recorded, with a verdict or alarms that are not fine
    FAILED = "failed"
    HALF = "half done"
    SKIPPED = "skipped"


OVER = frozenset({State.DONE, State.NOT_FINE, State.FAILED, State.HALF, State.SKIPPED})
RECORDED = frozenset({State.DONE, State.NOT_FINE})
"""The run and its record are complete. Such a job is never repeated."""


@dataclass(frozen=True, slots=True)
class Entry:
    """An entry of the journal. Fields that its kind does not have are None.

    `text` is for people. `again`: a resumed batch starts the job again. `asked`: the job's table in
    the jobs file, as JSON.
    """

    time: str
    kind: str
    text: str
    job: str | None = None
    attempt: int | None = None
    state: str | None = None
    again: bool | None = None
    exit_code: int | None = None
    verdict: str | None = None
    run: str | None = None
    due: str | None = None
    asked: str | None = None
    on_failure: str | None = None
    seq: int = 0
    prev_sha256: str = ""


# -- state -----------------------------------------------------------------------------------------


@dataclass(slots=True)
class Attempt:
    """One attempt at a job. `state` is RUNNING until the journal has its result."""

    number: int
    start: str
    state: State = State.RUNNING
    stop: str | None = None
    again: bool = False
    exit_code: int | None = None
    verdict: str | None = None
    run: str | None = None
    text: str = ""


@dataclass(slots=True)
class JobState:
    """The state of a job. `due`: its earliest start, seconds since 1970 UTC. `asked`: its table in
    the jobs file, as JSON.
    """

    name: str
    asked: str = ""
    due: float | None = None
    state: State = State.WAITING
    text: str = ""
    attempts: list[Attempt] = field(default_factory=list)

    @property
    def last(self) -> Attempt | None:
        return self.attempts[-1] if self.attempts else None

    @property
    def is_over(self) -> bool:
        return self.state in OVER


@dataclass(slots=True)
class BatchState:
    """The state of a batch. `stopped_by`: the job whose failure stopped it in this execution.
    `closing`: the text of its end.
    """

    jobs: dict[str, JobState] = field(default_factory=dict)
    policies: dict[str, OnFailure] = field(default_factory=dict)
    begun: str | None = None
    file: str = ""
    executions: int = 0
    stopped_by: str | None = None
    ended_by: str | None = None
    is_finished: bool = False
    last: str = ""
    closing: str = ""

    def running(self) -> list[JobState]:
        return [job for job in self.jobs.values() if job.state is State.RUNNING]

    def waiting(self) -> list[JobState]:
        return [job for job in self.jobs.values() if job.state is State.WAITING]

    def is_open(self) -> bool:
        """Whether a resumed batch has jobs to start or to follow."""
        return any(not job.is_over or _is_again(job) for job in self.jobs.values())

    def take(self, entry: Entry) -> None:
        """Apply the next entry of the journal."""
        self.last = entry.time
        if entry.kind == EntryKind.BEGIN:
            self.begun, self.file = entry.time, entry.asked or ""
        elif entry.kind == EntryKind.EXECUTION:
            self._reopen()
        elif entry.kind == EntryKind.SIGNAL:
            self.ended_by = entry.text
        elif entry.kind in (EntryKind.CLOSE, EntryKind.FINISH):
            self.is_finished, self.closing = entry.kind == EntryKind.FINISH, entry.text
        elif entry.job is not None:
            self._of_job(entry, entry.job)

    def _reopen(self) -> None:
        """Begin an execution: jobs that were cut off, or that stopped the batch, wait again."""
        self.executions += 1
        self.stopped_by = self.ended_by = None
        for job in self.jobs.values():
            if _is_again(job):
                job.state = State.WAITING

    def _of_job(self, entry: Entry, name: str) -> None:
        job = self.jobs.setdefault(name, JobState(name))
        if entry.kind == EntryKind.JOB:
            job.asked, job.due = entry.asked or "", _seconds(entry.due)
            self.policies[name] = OnFailure(entry.on_failure or OnFailure.STOP)
        elif entry.kind == EntryKind.START:
            job.state = State.RUNNING
            job.attempts.append(Attempt(entry.attempt or 1, entry.time))
        elif entry.kind == EntryKind.RUN and job.last is not None:
            job.last.run = entry.run
        elif entry.kind == EntryKind.SKIP:
            job.state, job.text = State.SKIPPED, entry.text
        elif entry.kind == EntryKind.END and job.last is not None:
            self._end(job, job.last, entry)

    def _end(self, job: JobState, attempt: Attempt, entry: Entry) -> None:
        job.state = attempt.state = State(entry.state or State.HALF)
        job.text = attempt.text = entry.text
        attempt.stop, attempt.again = entry.time, bool(entry.again)
        attempt.exit_code, attempt.verdict, attempt.run = entry.exit_code, entry.verdict, entry.run
        is_failure = job.state is not State.DONE
        if is_failure and self.policies.get(job.name) is OnFailure.STOP and self.stopped_by is None:
            self.stopped_by = job.name


def _is_again(job: JobState) -> bool:
    return (
        job.last is not None
        and job.state is job.last.state
        and job.last.again
        and job.state not in RECORDED
    )


def _seconds(time: str | None) -> float | None:
    return None if time is None else datetime.fromisoformat(time).timestamp()


def batch_state(entries: Iterable[Entry]) -> BatchState:
    """Return the state of the batch after these entries."""
    state = BatchState()
    for entry in entries:
        state.take(entry)
    return state


# -- queue -----------------------------------------------------------------------------------------
# Jobs on the same station run one after another in the order of the file, jobs on different
# stations in parallel.
#
# A job that waits, for its time or for other jobs, keeps its position: later jobs that need the
# same station wait behind it. So the order is that of the file, however long each job takes.

DONE_FOR = frozenset({State.FAILED, State.HALF, State.NOT_FINE})


@dataclass(frozen=True, slots=True)
class Waits:
    """A job that cannot start yet. `why` is for people; `until` is its earliest start if it waits
    for nothing else.
    """

    name: str
    why: str
    until: float | None = None


@dataclass(frozen=True, slots=True)
class Next:
    """Jobs that can start now, jobs to skip with the reason, and jobs that wait."""

    begin: tuple[str, ...] = ()
    skip: tuple[tuple[str, str], ...] = ()
    wait: tuple[Waits, ...] = ()


def next_jobs(turns: Sequence[Turn], batch: BatchState, now: float) -> Next:
    """Return what comes next at `now` (seconds since 1970 UTC). `turns` are ordered by `in_turn`.

    A stopped batch starts and skips no more jobs. Jobs to skip are returned alone, because they can
    change the state of others.
    """
    if batch.stopped_by is not None or batch.ended_by is not None:
        return Next()
    skipped = tuple(_skipped(turns, batch))
    if skipped:
        return Next(skip=skipped)
    taken = {place: name for name in _running(batch) for place in _places(turns, name)}
    begin: list[str] = []
    wait: list[Waits] = []
    for turn in turns:
        if batch.jobs[turn.name].state is not State.WAITING:
            continue
        waits = _why_waits(turn, batch, taken, now)
        if waits is None:
            begin.append(turn.name)
        else:
            wait.append(waits)
        for place in turn.places:
            taken.setdefault(place, turn.name)
    return Next(tuple(begin), wait=tuple(wait))


def _running(batch: BatchState) -> list[str]:
    return [job.name for job in batch.running()]


def _places(turns: Sequence[Turn], name: str) -> frozenset[str]:
    return next(turn.places for turn in turns if turn.name == name)


def _skipped(turns: Sequence[Turn], batch: BatchState) -> Iterator[tuple[str, str]]:
    policies = {turn.name: turn.on_failure for turn in turns}
    for turn in turns:
        if batch.jobs[turn.name].state is State.WAITING:
            for other in turn.after:
                state = batch.jobs[other].state
                if state is State.SKIPPED or (
                    state in DONE_FOR and policies[other] is OnFailure.SKIP
                ):
                    yield turn.name, f"it waits for {other}, which is {state.value}"
                    break


def _why_waits(turn: Turn, batch: BatchState, taken: dict[str, str], now: float) -> Waits | None:
    others = [name for name in turn.after if not batch.jobs[name].is_over]
    if others:
        return Waits(turn.name, f"after {', '.join(others)}")
    before = sorted({taken[place] for place in turn.places if place in taken})
    if before:
        places = sorted(place for place in turn.places if place in taken)
        return Waits(turn.name, f"{', '.join(places)}: behind {', '.join(before)}")
    due = batch.jobs[turn.name].due
    return Waits(turn.name, "its time", due) if due is not None and now < due else None
