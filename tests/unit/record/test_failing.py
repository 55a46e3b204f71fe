"""What a disk that fails for a moment, or for good, leaves in a record: losses by their number, and
nothing taken for damage.

The campaign that found these is `tests/faults/test_failing_disk.py`; here each stands by itself.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from jbclog.core.errors import RecordError
from jbclog.core.locks import CommitStatus, FolderLock, commit_status
from jbclog.record.batches import Batch
from jbclog.record.check import check
from jbclog.record.conclude import conclude
from jbclog.record.live import LiveStore
from jbclog.record.manifest import Manifest, read_manifest
from jbclog.record.recover import recover
from jbclog.record.seal import seal_rows
from jbclog.record.store import RESERVE, RESERVE_BYTES, Notes, Segment
from support.records import few_rows
from support.records.few_rows import begun, hand_over


def failed(code: int) -> sqlite3.OperationalError:
    error = sqlite3.OperationalError("made up")
    error.sqlite_errorcode = code
    return error


def full(monkeypatch: pytest.MonkeyPatch, *, while_true: Callable[[], bool] = lambda: True) -> None:
    """Commits find no room while that is true."""
    real = Segment.add

    def add(self: Segment, batches: Sequence[Batch], notes: Notes) -> None:
        if while_true():
            raise failed(sqlite3.SQLITE_FULL)
        real(self, batches, notes)

    monkeypatch.setattr(Segment, "add", add)


def half_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> LiveStore:
    """70 rows that are safe, then 50 that the disk does not take any more, and their events."""
    store = begun(tmp_path)
    hand_over(store, range(70))
    store.commit_now()
    with monkeypatch.context() as patch:
        full(patch)
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
    seal_rows(store.folder)
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


def test_the_last_rows_get_room_from_the_reserve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = begun(tmp_path)
    reserve = store.folder / RESERVE
    full(monkeypatch, while_true=lambda: reserve.stat().st_size > RESERVE_BYTES // 4)
    hand_over(store, range(10))
    store.close()
    assert store.unkept_rows == 0
    store.release()
    recover(store.folder)
    assert few_rows.sealed_numbers(store.folder) == list(range(10))


def test_a_reserve_that_cannot_be_removed_does_not_break_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = begun(tmp_path)
    hand_over(store, range(10))
    real = Path.unlink

    def unlink(path: Path, missing_ok: bool = False) -> None:
        if path.name == RESERVE:
            raise OSError(5, "Input/output error")
        real(path, missing_ok=missing_ok)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", unlink)
        store.close()
    store.release()
    recover(store.folder)
    assert few_rows.sealed_numbers(store.folder) == list(range(10))
    assert check(store.folder) == []


@pytest.mark.parametrize(
    "code",
    [
        sqlite3.SQLITE_CANTOPEN,
        sqlite3.SQLITE_FULL,
        sqlite3.SQLITE_IOERR_SHMSIZE,
        sqlite3.SQLITE_NOMEM,
    ],
)
def test_a_store_that_cannot_be_read_just_now_is_not_a_damaged_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    """It was: its rows were left out, it was set aside, and the manifest said that they were
    lost.
    """
    folder = few_rows.abandoned(tmp_path)

    def fails(self: Segment) -> bool:
        raise failed(code)

    with monkeypatch.context() as patch:
        patch.setattr(Segment, "is_begun", fails)
        with pytest.raises(RecordError, match="cannot be read now: made up; nothing was changed"):
            recover(folder)
    at_risk_s = few_rows.at_risk_s(folder)
    recover(folder)
    assert few_rows.sealed_numbers(folder) == list(range(150))
    lost = read_manifest(folder).lost
    assert lost is not None
    assert lost.seconds_at_most == at_risk_s


def test_places_that_cannot_be_read_any_more_are_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = few_rows.abandoned(tmp_path)
    real = Segment.get

    def fails(self: Segment, number: int) -> object:
        if number == 4:
            raise failed(sqlite3.SQLITE_IOERR_READ)
        return real(self, number)

    with monkeypatch.context() as patch:
        patch.setattr(Segment, "get", fails)
        recover(folder)
    lost = read_manifest(folder).lost
    assert lost is not None
    assert "batch 4" in lost.text


def test_what_was_at_risk_is_told_as_it_was(tmp_path: Path) -> None:
    """A disk or a machine that kept the last commit waiting: the guard saw the recorder end."""
    folder = few_rows.abandoned(tmp_path)
    said = commit_status(folder)
    assert said.since is not None
    lock = FolderLock.take(folder)
    lock.write_status(CommitStatus(said.last, 1_790_000_000.0, 1.26))
    lock.release()
    told = {
        "time": 1_790_000_003_410_000,
        "kind": "guard.took_over",
        "severity": "error",
        "text": "x",
        "station": None,
        "port": None,
    }
    (folder / "guard.jsonl").write_text(json.dumps({**told, "port": None}) + "\n")
    recover(folder)
    lost = read_manifest(folder).lost
    assert lost is not None
    assert lost.seconds_at_most == 3.5


def test_a_commit_that_waited_long_before_is_reckoned_with(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    lock = FolderLock.take(folder)
    lock.write_status(CommitStatus(commit_status(folder).last, 1_790_000_000.0, 1.26))
    lock.release()
    recover(folder)
    lost = read_manifest(folder).lost
    assert lost is not None
    assert lost.seconds_at_most == 1.3


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
