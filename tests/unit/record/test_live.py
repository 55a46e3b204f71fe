"""The live store: handing over never waits, what is committed is there, failures are said."""

from __future__ import annotations

import json
import sqlite3
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

from jbclog.core.errors import RecordError
from jbclog.core.rows import COLUMN, EventRow, Journal, Severity
from jbclog.record import live
from jbclog.record.batches import Batch
from jbclog.record.conclude import conclude
from jbclog.record.folder import create_run
from jbclog.record.live import LiveStore
from jbclog.record.manifest import Manifest
from jbclog.record.parts import part_paths
from jbclog.record.seal import seal_rows
from jbclog.record.seal_child import seal_in_child
from jbclog.record.store import RESERVE, RESERVE_BYTES, Notes, Segment, segments
from jbclog.record.store_reader import StoreReader
from support.records import few_rows
from support.records.few_rows import begun, hand_over


def finished(store: LiveStore) -> Path:
    """Close, seal and conclude as a recorder does."""
    store.close()
    seal_rows(store.folder)
    conclude(store.folder, Manifest(store.folder.name, exit_status="success"), store.lock)
    return store.folder


def until(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def failing(code: int, times: int = 10**9) -> Callable[[Segment, Sequence[Batch], Notes], None]:
    """A `Segment.add` that fails with one of SQLite's codes, then is itself again."""
    real, left = Segment.add, [times]

    def add(self: Segment, batches: Sequence[Batch], notes: Notes) -> None:
        if left[0]:
            left[0] -= 1
            error = sqlite3.OperationalError("made up")
            error.sqlite_errorcode = code
            raise error
        real(self, batches, notes)

    return add


def test_it_is_a_journal(tmp_path: Path) -> None:
    journal: Journal = LiveStore(create_run(tmp_path, "bench", 0.0))
    assert journal


def test_everything_handed_over_is_sealed(tmp_path: Path) -> None:
    store = begun(tmp_path)
    store.setting(few_rows.setting(1))
    hand_over(store, range(250))
    store.facts(few_rows.facts())
    folder = finished(store)
    assert few_rows.sealed_numbers(folder) == list(range(250))
    assert few_rows.sealed_events(folder) == list(range(0, 250, 7))
    assert few_rows.table(folder, "settings").to_pylist()[0]["setting"] == "setting_1"
    assert few_rows.table(folder, "counters")["value"].to_pylist() == [0.0, 100.0, 200.0]


def test_rows_of_many_threads_all_arrive(tmp_path: Path) -> None:
    store = begun(tmp_path)
    threads = [
        threading.Thread(
            target=lambda name=name: [store.sample(few_rows.sample(n, name)) for n in range(2000)]
        )
        for name in "abcd"
    ]
    for thread in threads:
        thread.start()
    for _ in range(20):
        store.commit_now()
    for thread in threads:
        thread.join()
    folder = finished(store)
    rows = few_rows.table(folder, "samples").select(["station", "tick"]).to_pylist()
    for name in "abcd":
        assert [row["tick"] for row in rows if row["station"] == name] == list(range(2000))


def test_the_writer_commits_within_a_second_by_itself(tmp_path: Path) -> None:
    store = begun(tmp_path)
    with store._committing:  # not in the middle
        hand_over(store, range(8))
    assert live.COMMIT_S < 1
    until(lambda: committed(store.folder) == 3)  # one of samples, one of events, one of counters
    store.close()
    store.release()


def test_at_once_is_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "COMMIT_S", 600.0)
    store = begun(tmp_path)
    store.commit_now()
    store.event(few_rows.event(1), at_once=True)
    until(lambda: committed(store.folder) == 1)
    store.close()
    store.release()


def committed(folder: Path) -> int:
    """How many batches another process would see."""
    with StoreReader(folder) as stock:
        return sum(
            len(stock.numbers_of(table, 0))
            for table in ("samples", "events", "settings", "counters")
        )


def test_facts_are_those_of_the_moment_they_were_handed_over(tmp_path: Path) -> None:
    store = begun(tmp_path)
    facts = few_rows.facts()
    store.facts(facts)
    facts.model = "changed later"
    store.commit_now()
    with StoreReader(store.folder) as stock:
        assert json.loads(stock.facts()["a"])["model"] is None
    store.facts(facts)
    folder = finished(store)
    assert '"changed later"' in (folder / "manifest.json").read_text()


def test_the_folder_is_locked_until_released(tmp_path: Path) -> None:
    store = begun(tmp_path)
    with pytest.raises(RecordError, match=r"process \d+"):
        LiveStore(store.folder).start()
    store.close()
    with pytest.raises(RecordError):
        LiveStore(store.folder).start()
    store.release()


def test_a_folder_that_takes_no_writes_is_refused_at_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Segment, "add", failing(sqlite3.SQLITE_FULL))
    store = LiveStore(create_run(tmp_path, "bench", 0.0))
    with pytest.raises(RecordError, match="No station was touched"):
        store.start()
    monkeypatch.undo()
    few = LiveStore(create_run(tmp_path, "bench", 0.0))
    few.start()
    few.close()
    few.release()


# -- when the disk fails ---------------------------------------------------------------------------


def test_after_an_input_output_error_recording_goes_on_in_a_new_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = begun(tmp_path)
    hand_over(store, range(50))
    store.commit_now()
    monkeypatch.setattr(Segment, "add", failing(sqlite3.SQLITE_IOERR_FSYNC, times=1))
    hand_over(store, range(50, 100))
    store.commit_now()
    assert [path.name for path in segments(store.folder)] == ["live.sqlite", "live-1.sqlite"]
    hand_over(store, range(100, 150))
    assert store.failure is None
    folder = finished(store)
    assert few_rows.sealed_numbers(folder) == list(range(150))
    assert "record.new_file" in few_rows.table(folder, "events")["kind"].to_pylist()
    assert not segments(folder)


def test_a_full_disk_is_told_once_and_the_reserve_holds_what_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[RecordError] = []
    store = begun(tmp_path, on_failure=told.append)
    assert (store.folder / RESERVE).stat().st_size >= 1 << 20
    monkeypatch.setattr(Segment, "add", failing(sqlite3.SQLITE_FULL, times=1))
    hand_over(store, range(50))
    store.commit_now()  # the second try, with the room of the reserve, went well
    assert (store.folder / RESERVE).stat().st_size == RESERVE_BYTES // 2
    assert len(told) == 1
    assert store.failure is told[0]
    hand_over(store, range(50, 60))
    folder = finished(store)
    assert len(told) == 1
    assert few_rows.sealed_numbers(folder) == list(range(60))
    assert "record.failed" in few_rows.table(folder, "events")["kind"].to_pylist()


def test_what_cannot_be_stored_now_is_held_and_stored_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[RecordError] = []
    store = begun(tmp_path, on_failure=told.append)
    store.facts(few_rows.facts())
    with monkeypatch.context() as broken:
        broken.setattr(Segment, "add", failing(sqlite3.SQLITE_FULL))
        for first in range(0, 150, 50):
            hand_over(store, range(first, first + 50))
            with pytest.raises(RecordError):
                store.commit_now()
    assert len(told) == 1
    store.commit_now()
    folder = finished(store)
    assert few_rows.sealed_numbers(folder) == list(range(150))
    assert few_rows.sealed_events(folder) == list(range(0, 150, 7))
    assert [
        facts["name"] for facts in json.loads((folder / "manifest.json").read_text())["stations"]
    ] == ["a"]


def test_what_memory_cannot_hold_is_counted_and_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "HELD_BYTES", 100_000)
    store = begun(tmp_path)
    with monkeypatch.context() as broken:
        broken.setattr(Segment, "add", failing(sqlite3.SQLITE_FULL))
        for first in range(0, 2000, 50):
            hand_over(store, range(first, first + 50))
            with pytest.raises(RecordError):
                store.commit_now()
    dropped = store.dropped_rows
    assert 0 < dropped < 2000
    folder = finished(store)
    assert few_rows.sealed_numbers(folder) == list(range(dropped, 2000))
    assert few_rows.sealed_events(folder) == list(range(0, 2000, 7))
    assert (
        f"{dropped} rows could not be stored"
        in json.loads((folder / "manifest.json").read_text())["lost"]["text"]
    )


def test_a_row_that_is_none_takes_no_other_with_it(tmp_path: Path) -> None:
    told: list[RecordError] = []
    store = begun(tmp_path, on_failure=told.append)
    for number in range(20):
        row = few_rows.sample(number)
        if number == 13:
            row[COLUMN["temperature_c"]] = "hot"
        store.sample(row)
    store.event(few_rows.event(0))
    store.event(EventRow("yesterday", "bad", Severity.INFO, "no time"))  # type: ignore[arg-type]  # the mistake meant
    store.event(few_rows.event(7))
    store.commit_now()
    assert len(told) == 1
    assert "no time" not in str(told[0])
    folder = finished(store)
    assert few_rows.sealed_numbers(folder) == [number for number in range(20) if number != 13]
    assert few_rows.sealed_events(folder) == [0, 7]
    assert store.dropped_rows == 2


@pytest.mark.parametrize("table", ["samples", "events", "counters"])
def test_what_memory_was_refused_for_is_taken_in_the_next_time(
    table: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each row once, in its order, and the events' chain whole; that it happened is told."""
    store, refused, encode = begun(tmp_path), list[str](), live.encode

    def encoded(number: int, name: str, values: Sequence[object]) -> Batch:
        if name == table and not refused:
            refused.append(name)
            raise MemoryError
        return encode(number, name, values)

    monkeypatch.setattr(live, "encode", encoded)
    for first in (0, 100, 200):
        hand_over(store, range(first, first + 100))
        with suppress(RecordError):
            store.commit_now()
    folder = finished(store)
    assert refused == [table]
    assert "memory was refused" in str(store.failure)
    assert few_rows.sealed_numbers(folder) == list(range(300))
    assert few_rows.sealed_events(folder) == list(range(0, 300, few_rows.EVENT_EVERY))
    assert few_rows.table(folder, "counters").num_rows == 3


def test_a_callback_that_fails_stops_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def listener(error: RecordError) -> None:
        raise RuntimeError("the loop is closed")

    store = begun(tmp_path, on_failure=listener)
    monkeypatch.setattr(Segment, "add", failing(sqlite3.SQLITE_FULL, times=1))
    hand_over(store, range(10))
    store.commit_now()
    assert store.failure is not None
    assert few_rows.sealed_numbers(finished(store)) == list(range(10))


# -- sealing while recording -----------------------------------------------------------------------


def test_hourly_sealing_beside_the_recording(tmp_path: Path) -> None:
    store = begun(tmp_path)
    number = 0
    for _ in range(2):
        hand_over(store, range(number, number + 300))
        store.commit_now()
        store.seal_now()
        number += 300
        while store._child:
            hand_over(store, range(number, number + 10))
            store.commit_now()
            number += 10
            store._wake.set()
            time.sleep(0.005)
    hand_over(store, range(number, number + 50))
    store.close()
    assert store.failure is None
    assert len(part_paths(store.folder, "samples")) == 2
    seal_in_child(store.folder, store.lock)
    conclude(store.folder, Manifest(store.folder.name, exit_status="success"), store.lock)
    assert few_rows.sealed_numbers(store.folder) == list(range(number + 50))
    assert few_rows.sealed_events(store.folder) == list(range(0, number + 50, 7))


def test_hourly_sealing_keeps_the_live_store_small(tmp_path: Path) -> None:
    store = begun(tmp_path)
    for hour in range(4):
        hand_over(store, range(hour * 3000, hour * 3000 + 3000))
        store.commit_now()
        seal_rows(store.folder, part=True)
        with StoreReader(store.folder) as stock:
            assert stock.numbers_of("samples", 0) == []
        if hour == 0:
            first = (store.folder / "live.sqlite").stat().st_size
    assert (store.folder / "live.sqlite").stat().st_size <= 2 * first
    store.close()
    store.release()


def test_a_sealing_that_fails_is_told_and_done_later(tmp_path: Path) -> None:
    store = begun(tmp_path)
    hand_over(store, range(30))
    store.commit_now()
    (store.folder / "samples").write_text("in the way")
    store.seal_now()
    store._wake.set()
    until(lambda: store._child is None)
    (store.folder / "samples").unlink()
    folder = finished(store)
    assert few_rows.sealed_numbers(folder) == list(range(30))
    assert "record.not_sealed" in few_rows.table(folder, "events")["kind"].to_pylist()


# -- what people are shown -------------------------------------------------------------------------


def test_an_event_is_shown_when_it_is_kept_and_not_before(tmp_path: Path) -> None:
    shown: list[tuple[int, int]] = []
    store = begun(
        tmp_path, on_event=lambda event: shown.append((event.code or 0, committed(store.folder)))
    )
    store._committing.acquire()  # the writer's thread must not come in between
    store.event(few_rows.event(1))
    assert shown == []
    store._committing.release()
    store.commit_now()
    assert shown == [(1, 1)]
    store.event(few_rows.event(2))
    store.close()
    assert [code for code, _ in shown] == [1, 2]
    store.release()


def test_an_event_that_cannot_be_kept_is_shown_and_an_observer_that_fails_is_harmless(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []

    def show(event: EventRow) -> None:
        shown.append(event.kind)
        raise OSError("nobody looks")

    store = begun(tmp_path, on_event=show)
    monkeypatch.setattr(Segment, "add", failing(sqlite3.SQLITE_FULL))
    store.event(few_rows.event(1))
    with pytest.raises(RecordError):
        store.commit_now()
    store.close()
    assert shown == ["test.event", "record.failed"]
    store.release()


def hanging_disk(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Let each commit wait until the event is set."""
    let_go, real = threading.Event(), Segment.add

    def add(self: Segment, batches: Sequence[Batch], notes: Notes) -> None:
        let_go.wait(200)
        real(self, batches, notes)

    monkeypatch.setattr(Segment, "add", add)
    return let_go


def test_an_event_waits_two_seconds_for_its_commit_and_the_disk_has_ten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []
    told: list[RecordError] = []
    store = begun(tmp_path, on_failure=told.append, on_event=lambda event: shown.append(event.kind))
    let_go = hanging_disk(monkeypatch)
    store.event(few_rows.event(1), at_once=True)
    until(lambda: store._commit_began is not None)
    began = store._commit_began or 0.0
    found = []
    for seconds in (1.9, 2.1, 9.9, 10.1):
        with monkeypatch.context() as clock:
            now = SimpleNamespace(monotonic=lambda at=began + seconds: at, time_ns=time.time_ns)
            clock.setattr(live, "time", now)
            store.check_stall()
        found.append((len(shown), len(told)))
    let_go.set()
    store.close()
    assert found == [(0, 0), (1, 0), (1, 0), (2, 1)]


def test_a_disk_that_keeps_a_commit_waiting_is_told_of_and_holds_up_nothing_that_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []
    told: list[RecordError] = []
    store = begun(tmp_path, on_failure=told.append, on_event=lambda event: shown.append(event.kind))
    let_go = hanging_disk(monkeypatch)
    monkeypatch.setattr(live, "WAITED_S", 600.0)  # however late this looks
    monkeypatch.setattr(live, "STALLED_S", 600.0)
    store.event(few_rows.event(1), at_once=True)
    until(lambda: store._commit_began is not None)
    store.check_stall()
    assert (shown, told) == ([], [])
    monkeypatch.setattr(live, "WAITED_S", 0.0)
    store.check_stall()
    assert (shown, told) == (["test.event"], [])
    monkeypatch.setattr(live, "STALLED_S", 0.0)
    store.check_stall()
    store.check_stall()
    assert shown == ["test.event", "record.failed"]
    assert "has delayed a commit" in str(told[0])
    assert len(told) == 1
    let_go.set()
    store.close()
    assert few_rows.sealed_events(finished(store)) == [1]
    assert len(shown) == 2
