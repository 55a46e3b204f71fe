"""What belongs to a run and is taken away, or spoilt, while nobody looks."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from jbclog.core.errors import RecordError
from jbclog.core.rows import EventRow, Severity
from jbclog.record.check import check
from jbclog.record.conclude import conclude
from jbclog.record.folder import create_run
from jbclog.record.journal_reader import Journal
from jbclog.record.manifest import Manifest, read_manifest, write_manifest
from jbclog.record.recover import recover
from jbclog.record.run_journal import RunJournal
from jbclog.record.seal_child import seal_in_child

EVENT = EventRow(1_790_000_000_000_000, "run.start", Severity.INFO, "It begins.")


def test_a_folder_that_is_removed_during_the_run_is_found_missing_at_the_next_commit(
    tmp_path: Path,
) -> None:
    folder, told = create_run(tmp_path, "bench", 1.79e9), list[RecordError]()
    store = RunJournal(folder, told.append)
    store.start()
    store.commit_now()
    shutil.rmtree(folder)
    store.event(EVENT)
    with pytest.raises(RecordError):
        store.commit_now()
    store.close()
    with pytest.raises(RecordError, match="was removed during the run"):
        seal_in_child(folder, store.lock)
    store.release()
    assert "was removed during the run" in str(told[0])


def test_a_spoilt_manifest_is_written_anew_from_the_live_store(tmp_path: Path) -> None:
    folder = create_run(tmp_path, "bench", 1.79e9)
    write_manifest(folder, Manifest(run=folder.name))
    store = RunJournal(folder)
    store.start()
    store.event(EVENT)
    store.close()
    store.release()
    (folder / "manifest.json").write_text('{"run":')
    assert "cannot be read; rewritten" in recover(folder).text
    assert read_manifest(folder).state == "sealed"
    assert check(folder) == []


@pytest.mark.parametrize("what", ["a link", "another folder"])
def test_what_is_put_in_the_folder_s_place_is_never_written_to(tmp_path: Path, what: str) -> None:
    folder, told = create_run(tmp_path, "bench", 1.79e9), list[RecordError]()
    write_manifest(folder, Manifest(run=folder.name))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    store = RunJournal(folder, told.append)
    store.start()
    store.event(EVENT)
    store.commit_now()
    moved = folder.rename(tmp_path / "20260921T141320Z-bench-aaaa")
    folder.symlink_to(elsewhere) if what == "a link" else folder.mkdir()
    for name in ("live-0000.journal", "live.lock"):
        (folder / name).touch()  # as if it were ours
    store.event(EVENT)
    store.close()
    with pytest.raises(RecordError, match="was replaced during the run"):
        seal_in_child(folder, store.lock)
    with pytest.raises(RecordError, match="was replaced during the run"):
        conclude(folder, Manifest(run=folder.name), store.lock)
    store.release()
    assert told
    assert sorted(path.name for path in folder.iterdir()) == ["live-0000.journal", "live.lock"]
    assert all(path.stat().st_size == 0 for path in folder.iterdir())
    assert "1 event," in recover(moved).text


def test_the_journal_of_a_folder_that_is_gone_is_not_waited_for(tmp_path: Path) -> None:
    """Its recorder may still hold the lock of a file in it, by which other commands find it."""
    with pytest.raises(RecordError, match="was removed"):
        Journal(tmp_path / "gone")
