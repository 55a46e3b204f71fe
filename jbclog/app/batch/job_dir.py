"""One attempt at a job: its row in the batch's store, its folder, and the serial handed over to the
next job.

The folder has what a database cannot hold: the lock, held by the job's process for its lifetime and
taken by its parent before the process exists, and the output of the process. So a job is never
started twice, and anyone can see that it is running.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import BinaryIO, Final, Literal

from jbclog.app.batch.store import ADD_EVENT, BatchStore
from jbclog.core.files import Kind, open_to_write, read_regular
from jbclog.core.json_files import builder, json_of
from jbclog.core.locks import is_locked
from jbclog.core.operating_system import lock_exclusive, write_at
from jbclog.core.rows import EventRow, Severity
from jbclog.transport.typed_lines import LineSource

LOCK: Final = "lock"
NOTES: Final = "notes.txt"
PAGE: Final = 10_000  # events in memory at once

Column = Literal["spec", "run", "progress", "result", "ended"]


@dataclass(frozen=True, slots=True)
class PortProgress:
    """A port as last read. None: not known now."""

    station: str
    port: int
    temperature_c: float | None = None
    set_c: float | None = None
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
    """Exit code of a job, and its findings, the most severe first."""

    exit_code: int
    verdict: str | None = None
    findings: list[str] = field(default_factory=list)
    run: str | None = None


_build_job_result: Final = builder(JobResult)


class JobDir:
    """One attempt, by its folder ``BATCH/jobs/NAME-NUMBER``. `store` is that of the batch, opened
    if None.
    """

    def __init__(self, folder: Path, store: BatchStore | None = None) -> None:
        self.folder = folder
        self.store = store or BatchStore(folder.parent.parent)

    # -- the executor ------------------------------------------------------------------------------

    def make(self, spec: bytes) -> int:
        """Create the folder, write the job's specification, and return its lock, taken. Raises
        `OSError`.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        self._set(spec=spec)
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
        spec = self._get("spec")
        if not isinstance(spec, bytes):
            raise FileNotFoundError(f"{self.store.path} does not have {self.folder.name}")
        return spec

    @staticmethod
    def sign(descriptor: int) -> None:
        """Write the process id into the lock."""
        write_at(descriptor, str(os.getpid()).encode(), 0)

    def set_run(self, run: Path) -> None:
        """Write the folder of its run, before any station is touched. Raises `OSError`."""
        self._set(run=json.dumps({"run": str(run.absolute())}))

    def set_progress(self, progress: JobProgress) -> None:
        """Write the progress, not synced: after a power cut it is worthless. Raises `OSError`."""
        self._set(synced=False, progress=json.dumps(asdict(progress)))

    def add_event(self, event: EventRow) -> None:
        """Add an event of its run for display, not synced: the run's record has it. Raises
        `OSError`.
        """
        with self.store.transaction(synced=False) as db:
            db.execute(ADD_EVENT, (self.folder.name, json.dumps(event)))

    def set_result(self, result: JobResult) -> None:
        """Write the result. Raises `OSError`."""
        self._set(result=json.dumps(asdict(result)), ended=time.time())

    # -- readers -----------------------------------------------------------------------------------

    def run(self) -> Path | None:
        """Return the folder of its run; None if it has none yet."""
        found = self._json("run")
        return Path(str(found["run"])) if isinstance(found, dict) and "run" in found else None

    def progress(self) -> JobProgress:
        """Return its last progress."""
        with contextlib.suppress(ValueError):
            return _build_job_progress(self._json("progress"))
        return JobProgress()

    def result(self) -> JobResult | None:
        """Return its result, or None."""
        with contextlib.suppress(ValueError):
            return _build_job_result(self._json("result"))
        return None

    def ended_at(self) -> float | None:
        """Return when its result was written, seconds since 1970; None without a result."""
        with contextlib.suppress(OSError):
            ended = self._get("ended")
            return ended if isinstance(ended, float) else None
        return None

    def events(self, since: int) -> tuple[list[EventRow], int]:
        """Return at most `PAGE` events after number `since`, and the number of the last."""
        try:
            rows = self.store.rows(
                "SELECT number, line FROM event WHERE attempt = ? AND number > ?"
                " ORDER BY number LIMIT ?",
                (self.folder.name, since, PAGE),
            )
        except OSError:
            return [], since
        found = [event for _, line in rows if (event := _event(line)) is not None]
        return found, rows[-1][0] if rows else since

    def each_event(self) -> Iterator[EventRow]:
        """Yield all events, a page at a time."""
        since, last = -1, 0
        while last > since:
            since = last
            found, last = self.events(since)
            yield from found

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

    def _json(self, column: Column) -> object:
        with contextlib.suppress(OSError, ValueError, RecursionError):
            text = self._get(column)
            if isinstance(text, str):
                data: object = json_of(text)
                return data
        return None

    def _get(self, column: Column) -> object:
        rows = self.store.rows(f"SELECT {column} FROM attempt WHERE name = ?", (self.folder.name,))
        return rows[0][0] if rows else None

    def _set(self, *, synced: bool = True, **values: object) -> None:
        """Write columns of the attempt's row, which the first write creates."""
        with self.store.transaction(synced=synced) as db:
            db.execute("INSERT OR IGNORE INTO attempt (name) VALUES (?)", (self.folder.name,))
            for column, value in values.items():
                db.execute(
                    f"UPDATE attempt SET {column} = ? WHERE name = ?", (value, self.folder.name)
                )


def _event(line: object) -> EventRow | None:
    with contextlib.suppress(ValueError, TypeError, RecursionError):
        event = EventRow(*json_of(str(line)))
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
    ended = [job_dir for job_dir in before if job_dir.ended_at() is not None]
    last = max(ended, key=lambda job_dir: job_dir.ended_at() or 0.0, default=None)
    newest = None
    for event in () if last is None else last.each_event():
        newest = event if event.kind in FEED else newest
    return newest.raw if newest and newest.kind == NEXT else None
