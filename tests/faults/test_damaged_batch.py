"""The files of a batch with altered bytes: either the entries of its journal are those that were
written, or the first of them; or it is refused, and nothing starts.
"""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from jbclog.app.batch.job_dir import (
    EVENTS,
    PROGRESS,
    RESULT,
    RUN,
    JobDir,
    JobProgress,
    JobResult,
)
from jbclog.app.batch.journal import NAME, begin, entries_in, newest
from jbclog.app.batch.state import Entry, EntryKind
from jbclog.core.errors import RecordError
from jbclog.core.rows import EventRow, Severity
from support.faults.altered_files import cut, zeros

NIGHT = 1_790_000_000.0
JOB = Entry("", EntryKind.JOB, "", "a")
ENTRIES = [
    Entry("", EntryKind.BEGIN, ""),
    *(Entry("", EntryKind.JOB, "", f"job-{number}") for number in range(20)),
    Entry("", EntryKind.EXECUTION, "Batch started."),
    Entry("", EntryKind.START, "a is started.", "a", 1),
    Entry("", EntryKind.END, "", "a", 1, "done", False, 0, "ACCEPT", "run-1"),
]
KINDS = [entry.kind for entry in ENTRIES]
EVENT = EventRow(1, "unit.next", Severity.INFO, "next", raw="S7")
Alteration = Callable[[bytearray, int], None]


def flip(data: bytearray, place: int) -> None:
    data[place] ^= 1 << place % 8


@pytest.fixture(scope="module")
def batch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("batches")
    journal = begin(home, "", lambda: NIGHT)
    job = JobDir(journal.folder / "jobs" / "a-1")
    for entry in ENTRIES:
        journal.note(entry)
    os.close(job.make(b"{}"))
    job.set_run(home / "run-1")
    job.set_progress(JobProgress(passed_s=2.0))
    job.add_event(EVENT)
    job.set_result(JobResult(0, "ACCEPT"))
    return home


def outcome(home: Path) -> str:
    """Return the state of the damaged batch: "whole", "cut" or "refused"."""
    try:
        journal = newest(home, lambda: NIGHT)
    except RecordError as error:
        return "refused" if "nothing was started" in str(error) else str(error)
    if journal is None:
        return "cut"
    kinds = [entry.kind for entry in entries_in(journal.folder)]
    job = JobDir(journal.folder / "jobs" / "a-1")
    for read in (job.progress, job.result, job.run, job.each_event):
        read()
    assert kinds == KINDS[: len(kinds)]
    return "whole" if kinds == KINDS else "cut"


def tried(batch: Path, name: str, alteration: Alteration, step: int) -> Counter[str]:
    found = Counter[str]()
    file = next(batch.rglob(name))
    whole = file.read_bytes()
    trial = batch.with_name("trial")
    for place in range(step // 2, len(whole), step):
        shutil.rmtree(trial, ignore_errors=True)
        shutil.copytree(batch, trial)
        data = bytearray(whole)
        alteration(data, place)
        (trial / file.relative_to(batch)).write_bytes(data)
        found[outcome(trial)] += 1
    return found


OF_JOB = (RUN, PROGRESS, EVENTS, RESULT)


@pytest.mark.parametrize("alteration", [flip, zeros, cut])
def test_some_places_of_the_journal(batch: Path, alteration: Alteration) -> None:
    found = tried(batch, NAME, alteration, 97)
    assert found["refused"] + found["cut"] > 5
    assert set(found) <= {"whole", "cut", "refused"}


@pytest.mark.parametrize("alteration", [flip, zeros, cut])
@pytest.mark.parametrize("name", OF_JOB)
def test_any_place_of_what_a_job_writes(batch: Path, name: str, alteration: Alteration) -> None:
    assert {*tried(batch, name, alteration, 2)} == {"whole"}


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("alteration", [flip, zeros, cut])
def test_every_seventh_byte(
    batch: Path, alteration: Alteration, counted: Callable[..., None]
) -> None:
    found = tried(batch, NAME, alteration, 7)
    assert set(found) <= {"whole", "cut", "refused"}
    counted(**found)
