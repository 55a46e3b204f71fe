"""The queue of the batch that runs on a folder of runs, read without locks or writes."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from jbclog.app.batch.job_dir import JobDir
from jbclog.app.batch.journal import JOBS, SUFFIX, journal_chain
from jbclog.app.batch.single_batch import LOCK
from jbclog.app.batch.state import Attempt, JobState, State, batch_state
from jbclog.config.durations import span_s
from jbclog.core.json_files import json_of
from jbclog.core.locks import is_locked
from jbclog.core.text import clean
from jbclog.live.follower import is_run

EVERY_S: Final = 2.0
NOT_READABLE: Final = "{}: its queue cannot be read now: {}"
MOST_JOBS: Final = 500
LONGEST: Final = 120  # characters of why a job ended as it did; the table of `jbclog batch` has all


class QueuedJob(NamedTuple):
    """A job: name, state (`State`), and a text about it."""

    name: str
    state: str
    text: str


@dataclass(frozen=True, slots=True)
class BatchQueue:
    """The jobs of a batch in order; `text` is its progress."""

    text: str
    jobs: tuple[QueuedJob, ...] = ()


class QueueFollower:
    """The batch that runs on the folder of runs at `path`, or on that of the run at `path`. `poll`
    may be called at any rate.
    """

    def __init__(self, path: Path) -> None:
        self._home = path.absolute().parent if is_run(path) else path
        self._looked_at: float | None = None
        self._queues: tuple[BatchQueue, ...] = ()

    def poll(self) -> tuple[BatchQueue, ...]:
        """Return the queue of each running batch."""
        now = time.monotonic()
        if self._looked_at is None or now - self._looked_at >= EVERY_S:
            self._looked_at, self._queues = now, tuple(self._running())
        return self._queues

    def _running(self) -> list[BatchQueue]:
        try:
            homes = sorted(self._home.glob(f"*{SUFFIX}"))
        except OSError as error:
            name = clean(self._home.name)
            return [BatchQueue(NOT_READABLE.format(name, error.strerror or error))]
        return [queue for home in homes if (queue := _running_queue(home)) is not None]


def _running_queue(home: Path) -> BatchQueue | None:
    try:
        return queue_of(home) if is_locked(home / LOCK) else None
    except OSError as error:
        return BatchQueue(NOT_READABLE.format(f"batch {_name(home)}", error.strerror or error))


def _name(home: Path) -> str:
    return clean(home.name.removesuffix(SUFFIX))


def queue_of(home: Path) -> BatchQueue:
    """Return the queue of the newest batch of a jobs file whose batches are in `home`."""
    name = _name(home)
    folders = sorted(
        (one for one in home.glob("*Z*") if one.is_dir() and not one.is_symlink()),
        key=lambda one: one.name,
    )
    if not folders:
        return BatchQueue(f"batch {name} begins")
    try:
        content = journal_chain(folders[-1]).read()
        state = batch_state(content.entries)
    except (OSError, ValueError) as error:
        return BatchQueue(NOT_READABLE.format(f"batch {name}", error))
    if content.damage:
        return BatchQueue(NOT_READABLE.format(f"batch {name}", content.damage[0]))
    jobs = list(state.jobs.values())[:MOST_JOBS]
    ended = sum(job.is_over for job in jobs)
    text = f"batch {name}: {ended} of {len(state.jobs)} jobs have ended"
    why = state.ended_by or (state.stopped_by and f"{state.stopped_by} failed")
    text += clean(f"; no more jobs start: {why}") if why else ""
    return BatchQueue(text, tuple(_job(job, folders[-1]) for job in jobs))


def _job(job: JobState, folder: Path) -> QueuedJob:
    if job.state is State.WAITING:
        text = _waiting(job)
    elif job.state is State.RUNNING and job.last is not None:
        text = _now(job, job.last, JobDir(folder / JOBS / f"{job.name}-{job.last.number}"))
    else:
        text = _ended(job)
    return QueuedJob(clean(job.name), str(job.state), clean(text))


def _waiting(job: JobState) -> str:
    asked = _asked(job)
    after = asked.get("after")
    parts = [f"after {', '.join(map(str, after))}"] if isinstance(after, list) and after else []
    parts += (
        [time.strftime("from %Y-%m-%d %H:%M", time.localtime(job.due))]
        if job.due is not None
        else []
    )
    return ", ".join(parts)


def _now(job: JobState, attempt: Attempt, job_dir: JobDir) -> str:
    now = job_dir.progress()
    duration = _asked(job).get("duration")
    whole_s = span_s(duration) if isinstance(duration, str) else None
    of = "" if whole_s is None else f" of {whole_s:.0f} s"
    parts = [f"{now.doing}, {now.passed_s:.0f} s{of}"]
    parts += [f"{now.units} units"] if now.units else []
    parts += [f"{now.alarms} alarms"] if now.alarms else []
    parts += [f"disconnected: {', '.join(now.away)}"] if now.away else []
    parts += [attempt.run] if attempt.run else []
    return " · ".join(parts)


def _ended(job: JobState) -> str:
    return job.text if len(job.text) <= LONGEST else f"{job.text[:LONGEST]}…"


def _asked(job: JobState) -> dict[str, object]:
    try:
        asked = json_of(job.asked)
    except ValueError:
        return {}
    return asked if isinstance(asked, dict) else {}
