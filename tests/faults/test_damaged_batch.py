"""The store of a batch with altered bytes, anywhere in its pages or its log: either the entries of
its journal are those that were written, or the first of them; or it is refused, and nothing starts.
"""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from jbclog.app.batch.job_dir import JobDir, JobProgress, JobResult
from jbclog.app.batch.journal import begin, entries_in, newest
from jbclog.app.batch.state import Entry, EntryKind
from jbclog.app.batch.store import NAME
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
def batches(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """By the file that holds it: a batch in the log, and one in the pages."""
    home = tmp_path_factory.mktemp("batches")
    journal = begin(home, "", lambda: NIGHT)
    job = JobDir(journal.folder / "jobs" / "a-1", journal.store)
    for entry in ENTRIES:
        journal.note(entry)
    os.close(job.make(b"{}"))
    job.set_progress(JobProgress(passed_s=2.0))
    job.add_event(EVENT)
    job.set_result(JobResult(0, "ACCEPT"))
    in_log = shutil.copytree(home, home.with_name("in-log"))
    journal.store.close()
    return {f"{NAME}-wal": in_log, NAME: home}


def outcome(home: Path) -> str:
    """Return the state of the damaged batch: "whole", "cut" or "refused"."""
    try:
        journal = newest(home, lambda: NIGHT)
    except RecordError as error:
        return "refused" if "nothing was started" in str(error) else str(error)
    if journal is None:
        return "cut"
    kinds = [entry.kind for entry in entries_in(journal.store)]
    job = JobDir(journal.folder / "jobs" / "a-1", journal.store)
    for read in (job.progress, job.result, job.ended_at, job.run, job.each_event):
        read()
    journal.store.close()
    assert kinds == KINDS[: len(kinds)]
    return "whole" if kinds == KINDS else "cut"


def tried(batches: dict[str, Path], name: str, alteration: Alteration, step: int) -> Counter[str]:
    before, found = batches[name], Counter[str]()
    file = next(before.rglob(name))
    whole = file.read_bytes()
    trial = before.with_name("trial")
    for place in range(step // 2, len(whole), step):
        shutil.rmtree(trial, ignore_errors=True)
        shutil.copytree(before, trial)
        data = bytearray(whole)
        alteration(data, place)
        (trial / file.relative_to(before)).write_bytes(data)
        found[outcome(trial)] += 1
    return found


@pytest.mark.parametrize("alteration", [flip, zeros, cut])
@pytest.mark.parametrize("name", [NAME, f"{NAME}-wal"])
def test_some_places(batches: dict[str, Path], name: str, alteration: Alteration) -> None:
    found = tried(batches, name, alteration, 997)
    assert found["refused"] + found["cut"] > 5
    assert set(found) <= {"whole", "cut", "refused"}


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("alteration", [flip, zeros, cut])
@pytest.mark.parametrize("name", [NAME, f"{NAME}-wal"])
def test_every_seventh_byte(
    batches: dict[str, Path], name: str, alteration: Alteration, counted: Callable[..., None]
) -> None:
    found = tried(batches, name, alteration, 7)
    assert set(found) <= {"whole", "cut", "refused"}
    counted(**{f"{name.partition('-')[2] or 'pages'}_{what}": n for what, n in found.items()})
