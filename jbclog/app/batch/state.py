"""How a batch stands, by its journal alone: whoever reads the same lines comes to the same standing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime

from jbclog.app.batch.entry import OVER, RECORDED, Entry, Kind, State
from jbclog.config.job_order import OnFailure


@dataclass(slots=True)
class Attempt:
    """One time that a job was started. `state` is RUNNING until the journal says how it ended."""

    number: int
    began: str
    state: State = State.RUNNING
    ended: str | None = None
    again: bool = False
    exit_code: int | None = None
    verdict: str | None = None
    run: str | None = None
    text: str = ""


@dataclass(slots=True)
class JobState:
    """How a job stands. `due` is the moment that it waits for, seconds since 1970 UTC; `asked` what its file asked of it."""

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
    """How the batch stands. `stopped_by` is the job whose failure stopped the line in this sitting, `closing` how it ended."""

    jobs: dict[str, JobState] = field(default_factory=dict)
    policies: dict[str, OnFailure] = field(default_factory=dict)
    begun: str | None = None
    file: str = ""
    sittings: int = 0
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
        """Whether something is left to do, when the batch is gone on with."""
        return any(not job.is_over or _is_again(job) for job in self.jobs.values())

    def take(self, entry: Entry) -> None:
        """What one more line of the journal changes."""
        self.last = entry.time
        if entry.kind == Kind.BEGIN:
            self.begun, self.file = entry.time, entry.asked or ""
        elif entry.kind == Kind.SITTING:
            self._reopen()
        elif entry.kind == Kind.SIGNAL:
            self.ended_by = entry.text
        elif entry.kind in (Kind.CLOSE, Kind.FINISH):
            self.is_finished, self.closing = entry.kind == Kind.FINISH, entry.text
        elif entry.job is not None:
            self._of_job(entry, entry.job)

    def _reopen(self) -> None:
        """A new sitting: what was half done, or stopped the line before it was done, waits again."""
        self.sittings += 1
        self.stopped_by = self.ended_by = None
        for job in self.jobs.values():
            if _is_again(job):
                job.state = State.WAITING

    def _of_job(self, entry: Entry, name: str) -> None:
        job = self.jobs.setdefault(name, JobState(name))
        if entry.kind == Kind.JOB:
            job.asked, job.due = entry.asked or "", _seconds(entry.due)
            self.policies[name] = OnFailure(entry.on_failure or OnFailure.STOP)
        elif entry.kind == Kind.START:
            job.state = State.RUNNING
            job.attempts.append(Attempt(entry.attempt or 1, entry.time))
        elif entry.kind == Kind.RUN and job.last is not None:
            job.last.run = entry.run
        elif entry.kind == Kind.SKIP:
            job.state, job.text = State.SKIPPED, entry.text
        elif entry.kind == Kind.END and job.last is not None:
            self._end(job, job.last, entry)

    def _end(self, job: JobState, attempt: Attempt, entry: Entry) -> None:
        job.state = attempt.state = State(entry.state or State.HALF)
        job.text = attempt.text = entry.text
        attempt.ended, attempt.again = entry.time, bool(entry.again)
        attempt.exit_code, attempt.verdict, attempt.run = entry.exit_code, entry.verdict, entry.run
        is_failure = job.state is not State.DONE
        if is_failure and self.policies.get(job.name) is OnFailure.STOP and self.stopped_by is None:
            self.stopped_by = job.name


def _is_again(job: JobState) -> bool:
    return job.last is not None and job.state is job.last.state and job.last.again and job.state not in RECORDED


def _seconds(time: str | None) -> float | None:
    return None if time is None else datetime.fromisoformat(time).timestamp()


def standing_of(entries: Iterable[Entry]) -> BatchState:
    """How the batch stands by these lines."""
    standing = BatchState()
    for entry in entries:
        standing.take(entry)
    return standing
