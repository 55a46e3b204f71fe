"""The joints of a run that goes on: as many as its record has afterwards, and not known where they
are not known.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

from jbclog.analysis.joints.evidence import NOTHING_RECORDED
from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import joints_and_metrics
from jbclog.core.clock import SystemClock
from jbclog.core.locks import commit_status
from jbclog.core.rows import EventRow, Severity
from jbclog.live import Follower, RunState, joint_counter
from jbclog.live.joint_counter import ENDED_S, count, scheduled
from jbclog.live.joint_numbers import ENDED, Counted, JointCounting, JointNumbers, PortCount
from jbclog.live.open_rows import OpenRows
from jbclog.record.manifest import write_manifest
from jbclog.record.seal import seal_rows
from support.records.live_rows import SOLDERED_ROWS as ROWS
from support.records.live_rows import Soldering, now_us

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
    assert (
        sum(len(rows) for rows in OpenRows(recording.folder, None).groups("samples", ["tick"]))
        == PART
    )


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
        assert [(port.joints.count, port.joints.why) for port in run.ports] == [
            (None, "not counted yet")
        ] * 2
        joints = until_counted(follower).ports[0].joints
        assert joints.count == ended(recording)
        assert joints.age_s is not None
        recording.finalize()
        end = time.monotonic() + WAIT_S
        # asked for the last count
        while (run := follower.poll()) is None or run.ports[0].joints.age_s is not None:
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


def test_a_count_depends_on_the_run_and_not_on_when_it_is_made(recording: Soldering) -> None:
    for rows in range(50, COMMIT + 1, 50):
        recording.solder(rows)
    through = scheduled(commit_status(recording.folder).last, 1)
    early = count(recording.folder, through)
    assert early.ports[0].found
    recording.solder(ROWS)
    late = count(recording.folder, through)
    assert late.ports == early.ports
    assert count(recording.folder).ports[0].found > early.ports[0].found


def schedule(ports: int, through: int, every: int = 1) -> list[int]:
    """What a process counts that looks at every `every`th batch."""
    return list(dict.fromkeys(scheduled(last, ports) for last in range(every, through + 1, every)))


def test_two_processes_count_at_the_same_commits() -> None:
    assert schedule(6, 120) == [1, 2, 4, 8, 16, 24, 32, 48, 64, 96]
    assert set(schedule(6, 2000, every=37)) <= set(schedule(6, 2000))
    assert schedule(64, 2000)[-2:] == [1024, 1536]
    assert scheduled(0, 6) == 0
    # a machine that is a bit slower agrees
    assert scheduled(1000, 6, took_s=0.5) == scheduled(1000, 6)
    assert scheduled(1000, 6, took_s=5.0) < scheduled(1000, 6)


@pytest.fixture
def counted_through(monkeypatch: pytest.MonkeyPatch) -> Callable[[Sequence[int]], list[int | None]]:
    """Return the batches through which a process counts that sees these commits, one each
    second.
    """

    def counts(commits: Sequence[int]) -> list[int | None]:
        seen, found = iter(commits), list[int | None]()
        clock, counted = (
            iter(range(1000)),
            Counted(ports=tuple(PortCount("a", port, 0, 0, None) for port in range(6))),
        )
        looks = iter([0] * (len(commits) - 1))
        monkeypatch.setattr(
            joint_counter, "commit_status", lambda _: SimpleNamespace(last=next(seen))
        )
        monkeypatch.setattr(
            joint_counter,
            "count",
            lambda _folder, through, **_: (found.append(through), counted)[1],
        )
        monkeypatch.setattr(joint_counter, "_number_of_ports", lambda _: len(counted.ports))
        monkeypatch.setattr(
            joint_counter.select,
            "select",
            lambda *_: ([] if next(looks, None) == 0 else [0], [], []),
        )
        monkeypatch.setattr(joint_counter.os, "read", lambda *_: b"")
        monkeypatch.setattr(joint_counter.time, "monotonic", lambda: next(clock))
        joint_counter._count_until_final(Path())
        return found

    return counts


def test_a_run_that_stands_still_is_counted_to_its_end(
    counted_through: Callable[[Sequence[int]], list[int | None]],
) -> None:
    assert counted_through([5, 6, 7, 8, 9]) == [4, 8]
    assert counted_through([7] * 10) == [4, 7]


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
    """As for a run that ends with a number of joints: it is in the manifest, so the manifest cannot
    be final yet.
    """
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


def test_the_age_is_by_the_clock_of_the_run_without_steps_of_the_wall_clock(
    recording: Soldering,
) -> None:
    recording.manifest.t0_utc = time.time() - 60.0
    write_manifest(recording.folder, recording.manifest)
    recording.solder(500)
    assert count(recording.folder).age_s == pytest.approx(60.0 - 49.9, abs=5.0)
    recording.store.event(EventRow(now_us(), "clock.step", Severity.WARNING, "", value=-1000.0))
    recording.commit()
    assert count(recording.folder).age_s == pytest.approx(1060.0 - 49.9, abs=5.0)


def test_a_user_without_write_permission_can_count(recording: Soldering) -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root, to become somebody else")
    recording.solder(COMMIT)
    for folder in (recording.folder, *recording.folder.parents):
        if folder.stat().st_mode & 0o005 != 0o005:
            folder.chmod(0o755)
    before = count(recording.folder)
    child = os.fork()
    if child == 0:
        os.setgid(65_534)
        os.setuid(65_534)
        with suppress(BaseException):
            os._exit(0 if count(recording.folder).ports == before.ports else 3)
        os._exit(4)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
