"""A recorder is killed or frozen while a station hears and its answers are lost: the guard orders
what was proven, tells the truth about it, and orders nothing else.

Assertions use what the virtual stations took and their physics.
"""

from __future__ import annotations

import random
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from jbclog.guard.continuity import ORDER_FOR_S
from support.command import until
from support.faults.guarded import (
    TOLD_S,
    TOOLS,
    Blow,
    actions_in,
    begun,
    ended,
    guard_of,
    only_run,
)
from support.virtual.served_line import ServedLine

pytestmark = pytest.mark.usefixtures("own_state")

Answers = Sequence[tuple[float, bytes]]
Loss = Callable[[Answers], Answers]


def all_of_them(_: Answers) -> Answers:
    return []


def nine_in_ten(answers: Answers) -> Answers:
    """Lose nine bytes in ten."""
    return [(at, bytes(byte for byte in data if random.random() < 0.1)) for at, data in answers]


def garbled(answers: Answers) -> Answers:
    """Strike one bit of every answer."""
    return [(at, data[:-3] + bytes([data[-3] ^ 1]) + data[-2:]) for at, data in answers]


@contextmanager
def lost(line: ServedLine, loss: Loss, *names: str) -> Iterator[None]:
    """Lose answers of these stations, of all if none is named, and keep their questions."""
    stations = [line.stations[name] for name in names or line.stations]
    for station in stations:
        hear = station.receive
        station.receive = lambda data, now, hear=hear: loss(hear(data, now))  # type: ignore[method-assign]
    try:
        yield
    finally:
        for station in stations:
            del station.receive  # type: ignore[method-assign]


@pytest.fixture
def line(tmp_path: Path) -> Iterator[ServedLine]:
    (tmp_path / "line").mkdir()
    with ServedLine(tmp_path / "line") as served:
        yield served


def at_work(line: ServedLine, out: Path) -> subprocess.Popen[str]:
    run = begun(line, out)
    assert until(lambda: line.at_work() == TOOLS), run.communicate(timeout=5)
    time.sleep(1.0)  # each status has been read
    return run


def guard_is_done(run: subprocess.Popen[str], guard: int) -> bool:
    return not Path(f"/proc/{guard}").exists()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["kill", "stop"])
@pytest.mark.parametrize("loss", [all_of_them, nine_in_ten, garbled])
def test_every_tool_is_ordered_to_stand_and_nobody_says_that_it_is_safe(
    line: ServedLine, tmp_path: Path, loss: Loss, number: signal.Signals
) -> None:
    run = at_work(line, tmp_path / "runs")
    guard = guard_of(run.pid)
    with lost(line, loss):
        blow = Blow.strike(run, number)
        assert until(lambda: line.at_work() == 0, 10.0), ended(run)
        assert time.monotonic() - blow.at < TOLD_S
        assert not line.motor("ale-1")
        time.sleep(ORDER_FOR_S + 1.0)
        orders = line.orders(blow.at + 0.5)
    run.communicate(timeout=200)
    folder = only_run(tmp_path / "runs")
    print(orders, actions_in(folder), guard)
    assert all(order.is_safe for order in orders)
