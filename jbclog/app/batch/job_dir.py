"""The folder of one attempt at a job, and the serial that one job leaves to the next.

The lock is held by the process of the job for as long as it lives, and taken for it by who starts it, before there is a process:
so nobody can start it twice, and one that still runs is known by anybody at any time.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final

from jbclog.core.durable_files import write_whole
from jbclog.core.foreign.files import Kind, open_foreign, read_foreign
from jbclog.core.foreign.json_reader import build, json_of, read_json
from jbclog.core.locks import is_locked
from jbclog.core.rows import EventRow, Severity
from jbclog.transport.typed_lines import LineSource

# -- job dir ------------------------------------------------------------------------------------------------------------------

JOB: Final = "job.json"
LOCK: Final = "lock"
RUN: Final = "run.json"
NOW: Final = "now.json"
SAID: Final = "said.json"
EVENTS: Final = "events.jsonl"
NOTES: Final = "notes.txt"


@dataclass(frozen=True, slots=True)
class PortProgress:
    """A port as it was last read. None: not known now."""

    station: str
    port: int
    temperature_c: float | None = None
    set_c: float | None = None
    status: str | None = None


@dataclass(frozen=True, slots=True)
class JobProgress:
    """How a job stands, told each second. `away` are stations that are not connected; `units` have been finished so far."""

    passed_s: float = 0.0
    doing: str = "starting"
    alarms: int = 0
    ports: list[PortProgress] = field(default_factory=list)
    away: list[str] = field(default_factory=list)
    units: int = 0


@dataclass(frozen=True, slots=True)
class JobResult:
    """The last words of a job: its exit code, and the sentences behind it, the gravest first."""

    exit_code: int
    verdict: str | None = None
    findings: list[str] = field(default_factory=list)
    run: str | None = None


class JobDir:
    """The folder of one attempt."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    # -- who starts it ------------------------------------------------------------------------------------------------------

    def make(self, job: bytes) -> int:
        """Make the folder with what the job is to do; give its lock, taken. Raises OSError."""
        self.folder.mkdir(parents=True, exist_ok=True)
        write_whole(self.folder / JOB, job)
        descriptor = os.open(self.folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(descriptor)
            raise
        return descriptor

    def is_running(self) -> bool:
        """Whether the job's process lives."""
        return is_locked(self.folder / LOCK)

    def process(self) -> int | None:
        """The job's process, as it says itself; None where it has not come to saying so."""
        with contextlib.suppress(OSError, ValueError):
            return int(read_foreign(self.folder / LOCK, Kind.LOCK))
        return None

    # -- the job itself -----------------------------------------------------------------------------------------------------

    def spec(self) -> bytes:
        """What it is to do. Raises OSError."""
        return read_foreign(self.folder / JOB, Kind.JOB)

    @staticmethod
    def sign(descriptor: int) -> None:
        """Say in the lock which process holds it."""
        os.pwrite(descriptor, str(os.getpid()).encode(), 0)

    def set_run(self, run: Path) -> None:
        """Its run has a folder; nothing was asked of any station yet. Raises OSError."""
        write_whole(self.folder / RUN, json.dumps({"run": str(run.absolute())}).encode())

    def set_progress(self, progress: JobProgress) -> None:
        """How it stands. Not synced: it is worth nothing after a power cut. Raises OSError."""
        aside = self.folder / f".{NOW}"
        aside.write_text(json.dumps(asdict(progress)), encoding="utf-8")
        aside.replace(self.folder / NOW)

    def add_event(self, event: EventRow) -> None:
        """An event of its run, for who looks on; the record has it. Raises OSError."""
        with (self.folder / EVENTS).open("a", encoding="utf-8") as file:
            file.write(json.dumps(event) + "\n")

    def set_result(self, result: JobResult) -> None:
        """What came of it. Raises OSError."""
        write_whole(self.folder / SAID, json.dumps(asdict(result)).encode())

    # -- who looks on -------------------------------------------------------------------------------------------------------

    def run(self) -> Path | None:
        """The folder of its run; None where it had not come to that."""
        found = self._read(RUN)
        return Path(str(found["run"])) if isinstance(found, dict) and "run" in found else None

    def progress(self) -> JobProgress:
        """How it stood at last."""
        with contextlib.suppress(ValueError):
            return build(JobProgress, self._read(NOW))
        return JobProgress()

    def result(self) -> JobResult | None:
        """Its last words; None where it had none."""
        with contextlib.suppress(ValueError):
            return build(JobResult, self._read(SAID))
        return None

    def ended_at(self) -> float | None:
        """When it said its last words, seconds since 1970; None where it did not."""
        with contextlib.suppress(OSError):
            return (self.folder / SAID).stat().st_mtime
        return None

    def events(self, since: int) -> tuple[list[EventRow], int]:
        """The events that were told from the byte `since` on, and where the next ones begin."""
        try:
            with open_foreign(self.folder / EVENTS, Kind.JOURNAL) as file:
                file.seek(since)
                data = file.read()
        except OSError:
            return [], since
        whole = data[: data.rfind(b"\n") + 1]
        found = [event for line in whole.splitlines() if (event := _event(line)) is not None]
        return found, since + len(whole)

    def last_note(self) -> str:
        """The last line that the process left behind: why it died, where it says so."""
        with contextlib.suppress(OSError):
            lines = read_foreign(self.folder / NOTES, Kind.JOB).decode(errors="replace").strip().splitlines()
            return lines[-1].strip() if lines else ""
        return ""

    def _read(self, name: str) -> object:
        with contextlib.suppress(OSError, ValueError, RecursionError):
            data: object = read_json(self.folder / name, Kind.JOB)
            return data
        return None


def _event(line: bytes) -> EventRow | None:
    with contextlib.suppress(ValueError, TypeError, RecursionError):
        event = EventRow(*json_of(line))
        return event._replace(severity=Severity(event.severity))
    return None


# -- serial handover ----------------------------------------------------------------------------------------------------------
# The serial that ends one job is that of the next one's first unit: who made the fortieth put away has the next one in hand.

NEXT: Final = "unit.next"
FEED: Final = (
    *("unit.begin", "unit.end", "unit.again", "unit.repeated", "unit.finish", "unit.refused", "unit.closed", "unit.lost"),
    NEXT,
)


class PrefixedSource(LineSource):
    """A source that first gives a serial which was read from it before."""

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
    """The serial that the last of these jobs read and left to the next; None where there is none, or it is not known."""
    ended = [job_dir for job_dir in before if job_dir.ended_at() is not None]
    last = max(ended, key=lambda job_dir: job_dir.ended_at() or 0.0, default=None)
    events = [] if last is None else [event for event in last.events(0)[0] if event.kind in FEED]
    return events[-1].raw if events and events[-1].kind == NEXT else None
