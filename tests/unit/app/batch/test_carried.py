"""The serial that one job leaves to the next one at the same reader."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from jbclog.app.batch.job_dir import (
    EVENTS,
    RESULT,
    JobDir,
    JobResult,
    PrefixedSource,
    unread_serial,
)
from jbclog.app.run.unit_feed import UnitFeed
from jbclog.core.rows import EventRow, Severity
from jbclog.transport.typed_lines import open_source


def papers(folder: Path, name: str, *kinds: str, ended: float | None = None) -> JobDir:
    made = JobDir(folder / "batch" / "jobs" / name)
    os.close(made.make(b"{}"))
    for number, kind in enumerate(kinds):
        made.add_event(EventRow(number, kind, Severity.INFO, "", raw=f"S{number}"))
    if ended is not None:
        (made.folder / RESULT).write_text(json.dumps({"exit_code": 0, "stop": ended}))
    return made


def test_the_last_job_leaves_the_serial_that_ended_it(tmp_path: Path) -> None:
    first = papers(tmp_path, "a-1", "unit.begin", "unit.end", "unit.next", "run.end", ended=100.0)
    assert unread_serial([first]) == "S2"
    # which had it, and left none
    second = papers(tmp_path, "b-1", "unit.begin", "unit.end", ended=200.0)
    assert unread_serial([first, second]) is None
    still = papers(tmp_path, "c-1", "unit.next")
    assert unread_serial([first, still]) == "S2"
    assert unread_serial([]) is None


def test_it_is_the_first_that_the_next_one_reads(tmp_path: Path) -> None:
    pipe = tmp_path / "reader"
    os.mkfifo(pipe)
    source = PrefixedSource(open_source(str(pipe)), "S41")
    events: list[EventRow] = []
    feed = UnitFeed(source, events.append, lambda: 0)
    feed.look()
    assert feed.unit == "S41"
    pipe.write_bytes(b"S42\n")
    feed.look()
    feed.finish()
    assert [(event.kind, event.raw) for event in events] == [
        ("unit.begin", "S41"),
        ("unit.end", "S41"),
        ("unit.begin", "S42"),
        ("unit.end", "S42"),
    ]


def test_a_serial_that_was_left_is_on_disk_before_the_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a power cut the next job would else miss it."""
    job, really, synced = papers(tmp_path, "a-1", "unit.next"), os.fsync, list[str]()

    def noted(descriptor: int) -> None:
        synced.append(Path(f"/proc/self/fd/{descriptor}").readlink().name)
        really(descriptor)

    monkeypatch.setattr(os, "fsync", noted)
    job.set_result(JobResult(0))
    assert synced[:2] == [EVENTS, f".{RESULT}.tmp"]
