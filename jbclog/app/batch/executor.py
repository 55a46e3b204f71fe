"""A batch being carried out: what comes next is asked of the queue, written down, and done, in this order.

So whatever is killed at whatever moment: what the journal has is what was decided, and the papers of the jobs say how far it came.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from jbclog.app.batch.journal import Journal
from jbclog.app.batch.processes import ENDED_BY, Came, Processes
from jbclog.app.batch.state import RECORDED, BatchState, Entry, JobState, Kind, Next, State, whats_next
from jbclog.config.job_order import OnFailure, Turn
from jbclog.core.errors import UsageError
from jbclog.core.outcome import Exit, RunFinding, exit_code

LOOK_EVERY_S: Final = 0.2


class Shown(Protocol):
    """Who is shown how a batch goes on. Nothing that it does changes the batch."""

    def started(self, job: JobState) -> None: ...

    def ended(self, job: JobState) -> None: ...

    def told(self, text: str) -> None: ...

    def look(self, standing: BatchState, following: Next) -> None: ...


class Unseen:
    """Nobody is shown anything."""

    def started(self, job: JobState) -> None:
        return

    def ended(self, job: JobState) -> None:
        return

    def told(self, text: str) -> None:
        return

    def look(self, standing: BatchState, following: Next) -> None:
        return


@dataclass(frozen=True, slots=True)
class Means:
    """What the executor needs of the world: the time now, seconds since 1970 UTC, and a pause."""

    utc: Callable[[], float]
    pause: Callable[[], None]


class BatchExecutor:
    """Carries out the jobs `turns` (in the order of `in_turn`) of the batch whose journal this is. Raises `RecordError`."""

    def __init__(self, turns: Sequence[Turn], journal: Journal, hands: Processes, shown: Shown, means: Means) -> None:
        self._turns = turns
        self._journal = journal
        self._hands = hands
        self._shown = shown
        self._means = means
        self._signal: signal.Signals | None = None
        self._asked: set[str] = set()

    @property
    def standing(self) -> BatchState:
        return self._journal.standing

    def interrupt(self, number: signal.Signals) -> None:
        """Nothing more begins, and what runs ends in good order. A second signal changes nothing."""
        if self._signal is None:
            self._signal = number

    def abandon(self) -> None:
        """Give the batch up for good: a new one is begun in its place. Raises `UsageError` where a job of it still runs."""
        running = self.settle()
        if running:
            raise UsageError(
                f"{', '.join(running)} of the batch of {self.standing.begun} still runs; end it, or go on with the batch"
            )
        self._note(Kind.FINISH, "The batch is given up: a new one is begun in its place.")

    def work(self) -> Exit:
        """Take the batch up and carry it out, as far as it goes; give the exit code of the whole batch."""
        self._take_up()
        while self._step():
            self._means.pause()
        self._give_up()
        return self.exit_code()

    # -- before -------------------------------------------------------------------------------------------------------------

    def _take_up(self) -> None:
        """Follow what still runs of the last executor's jobs, and write down what has ended."""
        self.settle()
        self._note(Kind.SITTING, "The batch is gone on with." if self.standing.sittings else "The batch begins.")
        for job in self.standing.running():
            self._shown.told(f"{job.name} still runs, and is followed")

    def settle(self) -> list[str]:
        """Write down the results of jobs that have ended since the last executor ended; return those that still run."""
        running = self.standing.running()
        for job in running:
            if not self._hands.runs(*_attempt(job)):
                self._end(job, self._await(job), is_old=True)
        return [job.name for job in running if job.state is State.RUNNING]

    def _await(self, job: JobState) -> Came:
        while (came := self._hands.came(*_attempt(job))) is None:
            self._means.pause()
        return came

    # -- during -------------------------------------------------------------------------------------------------------------

    def _step(self) -> bool:
        """Do what there is to do now; whether anything can come of waiting."""
        self._hear()
        for job in self.standing.running():
            self._follow(job)
        following = whats_next(self._turns, self.standing, self._means.utc())
        for name, why in following.skip:
            self._note(Kind.SKIP, f"{name} is skipped: {why}.", job=name)
            self._shown.ended(self.standing.jobs[name])
        for name in following.begin:
            self._start(self.standing.jobs[name])
        self._shown.look(self.standing, following)
        return bool(self.standing.running() or following.begin or following.skip or following.wait)

    def _hear(self) -> None:
        if self._signal is None:
            return
        if self.standing.ended_by is None:
            self._note(Kind.SIGNAL, f"{self._signal.name} received: nothing more begins, and what runs ends with its tools safe.")
            running = "; the jobs that run make their tools safe and end" if self.standing.running() else ""
            self._shown.told(f"{self._signal.name}: nothing more begins{running}")
        for job in self.standing.running():
            if job.name not in self._asked and self._hands.ask_to_end(*_attempt(job), self._signal):
                self._asked.add(job.name)

    def _follow(self, job: JobState) -> None:
        attempt = job.attempts[-1]
        runs = self._hands.runs(*_attempt(job))  # asked first: what it says afterwards is its last word
        if attempt.run is None:
            run = self._hands.run(*_attempt(job))
            if run is not None:
                self._note(Kind.RUN, f"{job.name} records into {run}.", job=job.name, attempt=attempt.number, run=run)
        if not runs:
            came = self._hands.came(*_attempt(job))
            if came is not None:
                self._end(job, came)

    def _start(self, job: JobState) -> None:
        number = len(job.attempts) + 1
        self._note(Kind.START, f"{job.name} is started{'' if number == 1 else ' again'}.", job=job.name, attempt=number)
        try:
            self._hands.start(job.name, number)
        except OSError as error:
            text = f"it could not be started: {error.strerror or error}"
            self._end(job, Came(State.FAILED, Exit.RECORD.value, text))
        else:
            self._shown.started(job)

    def _end(self, job: JobState, came: Came, *, is_old: bool = False) -> None:
        """Write down what came of a job, and whether it is open again when the batch is gone on with."""
        self._journal.note(
            Entry(
                "",
                Kind.END,
                came.text,
                job.name,
                job.attempts[-1].number,
                came.state.value,
                self._is_again(job, came, is_old=is_old),
                came.exit_code,
                came.verdict,
                None if came.run is None else came.run.name,
            )
        )
        self._shown.ended(job)
        is_stopping = self.standing.stopped_by == job.name and self.standing.ended_by is None and not is_old
        if is_stopping and self.standing.waiting():
            self._shown.told(f"{job.name} stops the line: nothing more begins, and what runs is let run to its end")

    def _is_again(self, job: JobState, came: Came, *, is_old: bool) -> bool:
        """What an interruption or a crash cut off, and what stopped the line; never what was recorded to its end."""
        if came.state in RECORDED:
            return False
        was_cut_off = self.standing.ended_by is not None or (is_old and (came.state is State.HALF or not came.is_begun))
        return was_cut_off or self.standing.policies[job.name] is OnFailure.STOP

    def _note(self, kind: Kind, text: str, job: str | None = None, attempt: int | None = None, run: str | None = None) -> None:
        self._journal.note(Entry("", kind, text, job, attempt, run=run))

    # -- after --------------------------------------------------------------------------------------------------------------

    def _give_up(self) -> None:
        standing = self.standing
        if standing.is_open():
            why = "The batch was interrupted" if standing.ended_by is not None else f"{standing.stopped_by} stopped the line"
            self._note(Kind.CLOSE, f"{why}; started again, it goes on.")

    def finish(self) -> None:
        """What came of the jobs has been told; where all have come to their ends the next start begins anew.

        Not before: killed in between, the next start must tell it and not do it all once more.
        """
        if not self.standing.is_open():
            self._note(Kind.FINISH, "Every job has come to its end.")

    def exit_code(self) -> Exit:
        """The most severe of what came of the jobs, and of the batch that was cut short."""
        found = list(_findings(self.standing.jobs.values()))
        if self._signal is not None and self.standing.is_open():
            found.append(RunFinding(ENDED_BY[self._signal], "the batch was cut short"))
        return exit_code(found)


def _findings(jobs: Iterable[JobState]) -> Iterable[RunFinding]:
    for job in jobs:
        if job.is_over and job.last is not None and job.last.exit_code is not None:
            code = Exit(job.last.exit_code) if job.last.exit_code in list(Exit) else Exit.RECORD
            yield RunFinding(Exit.STATION if code is Exit.USAGE else code, job.last.text)


def _attempt(job: JobState) -> tuple[str, int]:
    return job.name, job.attempts[-1].number
