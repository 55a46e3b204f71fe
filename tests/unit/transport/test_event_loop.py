"""The reactor's event loop: calls in their order and at their moments, from any thread; errors come
out of it and lose nothing.
"""

from __future__ import annotations

import os
import select
import threading
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import cast

import pytest

from jbclog.app.run.plan import Plan
from jbclog.app.run.run_record import Observer
from jbclog.app.run.runner import conduct
from jbclog.core import clock
from jbclog.core.errors import UsageError
from jbclog.transport.event_loop import EventLoop, LoopLag

LONG_S = 30.0


@pytest.fixture
def loop() -> Iterator[EventLoop]:
    made = EventLoop()
    yield made
    made.close()


def ended_after(loop: EventLoop, seconds: float) -> None:
    """Run the loop for so long."""
    loop.call_later(seconds, loop.stop)
    loop.run_forever()


def ended_after_turns(loop: EventLoop, turns: int) -> None:
    """Run the loop for so many turns, however long they take."""

    def turn(left: int) -> None:
        if left:
            loop.call_soon(turn, left - 1)
        else:
            loop.stop()

    loop.call_soon(turn, turns)
    loop.run_forever()


def test_without_epoll_a_run_is_refused_before_anything_is_sent(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delattr(select, "epoll")
    plan = cast("Plan", None)  # not even looked at
    with pytest.raises(UsageError, match="needs epoll, which Linux has; here jbclog reads"):
        conduct(plan, tmp_path / "runs", cast("Observer", None))
    assert not (tmp_path / "runs").exists()


def test_calls_come_at_their_moments(loop: EventLoop) -> None:
    called: list[tuple[int, float]] = []
    begun = clock.elapsed()
    for number, after_s in enumerate((0.02, 0.01, 0.0105, 0.0201, -5.0)):
        loop.call_at(
            begun + after_s, lambda number=number: called.append((number, clock.elapsed()))
        )
    loop.wake_at(begun + 0.0202, lambda moment: called.append((5, moment)))
    ended_after(loop, 0.05)
    assert [number for number, _ in called] == [4, 1, 2, 0, 3, 5]
    assert all(
        at >= begun + after_s
        for (_, at), after_s in zip(called, (-5.0, 0.01, 0.0105, 0.02, 0.0201, 0.0202), strict=True)
    )
    assert called[-1][1] == begun + 0.0202  # told its own moment


def test_calls_for_soon_come_in_the_next_turn_in_their_order(loop: EventLoop) -> None:
    called: list[str] = []

    def first() -> None:
        called.append("first")
        loop.call_soon(called.append, "third")

    loop.call_soon(first)
    loop.call_soon(called.append, "second")
    ended_after_turns(loop, 2)
    assert called == ["first", "second", "third"]


def test_what_is_cancelled_is_not_called(loop: EventLoop) -> None:
    called: list[str] = []
    loop.call_soon(called.append, "soon").cancel()
    loop.call_later(0.001, called.append, "later").cancel()
    ended_after(loop, 0.01)
    assert called == []


def test_descriptors_are_watched_until_they_are_removed(loop: EventLoop) -> None:
    out, into = os.pipe()
    heard: list[bytes] = []

    def ready() -> None:
        heard.append(os.read(out, 1))
        if len(heard) == 3:
            loop.remove_reader(out)

    loop.add_reader(out, ready)
    os.write(into, b"abcde")
    ended_after_turns(loop, 9)
    assert heard == [b"a", b"b", b"c"]
    os.close(into)
    os.close(out)


def test_one_removed_by_another_in_the_same_turn_is_not_called(loop: EventLoop) -> None:
    pipes = [os.pipe() for _ in range(2)]
    called: list[int] = []

    def ready(number: int) -> None:
        called.append(number)
        for out, _ in pipes:
            loop.remove_reader(out)

    for number, (out, into) in enumerate(pipes):
        os.write(into, b"x")
        loop.add_reader(out, lambda number=number: ready(number))
    ended_after_turns(loop, 3)
    assert len(called) == 1
    for descriptor in sum(pipes, ()):
        os.close(descriptor)


def test_another_thread_wakes_it(loop: EventLoop) -> None:
    called: list[int] = []
    begun = clock.elapsed()

    def call() -> None:
        for number in range(1000):
            loop.call_soon_threadsafe(called.append, number)
        loop.call_soon_threadsafe(loop.stop)

    loop.call_later(LONG_S, loop.stop)
    thread = threading.Timer(0.02, call)
    thread.start()
    loop.run_forever()
    thread.join()
    assert clock.elapsed() - begun < LONG_S / 2
    assert called == list(range(1000))


def test_a_closed_one_says_so_to_other_threads() -> None:
    loop = EventLoop()
    loop.close()
    with pytest.raises(RuntimeError, match="closed"):
        loop.call_soon_threadsafe(print)


def test_an_error_comes_out_and_the_other_calls_are_made_next_time(loop: EventLoop) -> None:
    called: list[str] = []

    def fail() -> None:
        raise ZeroDivisionError

    for schedule in (
        loop.call_soon,
        lambda call, *arguments: loop.call_later(0.005, call, *arguments),
    ):
        called.clear()
        schedule(called.append, "before")
        schedule(fail)
        schedule(called.append, "after")
        with pytest.raises(ZeroDivisionError):
            loop.run_forever()
        ended_after(loop, 0.01)
        assert called == ["before", "after"]


def test_one_that_is_stopped_before_it_runs_does_not_wait(loop: EventLoop) -> None:
    begun = clock.elapsed()
    loop.call_later(LONG_S, loop.stop)
    loop.stop()
    loop.run_forever()
    assert clock.elapsed() - begun < LONG_S / 2


def test_waits_do_not_end_early_and_are_exact_to_a_part_of_a_millisecond() -> None:
    """epoll alone would be late by 0.7 ms each time; the best of many is not, on any machine."""
    loop, late = EventLoop(), list[float]()

    def ring(moment: float) -> None:
        late.append(clock.elapsed() - moment)
        loop.wake_at(clock.elapsed() + 0.0033, ring) if len(late) < 50 else loop.stop()

    loop.wake_at(clock.elapsed() + 0.0033, ring)
    loop.run_forever()
    loop.close()
    assert 0 <= min(late) < 0.0004


def test_the_lag_is_what_a_standing_loop_missed() -> None:
    loop = EventLoop()
    lag = LoopLag(loop)
    lag.start()
    seen = []

    def stand() -> None:
        begun = clock.elapsed()
        while clock.elapsed() < begun + 0.3:
            pass
        seen.append(lag.late_s(clock.elapsed()))

    loop.call_later(0.01, stand)
    loop.call_later(0.4, lambda: seen.append(lag.late_s(clock.elapsed())))
    ended_after(loop, 0.5)
    loop.close()
    assert seen[0] >= 0.2
    assert all(after >= before for before, after in pairwise(seen))  # it is kept
