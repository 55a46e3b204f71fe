"""The processes of jobs: started, found again, asked to end, and what came of those that ended.

What came of a job is known by its run's manifest: sealed, or recovered here where the process died. A process that died before
its run had a folder has touched no station.
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

from jbclog.app.batch.child import ORDER
from jbclog.app.batch.job_dir import NOTES, JobDir, carried
from jbclog.app.batch.job_spec import JobSpec
from jbclog.app.batch.state import State
from jbclog.app.run.plan import Metadata
from jbclog.core.errors import RecordError, Unsafe, unexpected_error_text
from jbclog.core.outcome import Exit, Status
from jbclog.record.find_runs import Filter, Found, find
from jbclog.record.manifest import Manifest, read_manifest
from jbclog.record.recover import recover

ENDED_BY: Final = {signal.SIGINT: Exit.INTERRUPTED, signal.SIGTERM: Exit.TERMINATED, signal.SIGHUP: Exit.TERMINATED}
ATTEMPT: Final = "attempt"  # a tag of the run
CUT_SHORT: Final = (Exit.INTERRUPTED.value, Exit.TERMINATED.value)
RECOVERING_MOST: Final = 4  # at once


@dataclass(frozen=True, slots=True)
class Came:
    """What came of an attempt. `is_begun`: its run has a folder, and stations may have been touched."""

    state: State
    exit_code: int
    text: str
    run: Path | None = None
    verdict: str | None = None

    @property
    def is_begun(self) -> bool:
        return self.run is not None


class Processes(Protocol):
    """How the executor acts on processes; a test has others."""

    def start(self, name: str, attempt: int) -> None:
        """Start the job. Raises OSError."""

    def runs(self, name: str, attempt: int) -> bool:
        """Whether its process lives."""

    def run(self, name: str, attempt: int) -> str | None:
        """The name of its run's folder, as soon as it has one."""

    def ask_to_end(self, name: str, attempt: int, number: signal.Signals) -> bool:
        """Have it end in good order; False where it cannot be told yet."""

    def came(self, name: str, attempt: int) -> Came | None:
        """What came of it, when it does not run any more; None while that is being found out."""


class SystemProcesses:
    """Processes of this computer, with their papers below `folder`."""

    def __init__(self, folder: Path, orders: dict[str, JobSpec]) -> None:
        self._folder = folder
        self._orders = orders
        self._children: dict[Path, subprocess.Popen[bytes]] = {}
        self._pool = ThreadPoolExecutor(RECOVERING_MOST, "recover")
        self._coming: dict[Path, Future[Came]] = {}
        self._told: dict[Path, signal.Signals] = {}
        self._recorded: dict[Path, Path] = {}

    def papers(self, name: str, attempt: int) -> JobDir:
        return JobDir(self._folder / "jobs" / f"{name}-{attempt}")

    def remember(self, name: str, attempt: int, run: Path) -> None:
        """The journal knows its run's folder, should its papers be gone."""
        self._recorded[self.papers(name, attempt).folder] = run

    def start(self, name: str, attempt: int) -> None:
        papers = self.papers(name, attempt)
        descriptor = papers.make(ORDER.dump_json(signed(self._order(name), papers)))
        try:
            with (papers.folder / NOTES).open("ab") as notes:
                # -P: a file of the user's in the current folder must not pass for a module
                command = [sys.executable, "-P", "-m", "jbclog.app.batch.child", str(papers.folder.absolute()), str(descriptor)]
                self._children[papers.folder] = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=notes,
                    stderr=notes,
                    start_new_session=True,
                    pass_fds=(descriptor,),
                )
        finally:
            os.close(descriptor)

    def _order(self, name: str) -> JobSpec:
        """With the serial that the last job at its reader left to it."""
        order = self._orders[name]
        same = [other for other, one in self._orders.items() if one.units_from == order.units_from]
        if order.units_from is None:
            return order
        before = [JobDir(path) for path in (self._folder / "jobs").glob("*") if path.name.rpartition("-")[0] in same]
        return replace(order, first_unit=carried(before))

    def runs(self, name: str, attempt: int) -> bool:
        papers = self.papers(name, attempt)
        child = self._children.get(papers.folder)
        if child is not None:
            return child.poll() is None
        return papers.is_held()

    def run(self, name: str, attempt: int) -> str | None:
        run = self.papers(name, attempt).run()
        return None if run is None else run.name

    def ask_to_end(self, name: str, attempt: int, number: signal.Signals) -> bool:
        papers = self.papers(name, attempt)
        child = self._children.get(papers.folder)
        sent = signal.SIGTERM if number is signal.SIGHUP else number  # a job of a batch under `nohup` hears no SIGHUP
        if child is not None:
            child.send_signal(sent)
            self._told[papers.folder] = number
            return True
        process = papers.process()
        if process is None or not papers.is_held():
            return False
        with suppress(OSError):
            os.kill(process, sent)
            self._told[papers.folder] = number
        return True

    def came(self, name: str, attempt: int) -> Came | None:
        papers = self.papers(name, attempt)
        if papers.folder not in self._coming:
            told, run = self._told.get(papers.folder), self._recorded.get(papers.folder)
            self._coming[papers.folder] = self._pool.submit(came_of, papers, told, run)
        future = self._coming[papers.folder]
        if not future.done():
            return None
        try:
            return future.result()
        except Exception as error:  # of this program: nothing is known of the tools, and the other jobs go on
            text = f"what came of it could not be found out, {unexpected_error_text(error)}"
            return Came(State.HALF, Unsafe.exit_code, text, papers.run())

    def peek(self, name: str, attempt: int) -> str:
        """What will be done about an attempt that the journal has running; nothing is done about it."""
        papers = self.papers(name, attempt)
        if papers.is_held():
            return f"still runs (process {papers.process() or 'just starting'}): it is followed"
        run = papers.run() or self._recorded.get(papers.folder)
        if run is None:
            return "had not begun: it is started"
        ended = _ended(run)
        if ended is None:
            return f"was cut off by a crash: {run.name} is recovered and recorded as half done, and the job is done again"
        return f"ended meanwhile with exit code {ended.exit_code} ({run.name})"


def came_of(papers: JobDir, told: signal.Signals | None = None, recorded: Path | None = None) -> Came:
    """What came of an attempt whose process is gone; its run is recovered where that is needed.

    `told` is the signal that it was asked to end by, `recorded` the run that the journal has of it.
    """
    run, said = papers.run() or recorded, papers.said()
    if run is None and said is not None and said.run is not None:
        run = Path(said.run)
    run = run or _unnamed(papers)
    if run is None:
        if said is not None:
            return Came(State.FAILED, said.exit_code, "; ".join(said.findings))
        if told is not None:
            return Came(State.HALF, ENDED_BY[told].value, f"{told.name} ended it before its run began; no station was touched")
        why = papers.last_note()
        return Came(State.FAILED, Exit.RECORD.value, f"its process ended before its run began{f': {why}' if why else ''}")
    ended = _ended(run)
    if ended is None:
        return _recovered(run)
    if said is None:
        with suppress(RecordError):
            recover(run)  # sealed, but its process may have died before it had cleared up
    if ended.exit_status == Status.LOST:  # somebody else has recovered it
        return Came(State.HALF, ended.exit_code or RecordError.exit_code, "its process died while it ran", run, ended.verdict)
    if said is not None:
        return _told(said.exit_code, "; ".join(said.findings), run, said.verdict)
    return _told(ended.exit_code or 0, "", run, ended.verdict)


def signed(order: JobSpec, papers: JobDir) -> JobSpec:
    """The order with the attempt in its run's tags: by it the run is known, also one whose papers do not name it yet."""
    wanted = order.job.wanted
    said = wanted.metadata or Metadata()
    said = replace(said, tags=said.tags | {ATTEMPT: _attempt(papers)})
    return replace(order, job=replace(order.job, wanted=replace(wanted, metadata=said)))


def _attempt(papers: JobDir) -> str:
    """Such as ``20261122T004342Z/warm-up-1``: the batch's start, the job, and which try at it."""
    return f"{papers.folder.parent.parent.name}/{papers.folder.name}"


def _unnamed(papers: JobDir) -> Path | None:
    """The run of a process that died after it had made its folder and before its papers named it."""
    try:
        out = ORDER.validate_json(papers.job()).job.out
        found = find(out, Filter(tags={ATTEMPT: _attempt(papers)}))
        return next((run.folder for run in found if isinstance(run, Found)), None)
    except (OSError, ValueError, RecordError):
        return None


def _ended(run: Path) -> Manifest | None:
    """The manifest of a run that came to its end; None where it has to be recovered."""
    try:
        manifest = read_manifest(run)
    except RecordError:
        return None
    return manifest if manifest.state == "sealed" else None


def _told(code: int, text: str, run: Path, verdict: str | None) -> Came:
    states = {Exit.FINE.value: State.DONE, Exit.NOT_FINE.value: State.NOT_FINE}
    state = State.HALF if code in CUT_SHORT else states.get(code, State.FAILED)
    if state is State.NOT_FINE and not text:
        text = f"the verdict is {verdict}"
    return Came(state, code, text, run, verdict)


def _recovered(run: Path) -> Came:
    try:
        done = recover(run)
    except RecordError as error:
        text = f"its process died, and its run could not be recovered: {error}"
        return Came(State.HALF, Unsafe.exit_code, text, run)
    manifest = _ended(run)
    code = RecordError.exit_code if done.is_safe else Unsafe.exit_code
    verdict = None if manifest is None else manifest.verdict
    return Came(State.HALF, code, f"its process died while it ran; what it had recorded is sealed. {done.text}", run, verdict)
