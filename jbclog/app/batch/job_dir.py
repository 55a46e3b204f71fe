"""One attempt at a job: its folder, and the serial handed over to the next job.

The executor and the job exchange files in it. The lock is held by the job's process for its
lifetime and taken by its parent before the process exists: so a job is never started twice, and
anyone can see that it is running.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import BinaryIO, Final, TypeVar

from jbclog.core.durable_files import write_whole
from jbclog.core.files import Kind, open_to_write, read_regular
from jbclog.core.json_files import builder, json_of
from jbclog.core.line_file import LineFile
from jbclog.core.locks import is_locked
from jbclog.core.operating_system import lock_exclusive, sync_file, sync_folder, write_at
from jbclog.core.rows import EventRow, Severity
from jbclog.transport.typed_lines import LineSource

T = TypeVar("T")

LOCK: Final = "lock"
NOTES: Final = "notes.txt"
SPEC: Final = "spec.json"
RUN: Final = "run.json"
PROGRESS: Final = "progress.json"
EVENTS: Final = "events.jsonl"
RESULT: Final = "result.json"


@dataclass(frozen=True, slots=True)
class PortProgress:
    """A port as last read. None: not known now."""

    station: str
    port: int
    temperature_c: float | None = None
    setpoint_c: float | None = None
    status: str | None = None


@dataclass(frozen=True, slots=True)
class JobProgress:
    """Progress of a job, written every second. `away`: disconnected stations. `units`: finished so
    far; `unit`: on the bench.

    `due`, `obtained`: readings that count for the coverage. `joints`: found so far; None if not
    counted or not known.
    """

    passed_s: float = 0.0
    doing: str = "starting"
    alarms: int = 0
    ports: list[PortProgress] = field(default_factory=list)
    away: list[str] = field(default_factory=list)
    units: int = 0
    unit: str | None = None
    joints: int | None = None
    due: int = 0
    obtained: int = 0


_build_job_progress: Final = builder(JobProgress)


@dataclass(frozen=True, slots=True)
class JobResult:
    """Exit code of a job, and its findings, the most severe first. `stop`: when it was written,
    seconds since 1970.
    """

    exit_code: int
    verdict: str | None = None
    findings: list[str] = field(default_factory=list)
    run: str | None = None
    stop: float = 0.0


_build_job_result: Final = builder(JobResult)


@dataclass(frozen=True, slots=True)
class _JobRun:
    """The folder of a job's run."""

    run: str


_build_job_run: Final = builder(_JobRun)


class JobDir:
    """One attempt, by its folder ``BATCH/jobs/NAME-NUMBER``."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._events = LineFile(folder / EVENTS, Kind.JOB)

    # -- the executor ------------------------------------------------------------------------------

    def make(self, spec: bytes) -> int:
        """Create the folder, write the job's specification, and return its lock, taken. Raises
        `OSError`.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        write_whole(self.folder / SPEC, spec)
        sync_folder(self.folder.parent)
        sync_folder(self.folder.parent.parent)
        descriptor = open_to_write(self.folder / LOCK, Kind.LOCK)
        try:
            lock_exclusive(descriptor)
        except OSError:
            os.close(descriptor)
            raise
        return descriptor

    def notes(self) -> BinaryIO:
        """Open the file for the output of the process. Raises `OSError`."""
        return os.fdopen(open_to_write(self.folder / NOTES, Kind.JOB, appends=True), "ab")

    def is_running(self) -> bool:
        """Return whether the job's process is alive, by the lock that it holds."""
        return is_locked(self.folder / LOCK)

    def process(self) -> int | None:
        """Return the id of the job's process; None until the process has written it."""
        with contextlib.suppress(OSError, ValueError):
            return int(read_regular(self.folder / LOCK, Kind.LOCK))
        return None

    # -- the job -----------------------------------------------------------------------------------

    def spec(self) -> bytes:
        """Return the job's specification. Raises `OSError`."""
        return read_regular(self.folder / SPEC, Kind.JOB)

    @staticmethod
    def sign(descriptor: int) -> None:
        """Write the process id into the lock."""
        write_at(descriptor, str(os.getpid()).encode(), 0)

    def set_run(self, run: Path) -> None:
        """Write the folder of its run, before any station is touched. Raises `OSError`."""
        write_whole(self.folder / RUN, json.dumps({"run": str(run.absolute())}).encode())

    def set_progress(self, progress: JobProgress) -> None:
        """Write the progress, not synced: after a power cut it is worthless. Raises `OSError`."""
        data = json.dumps(asdict(progress)).encode()
        write_whole(self.folder / PROGRESS, data, is_synced=False)

    def add_event(self, event: EventRow) -> None:
        """Add an event of its run for display, not synced: the run's record has it. Raises
        `OSError`.
        """
        self._events.append_line(json.dumps(event).encode(), is_synced=False)

    def set_result(self, result: JobResult) -> None:
        """Write the result with the present time. Raises `OSError`.

        Its events are on disk before: the next job takes the serial that the last one left.
        """
        with contextlib.suppress(FileNotFoundError):
            sync_file(self.folder / EVENTS)
        data = json.dumps(asdict(replace(result, stop=time.time()))).encode()
        write_whole(self.folder / RESULT, data)

    # -- readers -----------------------------------------------------------------------------------

    def run(self) -> Path | None:
        """Return the folder of its run; None if it has none yet."""
        job_run = self._read(RUN, _build_job_run)
        return None if job_run is None else Path(job_run.run)

    def progress(self) -> JobProgress:
        """Return its last progress."""
        return self._read(PROGRESS, _build_job_progress) or JobProgress()

    def result(self) -> JobResult | None:
        """Return its result, or None."""
        return self._read(RESULT, _build_job_result)

    def events(self, since: int) -> tuple[list[EventRow], int]:
        """Return the next events from position `since` on, and the position behind them."""
        try:
            lines, since = self._events.lines_since(since)
        except OSError:
            return [], since
        return [event for line in lines if (event := _event(line)) is not None], since

    def each_event(self) -> Iterator[EventRow]:
        """Yield all events."""
        since, last = -1, 0
        while last > since:
            since = last
            events, last = self.events(since)
            yield from events

    def last_note(self) -> str:
        """Return the last line of the process's output, which may say why it died."""
        with contextlib.suppress(OSError):
            lines = (
                read_regular(self.folder / NOTES, Kind.JOB)
                .decode(errors="replace")
                .strip()
                .splitlines()
            )
            return lines[-1].strip() if lines else ""
        return ""

    def _read(self, name: str, build: Callable[[object], T]) -> T | None:
        with contextlib.suppress(OSError, ValueError):
            return build(json_of(read_regular(self.folder / name, Kind.JOB)))
        return None


def _event(line: bytes) -> EventRow | None:
    with contextlib.suppress(ValueError, TypeError):
        event = EventRow(*json_of(line))
        return event._replace(severity=Severity(event.severity))
    return None


# -- serial handover -------------------------------------------------------------------------------
# The serial that ends one job is the first unit of the next job at the same reader: the operator
# has that unit in hand.

NEXT: Final = "unit.next"
FEED: Final = (
    *(
        "unit.begin",
        "unit.end",
        "unit.again",
        "unit.repeated",
        "unit.finish",
        "unit.refused",
        "unit.closed",
        "unit.lost",
    ),
    NEXT,
)


class PrefixedSource(LineSource):
    """A source that first returns a serial already read from it."""

    def __init__(self, source: LineSource, serial: str) -> None:
        self.name = source.name
        self.is_typed = source.is_typed
        self._source = source
        self._first: bytes | None = serial.encode() + b"\n"

    def read(self) -> bytes | None:
        first, self._first = self._first, None
        return first if first is not None else self._source.read()

    def close(self) -> None:
        self._source.close()


def unread_serial(before: Iterable[JobDir]) -> str | None:
    """Return the serial that the last of these jobs has read and left to the next; None if there is
    none or it is not known.
    """
    results = [(job_dir, job_dir.result()) for job_dir in before]
    ended = [(result.stop, job_dir) for job_dir, result in results if result is not None]
    newest = None
    if ended:
        _, last = max(ended, key=lambda pair: pair[0])
        for event in last.each_event():
            newest = event if event.kind in FEED else newest
    return newest.raw if newest and newest.kind == NEXT else None
