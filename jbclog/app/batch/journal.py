"""The journal of a batch: chained JSON lines in its store, found again when its jobs file is
started again.

Below the folder of runs each jobs file has a folder of its own, and in it a folder for each batch::

    OUT/night.batch/lock
    OUT/night.batch/20261121T210000Z/batch.sqlite  jobs.toml  jobs/smd-1-1/
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from jbclog.app.batch.state import BatchState, Entry, EntryKind, batch_state
from jbclog.app.batch.store import ADD_LINE, BatchStore
from jbclog.core.clock import utc_text
from jbclog.core.database import Database
from jbclog.core.disk_space import write_failure
from jbclog.core.durable_files import (
    LineChain,
    chain_in,
    fields_of,
    line_of,
    sha256,
    write_whole,
)
from jbclog.core.errors import RecordError
from jbclog.core.json_files import builder
from jbclog.core.operating_system import sync_folder
from jbclog.core.text import file_name

_build_entry: Final = builder(Entry)

JOBS_FILE: Final = "jobs.toml"
JOBS: Final = "jobs"
SUFFIX: Final = ".batch"
FIRST: Final = sha256(b"journal.jsonl")
STAMP: Final = "%Y%m%dT%H%M%SZ"
WAY_OUT: Final = "Restore it from a copy, or move {} elsewhere and start a new batch"
NO_MORE: Final = (
    "no more jobs start. Running jobs continue to their end. Run the same command to resume"
)


def home_of(out: Path, jobs_file: Path) -> Path:
    """Return the folder of a jobs file's batches below the folder of runs."""
    return out / file_name(f"{jobs_file.stem}{SUFFIX}")


def iso(utc_s: float) -> str:
    """Format a time of the journal."""
    return utc_text(datetime.fromtimestamp(utc_s, UTC))


class Journal:
    """The journal of the batch in `folder`, and the state of the batch. `utc` returns the time,
    seconds since 1970.
    """

    def __init__(self, folder: Path, utc: Callable[[], float]) -> None:
        self.folder = folder
        self.store = BatchStore(folder)
        self.state: BatchState = batch_state(())
        self._utc = utc

    def note(self, entry: Entry) -> None:
        """Write an entry and sync it, before its action is taken. Raises `RecordError`."""
        try:
            with self.store.transaction() as db:
                seq, previous = _end(db)
                kept = replace(entry, time=iso(self._utc()), seq=seq + 1, prev_sha256=previous)
                db.execute(ADD_LINE, (_line(kept),))
        except OSError as error:
            why = write_failure(error, self.store.path)
            raise RecordError(f"{self.store.path} cannot be written: {why}; {NO_MORE}") from error
        self.state.take(kept)


def begin(home: Path, text: str, utc: Callable[[], float]) -> Journal:
    """Create the folder of a new batch with a copy of the jobs file. Raises `RecordError`."""
    folder = home / datetime.fromtimestamp(utc(), UTC).strftime(STAMP)
    try:
        while folder.exists():  # two within a second
            folder = folder.with_name(folder.name + "a")
        folder.mkdir()
        write_whole(folder / JOBS_FILE, text.encode())
        sync_folder(home)
    except OSError as error:
        raise RecordError(f"{folder} cannot be made: {write_failure(error, folder)}") from error
    return Journal(folder, utc)


def newest(home: Path, utc: Callable[[], float]) -> Journal | None:
    """Return the latest batch that has begun. Raises `RecordError`."""
    for folder in sorted(
        (path for path in home.glob("*Z*") if path.is_dir()),
        key=lambda path: path.name,
        reverse=True,
    ):
        journal = Journal(folder, utc)
        entries = entries_in(journal.store)
        _expect_all(folder, entries)
        if any(entry.kind == EntryKind.EXECUTION for entry in entries):
            journal.state = batch_state(entries)
            return journal
        journal.store.close()
    return None


def entries_in(store: BatchStore) -> list[Entry]:
    """Return a batch's entries. Raises `RecordError` if they cannot be read or were changed."""
    path, folder = store.path, store.path.parent
    try:
        rows = store.rows("SELECT line FROM journal ORDER BY number")
        lines = [line if isinstance(line, bytes) else b"" for (line,) in rows]
    except OSError as error:
        why = getattr(error, "strerror", None) or error
        raise RecordError(
            f"{path} cannot be read: {why}; nothing was started. {WAY_OUT.format(folder)}"
        ) from error
    found = _chain(lines)
    if found.wrong:
        number, text = found.wrong[0]
        raise RecordError(
            f"{path}: line {number} {text}; nothing was started. {WAY_OUT.format(folder)}"
        )
    return found.entries


def _chain(lines: list[bytes]) -> LineChain[Entry]:
    data = b"".join(line + b"\n" for line in lines)
    return chain_in(
        data, FIRST, parsed, what="line of a batch's journal", of_first="the file's name"
    )


def _expect_all(folder: Path, entries: list[Entry]) -> None:
    """Raise `RecordError` for a job's folder whose entry, written first, was lost."""
    known = {f"{entry.job}-{entry.attempt}" for entry in entries if entry.kind == EntryKind.START}
    unknown = sorted(path.name for path in (folder / JOBS).glob("*") if path.name not in known)
    if unknown:
        text = (
            f"its journal has no entry for jobs/{unknown[0]}, which was started: entries are"
            " missing; nothing was started"
        )
        raise RecordError(f"{folder}: {text}. {WAY_OUT.format(folder)}")


def _end(db: Database) -> tuple[int, str]:
    """Return the number of the last entry and the hash of its line."""
    row = db.execute("SELECT line FROM journal ORDER BY number DESC LIMIT 1").fetchone()
    last = None if row is None else parsed(row[0])
    return (0 if last is None else last.seq), (FIRST if row is None else sha256(row[0]))


def _line(entry: Entry) -> bytes:
    """Format an entry, without the fields that are None."""
    return line_of({name: value for name, value in asdict(entry).items() if value is not None})


def parsed(line: bytes) -> Entry | None:
    """Return the entry in a line; None if there is none, or if this program did not write it so."""
    try:
        entry = _build_entry(fields_of(line))
        return entry if _line(entry) == line else None
    except ValueError:
        return None
