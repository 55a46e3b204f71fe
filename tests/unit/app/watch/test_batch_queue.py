"""The queue of a batch as whoever watches sees it: only while the batch runs, and without touching
it.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from jbclog.app.batch.job_dir import JobDir, JobProgress
from jbclog.app.batch.journal import NAME, Journal, begin
from jbclog.app.batch.single_batch import LOCK
from jbclog.app.batch.state import Entry, EntryKind
from jbclog.app.watch import batch_queue
from jbclog.app.watch.batch_queue import BatchQueue, QueuedJob, QueueFollower
from jbclog.app.watch.words import queue_lines
from jbclog.core.locks import is_locked

UTC_S = 1_790_000_000.0


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    """A batch of three jobs that is held as `jbclog batch` holds it: one has ended, one runs, one
    waits.
    """
    home = tmp_path / "night.batch"
    home.mkdir()
    held = os.open(home / LOCK, os.O_RDWR | os.O_CREAT)
    fcntl.flock(held, fcntl.LOCK_EX)
    made = begin(home, "", lambda: UTC_S)
    made.note(Entry("", EntryKind.BEGIN, "A batch of 3 jobs."))
    for name, asked in (("one", {}), ("two", {"duration": "3m"}), ("three", {"after": ["two"]})):
        made.note(Entry("", EntryKind.JOB, "", name, asked=json.dumps(asked), on_failure="skip"))
    made.note(Entry("", EntryKind.EXECUTION, ""))
    made.note(Entry("", EntryKind.START, "", "one", 1))
    made.note(
        Entry("", EntryKind.END, "ACCEPT", "one", 1, state="done", exit_code=0, verdict="ACCEPT")
    )
    made.note(Entry("", EntryKind.START, "", "two", 1))
    two = JobDir(made.folder / "jobs" / "two-1")
    os.close(two.make(b"{}"))
    two.set_progress(JobProgress(42.0, "recording", alarms=1, away=["dde-2"]))
    yield made
    os.close(held)


def test_the_jobs_of_a_batch_that_runs(journal: Journal, tmp_path: Path) -> None:
    (queue,) = QueueFollower(tmp_path).poll()
    assert queue.text == "batch night: 1 of 3 jobs have ended"
    assert queue.jobs == (
        QueuedJob("one", "done", "ACCEPT"),
        QueuedJob("two", "running", "recording, 42 s of 180 s · 1 alarms · disconnected: dde-2"),
        QueuedJob("three", "waiting", "after two"),
    )
    assert queue_lines((queue,))[1:] == [
        "one    done     ACCEPT",
        "two    running  recording, 42 s of 180 s · 1 alarms · disconnected: dde-2",
        "three  waiting  after two",
    ]


def test_a_batch_that_nobody_carries_out_is_not_shown(journal: Journal, tmp_path: Path) -> None:
    (journal.folder.parent / LOCK).unlink()
    assert QueueFollower(tmp_path).poll() == ()
    (journal.folder.parent / LOCK).touch()
    assert QueueFollower(tmp_path).poll() == ()
    assert QueueFollower(tmp_path / "none").poll() == ()


def test_a_batch_whose_lock_is_no_file_is_carried_out_by_nobody(
    journal: Journal, tmp_path: Path
) -> None:
    (tmp_path / "bad.batch").mkdir()
    os.mkfifo(tmp_path / "bad.batch" / LOCK)
    assert [queue.text for queue in QueueFollower(tmp_path).poll()] == [
        "batch night: 1 of 3 jobs have ended"
    ]


def test_a_batch_whose_lock_may_not_be_read_hides_no_other(
    journal: Journal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bad.batch").mkdir()

    def locked(path: Path) -> bool:
        if path.parent.name == "bad.batch":
            raise PermissionError(errno.EACCES, "Permission denied")
        return is_locked(path)

    monkeypatch.setattr(batch_queue, "is_locked", locked)
    assert [queue.text for queue in QueueFollower(tmp_path).poll()] == [
        "batch bad: its queue cannot be read now: Permission denied",
        "batch night: 1 of 3 jobs have ended",
    ]


def test_a_batch_that_was_stopped_says_so(journal: Journal, tmp_path: Path) -> None:
    journal.note(Entry("", EntryKind.SIGNAL, "Ctrl-C"))
    assert (
        QueueFollower(tmp_path).poll()[0].text
        == "batch night: 1 of 3 jobs have ended; no more jobs start: Ctrl-C"
    )


def test_reading_leaves_the_batch_as_it_is(journal: Journal, tmp_path: Path) -> None:
    before = {
        path: (path.stat().st_mtime_ns, path.stat().st_size) for path in journal.folder.iterdir()
    }
    QueueFollower(tmp_path).poll()
    assert {
        path: (path.stat().st_mtime_ns, path.stat().st_size) for path in journal.folder.iterdir()
    } == before


def test_a_journal_that_is_none_is_named(journal: Journal, tmp_path: Path) -> None:
    other = journal.folder.with_name("20991121T210000Z")
    other.mkdir()
    (other / NAME).write_bytes(b"no journal\n" * 1000)
    (queue,) = QueueFollower(tmp_path).poll()
    assert queue.text.startswith("batch night: its queue cannot be read now: ")
    assert queue == BatchQueue(queue.text)
