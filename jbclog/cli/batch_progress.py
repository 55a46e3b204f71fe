"""Progress and result of a batch, as text and JSON."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from jbclog.app.batch.state import State
from jbclog.cli.options import Color
from jbclog.cli.output import echo_table, is_terminal, note
from jbclog.cli.progress import EventFilter, coverage_text, event_line, goal_text
from jbclog.cli.terminal import (
    Column,
    Printer,
    fitting,
    fitting_table,
    moment,
    span,
    span_of,
    started_live,
)
from jbclog.config.durations import span_s
from jbclog.core.goal import JOINTS, Goal
from jbclog.core.rows import EventRow
from jbclog.core.text import count_text

if TYPE_CHECKING:
    from rich.console import Group
    from rich.live import Live

    from jbclog.app.batch.job_dir import JobDir, JobProgress
    from jbclog.app.batch.resume import PreparedBatch
    from jbclog.app.batch.state import Attempt, BatchState, JobState, Next
    from jbclog.config.jobs_file import JobTable

NOT_STARTED: Final = "not started"
END_COLUMNS: Final = (
    Column("job"),
    Column("stations", dropped=3),
    Column("result"),
    Column("exit", dropped=4),
    Column("verdict"),
    Column("started", dropped=1),
    Column("duration", dropped=2),
    Column("run", dropped=5),
)
LOCAL: Final = "%Y-%m-%d %H:%M"


def local(utc_s: float) -> str:
    """Return local time with its zone, as jobs files use it."""
    return time.strftime(f"{LOCAL} %Z", time.localtime(utc_s))


def seconds(iso: str) -> float:
    """Convert a time of the journal to seconds since 1970, UTC."""
    from datetime import datetime

    return datetime.fromisoformat(iso).timestamp()


# -- start -----------------------------------------------------------------------------------------


def beginning(batch: PreparedBatch) -> Iterator[str]:
    """Yield whether the batch starts or resumes, and which jobs wait for a time."""
    jobs = batch.state.jobs
    count = count_text(len(jobs), "job")
    if batch.is_new:
        yield f"batch of {count} on line {batch.plan.line.name}; journal: {batch.journal.folder}"
    else:
        over = sum(job.is_over and not (job.last and job.last.again) for job in jobs.values())
        begun = local(seconds(batch.state.begun or batch.state.last))
        yield f"resuming the batch of {begun}: {over} of {count} done"
    for job in jobs.values():
        if job.due is not None and not job.is_over and not job.attempts:
            yield f"{job.name} waits until {local(job.due)}"


def intentions(batch: PreparedBatch) -> Iterator[str]:
    """Yield a line per job: its state and the next step."""
    width = max(len(name) for name in batch.state.jobs)
    for job, text in batch.next_steps():
        yield f"  {job.name:{width}}  {text}"


# -- result ----------------------------------------------------------------------------------------


def print_table(batch: PreparedBatch, out: Path) -> None:
    """Print a row for each attempt, in the jobs file's order; a terminal gets columns that fit."""
    columns: Sequence[Column] = END_COLUMNS
    rows: Sequence[Sequence[str]] = [
        row for job in _in_file_order(batch) for row in _rows(batch, job, out)
    ]
    if sys.stdout.isatty():
        columns, rows = fitting(columns, rows, shutil.get_terminal_size().columns, gap=2)
    echo_table([column.name for column in columns], rows)
    if columns[-1] is not END_COLUMNS[-1]:
        note(
            f"the runs are in {out}; `jbclog runs {out} --tag batch={batch.plan.file.path.stem}`"
            " lists them"
        )


def _in_file_order(batch: PreparedBatch) -> list[JobState]:
    return [batch.state.jobs[name] for name in batch.plan.specs]


def _rows(batch: PreparedBatch, job: JobState, out: Path) -> Iterator[Sequence[str]]:
    stations = ",".join(batch.plan.stations[job.name])
    for attempt in job.attempts[:-1]:
        yield (job.name, stations, *_cells(attempt, out))
    if job.last is not None and job.state is job.last.state:
        yield (job.name, stations, *_cells(job.last, out))
    else:
        if job.last is not None:
            yield (job.name, stations, *_cells(job.last, out))
        yield (job.name, stations, state_of(job), "-", "-", "-", "-", "-")


def state_of(job: JobState) -> str:
    """Return the job's state at the end of the batch."""
    return job.state.value if job.is_over else NOT_STARTED


def _cells(attempt: Attempt, out: Path) -> Sequence[str]:
    began = seconds(attempt.start)
    took = "-" if attempt.stop is None else span(seconds(attempt.stop) - began)
    code = "-" if attempt.exit_code is None else str(attempt.exit_code)
    run = "-" if attempt.run is None else str(out / attempt.run)
    return attempt.state.value, code, attempt.verdict or "-", moment(began), took, run


def facts(batch: PreparedBatch, out: Path, code: int) -> dict[str, object]:
    """Return the result of the batch as JSON data."""
    state = batch.state
    return {
        "batch": str(batch.plan.file.path),
        "journal": str(batch.journal.path),
        "finished": not state.is_open(),
        "exit_code": code,
        "jobs": [_job_facts(batch, job, out) for job in _in_file_order(batch)],
    }


def _job_facts(batch: PreparedBatch, job: JobState, out: Path) -> dict[str, object]:
    last = job.last
    return {
        "name": job.name,
        "stations": list(batch.plan.stations[job.name]),
        "state": state_of(job),
        "exit_code": None if last is None or not job.is_over else last.exit_code,
        "verdict": None if last is None else last.verdict,
        "text": job.text,
        "run": None if last is None else last.run,
        "folder": None if last is None or last.run is None else str(out / last.run),
        "runs": [_attempt_facts(attempt, out) for attempt in job.attempts],
    }


def _attempt_facts(attempt: Attempt, out: Path) -> dict[str, object]:
    return {
        "state": attempt.state.value,
        "start": attempt.start,
        "stop": attempt.stop,
        "exit_code": attempt.exit_code,
        "verdict": attempt.verdict,
        "text": attempt.text,
        "run": attempt.run,
        "folder": None if attempt.run is None else str(out / attempt.run),
    }


# -- progress --------------------------------------------------------------------------------------

SHOW_EVERY_S: Final = 1.0
COLUMNS: Final = (
    Column("job"),
    Column("stations", dropped=3),
    Column("order", dropped=2),
    Column("unit", dropped=4),
    Column("progress"),
    Column("now"),
    Column("tools", dropped=1),
    Column("alarms", is_number=True),
    Column("coverage", is_number=True, dropped=6),
    Column("lost", is_number=True, dropped=5),
)


class _Follower:
    """Events of one job that are worth showing, as they arrive."""

    def __init__(self, job_dir: JobDir) -> None:
        self.job_dir = job_dir
        self._filter = EventFilter()
        self._read = 0

    def news(self) -> Iterator[EventRow]:
        events, self._read = self.job_dir.events(self._read)
        return filter(self._filter.passes, events)


class Lines:
    """Lines for a log or a pipe: one for each job's start and end, and each event worth showing."""

    def __init__(self, batch: PreparedBatch, printer: Printer) -> None:
        self._batch = batch
        self._printer = printer
        self._followed: dict[str, _Follower] = {}
        self._recording: set[str] = set()
        self._shown = 0.0

    def started(self, job: JobState) -> None:
        again = "" if len(job.attempts) == 1 else ", again as a new run"
        self.message(
            f"{job.name} starts on {', '.join(self._batch.plan.stations[job.name])}{again}"
        )

    def ended(self, job: JobState) -> None:
        self._print_news(job)
        self._followed.pop(job.name, None)
        if job.state is State.SKIPPED or job.last is None:
            self.message(job.text.rstrip("."))
            return
        took = span(seconds(job.last.stop or job.last.start) - seconds(job.last.start))
        why = f": {job.text}" if job.text else ""
        self.message(
            f"{job.name} ended after {took}, {job.state.value}, exit code {job.last.exit_code}{why}"
        )

    def message(self, text: str) -> None:
        self._printer.print(f"{moment(time.time())}  {text}")

    def look(self, state: BatchState, following: Next) -> None:
        now = time.monotonic()
        if now - self._shown >= SHOW_EVERY_S:
            self._shown = now
            for job in state.running():
                self._print_run(job)
                self._print_news(job)
            self._second(state, following)

    def close(self) -> None:
        return

    def _print_run(self, job: JobState) -> None:
        run = job.last and job.last.run
        if run and run not in self._recording:
            self._recording.add(run)
            self.message(f"{job.name} records into {run}")

    def _print_news(self, job: JobState) -> None:
        for event in self._follow(job).news():
            self._printer.print(event_line(event, job.name), event.severity)

    def _follow(self, job: JobState) -> _Follower:
        job_dir = self._batch.processes.job_dir(job.name, max(len(job.attempts), 1))
        known = self._followed.get(job.name)
        if known is None or known.job_dir.folder != job_dir.folder:
            known = self._followed[job.name] = _Follower(job_dir)
        return known

    def _now(self, job: JobState) -> JobProgress:
        return self._follow(job).job_dir.progress()

    def _second(self, state: BatchState, following: Next) -> None:
        return


class Screen(Lines):
    """Live table for a terminal, with the events above it."""

    def __init__(self, batch: PreparedBatch, printer: Printer) -> None:
        super().__init__(batch, printer)
        self._asked: dict[str, JobTable] = {job.name: job for job in batch.plan.file.jobs}
        self._live: Live | None = started_live(printer.console)

    def close(self) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _second(self, state: BatchState, following: Next) -> None:
        if self._live is not None:
            self._live.update(self._table(state, following), refresh=True)

    def _table(self, state: BatchState, following: Next) -> Group:
        rows = [self._cells(job, self._now(job)) for job in state.running()]
        return fitting_table(title(state, following), COLUMNS, rows, self._printer.console.width)

    def _cells(self, job: JobState, now: JobProgress) -> tuple[str, ...]:
        stations = ", ".join(self._batch.plan.stations[job.name])
        away = f"; disconnected: {', '.join(now.away)}" if now.away else ""
        asked = self._asked[job.name]
        progress = (
            asked.order or "",
            now.unit or "",
            so_far(asked, now),
            now.doing + away,
            tools(now),
        )
        return (
            job.name,
            stations,
            *progress,
            str(now.alarms or ""),
            coverage_text(now.due, now.obtained),
            str(now.due - now.obtained or ""),
        )


def title(state: BatchState, following: Next) -> str:
    """Return ``2 of 9 jobs have ended; next smd-2 (dde-1: behind smd-1)``."""
    ended = sum(job.is_over for job in state.jobs.values())
    text = f"{ended} of {len(state.jobs)} jobs have ended"
    if not following.wait:
        return text
    first = following.wait[0]
    why = first.why if first.until is None else f"waits until {local(first.until)}"
    more = f", and {len(following.wait) - 1} more" if len(following.wait) > 1 else ""
    return f"{text}; next {first.name} ({why}){more}"


def so_far(asked: JobTable, now: JobProgress) -> str:
    """Return the job's progress towards its end."""
    passed = span_of(now.passed_s, span_s(asked.duration) if asked.duration else None)
    if asked.units is not None:
        return f"{now.units} of {asked.units} units, {passed}"
    return (
        passed
        if asked.joints is None
        else f"{passed}, {goal_text(Goal(JOINTS, asked.joints, now.joints))}"
    )


def tools(now: JobProgress) -> str:
    """Return the states and temperatures of the tools: ``working 346 to 352 °C``."""
    states = dict.fromkeys(port.status for port in now.ports if port.status)
    known = sorted(port.temperature_c for port in now.ports if port.temperature_c is not None)
    warm = (
        ""
        if not known
        else f"{known[0]:g} °C"
        if known[0] == known[-1]
        else f"{known[0]:g} to {known[-1]:g} °C"
    )
    return " ".join(part for part in (", ".join(states), warm) if part)


def shown_by(batch: PreparedBatch, color: Color, *, quiet: bool) -> Lines:
    """Return the live table on a terminal, lines elsewhere and with --json."""
    printer = Printer(color)
    return Screen(batch, printer) if is_terminal() and not quiet else Lines(batch, printer)
