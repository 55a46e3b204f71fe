"""Carries out a batch: decide the next action, write it to the journal, do it, in this order.

After a kill at any moment the journal has every decision; the records of the attempts show how far
each one came.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from jbclog.app.batch.journal import Journal
from jbclog.app.batch.processes import ENDED_BY, AttemptResult, Processes
from jbclog.app.batch.state import (
    RECORDED,
    BatchState,
    Entry,
    EntryKind,
    JobState,
    Next,
    State,
    next_jobs,
)
from jbclog.config.job_order import OnFailure, Turn
from jbclog.core.errors import UsageError
from jbclog.core.outcome import Exit, RunFinding, exit_code

LOOK_EVERY_S: Final = 0.2


class BatchObserver(Protocol):
    """Observes the progress of a batch; cannot change it."""

    def started(self, job: JobState) -> None: ...

    def ended(self, job: JobState) -> None: ...

    def message(self, text: str) -> None: ...

    def look(self, state: BatchState, following: Next) -> None: ...


class NullObserver:
    """Ignores everything."""

    def started(self, job: JobState) -> None:
        return

    def ended(self, job: JobState) -> None:
        return

    def message(self, text: str) -> None:
        return

    def look(self, state: BatchState, following: Next) -> None:
        return


@dataclass(frozen=True, slots=True)
class Timing:
    """Clock (seconds since 1970 UTC) and sleep."""

    utc: Callable[[], float]
    pause: Callable[[], None]


class BatchExecutor:
    """Carries out the jobs `turns` (ordered by `in_turn`) of the batch with this journal. Raises
    `RecordError`.
    """

    def __init__(
        self,
        turns: Sequence[Turn],
        journal: Journal,
        processes: Processes,
        observer: BatchObserver,
        timing: Timing,
    ) -> None:
        self._turns = turns
        self._journal = journal
        self._processes = processes
        self._observer = observer
        self._timing = timing
        self._signal: signal.Signals | None = None
        self._ending: set[str] = set()

    @property
    def state(self) -> BatchState:
        return self._journal.state

    def interrupt(self, number: signal.Signals) -> None:
        """Start no more jobs and end running ones in good order. A second signal has no effect."""
        if self._signal is None:
            self._signal = number

    def discard(self) -> None:
        """Close the batch permanently; a new one starts in its place.

        Raises `UsageError` while one of its jobs is running.
        """
        running = self.settle()
        if running:
            raise UsageError(
                f"{', '.join(running)} of the batch of {self.state.begun} still runs; end it, or"
                " resume the batch"
            )
        self._note(EntryKind.FINISH, "Batch discarded: a new one starts in its place.")

    def work(self) -> Exit:
        """Carry out the batch as far as possible; return the exit code of the whole batch."""
        self._follow_running()
        while self._step():
            self._timing.pause()
        self._close()
        return self.exit_code()

    # -- start -------------------------------------------------------------------------------------

    def _follow_running(self) -> None:
        """Follow the previous executor's jobs that still run, and record the results of the
        others.
        """
        self.settle()
        self._note(
            EntryKind.EXECUTION, "Batch resumed." if self.state.executions else "Batch started."
        )
        for job in self.state.running():
            self._observer.message(f"{job.name} still runs, and is followed")

    def settle(self) -> list[str]:
        """Record the results of jobs that ended since the last executor; return those still
        running.
        """
        running = self.state.running()
        for job in running:
            if not self._processes.runs(*_attempt(job)):
                self._end(job, self._await(job), is_old=True)
        return [job.name for job in running if job.state is State.RUNNING]

    def _await(self, job: JobState) -> AttemptResult:
        while (result := self._processes.result(*_attempt(job))) is None:
            self._timing.pause()
        return result

    # -- work --------------------------------------------------------------------------------------

    def _step(self) -> bool:
        """Do what is due now; return whether anything is left to wait for."""
        self._handle_signal()
        for job in self.state.running():
            self._follow(job)
        following = next_jobs(self._turns, self.state, self._timing.utc())
        for name, why in following.skip:
            self._note(EntryKind.SKIP, f"{name} is skipped: {why}.", job=name)
            self._observer.ended(self.state.jobs[name])
        for name in following.begin:
            self._start(self.state.jobs[name])
        self._observer.look(self.state, following)
        return bool(self.state.running() or following.begin or following.skip or following.wait)

    def _handle_signal(self) -> None:
        if self._signal is None:
            return
        if self.state.ended_by is None:
            self._note(
                EntryKind.SIGNAL,
                f"{self._signal.name} received: no more jobs start, running jobs end with safe"
                " tools.",
            )
            running = "; running jobs make their tools safe and end" if self.state.running() else ""
            self._observer.message(f"{self._signal.name}: no more jobs start{running}")
        for job in self.state.running():
            if job.name not in self._ending and self._processes.request_end(
                *_attempt(job), self._signal
            ):
                self._ending.add(job.name)

    def _follow(self, job: JobState) -> None:
        attempt = job.attempts[-1]
        # first: what the job wrote before it ended is read after this
        runs = self._processes.runs(*_attempt(job))
        if attempt.run is None:
            run = self._processes.run(*_attempt(job))
            if run is not None:
                self._note(
                    EntryKind.RUN,
                    f"{job.name} records into {run}.",
                    job=job.name,
                    attempt=attempt.number,
                    run=run,
                )
        if not runs:
            result = self._processes.result(*_attempt(job))
            if result is not None:
                self._end(job, result)

    def _start(self, job: JobState) -> None:
        number = len(job.attempts) + 1
        self._note(
            EntryKind.START,
            f"{job.name} is started{'' if number == 1 else ' again'}.",
            job=job.name,
            attempt=number,
        )
        try:
            self._processes.start(job.name, number)
        except OSError as error:
            text = f"it could not be started: {error.strerror or error}"
            self._end(job, AttemptResult(State.FAILED, Exit.RECORD.value, text))
        else:
            self._observer.started(job)

    def _end(self, job: JobState, result: AttemptResult, *, is_old: bool = False) -> None:
        """Record the result of an attempt, and whether a resumed batch starts the job again."""
        self._journal.note(
            Entry(
                "",
                EntryKind.END,
                result.text,
                job.name,
                job.attempts[-1].number,
                result.state.value,
                self._is_again(job, result, is_old=is_old),
                result.exit_code,
                result.verdict,
                None if result.run is None else result.run.name,
            )
        )
        self._observer.ended(job)
        is_stopping = (
            self.state.stopped_by == job.name and self.state.ended_by is None and not is_old
        )
        if is_stopping and self.state.waiting():
            self._observer.message(
                f"{job.name} stops the batch: no more jobs start, running jobs continue to"
                " their end"
            )

    def _is_again(self, job: JobState, result: AttemptResult, *, is_old: bool) -> bool:
        """Whether the job was cut off or stopped the batch; false for one recorded to its end."""
        if result.state in RECORDED:
            return False
        was_cut_off = self.state.ended_by is not None or (
            is_old and (result.state is State.HALF or not result.is_begun)
        )
        return was_cut_off or self.state.policies[job.name] is OnFailure.STOP

    def _note(
        self,
        kind: EntryKind,
        text: str,
        job: str | None = None,
        attempt: int | None = None,
        run: str | None = None,
    ) -> None:
        self._journal.note(Entry("", kind, text, job, attempt, run=run))

    # -- end ---------------------------------------------------------------------------------------

    def _close(self) -> None:
        if self.state.is_open():
            why = (
                "Batch interrupted"
                if self.state.ended_by is not None
                else f"Batch stopped: {self.state.stopped_by} failed"
            )
            self._note(EntryKind.CLOSE, f"{why}. Run the same command to resume.")

    def finish(self) -> None:
        """Close a batch whose jobs have all ended; the next start begins a new one.

        Call it after the results were shown: after a kill in between, the next start must show them
        and repeat nothing.
        """
        if not self.state.is_open():
            self._note(EntryKind.FINISH, "All jobs have ended.")

    def exit_code(self) -> Exit:
        """Return the most severe exit code of the jobs and of the interruption, if any."""
        found = list(_findings(self.state.jobs.values()))
        if self._signal is not None and self.state.is_open():
            found.append(RunFinding(ENDED_BY[self._signal], "the batch was interrupted"))
        return exit_code(found)


def _findings(jobs: Iterable[JobState]) -> Iterable[RunFinding]:
    for job in jobs:
        if job.is_over and job.last is not None and job.last.exit_code is not None:
            code = Exit(job.last.exit_code) if job.last.exit_code in list(Exit) else Exit.RECORD
            yield RunFinding(Exit.STATION if code is Exit.USAGE else code, job.last.text)


def _attempt(job: JobState) -> tuple[str, int]:
    return job.name, job.attempts[-1].number
