"""How a batch stands by the lines of its journal, and what may begin now."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum

from jbclog.config.job_order import OnFailure, Turn

# -- entry --------------------------------------------------------------------------------------------------------------------
# The lines of a batch's journal: what was decided, before it is done, and what came of it.


class Kind(StrEnum):
    """What a line of the journal tells."""

    BEGIN = "begin"  # the batch: its jobs file
    JOB = "job"  # what the file asks of one job, and when it is due
    SITTING = "sitting"  # a process takes the batch up; from here on what was held back or half done is open again
    START = "start"  # a job is about to be started
    RUN = "run"  # its run has a folder
    END = "end"  # it ended: how
    SKIP = "skip"  # it is not done, because one that it waits for was not
    SIGNAL = "signal"  # somebody wants the batch to end
    CLOSE = "close"  # the process gives the batch up: nothing more can begin
    FINISH = "finish"  # every job has come to its end


class State(StrEnum):
    """How a job stands, in the words that people see."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    NOT_FINE = "not fine"  # done and recorded, with a verdict or alarms that are not fine
    FAILED = "failed"
    HALF = "half done"
    SKIPPED = "skipped"


OVER = frozenset({State.DONE, State.NOT_FINE, State.FAILED, State.HALF, State.SKIPPED})
RECORDED = frozenset({State.DONE, State.NOT_FINE})
"""Its run came to the end that was wanted, with its record whole. These are never done again."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A line of the journal; `text` says it to people. What does not belong to its kind is None.

    `again`: the job is open again when the batch is gone on with. `asked` is what the jobs file asks of a job, as JSON.
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


# -- state --------------------------------------------------------------------------------------------------------------------


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


# -- queue --------------------------------------------------------------------------------------------------------------------
# What may begin now. In turn on one place, side by side on different ones, in the file's order.
#
# A job that waits, for its time or for others, keeps its place in the queue: what stands behind it and needs the same station waits
# as well. So the file is what happens, whatever takes how long.

DONE_FOR = frozenset({State.FAILED, State.HALF, State.NOT_FINE})


@dataclass(frozen=True, slots=True)
class Waits:
    """A job that cannot begin yet. `why` is for people; `until` the moment that it waits for, if that is all."""

    name: str
    why: str
    until: float | None = None


@dataclass(frozen=True, slots=True)
class Next:
    """What comes next: jobs that can begin now, those that are not done and why, those that wait."""

    begin: tuple[str, ...] = ()
    skip: tuple[tuple[str, str], ...] = ()
    wait: tuple[Waits, ...] = ()


def whats_next(turns: Sequence[Turn], standing: BatchState, now: float) -> Next:
    """What comes next at `now` (seconds since 1970 UTC). `turns` in the order of `in_turn`.

    A line that was stopped begins and skips nothing more. Skipping comes alone: what it means for others is asked next.
    """
    if standing.stopped_by is not None or standing.ended_by is not None:
        return Next()
    skipped = tuple(_skipped(turns, standing))
    if skipped:
        return Next(skip=skipped)
    taken = {place: name for name in _running(standing) for place in _places(turns, name)}
    begin: list[str] = []
    wait: list[Waits] = []
    for turn in turns:
        if standing.jobs[turn.name].state is not State.WAITING:
            continue
        waits = _why_waits(turn, standing, taken, now)
        if waits is None:
            begin.append(turn.name)
        else:
            wait.append(waits)
        for place in turn.places:
            taken.setdefault(place, turn.name)
    return Next(tuple(begin), wait=tuple(wait))


def _running(standing: BatchState) -> list[str]:
    return [job.name for job in standing.running()]


def _places(turns: Sequence[Turn], name: str) -> frozenset[str]:
    return next(turn.places for turn in turns if turn.name == name)


def _skipped(turns: Sequence[Turn], standing: BatchState) -> Iterator[tuple[str, str]]:
    policies = {turn.name: turn.on_failure for turn in turns}
    for turn in turns:
        if standing.jobs[turn.name].state is State.WAITING:
            for other in turn.after:
                state = standing.jobs[other].state
                if state is State.SKIPPED or (state in DONE_FOR and policies[other] is OnFailure.SKIP):
                    yield turn.name, f"it waits for {other}, which is {state.value}"
                    break


def _why_waits(turn: Turn, standing: BatchState, taken: dict[str, str], now: float) -> Waits | None:
    others = [name for name in turn.after if not standing.jobs[name].is_over]
    if others:
        return Waits(turn.name, f"after {', '.join(others)}")
    before = sorted({taken[place] for place in turn.places if place in taken})
    if before:
        places = sorted(place for place in turn.places if place in taken)
        return Waits(turn.name, f"{', '.join(places)}: behind {', '.join(before)}")
    due = standing.jobs[turn.name].due
    return Waits(turn.name, "its time", due) if due is not None and now < due else None
