"""What a batch comes to, in words: how it begins, what will be done, the table of its jobs, the same as JSON."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from jbclog.app.batch.resume import Shift
    from jbclog.app.batch.state import Attempt, JobState

NOT_STARTED: Final = "not started"
COLUMNS: Final = ("job", "stations", "came to", "exit", "verdict", "began", "took", "run")
LOCAL: Final = "%Y-%m-%d %H:%M"


def local(utc_s: float) -> str:
    """A moment as the clock on the wall shows it, with its zone: jobs files are written in local time."""
    return time.strftime(f"{LOCAL} %Z", time.localtime(utc_s))


def seconds(iso: str) -> float:
    """A time of the journal as seconds since 1970 UTC."""
    from datetime import datetime

    return datetime.fromisoformat(iso).timestamp()


def span(passed_s: float) -> str:
    """``45 s``, ``12:30``, ``1:02:03``."""
    minutes, rest = divmod(round(passed_s), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours}:{minutes:02}:{rest:02}"
    return f"{minutes}:{rest:02}" if minutes else f"{rest} s"


# -- before -----------------------------------------------------------------------------------------------------------------


def beginning(shift: Shift) -> Iterator[str]:
    """Whether it begins or is gone on with, and what waits for which moment."""
    jobs = shift.standing.jobs
    count = f"{len(jobs)} job{'' if len(jobs) == 1 else 's'}"
    if shift.is_new:
        yield f"batch of {count} on line {shift.orders.line.name}; its journal is in {shift.journal.folder}"
    else:
        over = sum(job.is_over and not (job.last and job.last.again) for job in jobs.values())
        begun = local(seconds(shift.standing.begun or shift.standing.last))
        yield f"the batch of {begun} was not finished: going on where it was, with {over} of {count} behind it"
    for job in jobs.values():
        if job.due is not None and not job.is_over and not job.attempts:
            yield f"{job.name} waits until {local(job.due)}"


def intentions(shift: Shift) -> Iterator[str]:
    """A line for each job: how it stands, and what will be done about it."""
    width = max(len(name) for name in shift.standing.jobs)
    for job, text in shift.what_will_be_done():
        yield f"  {job.name:{width}}  {text}"


# -- after ------------------------------------------------------------------------------------------------------------------


def table(shift: Shift, out: Path) -> list[str]:
    """The jobs in the file's order, a line each; a job that was begun more than once has a line for each of its runs."""
    rows = [COLUMNS, *(row for job in _in_file_order(shift) for row in _rows(shift, job, out))]
    widths = [max(len(row[place]) for row in rows) for place in range(len(COLUMNS))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _in_file_order(shift: Shift) -> list[JobState]:
    return [shift.standing.jobs[name] for name in shift.orders.orders]


def _rows(shift: Shift, job: JobState, out: Path) -> Iterator[Sequence[str]]:
    stations = ",".join(shift.orders.stations[job.name])
    for attempt in job.attempts[:-1]:
        yield (job.name, stations, *_cells(attempt, out))
    if job.last is not None and job.state is job.last.state:
        yield (job.name, stations, *_cells(job.last, out))
    else:
        if job.last is not None:
            yield (job.name, stations, *_cells(job.last, out))
        yield (job.name, stations, state_of(job), "-", "-", "-", "-", "-")


def state_of(job: JobState) -> str:
    """How it stands, when nothing more will be done."""
    return job.state.value if job.is_over else NOT_STARTED


def _cells(attempt: Attempt, out: Path) -> Sequence[str]:
    began = seconds(attempt.began)
    took = "-" if attempt.ended is None else span(seconds(attempt.ended) - began)
    code = "-" if attempt.exit_code is None else str(attempt.exit_code)
    run = "-" if attempt.run is None else str(out / attempt.run)
    return attempt.state.value, code, attempt.verdict or "-", time.strftime("%H:%M:%S", time.localtime(began)), took, run


def facts(shift: Shift, out: Path, code: int) -> dict[str, object]:
    """The same for programs."""
    standing = shift.standing
    return {
        "batch": str(shift.orders.file.path),
        "journal": str(shift.journal.folder / "journal.jsonl"),
        "finished": not standing.is_open(),
        "exit_code": code,
        "jobs": [_job_facts(shift, job, out) for job in _in_file_order(shift)],
    }


def _job_facts(shift: Shift, job: JobState, out: Path) -> dict[str, object]:
    last = job.last
    return {
        "name": job.name,
        "stations": list(shift.orders.stations[job.name]),
        "state": state_of(job),
        "exit_code": None if last is None or not job.is_over else last.exit_code,
        "verdict": None if last is None else last.verdict,
        "text": job.text,
        "run": None if last is None or last.run is None else str(out / last.run),
        "runs": [_attempt_facts(attempt, out) for attempt in job.attempts],
    }


def _attempt_facts(attempt: Attempt, out: Path) -> dict[str, object]:
    return {
        "state": attempt.state.value,
        "began": attempt.began,
        "ended": attempt.ended,
        "exit_code": attempt.exit_code,
        "verdict": attempt.verdict,
        "text": attempt.text,
        "run": None if attempt.run is None else str(out / attempt.run),
    }
