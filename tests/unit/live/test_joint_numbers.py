"""The joints of a run that goes on: as many as its record has afterwards, and not known where they are not known."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from jbclog.analysis.joints.evidence import NOTHING_RECORDED
from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import joints_and_metrics
from jbclog.core.clock import SystemClock
from jbclog.core.locks import commit_status
from jbclog.live import Follower, RunState, joint_counter
from jbclog.live.joint_counter import ENDED_S, LEAST_PAUSE_S, REST, count
from jbclog.live.joint_numbers import ENDED, Counted, JointCounting, JointNumbers
from jbclog.live.open_rows import OpenRows
from jbclog.record.seal import seal_rows
from support.records.live_rows import SOLDERED_ROWS as ROWS
from support.records.live_rows import Soldering

WAIT_S = 30.0
PART, COMMIT = 600, 500


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Soldering]:
    made = Soldering(tmp_path)
    yield made
    made.abandon()


def ended(recording: Soldering) -> int:
    """How many joints the finished record has that end long enough before the last row."""
    joints = open_run(recording.folder).joints()
    return int((joints["end_s"] <= (recording.tick - 1) / 10 - ENDED_S).sum())


def test_the_numbers_are_those_of_the_record(recording: Soldering) -> None:
    recording.solder(COMMIT)
    first, second = count(recording.folder).ports
    assert (first.count, first.why) == (ended(recording), None)
    assert first.found > 5
    assert (second.count, second.why) == (None, NOTHING_RECORDED)  # and not 0
    recording.solder(PART)
    recording.seal_part()
    recording.solder(ROWS)
    assert count(recording.folder).ports[0].count == ended(recording) > 20
    recording.finalize()
    final = count(recording.folder)
    assert final.is_final
    assert final.ports[0].count == len(open_run(recording.folder).joints())


def test_rows_in_a_part_and_still_in_the_store_are_read_once(recording: Soldering) -> None:
    """As between the completion of a part and the deletion of its batches."""
    recording.solder(COMMIT)
    seal_rows(recording.folder)
    recording.solder(PART)
    assert sum(len(rows) for rows in OpenRows(recording.folder, None).groups("samples", ["tick"])) == PART


def test_nothing_that_is_not_committed_is_counted(recording: Soldering) -> None:
    recording.solder(COMMIT)
    before = count(recording.folder)
    recording.store._ending = True  # its thread does not write the lock again
    recording.store._thread.join()
    status = commit_status(recording.folder)
    recording.solder(ROWS)
    recording.store.lock.write_status(status)
    assert count(recording.folder).ports == before.ports


def until_counted(follower: Follower) -> RunState:
    end = time.monotonic() + WAIT_S
    while (run := follower.poll()) is None or run.ports[0].joints.count is None:
        assert time.monotonic() < end, run
        time.sleep(0.05)
    return run


def test_a_follower_has_them_from_a_process_that_ends_with_it(recording: Soldering) -> None:
    recording.solder(COMMIT)
    with Follower(recording.folder, joints=True) as follower:
        run = follower.poll()
        assert run is not None
        assert [(port.joints.count, port.joints.why) for port in run.ports] == [(None, "not counted yet")] * 2
        joints = until_counted(follower).ports[0].joints
        assert joints.count == ended(recording)
        assert joints.age_s is not None
        recording.finalize()
        end = time.monotonic() + WAIT_S
        while (run := follower.poll()) is None or run.ports[0].joints.age_s is not None:  # asked for the last count
            assert time.monotonic() < end, run
            time.sleep(0.05)
        assert run.ports[0].joints.count == len(open_run(recording.folder).joints())
        assert follower._run is not None
        numbers = follower._run._joints
    assert numbers is not None
    assert numbers._counting._process is None


def test_without_being_asked_nothing_is_counted(recording: Soldering) -> None:
    recording.solder(COMMIT)
    with Follower(recording.folder) as follower:
        run = follower.poll()
        assert run is not None
        assert run.ports[0].joints.why == "not counted yet"
        assert follower._run is not None
        assert follower._run._joints is None


def test_the_first_count_which_loads_much_is_soon_followed_by_another(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    clock, pauses, commits = iter([0.0, 0.0, 1.5, 2.0, 10.0]), list[float](), iter([1, 2, 3])

    def wait(_read: object, _write: object, _faulty: object, pause: float) -> tuple[list[int], list[int], list[int]]:
        pauses.append(pause)
        return ([joint_counter.STDIN] if len(pauses) == 3 else []), [], []

    monkeypatch.setattr(joint_counter.time, "process_time", lambda: next(clock))
    monkeypatch.setattr(joint_counter, "commit_status", lambda _: SimpleNamespace(last=next(commits)))
    monkeypatch.setattr(joint_counter, "count", lambda *_, **__: Counted())
    monkeypatch.setattr(joint_counter.select, "select", wait)
    monkeypatch.setattr(joint_counter.os, "read", lambda *_: b"")
    joint_counter._count_until_final(tmp_path)
    assert pauses == [LEAST_PAUSE_S, REST * 1.5, REST * 8.0]


def test_a_killed_process_leaves_numbers_not_known(recording: Soldering) -> None:
    numbers = JointNumbers(recording.folder, SystemClock())
    process = numbers._counting._process
    assert process is not None
    process.kill()
    process.wait()
    assert numbers.look(has_ended=False) == {}
    assert numbers.not_counted.why == f"cannot be counted: {ENDED}"
    numbers.close()


def test_a_recorder_gets_the_last_count_before_its_run_is_finalized(recording: Soldering) -> None:
    """As for a run that ends with a number of joints: it is in the manifest, so the manifest cannot be final yet."""
    recording.solder(ROWS)
    counting = JointCounting(recording.folder)
    last = counting.last(WAIT_S)
    counting.close()
    assert last is not None
    assert last.is_final
    assert last.ports[0].count == len(open_run(recording.folder).joints())


def test_the_process_says_why_it_cannot_count(tmp_path: Path) -> None:
    counting = JointCounting(tmp_path)
    assert counting.last(WAIT_S) is None
    assert "no manifest" in str(counting.why)
    counting.close()


def test_a_count_that_never_comes_is_not_waited_for(recording: Soldering) -> None:
    counting = JointCounting(recording.folder)
    assert counting.last(0.0) is None
    assert counting.why == "it took more than 0 s"
    counting.close()


def test_feeds_are_evidence_during_a_run_too() -> None:
    """The recorded example with a feeder."""
    run = open_run(next((Path(__file__).parents[3] / "notebooks" / "data" / "joints").glob("2*")))
    assert any(row["wire_decides"] for row in joints_and_metrics(run)[2])
    assert sum(port.found for port in count(run.folder).ports) == len(run.joints())
