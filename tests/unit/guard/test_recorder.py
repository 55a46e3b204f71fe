"""The recorder as its guard sees it: ended by what cannot be mistaken for another process."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from support.product import Recorder

SLEEP = [sys.executable, "-S", "-c", "import time; time.sleep(60)"]


@pytest.fixture
def other() -> Iterator[subprocess.Popen[bytes]]:
    """Some process that lives."""
    process = subprocess.Popen(SLEEP)
    yield process
    process.kill()
    process.wait()


@pytest.fixture(params=["descriptor", "number"])
def _way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """With descriptors of processes, and on a system that has none."""
    if request.param == "number":
        monkeypatch.delattr(os, "pidfd_open")


@pytest.mark.usefixtures("_way")
def test_a_parent_that_lives_is_killed_and_waited_for(
    other: subprocess.Popen[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "getppid", lambda: other.pid if other.poll() is None else 1)
    assert Recorder(other.pid).end(0.0, 5.0)
    assert other.wait(5) == -9


@pytest.mark.usefixtures("_way")
def test_one_that_ends_by_itself_in_time_is_not_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    process = subprocess.Popen([sys.executable, "-S", "-c", "input()"], stdin=subprocess.PIPE)
    monkeypatch.setattr(os, "getppid", lambda: process.pid if process.poll() is None else 1)
    recorder = Recorder(process.pid)
    process.communicate(b"\n")
    assert recorder.end(5.0, 0.0)
    assert process.returncode == 0


@pytest.mark.usefixtures("_way")
def test_a_number_that_is_another_processs_by_now_is_left_alone(
    other: subprocess.Popen[bytes],
) -> None:
    """This process is nobody's child of that number: the recorder has died, and the number was
    given away.
    """
    began = time.monotonic()
    assert Recorder(other.pid).end(60.0, 60.0)
    assert time.monotonic() - began < 30
    assert other.poll() is None


def test_a_number_that_is_nobodys_is_gone() -> None:
    process = subprocess.Popen([sys.executable, "-S", "-c", ""])
    process.wait()
    assert Recorder(process.pid).end(0.0, 0.0)
