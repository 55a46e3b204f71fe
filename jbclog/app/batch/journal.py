"""The journal of a batch: a chain of JSON lines, found again when its jobs file is started again.

Below the folder of runs each jobs file has a folder of its own, and in it a folder for each batch::

    OUT/night.batch/lock
    OUT/night.batch/20261121T210000Z/journal.jsonl  jobs.toml  jobs/smd-1-1/
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from jbclog.app.batch.state import BatchState, Entry, EntryKind, batch_state
from jbclog.core.chain import Chain
from jbclog.core.clock import utc_text
from jbclog.core.disk_space import write_failure
from jbclog.core.durable_files import write_new, write_whole
from jbclog.core.errors import RecordError
from jbclog.core.files import Kind
from jbclog.core.json_files import decoder
from jbclog.core.operating_system import sync_folder
from jbclog.core.text import file_name

_read_entry: Final = decoder(Entry)

NAME: Final = "journal.jsonl"
JOBS_FILE: Final = "jobs.toml"
JOBS: Final = "jobs"
SUFFIX: Final = ".batch"
STAMP: Final = "%Y%m%dT%H%M%SZ"
NO_MORE: Final = (
    "no more jobs start. Running jobs continue to their end. Run the same command to resume"
)


def home_of(out: Path, jobs_file: Path) -> Path:
    """Return the folder of a jobs file's batches below the folder of runs."""
    return out / file_name(f"{jobs_file.stem}{SUFFIX}")


def iso(utc_s: float) -> str:
    """Format a time of the journal."""
    return utc_text(datetime.fromtimestamp(utc_s, UTC))


def journal_chain(folder: Path) -> Chain[Entry]:
    """Return the journal of the batch in `folder` as a file."""
    return Chain(
        folder / NAME,
        Kind.JOURNAL,
        _read_entry,
        what="line of a batch's journal",
        creates=False,  # one that was removed is not begun again
    )


class Journal:
    """The journal of the batch in `folder`, and the state of the batch. `utc` returns the time,
    seconds since 1970.
    """

    def __init__(self, folder: Path, utc: Callable[[], float]) -> None:
        self.folder = folder
        self.path = folder / NAME
        self.state: BatchState = batch_state(())
        self._utc = utc

    def note(self, entry: Entry) -> None:
        """Write an entry and sync it, before its action is taken. Raises `RecordError`."""
        timed = replace(entry, time=iso(self._utc()))
        try:
            ((_, kept),) = journal_chain(self.folder).append(timed)
        except OSError as error:
            why = write_failure(error, self.path)
            raise RecordError(f"{self.path} cannot be written: {why}; {NO_MORE}") from error
        self.state.take(kept)


def begin(home: Path, text: str, utc: Callable[[], float]) -> Journal:
    """Create the folder of a new batch with a copy of the jobs file. Raises `RecordError`."""
    folder = home / datetime.fromtimestamp(utc(), UTC).strftime(STAMP)
    try:
        while folder.exists():  # two within a second
            folder = folder.with_name(folder.name + "a")
        folder.mkdir()
        write_whole(folder / JOBS_FILE, text.encode())
        write_new(folder / NAME, b"")
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
        entries = entries_in(folder)
        _expect_all(folder, entries)
        if any(entry.kind == EntryKind.EXECUTION for entry in entries):
            journal = Journal(folder, utc)
            journal.state = batch_state(entries)
            return journal
    return None


def entries_in(folder: Path) -> list[Entry]:
    """Return the entries of the batch in `folder`. Raises `RecordError` if they cannot be read or
    were changed.
    """
    chain = journal_chain(folder)
    try:
        content = chain.read()
    except OSError as error:
        why = f"cannot be read: {error.strerror or error}"
        raise RecordError(_nothing_started(f"{chain.path} {why}", folder)) from error
    if content.damage:
        raise RecordError(_nothing_started(f"{chain.path}: {content.damage[0]}", folder))
    return content.entries


def _expect_all(folder: Path, entries: list[Entry]) -> None:
    """Raise `RecordError` for a job's folder whose entry, written first, was lost."""
    known = {f"{entry.job}-{entry.attempt}" for entry in entries if entry.kind == EntryKind.START}
    unknown = sorted(path.name for path in (folder / JOBS).glob("*") if path.name not in known)
    if unknown:
        text = (
            f"{folder}: its journal has no entry for jobs/{unknown[0]}, which was started: entries"
            " are missing"
        )
        raise RecordError(_nothing_started(text, folder))


def _nothing_started(why: str, folder: Path) -> str:
    return (
        f"{why}; nothing was started. Restore it from a copy, or move {folder} elsewhere and start"
        " a new batch"
    )
