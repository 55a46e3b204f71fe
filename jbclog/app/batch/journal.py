"""The journal of one batch on disk: chained JSON lines (`core/durable_files.py`), found again when its jobs file is started again.

Below the folder of runs each jobs file has a folder of its own, and in it each time that the batch began a folder with its journal,
the jobs file as it was then, and the papers of its jobs::

    OUT/night.batch/lock
    OUT/night.batch/20261121T210000Z/journal.jsonl  jobs.toml  jobs/smd-1-1/

A line that a crash cut off was never acted upon and counts for nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from jbclog.app.batch.state import BatchState, Entry, Kind, batch_state
from jbclog.core.durable_files import add_line, chain_in, fields_of, line_of, sha256, sync_folder, write_whole
from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import Kind as FileKind
from jbclog.core.foreign.files import read_foreign
from jbclog.core.foreign.json_reader import build

NAME: Final = "journal.jsonl"
JOBS_FILE: Final = "jobs.toml"
JOBS: Final = "jobs"
SUFFIX: Final = ".batch"
FIRST: Final = sha256(NAME.encode())
STAMP: Final = "%Y%m%dT%H%M%SZ"
CUT_OFF: Final = "cut off"
WAY_OUT: Final = "Restore it from a copy, or move {} elsewhere and start a new batch"
AT_A_LOSS: Final = "no more jobs start. Running jobs continue to their end. Run the same command to resume"


def home_of(out: Path, jobs_file: Path) -> Path:
    """The folder of a jobs file's batches below the folder of runs."""
    return out / f"{jobs_file.stem}{SUFFIX}"


def iso(utc_s: float) -> str:
    """As times stand in the journal."""
    return datetime.fromtimestamp(utc_s, UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


class Journal:
    """The journal in `folder`, and how the batch stands by it. `utc` gives the time now, seconds since 1970."""

    def __init__(self, folder: Path, utc: Callable[[], float], entries: list[Entry] | None = None) -> None:
        self.folder = folder
        self.state: BatchState = batch_state(entries or ())
        self._utc = utc

    def note(self, entry: Entry) -> None:
        """Write an entry and sync it, before its action is taken. Raises `RecordError`."""
        kept: list[Entry] = []

        def made(seq: int, previous: str) -> bytes:
            kept.append(replace(entry, time=iso(self._utc()), seq=seq, prev_sha256=previous))
            return _line(kept[-1])

        try:
            add_line(self.folder / NAME, FIRST, _parsed, made)
        except OSError as error:
            text = f"{self.folder / NAME} cannot be written: {error.strerror or error}; {AT_A_LOSS}"
            raise RecordError(text) from error
        self.state.take(kept[-1])


def begin(home: Path, text: str, utc: Callable[[], float]) -> Journal:
    """A new batch: its folder with the jobs file as it is now. Raises `RecordError`."""
    folder = home / datetime.fromtimestamp(utc(), UTC).strftime(STAMP)
    try:
        while folder.exists():  # two within a second
            folder = folder.with_name(folder.name + "a")
        folder.mkdir()
        write_whole(folder / JOBS_FILE, text.encode())
        sync_folder(home)
    except OSError as error:
        raise RecordError(f"{folder} cannot be made: {error.strerror or error}") from error
    return Journal(folder, utc)


def newest(home: Path, utc: Callable[[], float]) -> Journal | None:
    """The batch that was begun last, None where there is none. Raises `RecordError` where its journal was changed.

    One that was killed before its first line stood is none.
    """
    for folder in sorted((path for path in home.glob("*Z*") if path.is_dir()), key=lambda path: path.name, reverse=True):
        entries = read(folder)
        _expect_all(folder, entries)
        if any(entry.kind == Kind.EXECUTION for entry in entries):
            return Journal(folder, utc, entries)
    return None


def _expect_all(folder: Path, entries: list[Entry]) -> None:
    """An attempt is written down before it has papers: papers of which the journal says nothing mean that it has lost lines."""
    known = {f"{entry.job}-{entry.attempt}" for entry in entries if entry.kind == Kind.START}
    unknown = sorted(path.name for path in (folder / JOBS).glob("*") if path.name not in known)
    if unknown:
        text = f"has no entry for jobs/{unknown[0]}, which was started: entries are missing; nothing was started"
        raise RecordError(f"{folder / NAME}: {text}. {WAY_OUT.format(folder)}")


def read(folder: Path) -> list[Entry]:
    """Every line of a batch's journal. Raises `RecordError` where it cannot be read, or is not what was written."""
    path = folder / NAME
    try:
        found = chain_in(
            read_foreign(path, FileKind.JOURNAL), FIRST, _parsed, what="line of a batch's journal", of_first="the file's name"
        )
    except FileNotFoundError:
        return []
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}") from error
    wrong = [(number, text) for number, text in found.wrong if CUT_OFF not in text]
    if wrong:
        number, text = wrong[0]
        raise RecordError(f"{path}: line {number} {text}; nothing was started. {WAY_OUT.format(folder)}")
    return found.entries


def _line(entry: Entry) -> bytes:
    """What does not belong to its kind is left out."""
    return line_of({name: value for name, value in asdict(entry).items() if value is not None})


def _parsed(line: bytes) -> Entry | None:
    try:
        said = build(Entry, fields_of(line))
        return said if _line(said) == line else None
    except ValueError:
        return None
