"""Recovery: any state that a crash leaves ends sealed, says what is missing, and a second time
changes nothing.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from jbclog.core.errors import RecordError
from jbclog.core.rows import TABLES
from jbclog.record.check import check
from jbclog.record.conclude import conclude
from jbclog.record.folder import create_run, keep_text
from jbclog.record.live import LiveStore
from jbclog.record.manifest import Manifest, read_manifest, write_manifest
from jbclog.record.parts import part_paths
from jbclog.record.recover import Outcome, Recovery, recover, recover_all
from jbclog.record.seal import seal_rows
from jbclog.record.store import META, Segment, segments
from support.faults.crash import contents
from support.links.small_wire import write_wire
from support.records import few_rows

JUDGED = '[recipe]\nname = "a"\n\n[acceptance]\ncoverage_percent = 99.5\n'
PLAIN = '[recipe]\nname = "a"\n'


@pytest.fixture
def abandoned(tmp_path: Path) -> Path:
    return few_rows.abandoned(tmp_path)


def test_what_was_committed_is_sealed_and_the_manifest_says_lost(abandoned: Path) -> None:
    at_risk_s = few_rows.at_risk_s(abandoned)
    done = recover(abandoned)
    manifest = read_manifest(abandoned)
    assert done.outcome is Outcome.RECOVERED
    assert few_rows.sealed_numbers(abandoned) == list(range(150))
    assert few_rows.sealed_events(abandoned) == list(range(0, 150, 7))
    assert (manifest.state, manifest.exit_status, manifest.exit_code, manifest.verdict) == (
        "sealed",
        "lost",
        4,
        "NOT JUDGED",
    )
    assert manifest.lost is not None
    assert manifest.lost.seconds_at_most == at_risk_s
    assert [facts.name for facts in manifest.stations] == ["a"]
    assert manifest.ledger["a"]["1"]["temperature_c"] == {"due": 150, "ok": 150}
    assert check(abandoned) == []
    assert sorted(path.name for path in abandoned.iterdir()) == [
        *sorted(["manifest.json", *TABLES])
    ]


def test_it_tells_samples_events_settings_counters_and_lines_of_wires_apart(
    abandoned: Path,
) -> None:
    write_wire(abandoned)
    done = recover(abandoned)
    assert done.rows == {"samples": 150, "events": 22, "settings": 1, "counters": 2, "wire": 25}
    assert (
        "recovered, 150 samples, 22 events, 1 setting, 2 counters and 25 lines of serial capture"
        " sealed; exit status lost" in done.text
    )
    assert read_manifest(abandoned).wire == "whole"


def test_a_wire_of_which_nothing_was_written_is_told_and_not_kept(abandoned: Path) -> None:
    write_wire(abandoned)
    empty = abandoned / "wire" / "b.tsv.gz"
    empty.touch()
    recover(abandoned)
    assert not empty.exists()
    assert read_manifest(abandoned).wire == "wire/b.tsv.gz: empty."
    assert check(abandoned) == []


def test_twice_changes_not_a_byte(abandoned: Path) -> None:
    recover(abandoned)
    before = contents(abandoned)
    times = {path: path.stat().st_mtime_ns for path in abandoned.rglob("*")}
    assert recover(abandoned).outcome is Outcome.WHOLE
    assert contents(abandoned) == before
    assert {path: path.stat().st_mtime_ns for path in abandoned.rglob("*")} == times


def test_recovered_is_what_would_have_been_sealed(tmp_path: Path) -> None:
    """The same rows, killed and recovered, or closed and sealed."""
    killed = few_rows.abandoned(tmp_path)
    recover(killed)
    store = few_rows.begun(tmp_path)
    store.setting(few_rows.setting(0))
    for commit in range(3):
        few_rows.hand_over(store, range(commit * 50, commit * 50 + 50))
        store.commit_now()
    store.close()
    seal_rows(store.folder)
    conclude(store.folder, Manifest(store.folder.name), store.lock)
    for table in ("samples", "settings", "counters"):
        ours, theirs = part_paths(killed, table), part_paths(store.folder, table)
        assert few_rows.table(killed, table).equals(few_rows.table(store.folder, table))
        assert len(ours) == len(theirs) == 1
    assert few_rows.sealed_events(killed) == few_rows.sealed_events(store.folder)


@pytest.mark.parametrize(
    ("recipe", "verdict"),
    [(JUDGED, "INCONCLUSIVE"), (PLAIN, "NOT JUDGED"), ("[[[ no toml", "INCONCLUSIVE")],
)
def test_missing_evidence_is_never_accepted(abandoned: Path, recipe: str, verdict: str) -> None:
    keep_text(abandoned, "recipes/a.toml", recipe)
    recover(abandoned)
    assert read_manifest(abandoned).verdict == verdict


def test_what_the_recorder_had_written_of_the_run_stays(abandoned: Path) -> None:
    write_manifest(
        abandoned,
        Manifest(abandoned.name, started="2026-11-21T01:30:00.000000Z", t0_mono=5.0, rate=10.0),
    )
    recover(abandoned)
    manifest = read_manifest(abandoned)
    assert (manifest.started, manifest.t0_mono, manifest.rate) == (
        "2026-11-21T01:30:00.000000Z",
        5.0,
        10.0,
    )
    assert manifest.ended == "2026-09-21T14:13:34.900000Z"


# -- the states that a crash can leave -------------------------------------------------------------


def test_an_empty_folder(tmp_path: Path) -> None:
    folder = create_run(tmp_path, "bench", 0.0)
    recover(folder)
    assert read_manifest(folder).exit_status == "lost"
    assert check(folder) == []


def test_a_store_that_was_only_just_made(tmp_path: Path) -> None:
    folder = create_run(tmp_path, "bench", 0.0)
    Segment.create(folder / "live.sqlite").close()
    recover(folder)
    assert few_rows.sealed_numbers(folder) == []
    assert check(folder) == []


def test_a_store_without_tables(tmp_path: Path) -> None:
    """Killed between making the file and making its tables: nothing can have been in it."""
    folder = create_run(tmp_path, "bench", 0.0)
    (folder / "live.sqlite").write_bytes(b"")
    recover(folder)
    assert read_manifest(folder).state == "sealed"


def test_a_run_that_was_closed_and_said_how_it_ended_is_not_lost(tmp_path: Path) -> None:
    folder = few_rows.closed(tmp_path, 20)
    recover(folder)
    manifest = read_manifest(folder)
    assert (manifest.exit_status, manifest.exit_code, manifest.verdict, manifest.lost) == (
        "success",
        0,
        "ACCEPT",
        None,
    )


def test_a_run_that_was_closed_without_saying_how_it_ended(tmp_path: Path) -> None:
    store = few_rows.begun(tmp_path)
    few_rows.hand_over(store, range(20))
    store.close()
    store.release()
    write_manifest(store.folder, Manifest(store.folder.name))
    recover(store.folder)
    manifest = read_manifest(store.folder)
    assert manifest.exit_status == "lost"
    assert manifest.lost is not None
    assert manifest.lost.seconds_at_most == 0.0
    assert few_rows.sealed_numbers(store.folder) == list(range(20))


def test_sealed_but_the_store_not_removed(abandoned: Path) -> None:
    store = {path: path.read_bytes() for path in abandoned.glob("live*")}
    recover(abandoned)
    sealed = contents(abandoned)
    for path, data in store.items():
        path.write_bytes(data)
    assert [finding.file for finding in check(abandoned)] == sorted(path.name for path in store)
    assert recover(abandoned).outcome is Outcome.RECOVERED
    assert contents(abandoned) == sealed


def test_parts_of_earlier_hours_stay_as_they_are(tmp_path: Path) -> None:
    store = few_rows.begun(tmp_path)
    few_rows.hand_over(store, range(100))
    store.commit_now()
    seal_rows(store.folder, part=True)
    few_rows.hand_over(store, range(100, 150))
    store.commit_now()
    few_rows.vanish(store)
    first = part_paths(store.folder, "samples")[0].read_bytes()
    recover(store.folder)
    assert part_paths(store.folder, "samples")[0].read_bytes() == first
    assert few_rows.sealed_numbers(store.folder) == list(range(150))


def test_an_unreadable_part_is_set_aside_and_sealed_again_from_the_store(abandoned: Path) -> None:
    seal_rows(abandoned)
    part = part_paths(abandoned, "samples")[0]
    part.write_bytes(part.read_bytes()[:-100])
    recover(abandoned)
    assert few_rows.sealed_numbers(abandoned) == list(range(150))
    assert (abandoned / "damaged" / "samples-part-0000.parquet").exists()
    lost = read_manifest(abandoned).lost
    assert lost is not None
    assert "samples/part-0000.parquet" in lost.text
    assert check(abandoned) == []


# -- who is left alone -----------------------------------------------------------------------------


def test_a_run_that_is_being_recorded_is_left_alone(tmp_path: Path) -> None:
    store = few_rows.begun(tmp_path)
    few_rows.hand_over(store, range(10))
    store.commit_now()
    with pytest.raises(RecordError, match=f"is being written by process {os.getpid()}"):
        recover(store.folder, 0.0)
    few_rows.hand_over(store, range(10, 20))
    store.commit_now()
    store.close()
    store.release()
    recover(store.folder)
    assert few_rows.sealed_numbers(store.folder) == list(range(20))


def test_a_store_of_a_newer_jbclog_is_left_alone(abandoned: Path) -> None:
    segment = Segment.open(abandoned / "live.sqlite")
    segment.add([], {(META, "schema"): "2"})
    segment.close()
    before = contents(abandoned)
    with pytest.raises(RecordError, match="this jbclog knows 1"):
        recover(abandoned)
    assert contents(abandoned).items() >= before.items() - {
        ("live.lock", before.get("live.lock", ""))
    }


def test_a_manifest_of_a_newer_jbclog_is_left_alone(abandoned: Path) -> None:
    (abandoned / "manifest.json").write_text(json.dumps({"run": abandoned.name, "schema": 2}))
    before = contents(abandoned)
    with pytest.raises(RecordError, match="this jbclog knows 1"):
        recover(abandoned)
    assert contents(abandoned) == before


def test_a_folder_that_is_no_run_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "letters").mkdir()
    with pytest.raises(RecordError, match="not a run"):
        recover(tmp_path / "letters")
    assert list((tmp_path / "letters").iterdir()) == []


def test_many_runs_at_once(tmp_path: Path) -> None:
    alive = few_rows.begun(tmp_path)
    crashed, whole = few_rows.abandoned(tmp_path), few_rows.abandoned(tmp_path)
    recover(whole)
    (tmp_path / "notes").mkdir()
    (tmp_path / "a-file").write_text("")
    found = {done.folder: done.outcome for done in recover_all(tmp_path, 0.0)}
    assert found == {
        alive.folder: Outcome.REFUSED,
        crashed: Outcome.RECOVERED,
        whole: Outcome.WHOLE,
    }
    alive.close()
    alive.release()
    assert [done.outcome for done in recover_all(alive.folder)] == [Outcome.RECOVERED]


def test_a_folder_that_may_not_be_entered_stops_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    crashed, closed = few_rows.abandoned(tmp_path), tmp_path / "20260101T000000Z-bench-abcd"
    for folder in (closed, tmp_path / "lost+found"):
        folder.mkdir()
    exists = Path.exists

    def refused(path: Path) -> bool:
        if path.parent.name in (closed.name, "lost+found"):
            raise PermissionError(errno.EACCES, "Permission denied")
        return exists(path)

    monkeypatch.setattr(Path, "exists", refused)
    found = {done.folder: done for done in recover_all(tmp_path, 0.0)}
    assert found.pop(crashed).outcome is Outcome.RECOVERED
    text = f"{closed} cannot be recovered: Permission denied"
    assert found == {closed: Recovery(closed, Outcome.REFUSED, text)}


# -- damage ----------------------------------------------------------------------------------------


def altered(folder: Path, sql: str, *values: object) -> None:
    connection = sqlite3.connect(folder / "live.sqlite")
    connection.execute(sql, values)
    connection.commit()
    connection.close()


def test_a_damaged_batch_is_left_out_counted_and_named(abandoned: Path) -> None:
    altered(
        abandoned,
        "UPDATE batch SET data = zeroblob(9) WHERE number = (SELECT min(number) FROM batch WHERE"
        " name = 'samples')",
    )
    recover(abandoned)
    lost = read_manifest(abandoned).lost
    assert few_rows.sealed_numbers(abandoned) == list(range(50, 150))
    assert lost is not None
    assert "(samples), 50 rows: its check sum does not match" in lost.text
    assert lost.seconds_at_most is None
    assert (abandoned / "damaged" / "live.sqlite").exists()
    assert check(abandoned) == []
    before = contents(abandoned)
    recover(abandoned)
    assert contents(abandoned) == before


@pytest.mark.parametrize("which", ["min", "max"])
def test_a_batch_that_vanished_is_missed(abandoned: Path, which: str) -> None:
    altered(
        abandoned,
        f"DELETE FROM batch WHERE number = (SELECT {which}(number) FROM batch WHERE name ="
        " 'samples')",
    )
    recover(abandoned)
    lost = read_manifest(abandoned).lost
    assert lost is not None
    assert "missing from the live store" in lost.text
    assert len(few_rows.sealed_numbers(abandoned)) == 100


def test_a_batch_of_no_table_is_said(abandoned: Path) -> None:
    altered(
        abandoned,
        "UPDATE batch SET name = 'simples' WHERE number = (SELECT max(number) FROM batch WHERE name"
        " = 'samples')",
    )
    recover(abandoned)
    lost = read_manifest(abandoned).lost
    assert lost is not None
    assert "belongs to no table" in lost.text


def test_a_store_that_is_none_any_more(abandoned: Path) -> None:
    for path in segments(abandoned):
        path.write_bytes(b"SQLite format 3\0" + os.urandom(8000))
    (abandoned / "live.sqlite-wal").unlink()
    recover(abandoned)
    manifest = read_manifest(abandoned)
    assert manifest.lost is not None
    assert "cannot be read at all" in manifest.lost.text
    assert (abandoned / "damaged" / "live.sqlite").exists()
    assert few_rows.sealed_numbers(abandoned) == []


def test_facts_that_rotted_do_not_stop_it(abandoned: Path) -> None:
    altered(abandoned, "UPDATE note SET text = replace(text, 'T210', 'T211') WHERE kind = 'facts'")
    recover(abandoned)
    assert read_manifest(abandoned).stations == []


def flip(data: bytes) -> bytes:
    return data[:-30] + bytes([data[-30] ^ 1]) + data[-29:]  # in the last page of the last commit


@pytest.mark.parametrize(
    "alter",
    [flip, lambda data: data[:-30], lambda data: data[:-4000] + bytes(4000)],
    ids=["bit", "cut", "zeros"],
)
def test_an_end_of_the_log_that_is_gone_is_known_and_bounded(
    tmp_path: Path, alter: Callable[[bytes], bytes]
) -> None:
    """SQLite takes it for never written; the recorder had said that it was committed."""
    folder = few_rows.abandoned(tmp_path, commits=5, rows=2)
    log = folder / "live.sqlite-wal"
    log.write_bytes(alter(log.read_bytes()))
    at_risk_s = few_rows.at_risk_s(folder)
    recover(folder)
    manifest = read_manifest(folder)
    assert manifest.lost is not None
    assert manifest.lost.seconds_at_most == at_risk_s + 1.0
    assert "acknowledged, and missing" not in manifest.lost.text
    assert few_rows.sealed_numbers(folder) == list(range(8))
    assert check(folder) == []


def test_two_segments_with_the_same_batches_count_once(tmp_path: Path) -> None:
    """A commit that failed may be there all the same, and was stored again in the next file."""
    folder = few_rows.abandoned(tmp_path)
    for end in ("", "-wal"):
        shutil.copy(folder / f"live.sqlite{end}", folder / f"live-1.sqlite{end}")
    altered(folder, "UPDATE batch SET data = zeroblob(9) WHERE number = 2")
    recover(folder)
    assert few_rows.sealed_numbers(folder) == list(range(150))
    assert read_manifest(folder).lost is not None


def test_a_store_held_by_a_process_that_did_not_start(tmp_path: Path) -> None:
    """A recorder whose store could not be made leaves nothing that recovery cannot take."""
    folder = create_run(tmp_path, "bench", 0.0)
    (folder / "live.sqlite").mkdir()
    store = LiveStore(folder)
    with pytest.raises(RecordError):
        store.start()
    (folder / "live.sqlite").rmdir()
    recover(folder)
    assert read_manifest(folder).state == "sealed"
