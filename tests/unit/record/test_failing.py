"""What a disk that fails for a moment, or permanently, leaves in a record: losses by their number,
and nothing taken for damage.

The campaign that found these is `tests/faults/test_failing_disk.py`; here each stands by itself.
"""

from __future__ import annotations

import errno
import json
from pathlib import Path

import pytest

from jbclog.core.errors import RecordError
from jbclog.record.check import check
from jbclog.record.conclude import conclude
from jbclog.record.manifest import Manifest, read_manifest
from jbclog.record.recover import recover
from jbclog.record.run_journal import RunJournal
from jbclog.record.segments import Disk
from support.product import seal
from support.records import few_rows
from support.records.few_rows import begun, hand_over
from support.records.journal_rows import read_journal


def fill_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    def write(disk: Disk, file: int, data: memoryview) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Disk, "write", write)


def half_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunJournal:
    """70 rows that are safe, then 50 that the disk does not take any more, and their events."""
    store = begun(tmp_path)
    hand_over(store, range(70))
    store.commit_now()
    with monkeypatch.context() as patch:
        fill_disk(patch)
        hand_over(store, range(70, 120))
        with pytest.raises(RecordError):
            store.commit_now()
        store.close()
    return store


def test_rows_that_the_disk_did_not_take_to_the_end_are_counted_in_the_manifest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = half_kept(tmp_path, monkeypatch)
    unkept = store.unkept_rows
    assert unkept >= 50
    seal(store.folder)
    conclude(
        store.folder, Manifest(store.folder.name, exit_status="failed", exit_code=4), store.lock
    )
    assert few_rows.sealed_numbers(store.folder) == list(range(70))
    lost = read_manifest(store.folder).lost
    assert lost is not None
    assert lost.text == f"{unkept} rows could not be stored while the disk refused them"


def test_and_when_it_is_recovered_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = half_kept(tmp_path, monkeypatch)
    store.release()
    recover(store.folder)
    lost = read_manifest(store.folder).lost
    assert lost is not None
    assert lost.seconds_at_most is None
    assert f"{store.unkept_rows} rows could not be stored" in lost.text


def test_what_was_at_risk_is_what_the_guard_saw(tmp_path: Path) -> None:
    """A disk or a machine that kept the last commit waiting: the guard saw the recorder end."""
    folder = few_rows.abandoned(tmp_path)
    event = {
        "time": read_journal(folder).marked_us + 3_410_000,
        "kind": "guard.took_over",
        "severity": "error",
        "text": "x",
        "station": None,
        "port": None,
    }
    (folder / "guard.jsonl").write_text(json.dumps(event) + "\n")
    recover(folder)
    lost = read_manifest(folder).lost
    assert lost is not None
    assert lost.seconds_at_most == 3.5


def test_a_commit_that_waited_long_before_is_reckoned_with(tmp_path: Path) -> None:
    store = begun(tmp_path)
    with store._committing:
        store._safe_until -= 12.0
    hand_over(store, range(10))
    store.commit_now()
    hand_over(store, range(10, 20))
    store.commit_now()
    few_rows.vanish(store)
    recover(store.folder)
    lost = read_manifest(store.folder).lost
    assert lost is not None
    assert lost.seconds_at_most is not None
    assert lost.seconds_at_most >= 12.0


def test_what_a_kill_left_aside_at_the_start_is_removed(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    (folder / "recipes").mkdir()
    for name in (
        "probe",
        ".probe.tmp",
        ".line.toml.tmp",
        ".manifest.json.tmp",
        "lease.json.new",
        "recipes/.job.toml.tmp",
    ):
        (folder / name).write_text("half")
    recover(folder)
    assert check(folder) == []
    assert [
        path.name for path in folder.rglob("*") if path.name.endswith((".tmp", ".new", "probe"))
    ] == []
