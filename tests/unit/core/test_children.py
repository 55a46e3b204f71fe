"""A child that takes longer to end than anybody waits."""

from __future__ import annotations

import subprocess
import threading
from typing import cast

from jbclog.core.children import await_end, kill


class SlowToEnd:
    """A process that ends some time after it was killed."""

    def __init__(self) -> None:
        self.is_killed = False
        self.is_waited_for = threading.Event()
        self.has_ended = threading.Event()

    def kill(self) -> None:
        self.is_killed = True

    def wait(self, timeout: float | None = None) -> int:
        if timeout is None:
            self.is_waited_for.set()
        if not self.has_ended.wait(timeout):
            raise subprocess.TimeoutExpired("", timeout or 0.0)
        return -9


def test_its_end_is_awaited_beside_whoever_killed_it() -> None:
    child = SlowToEnd()
    kill(cast("subprocess.Popen[bytes]", child), 0.01)  # returns
    assert child.is_killed
    assert child.is_waited_for.wait(30.0)
    child.has_ended.set()


def test_one_that_was_told_to_end_is_not_killed_and_awaited_as_well() -> None:
    child = SlowToEnd()
    await_end(cast("subprocess.Popen[bytes]", child), 0.01)
    assert not child.is_killed
    assert child.is_waited_for.wait(30.0)
    child.has_ended.set()


def test_one_that_ends_at_once_needs_no_thread() -> None:
    child = SlowToEnd()
    child.has_ended.set()
    kill(cast("subprocess.Popen[bytes]", child), 30.0)
    assert child.is_killed
    assert not child.is_waited_for.is_set()
