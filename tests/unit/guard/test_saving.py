"""A rescue is done once: by its thread, or here where the thread never begins."""

from __future__ import annotations

import _thread
import threading
from collections.abc import Callable

import pytest

from support.product import OnceInThread, patch


def started_nothing(work: Callable[[], None], arguments: tuple[()]) -> int:
    """As a thread that is refused memory on its first step: the system has started it, and nothing
    is done.
    """
    return 0


def refused(work: Callable[[], None], arguments: tuple[()]) -> int:
    raise RuntimeError("can't start new thread")


def test_a_thread_does_it_once(monkeypatch: pytest.MonkeyPatch) -> None:
    patch(monkeypatch, "takeover.BEGUN_S", 60.0)
    done: list[int] = []
    one = OnceInThread(lambda: done.append(threading.get_ident()))
    one.begin()
    one.do_unless_begun()
    one.await_done(60.0)
    assert len(done) == 1
    assert done != [threading.get_ident()]


@pytest.mark.parametrize("start", [started_nothing, refused])
def test_what_no_thread_begins_is_done_here(
    monkeypatch: pytest.MonkeyPatch, start: Callable[..., int]
) -> None:
    monkeypatch.setattr(_thread, "start_new_thread", start)
    patch(monkeypatch, "takeover.BEGUN_S", 0.02)
    done: list[int] = []
    several = [OnceInThread(lambda: done.append(threading.get_ident())) for _ in range(3)]
    for one in several:
        one.begin()
    for one in several:
        one.do_unless_begun()
        one.await_done(0.0)
    assert done == [threading.get_ident()] * 3


def test_one_that_hangs_is_not_awaited_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    patch(monkeypatch, "takeover.BEGUN_S", 60.0)
    hold = threading.Event()
    over: list[bool] = []

    def hang() -> None:
        hold.wait(60.0)
        over.append(True)

    one = OnceInThread(hang)
    one.begin()
    one.do_unless_begun()
    one.await_done(0.02)
    assert over == []
    hold.set()
    one.await_done(60.0)
    assert over == [True]


def test_one_that_breaks_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_thread, "start_new_thread", refused)
    patch(monkeypatch, "takeover.BEGUN_S", 0.0)

    def broken() -> None:
        raise ValueError("broken")

    one = OnceInThread(broken)
    with pytest.raises(ValueError, match="broken"):
        one.do_unless_begun()
    one.await_done(10.0)
