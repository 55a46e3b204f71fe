"""The joints of a run that goes on: as many as its record has afterwards, and not known where they
are not known.
"""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from jbclog.analysis.joints.evidence import NOTHING_RECORDED
from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import joints_and_metrics
from jbclog.core.clock import SystemClock
from jbclog.core.rows import EventRow, Severity
from jbclog.live import Follower, RunState, joint_counter
from jbclog.live.joint_counter import ENDED_S, LOOK_S, count, rows_of
from jbclog.live.joint_numbers import ENDED, Counted, JointCounting, JointNumbers
from jbclog.record.folder import create_run
from jbclog.record.manifest import Manifest, write_manifest
from jbclog.record.seal import seal_journal
from jbclog.record.segments import SegmentWriter
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
    return int((joints["stop_s"] <= (recording.tick - 1) / 10 - ENDED_S).sum())


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


def test_rows_in_a_part_and_still_in_the_journal_are_read_once(recording: Soldering) -> None:
    """As between the completion of a part and the removal of its segment."""
    recording.solder(COMMIT)
    seal_journal(recording.folder)
    recording.solder(PART)
    assert sum(map(len, rows_of(recording.folder, "samples", ["tick"]))) == PART


def test_nothing_that_is_not_marked_is_counted(
    recording: Soldering, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording.solder(COMMIT)
    before = count(recording.folder)
    monkeypatch.setattr(SegmentWriter, "mark", lambda *_: None)
    recording.solder(ROWS)
    assert count(recording.folder).ports == before.ports
    assert count(recording.folder, is_last=True).ports != before.ports


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


@pytest.fixture
def pauses(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[list[int]], list[float]]:
    """Return the pauses of a process that finds these bytes in the journal at its looks, and of
    which each count takes 2 s.
    """

    def made(sizes: list[int]) -> list[float]:
        waited: list[float] = []
        seconds = itertools.count(0, 2)
        looks = iter(sizes)
        counted: list[Counted] = []

        def count(*_: object, **__: object) -> Counted:
            counted.append(Counted())
            return counted[-1]

        def wait(requests: object, most_s: float) -> None:
            waited.append(most_s)
            requests.are_over = len(waited) == len(sizes)  # type: ignore[attr-defined]

        monkeypatch.setattr(joint_counter._Requests, "wait", wait)
        monkeypatch.setattr(joint_counter, "_journal", lambda _: [("", next(looks))])
        monkeypatch.setattr("jbclog.live.joint_counter.time.process_time", lambda: next(seconds))
        monkeypatch.setattr(joint_counter, "count", count)
        (tmp_path / "manifest.json").touch()
        joint_counter._count_until_final(tmp_path)
        assert len(counted) == len(set(sizes))
        return waited

    return made


def test_counting_takes_a_bounded_share_of_a_core(
    pauses: Callable[[list[int]], list[float]],
) -> None:
    assert pauses([1, 2, 3]) == [pytest.approx(2 / joint_counter.SHARE)] * 3


def test_a_run_that_stands_still_is_counted_once(
    pauses: Callable[[list[int]], list[float]],
) -> None:
    assert len(pauses([7] * 10)) == 10


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
