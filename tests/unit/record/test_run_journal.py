"""The journal of a run: handing over never waits, what is committed is there, failures are
reported.
"""

from __future__ import annotations

import errno
import math
import os
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

from jbclog.core.errors import RecordError
from jbclog.core.locks import unkept_rows
from jbclog.core.rows import COLUMN, EventRow, Journal, Severity
from jbclog.record import run_journal
from jbclog.record.chains import breaks
from jbclog.record.folder import create_run
from jbclog.record.frames import Frame
from jbclog.record.run_journal import RowBuffer, RunJournal
from jbclog.record.segments import RESERVE, RESERVE_BYTES, Disk, segments
from support.records import few_rows
from support.records.few_rows import begun, hand_over
from support.records.journal_rows import JournalRows, read_files, read_journal


def until(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def fail_writes(monkeypatch: pytest.MonkeyPatch, error: int, times: float = math.inf) -> None:
    """Let so many writes of segments fail."""
    write = Disk.write
    left = times

    def failing(disk: Disk, file: int, data: memoryview) -> int:
        nonlocal left
        if left > 0:
            left -= 1
            raise OSError(error, os.strerror(error))
        return write(disk, file, data)

    monkeypatch.setattr(Disk, "write", failing)


def ended(store: RunJournal) -> JournalRows:
    store.close()
    store.release()
    journal = read_journal(store.folder)
    assert journal.notes["closed"] is True
    return journal


def ticks(journal: JournalRows) -> list[object]:
    return journal.column("samples", "tick")


def test_it_is_a_journal(tmp_path: Path) -> None:
    journal: Journal = RunJournal(create_run(tmp_path, "bench", 0.0))
    assert journal


def test_everything_handed_over_is_stored(tmp_path: Path) -> None:
    store = begun(tmp_path)
    store.setting(few_rows.setting(1))
    hand_over(store, range(250))
    store.facts(few_rows.facts())
    journal = ended(store)
    assert ticks(journal) == [*range(250)]
    assert [*journal.rows["samples"]] == [*range(250)]
    assert journal.column("events", "code") == [*range(0, 250, 7)]
    assert journal.column("settings", "setting") == ["setting_1"]
    assert journal.column("counters", "value") == [0.0, 100.0, 200.0]
    assert journal.facts.keys() == {"a"}
    assert journal.notes["run"] == store.folder.name


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
    rows = ended(store).rows["samples"].values()
    for name in "abcd":
        assert [row["tick"] for row in rows if row["station"] == name] == [*range(2000)]


def test_the_writer_commits_within_a_second_by_itself(tmp_path: Path) -> None:
    store = begun(tmp_path)
    with store._committing:  # not in the middle
        hand_over(store, range(8))
    assert run_journal.COMMIT_S < run_journal.AT_RISK_S
    until(lambda: ticks(read_journal(store.folder)) == [*range(8)])
    store.close()
    store.release()


@pytest.mark.parametrize("what", ["at once", "critical", "hot"])
def test_what_must_be_seen_at_once_does_not_wait(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_journal, "COMMIT_S", 600.0)
    store = begun(tmp_path)
    store.commit_now()
    if what == "hot":
        store.facts(few_rows.facts())
        until(lambda: "a" in read_journal(store.folder).facts)
    else:
        severity = Severity.CRITICAL if what == "critical" else Severity.INFO
        event = few_rows.event(1)._replace(severity=severity)
        store.event(event, at_once=what == "at once")
        until(lambda: bool(read_journal(store.folder).rows["events"]))
    store.close()
    store.release()


def test_a_recorder_with_nothing_to_record_shows_that_it_lives(tmp_path: Path) -> None:
    """The time of its last mark."""
    store = begun(tmp_path)
    store.commit_now()
    before = read_journal(store.folder)
    time.sleep(0.01)
    store.commit_now()
    after = read_journal(store.folder)
    assert after.commits == before.commits
    assert after.marked_us > before.marked_us
    store.close()
    store.release()


def test_facts_are_those_of_the_moment_they_were_handed_over(tmp_path: Path) -> None:
    store = begun(tmp_path)
    facts = few_rows.facts()
    store.facts(facts)
    facts.software = "changed later"
    store.commit_now()
    assert read_journal(store.folder).facts["a"]["software"] is None
    store.facts(facts)
    assert ended(store).facts["a"]["software"] == "changed later"


def test_facts_that_only_count_wait_and_what_may_be_hot_does_not() -> None:
    buffer = RowBuffer("run", lambda table, error: None)
    facts = few_rows.facts()
    assert buffer.facts(facts)
    buffer.take(100.0)
    assert buffer.changed_facts.keys() == {"a"}
    buffer.stored()
    facts.outages = 3
    assert not buffer.facts(facts)
    buffer.take(109.0)
    assert not buffer.changed_facts
    facts.touched = [1]
    assert buffer.facts(facts)
    buffer.take(109.1)
    assert buffer.changed_facts.keys() == {"a"}
    buffer.stored()
    facts.outages = 4
    buffer.facts(facts)
    buffer.take(119.0)
    assert not buffer.changed_facts
    buffer.take(119.2)
    assert '"outages": 4' in buffer.changed_facts["a"]


def test_the_folder_is_locked_until_released(tmp_path: Path) -> None:
    store = begun(tmp_path)
    with pytest.raises(RecordError, match=r"process \d+"):
        RunJournal(store.folder).start()
    store.close()
    with pytest.raises(RecordError):
        RunJournal(store.folder).start()
    store.release()


def test_a_folder_that_takes_no_writes_is_refused_at_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fail_writes(monkeypatch, errno.ENOSPC)
    store = RunJournal(create_run(tmp_path, "bench", 0.0))
    with pytest.raises(RecordError, match="No station was touched"):
        store.start()
    monkeypatch.undo()
    other = RunJournal(create_run(tmp_path, "bench", 0.0))
    other.start()
    other.close()
    other.release()


# -- when the disk fails ---------------------------------------------------------------------------


def test_after_an_input_output_error_recording_continues_in_a_new_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = begun(tmp_path)
    hand_over(store, range(50))
    store.commit_now()
    with store._committing:
        fail_writes(monkeypatch, errno.EIO, times=1)
        hand_over(store, range(50, 100))
        assert store._commit()
    assert len(segments(store.folder)) == 2
    hand_over(store, range(100, 150))
    assert store.failure is None
    journal = ended(store)
    assert ticks(journal) == [*range(150)]
    assert "record.new_file" in journal.column("events", "kind")


def test_a_full_disk_is_reported_once_and_the_reserve_holds_what_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failures: list[RecordError] = []
    store = begun(tmp_path, on_failure=failures.append)
    with store._committing:
        fail_writes(monkeypatch, errno.ENOSPC, times=1)
        hand_over(store, range(50))
        assert store._commit()  # the second attempt, with space from the reserve
    assert (store.folder / RESERVE).stat().st_size == RESERVE_BYTES // 2
    assert len(failures) == 1
    assert store.failure is failures[0]
    hand_over(store, range(50, 60))
    journal = ended(store)
    assert len(failures) == 1
    assert ticks(journal) == [*range(60)]
    assert "record.failed" in journal.column("events", "kind")
    assert len(segments(store.folder)) == 1


def test_what_cannot_be_stored_now_waits_and_is_stored_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failures: list[RecordError] = []
    store = begun(tmp_path, on_failure=failures.append)
    store.facts(few_rows.facts())
    with monkeypatch.context() as broken:
        fail_writes(broken, errno.ENOSPC)
        for first in range(0, 150, 50):
            hand_over(store, range(first, first + 50))
            with pytest.raises(RecordError):
                store.commit_now()
        assert unkept_rows(store.folder) >= 150
    store.commit_now()
    assert len(failures) == 1
    assert unkept_rows(store.folder) == 0
    journal = ended(store)
    assert ticks(journal) == [*range(150)]
    own = [row["code"] for row in journal.rows["events"].values() if row["kind"] == "test.event"]
    assert own == [*range(0, 150, 7)]
    assert list(journal.facts) == ["a"]


def test_what_memory_cannot_hold_is_counted_and_leaves_its_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_journal, "WAITING_BYTES", 40_000)
    store = begun(tmp_path)
    with monkeypatch.context() as broken:
        fail_writes(broken, errno.ENOSPC)
        for first in range(0, 2000, 50):
            hand_over(store, range(first, first + 50))
            with pytest.raises(RecordError):
                store.commit_now()
    dropped = store.dropped_rows
    assert 0 < dropped < 2000
    journal = ended(store)
    assert ticks(journal) == [*range(dropped, 2000)]
    assert sorted(journal.rows["samples"]) == [*range(dropped, 2000)]
    assert journal.column("counters", "value") == [float(n) for n in range(0, 2000, 100)]
    assert journal.notes["dropped"] == dropped
    assert unkept_rows(store.folder) == dropped


def test_the_last_rows_get_space_from_the_reserve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = begun(tmp_path)
    reserve = store.folder / RESERVE
    write = Disk.write

    def write_with_space(disk: Disk, file: int, data: memoryview) -> int:
        if reserve.stat().st_size > RESERVE_BYTES // 4:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(disk, file, data)

    monkeypatch.setattr(Disk, "write", write_with_space)
    hand_over(store, range(10))
    store.close()
    store.release()
    assert store.unkept_rows == 0
    assert ticks(read_journal(store.folder)) == [*range(10)]
    assert not reserve.exists()


def test_a_reserve_that_cannot_be_removed_does_not_break_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = begun(tmp_path)
    hand_over(store, range(10))

    def fail(disk: Disk, path: Path) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(Disk, "remove", fail)
    assert ticks(ended(store)) == [*range(10)]


def test_a_row_that_is_none_takes_no_other_with_it(tmp_path: Path) -> None:
    failures: list[RecordError] = []
    store = begun(tmp_path, on_failure=failures.append)
    for number in range(20):
        row = few_rows.sample(number)
        if number == 13:
            row[COLUMN["temperature_c"]] = "hot"
        store.sample(row)
    store.event(few_rows.event(0))
    store.event(EventRow("yesterday", "bad", Severity.INFO, "no time"))  # type: ignore[arg-type]  # the mistake meant
    store.event(few_rows.event(7))
    store.commit_now()
    assert len(failures) == 1
    journal = ended(store)
    assert ticks(journal) == [number for number in range(20) if number != 13]
    assert sorted(journal.rows["samples"]) == ticks(journal)
    own = [row for row in journal.rows["events"].values() if row["kind"] == "test.event"]
    assert [(row["code"], row["seq"]) for row in own] == [(0, 0), (7, 2)]
    assert store.dropped_rows == 2
    assert journal.notes["dropped"] == 2


@pytest.mark.parametrize("table", ["samples", "events", "counters"])
def test_rows_for_which_there_was_no_memory_are_stored_the_next_time(
    table: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each row once, in its order, and the events' chain whole; that it happened is reported."""
    store = begun(tmp_path)
    refused = list[str]()
    encode = run_journal.encode

    def encode_or_refuse(name: str, values: Sequence[object], first: int, number: int) -> Frame:
        if name == table and not refused:
            refused.append(name)
            raise MemoryError
        return encode(name, values, first, number)

    monkeypatch.setattr(run_journal, "encode", encode_or_refuse)
    for first in (0, 100, 200):
        hand_over(store, range(first, first + 100))
        with suppress(RecordError):
            store.commit_now()
    journal = ended(store)
    assert refused == [table]
    assert "memory was refused" in str(store.failure)
    assert ticks(journal) == [*range(300)]
    assert len(journal.rows["counters"]) == 3
    events = [journal.rows["events"][seq] for seq in sorted(journal.rows["events"])]
    assert [row["seq"] for row in events] == [*range(len(events))]
    assert [*breaks(store.folder.name, events)] == []
    own = [row["code"] for row in events if row["kind"] == "test.event"]
    assert own == [*range(0, 300, few_rows.EVENT_EVERY)]


def test_a_callback_that_fails_stops_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def listener(error: RecordError) -> None:
        raise RuntimeError("the loop is closed")

    store = begun(tmp_path, on_failure=listener)
    with store._committing:
        fail_writes(monkeypatch, errno.ENOSPC, times=1)
        hand_over(store, range(10))
        assert store._commit()
    assert store.failure is not None
    assert ticks(ended(store)) == [*range(10)]


# -- sealing while recording -----------------------------------------------------------------------


class Child:
    """A sealing child that works until it is let go."""

    begun = 0
    problem: str | None = None

    def __init__(self, *_: object, **__: object) -> None:
        Child.begun += 1

    def ended(self) -> str | None:
        return Child.problem

    def wait(self) -> str:
        return Child.problem or ""


@pytest.fixture
def child(monkeypatch: pytest.MonkeyPatch) -> type[Child]:
    monkeypatch.setattr(run_journal, "SealChild", Child)
    Child.begun = 0
    Child.problem = None
    return Child


def test_each_segment_has_all_that_its_reader_needs(tmp_path: Path, child: type[Child]) -> None:
    store = begun(tmp_path)
    store.facts(few_rows.facts())
    hand_over(store, range(30))
    store.commit_now()
    store.seal_now()
    assert child.begun == 1
    store.seal_now()
    assert child.begun == 1  # it is still at work
    hand_over(store, range(30, 40))
    store.close()
    store.release()
    first, *others = segments(store.folder)
    assert len(others) == 2
    assert ticks(read_files({first.name: first.read_bytes()})) == [*range(30)]
    last = read_files({others[1].name: others[1].read_bytes()})
    assert ticks(last) == [*range(30, 40)]
    assert last.facts.keys() == {"a"}
    assert last.notes["run"] == store.folder.name


def test_a_segment_of_many_rows_is_sealed_before_its_hour(
    tmp_path: Path, child: type[Child], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_journal, "ROWS_A_SEGMENT", 50)
    store = RunJournal(create_run(tmp_path, "bench", 0.0))
    store.start()
    hand_over(store, range(100))
    until(lambda: child.begun == 1)
    store.close()
    store.release()
    assert len(segments(store.folder)) == 2


def test_a_sealing_that_fails_is_reported(tmp_path: Path, child: type[Child]) -> None:
    store = begun(tmp_path)
    store.seal_now()
    child.problem = "it has no space"
    store._wake.set()
    until(lambda: store._child is None)
    events = ended(store).rows["events"].values()
    assert [row["kind"] for row in events] == ["record.not_sealed"]


# -- what people are shown -------------------------------------------------------------------------


def test_an_event_is_shown_when_it_is_stored_and_not_before(tmp_path: Path) -> None:
    shown: list[tuple[object, list[object]]] = []

    def show(event: EventRow) -> None:
        shown.append((event.code, read_journal(store.folder).column("events", "code")))

    store = begun(tmp_path, on_event=show)
    with store._committing:  # the writer's thread must not come in between
        store.event(few_rows.event(1))
        assert shown == []
    store.commit_now()
    store.event(few_rows.event(2))
    store.close()
    store.release()
    assert shown == [(1, [1]), (2, [1, 2])]


def test_an_event_that_cannot_be_stored_is_shown_and_an_observer_that_fails_is_harmless(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []

    def show(event: EventRow) -> None:
        shown.append(event.kind)
        raise OSError("nobody looks")

    store = begun(tmp_path, on_event=show)
    fail_writes(monkeypatch, errno.ENOSPC)
    store.event(few_rows.event(1))
    with pytest.raises(RecordError):
        store.commit_now()
    store.close()
    store.release()
    assert shown == ["test.event", "record.failed"]


def hanging_disk(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Let each write wait until the event is set."""
    let_go = threading.Event()
    write = Disk.write

    def wait_and_write(disk: Disk, file: int, data: memoryview) -> int:
        let_go.wait(200)
        return write(disk, file, data)

    monkeypatch.setattr(Disk, "write", wait_and_write)
    return let_go


def test_an_event_waits_two_seconds_for_its_commit_and_the_disk_has_ten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []
    failures: list[RecordError] = []
    store = begun(
        tmp_path, on_failure=failures.append, on_event=lambda event: shown.append(event.kind)
    )
    let_go = hanging_disk(monkeypatch)
    store.event(few_rows.event(1), at_once=True)
    until(lambda: store._commit_began is not None)
    began = store._commit_began or 0.0
    counts = []
    for seconds in (1.9, 2.1, 9.9, 10.1):
        with monkeypatch.context() as clock:
            now = SimpleNamespace(monotonic=lambda at=began + seconds: at, time_ns=time.time_ns)
            clock.setattr(run_journal, "time", now)
            store.check_stall()
        counts.append((len(shown), len(failures)))
    let_go.set()
    store.close()
    store.release()
    assert counts == [(0, 0), (1, 0), (1, 0), (2, 1)]


def test_a_long_wait_is_noted_for_recover(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = begun(tmp_path)
    with store._committing:
        store._safe_until -= 12.0
    hand_over(store, range(3))
    risk_s = ended(store).notes["risk_s"]
    assert isinstance(risk_s, float)
    assert 12.0 <= risk_s < 30.0


def test_a_disk_that_delays_a_commit_is_reported_and_holds_up_nothing_that_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []
    failures: list[RecordError] = []
    store = begun(
        tmp_path, on_failure=failures.append, on_event=lambda event: shown.append(event.kind)
    )
    let_go = hanging_disk(monkeypatch)
    monkeypatch.setattr(run_journal, "WAITED_S", 0.0)
    monkeypatch.setattr(run_journal, "STALLED_S", 0.0)
    store.event(few_rows.event(1), at_once=True)
    until(lambda: store._commit_began is not None)
    store.check_stall()
    store.check_stall()
    assert shown == ["test.event", "record.failed"]
    assert "has delayed a commit" in str(failures[0])
    assert len(failures) == 1
    let_go.set()
    journal = ended(store)
    assert journal.column("events", "kind") == ["test.event", "record.failed"]
    assert len(shown) == 2
