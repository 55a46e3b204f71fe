"""Runs with a guard: started, stopped in the hardest ways, and what the virtual stations saw of it
afterwards.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from support.command import started, until
from support.product import ACTION_LOG_FILE, GUARD_PROCESS
from support.virtual.served_line import ServedLine

TOOLS = 6  # of a served line
TOLD_S = 5.0  # by then every tool has been made safe (docs/reference/faults.md, S-3)
# what was written just before may still be under way to a station on a busy machine
ON_THE_WIRE_S = 0.5
GUARD = GUARD_PROCESS


def begun(line: ServedLine, out: Path, *more: str) -> subprocess.Popen[str]:
    """A run of the whole line, without an end of its own, as quick as a busy machine allows."""
    return started("run", line.recipe, "--line", line.path, "--out", out, "--rate", "fit", *more)


@contextmanager
def running(line: ServedLine, out: Path, *more: str) -> Iterator[subprocess.Popen[str]]:
    """A run that has put all tools to work."""
    run = begun(line, out, *more)
    try:
        assert until(lambda: line.at_work() == TOOLS), run.communicate(timeout=5)
        yield run
    finally:
        run.kill()
        run.communicate(timeout=200)


def full_pipe() -> tuple[int, int]:
    """Both ends of a pipe that takes nothing any more, as a terminal that is held takes nothing."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writing, b"x" * 4096)
    os.set_blocking(writing, True)
    return reading, writing


def ended(run: subprocess.Popen[str]) -> str:
    """What it and its guard said, when both have ended."""
    return run.communicate(timeout=200)[1]


def events(folder: Path) -> list[str]:
    """The kinds of all events that are sealed."""
    import pandas as pd  # half a second, which tests without a guard do not wait for

    return list(pd.read_parquet(folder / "events")["kind"])


def actions_in(folder: Path) -> list[tuple[str, str, int | None, str]]:
    """Kind, severity, port and text of what the guard of this run wrote down; none without it."""
    log = folder / ACTION_LOG_FILE
    lines = log.read_text().splitlines() if log.exists() else ()
    rows = (json.loads(line) for line in lines if line)
    return [(row["kind"], row["severity"], row["port"], row["text"]) for row in rows]


def guard_of(recorder: int) -> int | None:
    """The process that guards this recorder."""
    for place in Path("/proc").iterdir():
        if place.name.isdigit() and _parent(place) == recorder and GUARD in _command(place):
            return int(place.name)
    return None


def guard_that_is_there(recorder: int, *, not_this: int | None = None) -> int:
    """Its guard, once there is one."""
    found: list[int] = []

    def is_there() -> bool:
        guard = guard_of(recorder)
        found[:] = [] if guard in (None, not_this) else [guard]  # type: ignore[list-item]  # not None
        return bool(found)

    assert until(is_there), "the run has no guard"
    return found[0]


def _parent(place: Path) -> int:
    try:
        return int((place / "stat").read_text().rpartition(")")[2].split()[1])
    except (OSError, ValueError, IndexError):
        return 0


def _command(place: Path) -> bytes:
    try:
        return (place / "cmdline").read_bytes()
    except OSError:
        return b""


@dataclass(frozen=True)
class Blow:
    """What was done to a recorder, and when (monotonic seconds)."""

    at: float
    number: signal.Signals

    @classmethod
    def strike(cls, recorder: subprocess.Popen[str], number: signal.Signals) -> Blow:
        at = time.monotonic()
        os.kill(recorder.pid, number)
        return cls(at, number)


def told_after(line: ServedLine, began: float, blow: Blow) -> float:
    """Assert that all that the run had written to when it was struck was told to be safe
    afterwards, and nothing else was written any more; give the seconds until the last of them was
    told.
    """
    orders = line.orders(began)
    after = [order for order in orders if order.at > blow.at]
    assert [
        order for order in after if not order.is_safe and order.at > blow.at + ON_THE_WIRE_S
    ] == []
    told = {}
    for order in reversed(after):
        if order.is_safe:
            told[order.station, order.port] = order.at - blow.at
    touched = {(order.station, order.port): order for order in orders if not order.is_safe}
    assert touched.keys() - told.keys() == set(), "never told to be safe"
    assert [order for place, order in touched.items() if order.at - blow.at > told[place]] == [], (
        "put to work again"
    )
    for station in {station for station, port in touched if port == 0}:
        assert all(
            told[station, 0] < seconds
            for (name, port), seconds in told.items()
            if name == station and port
        )
    assert max(told.values(), default=0.0) <= TOLD_S
    return max(told.values(), default=0.0)


def only_run(out: Path) -> Path:
    (folder,) = (path for path in out.iterdir() if path.is_dir())
    return folder


def guard_process(folder: Path) -> subprocess.Popen[bytes]:
    """A guard of this process, spoken to by hand."""
    command = [
        sys.executable,
        "-P",
        "-m",
        GUARD_PROCESS.decode(),
        str(folder),
        "--recorder",
        str(os.getpid()),
    ]
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
