"""The queue and its journal, whatever ends how and whoever is killed when: pure, on a world of
plain values.
"""

from __future__ import annotations

import errno
import signal
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jbclog.app.batch.executor import BatchExecutor
from jbclog.app.batch.state import RECORDED, BatchState, EntryKind, State, batch_state, next_jobs
from jbclog.config.job_order import At, OnFailure, Turn, circle, in_turn, read_at
from jbclog.core.outcome import Exit
from support.faults.batch_world import CRASH, NIGHT, STILLBORN, Fate, Killed, World

STOP, SKIP, CONTINUE = OnFailure.STOP, OnFailure.SKIP, OnFailure.CONTINUE
FINE = Fate()
MOST_SITTINGS = 60


def turn(
    name: str,
    *places: str,
    after: tuple[str, ...] = (),
    on_failure: OnFailure = CONTINUE,
    at: At | None = None,
) -> Turn:
    return Turn(name, frozenset(places), after, on_failure, at)


def world(*turns: Turn, **fates: Fate) -> World:
    return World(list(turns), lambda name, attempt: fates.get(name, FINE) if attempt == 1 else FINE)


def states(of: World) -> dict[str, str]:
    return {name: job.state.value for name, job in batch_state(of.disk).jobs.items()}


def starts(of: World) -> list[str]:
    return [process.name for process in of.processes]


# -- whose turn it is ------------------------------------------------------------------------------


def test_on_one_station_jobs_come_in_turn_and_on_different_ones_side_by_side() -> None:
    bench = world(turn("a", "dde-1"), turn("b", "dde-1"), turn("c", "ucr-1"))
    assert bench.executor().work() is Exit.FINE
    assert starts(bench) == ["a", "c", "b"]
    assert [process.began - NIGHT for process in bench.processes] == [0, 0, 10]
    assert states(bench) == dict.fromkeys("abc", "done")


def test_a_job_on_several_stations_waits_for_all_and_keeps_its_place() -> None:
    bench = world(turn("a", "s1"), turn("both", "s1", "s2"), turn("c", "s2"))
    bench.executor().work()
    assert starts(bench) == ["a", "both", "c"]


def test_a_job_that_waits_for_one_behind_it_lets_it_go_first() -> None:
    bench = world(turn("last", "s1", after=("first",)), turn("first", "s1"))
    assert bench.executor().work() is Exit.FINE
    assert starts(bench) == ["first", "last"]


def test_a_circle_is_found_with_its_way() -> None:
    after = {"a": [], "b": ["a", "d"], "c": ["b"], "d": ["c"], "e": ["d"]}
    assert circle(after) in (["b", "d", "c", "b"], ["d", "c", "b", "d"], ["c", "b", "d", "c"])
    assert circle({"a": ["a"]}) == ["a", "a"]
    assert circle({"a": [], "b": ["a"]}) == []


def test_a_job_waits_for_its_time_and_holds_its_place() -> None:
    bench = world(turn("a", "s1", at=read_at("15:00")), turn("b", "s1"), turn("c", "s2"))
    bench.executor().work()  # the night begins at 14:13:20 UTC
    assert starts(bench) == ["c", "a", "b"]
    assert 0 <= bench.processes[1].began - (NIGHT + 2800) < 2


# -- what a failure means --------------------------------------------------------------------------


def test_stop_begins_nothing_more_and_lets_what_runs_run() -> None:
    bench = world(
        turn("a", "s1", on_failure=STOP), turn("b", "s2"), turn("c", "s1"), a=Fate(3, 2.0)
    )
    assert bench.executor().work() is Exit.STATION
    assert states(bench) == {"a": "failed", "b": "done", "c": "waiting"}
    assert bench.disk[-1].kind == EntryKind.CLOSE


def test_started_again_a_line_that_was_stopped_does_what_stopped_it_and_the_rest() -> None:
    bench = world(
        turn("a", "s1", on_failure=STOP), turn("b", "s2"), turn("c", "s1"), a=Fate(3, 2.0)
    )
    bench.executor().work()
    assert bench.executor().work() is Exit.FINE
    assert starts(bench) == ["a", "b", "a", "c"]
    assert states(bench) == dict.fromkeys("abc", "done")
    assert bench.disk[-1].kind == EntryKind.FINISH


def test_a_rejected_job_that_stopped_the_line_was_made_and_is_not_made_again() -> None:
    bench = world(turn("a", "s1", on_failure=STOP), turn("c", "s1"), a=Fate(1, 2.0))
    bench.executor().work()
    assert bench.executor().work() is Exit.NOT_FINE
    assert starts(bench) == ["a", "c"]


def test_skip_leaves_out_what_waits_for_it_and_what_waits_for_that() -> None:
    bench = world(
        turn("a", "s1", on_failure=SKIP),
        turn("b", "s1", after=("a",)),
        turn("c", "s1", after=("b",)),
        turn("d", "s1"),
        a=Fate(4),
    )
    assert bench.executor().work() is Exit.RECORD
    assert states(bench) == {"a": "failed", "b": "skipped", "c": "skipped", "d": "done"}
    assert bench.disk[-1].kind == EntryKind.FINISH


def test_continue_goes_on_as_if() -> None:
    bench = world(turn("a", "s1"), turn("b", "s1", after=("a",)), a=Fate(CRASH))
    assert bench.executor().work() is Exit.RECORD
    assert states(bench) == {"a": "half done", "b": "done"}


@pytest.mark.parametrize(
    ("ends", "code"),
    [((1, 3), 3), ((4, 3), 4), ((5, 4), 5), ((1, 0), 1), ((2, 0), 3), ((0, 0), 0), ((CRASH, 1), 4)],
)
def test_the_exit_code_is_the_most_severe(ends: tuple[int | str, int | str], code: int) -> None:
    bench = world(turn("a", "s1"), turn("b", "s2"), a=Fate(ends[0]), b=Fate(ends[1]))
    assert bench.executor().work() == code


def test_what_this_machine_could_not_start_is_no_fault_of_a_station() -> None:
    bench = world(turn("a", "s1"))

    def full(name: str) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    bench.watch = full
    assert bench.executor().work() is Exit.RECORD
    assert (
        batch_state(bench.disk).jobs["a"].text == "it could not be started: No space left on device"
    )


# -- cut short -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 143)]
)
def test_a_signal_ends_what_runs_and_begins_nothing_more(number: signal.Signals, code: int) -> None:
    bench = world(turn("a", "s1"), turn("b", "s1"))
    executor = bench.executor()
    executor.interrupt(number)
    bench.fates = lambda name, attempt: Fate(0, 100.0)
    assert executor.work() == code
    assert starts(bench) == []
    bench.watch = lambda name: executor.interrupt(number)
    executor = bench.executor()
    assert executor.work() == code
    assert states(bench) == {"a": "half done", "b": "waiting"}
    bench.watch, bench.fates = (lambda name: None), (lambda name, attempt: FINE)
    assert bench.executor().work() is Exit.FINE
    assert starts(bench) == ["a", "a", "b"]


@pytest.mark.parametrize("policy", OnFailure)
def test_the_only_job_cut_short_is_left_to_be_gone_on_with(policy: OnFailure) -> None:
    bench = world(turn("a", "s1", on_failure=policy), a=Fate(0, 100.0))
    executor = bench.executor()
    bench.watch = lambda name: executor.interrupt(signal.SIGTERM)
    assert executor.work() is Exit.TERMINATED
    assert bench.disk[-1].kind == EntryKind.CLOSE
    bench.watch = lambda name: None
    assert bench.executor().work() is Exit.FINE
    assert starts(bench) == ["a", "a"]


@pytest.mark.parametrize("policy", OnFailure)
@pytest.mark.parametrize("dies", [CRASH, STILLBORN])
def test_what_died_while_nobody_looked_is_told_and_done_again(policy: OnFailure, dies: str) -> None:
    bench = world(
        turn("a", "s1", on_failure=policy), turn("b", "s1", after=("a",)), a=Fate(dies, 30.0)
    )
    bench.kill_at = 6  # when it runs
    with pytest.raises(Killed):
        bench.executor().work()
    bench.go_on(60.0)
    assert bench.executor().work() is Exit.FINE
    assert starts(bench) == ["a", "a", "b"]
    told = [attempt.state.value for attempt in batch_state(bench.disk).jobs["a"].attempts]
    assert told == ["half done" if dies == CRASH else "failed", "done"]


def test_killed_before_it_could_tell_what_came_of_it_it_tells_it_and_does_nothing_again() -> None:
    bench = world(turn("a", "s1"), turn("b", "s1"), b=Fate(1))
    assert BatchExecutor.work(bench.executor()) is Exit.NOT_FINE  # and there it dies
    assert not batch_state(bench.disk).is_finished
    assert bench.executor().work() is Exit.NOT_FINE
    assert starts(bench) == ["a", "b"]
    assert batch_state(bench.disk).is_finished


def test_a_worse_end_wins_over_the_signal() -> None:
    bench = world(turn("a", "s1"), turn("b", "s2", after=("a",)), a=Fate(5, 1.0))
    bench.fates = lambda name, attempt: Fate(5, 1.0) if name == "a" else Fate(0, 50.0)
    executor = bench.executor()
    bench.watch = lambda name: executor.interrupt(signal.SIGINT) if name == "b" else None
    assert executor.work() is Exit.UNSAFE


# -- whatever ends how, whoever is killed when -----------------------------------------------------

NAMES = "abcdefg"
PLACES = ("s1", "s2", "s3")


@st.composite
def queues(draw: st.DrawFn) -> list[Turn]:
    names = draw(st.permutations(NAMES[: draw(st.integers(1, len(NAMES)))]))
    places = st.sets(st.sampled_from(PLACES), min_size=1).map(frozenset)
    found = []
    for name in names:
        # so there is no circle, and names may stand before what they wait for
        before = [one for one in names if one < name]
        after = (
            tuple(draw(st.lists(st.sampled_from(before), unique=True, max_size=2)))
            if before
            else ()
        )
        at = (
            read_at(draw(st.sampled_from(["14:20", "23:59", "02:30"])))
            if draw(st.integers(0, 5)) == 0
            else None
        )
        found.append(Turn(name, draw(places), after, draw(st.sampled_from(OnFailure)), at))
    return found


ENDS = st.builds(
    Fate, st.sampled_from([0, 0, 0, 1, 3, 4, 5, 143, CRASH, STILLBORN]), st.floats(0.5, 40.0)
)
MEANWHILE = st.tuples(st.sampled_from(["nothing", "time", "power cut"]), st.floats(0.0, 60.0))
Batch = tuple[list[Turn], list[Fate], list[int], tuple[str, float], int]
BATCHES = st.tuples(
    queues(),
    st.lists(ENDS, min_size=30, max_size=30),
    st.lists(st.integers(1, 40), max_size=8),
    MEANWHILE,
    st.integers(0, 300),
)


@settings(deadline=None, max_examples=40)
@given(BATCHES)
def test_each_job_comes_to_exactly_one_end_whatever_dies_when(batch: Batch) -> None:
    each_job_comes_to_one_end(*batch)


def each_job_comes_to_one_end(
    turns: list[Turn],
    ends: list[Fate],
    kills: list[int],
    meanwhile: tuple[str, float],
    signal_at: int,
) -> None:
    left = list(ends)
    bench = World(turns, lambda name, attempt: left.pop() if left else FINE)
    bench.watch = lambda name: expect_its_turn(bench, turns, name)
    for number in range(MOST_SITTINGS):
        bench.kill_at = bench.steps + kills.pop() if kills else None
        executor = bench.executor()
        if number == 2 and signal_at % 3 == 0:
            executor.interrupt(signal.SIGTERM)
        try:
            executor.work()
        except Killed:
            if meanwhile[0] == "power cut":
                bench.power_cut()
            bench.go_on(meanwhile[1] if meanwhile[0] != "nothing" else 0.0)
            continue
        assert not bench.running()
        if batch_state(bench.disk).is_finished:
            break
    assert bench.wrong == []
    expect_one_end_each(bench, turns)


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@settings(deadline=None, max_examples=4000)
@given(BATCHES)
def test_the_same_of_many_more(batch: Batch) -> None:
    each_job_comes_to_one_end(*batch)


def expect_its_turn(bench: World, turns: list[Turn], name: str) -> None:
    """A job begins when all that it comes after is over, when its time has come, and never on a
    line that was stopped.
    """
    state = batch_state(bench.disk)
    order = in_turn(turns)
    mine = next(one for one in order if one.name == name)
    for other in order[: order.index(mine)]:
        is_before = other.name in mine.after or other.places & mine.places
        if is_before and not state.jobs[other.name].is_over:
            bench.wrong.append(f"{name} began before {other.name} was over")
    for after in mine.after:
        policy = next(one.on_failure for one in turns if one.name == after)
        before = state.jobs[after].state
        if before is State.SKIPPED or (before not in (State.DONE,) and policy is SKIP):
            bench.wrong.append(f"{name} began after {after}, which is {before.value}")
    if bench.now < (state.jobs[name].due or 0.0):
        bench.wrong.append(f"{name} began before its time")
    if state.stopped_by:
        bench.wrong.append(f"{name} began when {state.stopped_by} had stopped the line")


def expect_one_end_each(bench: World, turns: list[Turn]) -> None:
    state = batch_state(bench.disk)
    assert state.is_finished
    assert bench.disk[-1].kind == EntryKind.FINISH
    done = Counter(process.name for process in bench.processes if process.comes_to in (0, 1))
    for one in turns:
        job = state.jobs[one.name]
        assert job.is_over
        assert done[one.name] == (job.state in RECORDED)  # nothing twice, nothing half done counted
        tried = [process for process in bench.processes if process.name == one.name]
        told = {attempt.number: attempt for attempt in job.attempts}
        assert {process.attempt for process in tried} <= set(told)
        for process in tried:
            recorded = told[process.attempt].state in RECORDED
            assert recorded == (process.comes_to in (0, 1))
        assert (job.state is State.SKIPPED) == (
            one.name in {entry.job for entry in bench.disk if entry.kind == EntryKind.SKIP}
        )


@settings(deadline=None, max_examples=8)
@given(queues(), st.lists(ENDS, min_size=30, max_size=30))
def test_killed_at_each_step_in_turn_it_comes_to_the_same_as_undisturbed(
    turns: list[Turn], ends: list[Fate]
) -> None:
    """With jobs that go on meanwhile: what was done, skipped and failed is the same as if nobody
    had been killed.
    """
    fates = {
        (name, number): ends[(NAMES.index(name) * 4 + number) % len(ends)]
        for name in NAMES
        for number in range(1, 40)
    }
    whole = World(turns, lambda name, attempt: fates[name, attempt])
    whole.executor().work()
    for kill_at in range(1, whole.steps + 1):
        bench = World(turns, lambda name, attempt: fates[name, attempt])
        bench.kill_at = kill_at
        with pytest.raises(Killed):
            bench.executor().work()
        bench.kill_at = None
        executor = bench.executor()
        executor.work()
        assert bench.wrong == []
        assert_goes_on(bench, executor.state)


def assert_goes_on(bench: World, state: BatchState) -> None:
    for job in state.jobs.values():
        assert not [
            process
            for process in bench.processes
            if process.name == job.name and process.ended is None
        ]
        recorded = [
            process
            for process in bench.processes
            if process.name == job.name and process.comes_to in (0, 1)
        ]
        assert len(recorded) == (job.state in RECORDED)
    assert state.is_finished or state.stopped_by is not None


@settings(max_examples=20)
@given(queues())
def test_something_can_always_begin_when_nothing_runs(turns: list[Turn]) -> None:
    bench = World(turns, lambda name, attempt: FINE)
    state = batch_state(bench.disk)
    assert next_jobs(in_turn(turns), state, now=1e12).begin
