"""Recovery: any state that a crash leaves ends sealed, says what is missing, and a second time
changes nothing.
"""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import pytest

from jbclog.core.errors import RecordError
from jbclog.core.rows import TABLES
from jbclog.record.check import check
from jbclog.record.conclude import conclude
from jbclog.record.damage import read_damage
from jbclog.record.folder import create_run, keep_text
from jbclog.record.frames import Frame, FrameKind, commit_bytes
from jbclog.record.manifest import Manifest, read_manifest, write_manifest
from jbclog.record.parts import part_paths
from jbclog.record.recover import Outcome, Recovery, recover, recover_all
from jbclog.record.run_journal import RunJournal
from jbclog.record.seal import seal_journal
from jbclog.record.segments import segment_name
from support.faults.crash import contents
from support.links.small_wire import write_wire
from support.product import lose_commit, seal_part
from support.records import few_rows
from support.records.journals import journal

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


def test_it_tells_samples_events_settings_counters_and_rows_of_the_capture_apart(
    abandoned: Path,
) -> None:
    write_wire(abandoned)
    done = recover(abandoned)
    assert done.rows == {"samples": 150, "events": 22, "settings": 1, "counters": 2, "wire": 22}
    assert (
        "recovered, 150 samples, 22 events, 1 setting, 2 counters and 22 rows of serial capture"
        " sealed; exit status lost" in done.text
    )
    assert read_manifest(abandoned).wire == "whole"


def test_a_capture_that_was_not_begun_is_told(abandoned: Path) -> None:
    write_manifest(abandoned, Manifest(run=abandoned.name, wire="open"))
    recover(abandoned)
    assert read_manifest(abandoned).wire == "The recorder ended before the capture began."
    assert check(abandoned) == []


def test_a_capture_without_its_end_is_told(abandoned: Path) -> None:
    write_wire(abandoned)
    (segment,) = abandoned.glob("wire-*.journal")
    segment.write_bytes(segment.read_bytes()[:-1])
    recover(abandoned)
    told = read_manifest(abandoned).wire or ""
    assert "the session of dde-1 has no end" in told
    assert "At most the last 1 s are missing" in told
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
    seal_journal(store.folder)
    conclude(store.folder, Manifest(store.folder.name), store.lock)
    for table in ("samples", "settings", "counters"):
        ours, theirs = part_paths(killed, table), part_paths(store.folder, table)
        rows = [few_rows.table(folder, table) for folder in (killed, store.folder)]
        mine, other = (one.drop_columns(["run"]) for one in rows)
        assert mine.equals(other)
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
        Manifest(abandoned.name, start="2026-11-21T01:30:00.000000Z", t0_mono=5.0, rate=10.0),
    )
    recover(abandoned)
    manifest = read_manifest(abandoned)
    assert (manifest.start, manifest.t0_mono, manifest.rate) == (
        "2026-11-21T01:30:00.000000Z",
        5.0,
        10.0,
    )
    assert manifest.stop == "2026-09-21T14:13:34.900000Z"


# -- the states that a crash can leave -------------------------------------------------------------


def test_an_empty_folder(tmp_path: Path) -> None:
    folder = create_run(tmp_path, "bench", 0.0)
    recover(folder)
    assert read_manifest(folder).exit_status == "lost"
    assert check(folder) == []


def test_a_journal_that_was_only_just_begun(tmp_path: Path) -> None:
    folder = journal(tmp_path, [[]]).folder
    recover(folder)
    assert few_rows.sealed_numbers(folder) == []
    assert check(folder) == []


def test_a_segment_of_which_nothing_was_written(tmp_path: Path) -> None:
    """Killed between making the file and its first commit."""
    folder = few_rows.abandoned(tmp_path)
    (folder / segment_name(1)).touch()
    recover(folder)
    assert few_rows.sealed_numbers(folder) == list(range(150))
    assert [facts.name for facts in read_manifest(folder).stations] == ["a"]


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
    seal_part(store.folder)
    few_rows.hand_over(store, range(100, 150))
    store.commit_now()
    few_rows.vanish(store)
    first = part_paths(store.folder, "samples")[0].read_bytes()
    recover(store.folder)
    assert part_paths(store.folder, "samples")[0].read_bytes() == first
    assert few_rows.sealed_numbers(store.folder) == list(range(150))


def test_an_unreadable_part_is_set_aside_and_sealed_again_from_the_store(abandoned: Path) -> None:
    seal_journal(abandoned)
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


def test_a_journal_of_a_newer_jbclog_is_left_alone(abandoned: Path) -> None:
    notes = Frame.of(FrameKind.NOTES, b'{"schema": 3}')
    with (abandoned / segment_name(0)).open("ab") as file:
        file.write(commit_bytes(100, [notes]))
    before = contents(abandoned)
    with pytest.raises(RecordError, match="this jbclog knows 2"):
        recover(abandoned)
    assert contents(abandoned) == before


def test_an_open_run_of_the_first_release_is_left_to_it(tmp_path: Path) -> None:
    folder = create_run(tmp_path, "bench", 0.0)
    (folder / "live.sqlite").write_bytes(b"SQLite format 3\0")
    before = contents(folder)
    with pytest.raises(RecordError, match=r"an open run of jbclog 0\.1\.0; finish it with"):
        recover(folder)
    assert contents(folder) == before


def test_a_manifest_of_a_newer_jbclog_is_left_alone(abandoned: Path) -> None:
    (abandoned / "manifest.json").write_text(json.dumps({"run": abandoned.name, "schema": 3}))
    before = contents(abandoned)
    with pytest.raises(RecordError, match="this jbclog knows 2"):
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


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_damaged_commit_is_left_out_counted_and_named(abandoned: Path, place: int) -> None:
    lose_commit(abandoned, "samples", place)
    done = recover(abandoned)
    lost = read_manifest(abandoned).lost
    missing = range(place * 50, place * 50 + 50)
    assert few_rows.sealed_numbers(abandoned) == [n for n in range(150) if n not in missing]
    assert lost is not None
    assert lost.text in done.text
    assert "live-0000.journal, commit " in lost.text
    if place < 2:  # of the last one nothing tells how many rows it had
        assert "50 samples" in lost.text
    assert lost.seconds_at_most is None
    assert (abandoned / "damaged" / segment_name(0)).exists()
    assert check(abandoned) == []
    before = contents(abandoned)
    recover(abandoned)
    assert contents(abandoned) == before


def test_a_whole_frame_that_cannot_be_unpacked_is_damage(abandoned: Path) -> None:
    frame = Frame.of(FrameKind.ROWS, b"no rows", 0, 150, 7)
    with (abandoned / segment_name(0)).open("ab") as file:
        file.write(commit_bytes(100, [frame]))
    recover(abandoned)
    assert few_rows.sealed_numbers(abandoned) == list(range(150))
    (damage,) = read_damage(abandoned)
    assert (damage.place, damage.rows) == ("live-0000.journal, commit 100 (samples)", 7)


def test_a_journal_that_is_none_any_more(abandoned: Path) -> None:
    write_manifest(abandoned, Manifest(abandoned.name, start="2026-11-21T01:30:00.000000Z"))
    (abandoned / segment_name(0)).write_bytes(os.urandom(8000))
    recover(abandoned)
    manifest = read_manifest(abandoned)
    assert manifest.lost is not None
    assert manifest.lost.seconds_at_most is None
    assert "The journal holds nothing of it." in manifest.lost.text
    assert few_rows.sealed_numbers(abandoned) == []


def test_a_part_of_which_the_chain_lost_the_line_is_taken_in(tmp_path: Path) -> None:
    folder = journal(tmp_path, [[(50, 3)], [(40, 2)], [(10, 1)]]).folder
    seal_journal(folder, is_open=True)
    chain = folder / "parts.jsonl"
    chain.write_bytes(chain.read_bytes().replace(b"samples/part-0000", b"samples/part-9000"))
    recover(folder)
    assert few_rows.sealed_numbers(folder) == list(range(100))
    lost = read_manifest(folder).lost
    assert lost is not None
    assert "parts.jsonl: line 1 is no part, or was changed" in lost.text
    assert check(folder) == []


def test_a_journal_that_could_not_be_begun(tmp_path: Path) -> None:
    """A recorder whose journal could not be made leaves nothing that recovery cannot take."""
    folder = create_run(tmp_path, "bench", 0.0)
    (folder / segment_name(0)).mkdir()
    store = RunJournal(folder)
    with pytest.raises(RecordError):
        store.start()
    (folder / segment_name(0)).rmdir()
    recover(folder)
    assert read_manifest(folder).state == "sealed"
