"""Who looks on cannot hold a run: not by a terminal that is held, not by a pipe that nobody reads,
not by failing.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from jbclog.cli import progress
from jbclog.cli.progress import BackgroundObserver, Lines
from jbclog.core.rows import EventRow, Severity
from support.command import until

EVENT = EventRow(0, "station.error", Severity.ERROR, "text", "dde-1")


class Noted(Lines):
    """Notes what it is told; fails at every event."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def begun(self, folder: Path) -> None:
        self.told.append(f"begun {folder}")

    def happened(self, event: EventRow) -> None:
        self.told.append(event.kind)
        raise ValueError("a fault of its own")

    def sealing(self) -> None:
        self.told.append("sealing")

    def close(self) -> None:
        self.told.append("close")


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[int, int]]:
    """A pipe in the place of stderr."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    monkeypatch.setattr(progress, "STDERR", writing)
    monkeypatch.setattr(progress, "CLOSE_S", 60.0)  # the thread of a busy machine may be late
    yield reading, writing
    os.close(reading)
    os.close(writing)


def fill(writing: int) -> None:
    try:
        while True:
            os.write(writing, b"x" * 4096)
    except BlockingIOError:
        pass


def test_all_is_told_in_order_whatever_fails(pipe: tuple[int, int]) -> None:
    noted = Noted()
    shown = BackgroundObserver(noted)
    shown.begun(Path("x"))
    shown.happened(EVENT)
    shown.second([], [])
    shown.sealing()
    shown.close()
    assert noted.told == ["begun x", "station.error", "sealing", "close"]
    assert shown.missed() == 1  # the one that failed


def test_nobody_waits_for_a_stderr_that_takes_nothing(
    pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "CLOSE_S", 0.05)
    monkeypatch.setattr(progress, "LOOK_S", 0.01)
    fill(pipe[1])
    noted = Noted()
    shown = BackgroundObserver(noted)
    for _ in range(2 * progress.WAITING_MOST):
        shown.happened(EVENT)
    assert until(lambda: shown.missed() == 2 * progress.WAITING_MOST)
    shown.close()  # or it would wait for ever
    assert noted.told == []


def test_what_waited_is_told_when_somebody_reads_again(pipe: tuple[int, int]) -> None:
    fill(pipe[1])
    noted = Noted()
    shown = BackgroundObserver(noted)
    shown.happened(EVENT)
    os.read(pipe[0], 1 << 20)
    shown.close()
    assert noted.told == ["station.error", "close"]
