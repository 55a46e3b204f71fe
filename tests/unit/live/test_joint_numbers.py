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
from jbclog.analysis.joints.growing import NEW_TOOL
from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import joints_and_metrics
from jbclog.core.clock import SystemClock
from jbclog.core.locks import commit_status
from jbclog.core.rows import EventRow, Severity
from jbclog.live import Follower, RunState, joint_counter
from jbclog.live.growing_joints import ENDED_S, GrowingJoints, OpenRows, count
from jbclog.live.joint_counter import ALLOWED_S, BATCH_S, COUNT_S, LOOK_S, Schedule, _Counter
from jbclog.live.joint_numbers import ENDED, Counted, JointCounting, JointNumbers
from jbclog.live.store_follower import StoreFollower
from jbclog.record.folder import create_run
from jbclog.record.manifest import Manifest, write_manifest
from jbclog.record.seal import seal_rows
from support.records.live_rows import SOLDERED_ROWS as ROWS
from support.records.live_rows import Soldering, now_us

WAIT_S = 240.0  # the counter is niced: on a busy machine everything else comes first
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
    """Whoever begins late, or stopped over a part that was sealed, has the same numbers as one who
    counted again and again.
    """
    for rows in range(10, COMMIT + 1, 10):
        recording.solder(rows)
    models = commit_status(recording.folder).last
    often, late = GrowingJoints(recording.folder), GrowingJoints(recording.folder)
    early = often.identify(models)
    assert early.ports == count(recording.folder, models).ports
    for rows in range(COMMIT + 10, ROWS + 1, 10):
        recording.solder(rows)
        if rows == PART:
            recording.seal_part()
        if rows % 70 == 0:
            counted = often.count(commit_status(recording.folder).last)
    through = commit_status(recording.folder).last
    late.identify(models)
    counted = often.count(through)
    assert counted.ports == late.count(through).ports
    often.close()
    late.close()
    assert counted.ports[0].count == ended(recording) > early.ports[0].found > 5
    assert counted.ports[1].why == NOTHING_RECORDED


def test_each_row_is_read_once(recording: Soldering, monkeypatch: pytest.MonkeyPatch) -> None:
    recording.solder(COMMIT)
    joints = GrowingJoints(recording.folder)
    joints.identify(commit_status(recording.folder).last)
    joints.count(commit_status(recording.folder).last)
    read: list[int] = []
    real = StoreFollower.table
    monkeypatch.setattr(
        StoreFollower, "table", lambda self, number: (read.append(number), real(self, number))[1]
    )
    for rows in range(COMMIT + 100, COMMIT + 400, 100):
        recording.solder(rows)
        joints.count(commit_status(recording.folder).last)
        joints.count(commit_status(recording.folder).last)
    joints.close()
    assert len(read) == len(set(read)) == 3


def test_of_a_tool_that_was_exchanged_no_joints_are_known(recording: Soldering) -> None:
    """Until its heat balance is identified as well."""
    for tool, through in ((2, COMMIT), (0, COMMIT + 30), (9, ROWS)):  # 0: none
        recording.tool = tool
        recording.solder(through)
        if tool == 2:
            joints = GrowingJoints(recording.folder)
            assert joints.identify(commit_status(recording.folder).last).ports[0].count
    last = commit_status(recording.folder).last
    port = joints.count(last).ports[0]
    joints.close()
    assert (port.count, port.why) == (None, NEW_TOOL)
    assert joints.identify(last).ports[0].found > port.found + 10


def schedule(ports: int, through: int, every: int = 1) -> list[tuple[int, int]]:
    """What a process counts that looks at every `every`th batch."""
    made = Schedule(ports)
    return list(dict.fromkeys(made.batches(last) for last in range(every, through + 1, every)))


def test_two_processes_count_at_the_same_commits() -> None:
    assert [models for models, _ in schedule(6, 60)][:4] == [0, 20, 25, 32]
    assert set(schedule(6, 3000, every=37)) <= set(schedule(6, 3000))
    assert Schedule(6).batches(0) == (0, 0)
    slow, quick = Schedule(6), Schedule(6)
    assert slow.batches(1000) == quick.batches(1000)
    quick.took(2.0)
    assert slow.batches(5000) == quick.batches(5000)  # a machine that is a bit slower agrees
    slow.took(60.0)
    assert slow.batches(6000)[0] < quick.batches(6000)[0]


@pytest.mark.parametrize(("ports", "most"), [(6, 0.02), (16, 0.02), (32, 0.013), (64, 0.006)])
def test_counting_takes_a_bounded_share_of_a_core(ports: int, most: float) -> None:
    """By what a count takes (tests/bench/bench_watch.py measures it), for any hour of a shift."""
    made, counts, last = Schedule(ports), 0, 0
    for batch in range(1, round(8 * 3600 / BATCH_S)):
        models, through = made.batches(batch)
        counts += through not in (last, models)
        last = through
        if batch * BATCH_S > 3600:
            spent_s = made._spent_s + counts * ports * COUNT_S
            assert spent_s <= ALLOWED_S + most * batch * BATCH_S
    assert made.batches(batch)[0] > 2000  # models are identified anew
    assert batch - through <= 300 / BATCH_S * max(ports / 32, 1)


def test_ports_that_are_known_later_have_a_say(recording: Soldering) -> None:
    """A run begins before its stations have told how many ports they have."""
    ports, recording.facts.ports = recording.facts.ports, []
    recording.manifest.stations = []
    write_manifest(recording.folder, recording.manifest)
    recording.store.facts(recording.facts)
    recording.commit()
    counter = _Counter(recording.folder)
    assert counter.scheduled(commit_status(recording.folder).last) is None
    recording.facts.ports = [*ports, *range(3, 20)]
    recording.store.facts(recording.facts)
    counts = []
    for rows in range(5, 300, 5):
        recording.solder(rows)
        last = commit_status(recording.folder).last
        counted = counter.scheduled(last)
        counts += [] if counted is None else [(last, len(counted.ports))]
    counter.close()
    # so many ports are counted later than one
    assert counts[0] == (Schedule(19).batches(counts[0][0])[0], 19)


def test_many_ports_are_counted_too() -> None:
    assert schedule(250, 3000)[-1][0] > 0


@pytest.fixture
def counted_through(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Callable[[Sequence[int]], list[int | None]]:
    """Return the batches through which a process counts everything that sees these commits, one
    each second.
    """

    def counts(commits: Sequence[int]) -> list[int | None]:
        seen, found, clock = iter(commits), list[int | None](), iter(range(1000))
        looks = iter([0] * (len(commits) - 1))
        monkeypatch.setattr(
            joint_counter, "commit_status", lambda _: SimpleNamespace(last=next(seen))
        )
        monkeypatch.setattr(
            joint_counter,
            "count",
            lambda _folder, through, **_: (found.append(through), Counted())[1],
        )
        monkeypatch.setattr(joint_counter._Counter, "scheduled", lambda *_: None)
        monkeypatch.setattr(
            joint_counter, "read_manifest", lambda _: SimpleNamespace(state="recording")
        )
        monkeypatch.setattr(
            joint_counter.select,
            "select",
            lambda *_: ([] if next(looks, None) == 0 else [0], [], []),
        )
        monkeypatch.setattr(joint_counter.os, "read", lambda *_: b"")
        monkeypatch.setattr(joint_counter.time, "monotonic", lambda: next(clock))
        (tmp_path / "manifest.json").touch()
        joint_counter._count_until_final(tmp_path)
        return found

    return counts


def test_a_run_that_stands_still_is_counted_to_its_end_once(
    counted_through: Callable[[Sequence[int]], list[int | None]],
) -> None:
    assert counted_through([5, 6, 7, 8, 9]) == []
    assert counted_through([7] * 10) == [7]


def test_a_process_that_is_started_before_the_manifest_is_there_waits_for_it(
    tmp_path: Path,
) -> None:
    """Who watches a folder of runs sees a new run before anything is in it."""
    folder = create_run(tmp_path, "bench", time.time())
    counting = JointCounting(folder)
    time.sleep(1.5 * LOOK_S)
    counting.poll()
    assert counting.why is None
    write_manifest(folder, Manifest(folder.name))
    assert counting.last(WAIT_S) is not None
    counting.close()


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

    def expect_age(stepped_s: float) -> None:
        least_s = time.time() + stepped_s - recording.manifest.t0_utc - 49.9
        began = time.monotonic()
        age_s = count(recording.folder).age_s
        assert least_s - 0.1 <= age_s <= least_s + time.monotonic() - began + 0.1

    expect_age(0.0)
    recording.store.event(EventRow(now_us(), "clock.step", Severity.WARNING, "", value=-1000.0))
    recording.commit()
    expect_age(1000.0)


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
