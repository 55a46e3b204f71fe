"""Starts, finds, ends and evaluates the processes of jobs.

The result of a job is in its run's manifest: sealed, or recovered here if the process died. A
process that died before its run had a folder has touched no station.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Protocol

from jbclog.app.batch.child import SPEC
from jbclog.app.batch.job_dir import JobDir, unread_serial
from jbclog.app.batch.job_spec import JobSpec
from jbclog.app.batch.state import State
from jbclog.app.run.options import Metadata
from jbclog.core.errors import RecordError, Unsafe, unexpected_error_text
from jbclog.core.outcome import Exit, Status
from jbclog.record.find_runs import Filter, Found, find
from jbclog.record.manifest import Manifest, read_manifest
from jbclog.record.recover import recover

ENDED_BY: Final = {
    signal.SIGINT: Exit.INTERRUPTED,
    signal.SIGTERM: Exit.TERMINATED,
    signal.SIGHUP: Exit.TERMINATED,
}
ATTEMPT: Final = "attempt"  # tag of the run
CUT_SHORT: Final = (Exit.INTERRUPTED.value, Exit.TERMINATED.value)
RECOVERING_MOST: Final = 4  # recoveries at once


@dataclass(frozen=True, slots=True)
class AttemptResult:
    """The result of an attempt at a job."""

    state: State
    exit_code: int
    text: str
    run: Path | None = None
    verdict: str | None = None

    @property
    def is_begun(self) -> bool:
        """Whether its run has a folder; stations may have been touched."""
        return self.run is not None


class Processes(Protocol):
    """Starts and ends the processes of a batch; tests have their own."""

    def start(self, name: str, attempt: int) -> None:
        """Start the job. Raises OSError."""

    def runs(self, name: str, attempt: int) -> bool:
        """Return whether its process is alive."""

    def run(self, name: str, attempt: int) -> str | None:
        """Return the name of its run's folder, or None before it exists."""

    def request_end(self, name: str, attempt: int, number: signal.Signals) -> bool:
        """Ask it to end in good order; False if it cannot take signals yet."""

    def result(self, name: str, attempt: int) -> AttemptResult | None:
        """Return the result of an attempt that has ended; None while it is evaluated."""


class SystemProcesses:
    """Processes of this computer, with the folders of their jobs below `folder`."""

    def __init__(self, folder: Path, specs: dict[str, JobSpec]) -> None:
        self._folder = folder
        self._specs = specs
        self._children: dict[Path, subprocess.Popen[bytes]] = {}
        self._pool = ThreadPoolExecutor(RECOVERING_MOST, "recover")
        self._results: dict[Path, Future[AttemptResult]] = {}
        self._signals: dict[Path, signal.Signals] = {}
        self._recorded: dict[Path, Path] = {}

    def job_dir(self, name: str, attempt: int) -> JobDir:
        return JobDir(self._folder / "jobs" / f"{name}-{attempt}")

    def set_recorded_run(self, name: str, attempt: int, run: Path) -> None:
        """Set the run that the journal has for an attempt, in case the job's folder is gone."""
        self._recorded[self.job_dir(name, attempt).folder] = run

    def start(self, name: str, attempt: int) -> None:
        job_dir = self.job_dir(name, attempt)
        descriptor = job_dir.make(SPEC.dump_json(tagged(self._spec(name), job_dir)))
        try:
            with job_dir.notes() as notes:
                # -P: a user's file in the current folder must not be imported as a module
                command = [
                    sys.executable,
                    "-P",
                    "-m",
                    "jbclog.app.batch.child",
                    str(job_dir.folder.absolute()),
                    str(descriptor),
                ]
                self._children[job_dir.folder] = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=notes,
                    stderr=notes,
                    start_new_session=True,
                    pass_fds=(descriptor,),
                )
        finally:
            os.close(descriptor)

    def _spec(self, name: str) -> JobSpec:
        """Return the job with the serial that the previous job at its reader has left."""
        spec = self._specs[name]
        if spec.units_from is None:
            return spec
        same = [other for other, one in self._specs.items() if one.units_from == spec.units_from]
        before = [
            JobDir(path)
            for path in (self._folder / "jobs").glob("*")
            if path.name.rpartition("-")[0] in same
        ]
        return replace(spec, first_unit=unread_serial(before))

    def runs(self, name: str, attempt: int) -> bool:
        job_dir = self.job_dir(name, attempt)
        child = self._children.get(job_dir.folder)
        if child is not None:
            return child.poll() is None
        return job_dir.is_running()

    def run(self, name: str, attempt: int) -> str | None:
        run = self.job_dir(name, attempt).run()
        return None if run is None else run.name

    def request_end(self, name: str, attempt: int, number: signal.Signals) -> bool:
        job_dir = self.job_dir(name, attempt)
        child = self._children.get(job_dir.folder)
        # jobs of a batch under `nohup` ignore SIGHUP
        sent = signal.SIGTERM if number is signal.SIGHUP else number
        if child is not None:
            child.send_signal(sent)
            self._signals[job_dir.folder] = number
            return True
        process = job_dir.process()
        if process is None or not job_dir.is_running():
            return False
        with suppress(OSError):
            os.kill(process, sent)
            self._signals[job_dir.folder] = number
        return True

    def result(self, name: str, attempt: int) -> AttemptResult | None:
        job_dir = self.job_dir(name, attempt)
        if job_dir.folder not in self._results:
            number, run = self._signals.get(job_dir.folder), self._recorded.get(job_dir.folder)
            self._results[job_dir.folder] = self._pool.submit(result_of, job_dir, number, run)
        future = self._results[job_dir.folder]
        if not future.done():
            return None
        try:
            return future.result()
        # an internal error: the state of the tools is unknown, and the other jobs continue
        except Exception as error:
            text = f"its result could not be determined, {unexpected_error_text(error)}"
            return AttemptResult(State.HALF, Unsafe.exit_code, text, job_dir.run())

    def next_step(self, name: str, attempt: int) -> str:
        """Describe what `settle` would do with an attempt in the journal; changes nothing."""
        job_dir = self.job_dir(name, attempt)
        if job_dir.is_running():
            return f"still runs (process {job_dir.process() or 'just starting'}): it is followed"
        run = job_dir.run() or self._recorded.get(job_dir.folder)
        if run is None:
            return "had not begun: it is started"
        ended = _ended(run)
        if ended is None:
            return (
                f"was cut off by a crash: {run.name} is recovered and recorded as half done, and"
                " the job is done again"
            )
        return f"ended meanwhile with exit code {ended.exit_code} ({run.name})"


def result_of(
    job_dir: JobDir, number: signal.Signals | None = None, recorded: Path | None = None
) -> AttemptResult:
    """Return the result of an attempt whose process has ended; recovers its run if necessary.

    `number` is the signal that asked it to end, `recorded` the run that the journal has for it.
    """
    run, reported = job_dir.run() or recorded, job_dir.result()
    if run is None and reported is not None and reported.run is not None:
        run = Path(reported.run)
    run = run or _tagged_run(job_dir)
    if run is None:
        if reported is not None:
            return AttemptResult(State.FAILED, reported.exit_code, "; ".join(reported.findings))
        if number is not None:
            text = f"{number.name} ended it before its run began; no station was touched"
            return AttemptResult(State.HALF, ENDED_BY[number].value, text)
        why = job_dir.last_note()
        text = f"its process ended before its run began{f': {why}' if why else ''}"
        return AttemptResult(State.FAILED, Exit.RECORD.value, text)
    ended = _ended(run)
    if ended is None:
        return _recovered(run)
    if reported is None:
        with suppress(RecordError):
            recover(run)  # sealed, but the process may have died before it removed the journal
    if ended.exit_status == Status.LOST:  # recovered by another process
        code = ended.exit_code or RecordError.exit_code
        return AttemptResult(State.HALF, code, "its process died while it ran", run, ended.verdict)
    if reported is not None:
        return _by_code(reported.exit_code, "; ".join(reported.findings), run, reported.verdict)
    return _by_code(ended.exit_code or 0, "", run, ended.verdict)


def tagged(spec: JobSpec, job_dir: JobDir) -> JobSpec:
    """Return the job with its attempt as a tag of the run, by which the run is found even if the
    job's folder does not name it.
    """
    options = spec.job.wanted
    metadata = options.metadata or Metadata()
    metadata = replace(metadata, tags=metadata.tags | {ATTEMPT: _attempt(job_dir)})
    return replace(spec, job=replace(spec.job, wanted=replace(options, metadata=metadata)))


def _attempt(job_dir: JobDir) -> str:
    """Return batch start, job and attempt, such as ``20261122T004342Z/warm-up-1``."""
    return f"{job_dir.folder.parent.parent.name}/{job_dir.folder.name}"


def _tagged_run(job_dir: JobDir) -> Path | None:
    """Return the run of a process that died between creating the run's folder and reporting it."""
    try:
        out = SPEC.validate_json(job_dir.spec()).job.out
        found = find(out, Filter(tags={ATTEMPT: _attempt(job_dir)}))
        return next((run.folder for run in found if isinstance(run, Found)), None)
    except (OSError, ValueError, RecordError):
        return None


def _ended(run: Path) -> Manifest | None:
    """Return the manifest of a sealed run; None for a run that needs recovery."""
    try:
        manifest = read_manifest(run)
    except RecordError:
        return None
    return manifest if manifest.is_sealed else None


def _by_code(code: int, text: str, run: Path, verdict: str | None) -> AttemptResult:
    states = {Exit.FINE.value: State.DONE, Exit.NOT_FINE.value: State.NOT_FINE}
    state = State.HALF if code in CUT_SHORT else states.get(code, State.FAILED)
    if state is State.NOT_FINE and not text:
        text = f"the verdict is {verdict}"
    return AttemptResult(state, code, text, run, verdict)


def _recovered(run: Path) -> AttemptResult:
    try:
        done = recover(run)
    except RecordError as error:
        text = f"its process died, and its run could not be recovered: {error}"
        return AttemptResult(State.HALF, Unsafe.exit_code, text, run)
    manifest = _ended(run)
    code = RecordError.exit_code if done.is_safe else Unsafe.exit_code
    text = f"its process died while it ran; what it had recorded is sealed. {done.text}"
    return AttemptResult(
        State.HALF, code, text, run, None if manifest is None else manifest.verdict
    )
