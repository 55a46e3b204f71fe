"""A real run of virtual stations on real terminals, watched from another process with `jbclog.live`
and `jbclog watch`.
"""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.command import jbclog, started
from support.product import (
    DISCONNECTED,
    WATCH_NICENESS,
    Follower,
    LiveCondition,
    LivePhase,
    RunState,
    SimProcess,
    check_run,
    open_run,
)
from support.records.live_rows import Recording

WAIT_S = 120.0
LINE = """
[line]
name = "two"

[[station]]
name = "a"
url = "a"
family = "dde"
ports = [1]
[station.sim]
joints_per_minute = 30

[[station]]
name = "b"
url = "b"
family = "dde"
ports = [1]
[[station.sim.fault]]
kind = "dropout"
at_s = 10.0
for_s = 4.0
"""
RECIPE = """
[recipe]
name = "watched"
revision = 1
families = ["dde"]
[temperature]
select_c = 350
[sleep]
delay_min = 5
[hibernation]
delay_min = 30
[sampling]
rate_hz = 2
[run]
status = "working"
"""


@contextmanager
def running(home: Path, duration: str) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """Run `jbclog run` on two stations; yield the process and the folder of its runs."""
    (home / "two.toml").write_text(LINE)
    (home / "job.toml").write_text(RECIPE)
    (home / "runs").mkdir()
    with SimProcess(home / "two.toml", home / "bench") as stations:
        words = [
            "run",
            str(home / "job.toml"),
            "--line",
            str(stations.line_path),
            "--out",
            str(home / "runs"),
            "-d",
            duration,
        ]
        with started(*words) as process:
            try:
                yield process, home / "runs"
            finally:
                process.kill()
                process.communicate()


def until(follower: Follower, holds: Callable[[RunState], bool]) -> RunState:
    end = time.monotonic() + WAIT_S
    while (run := follower.poll()) is None or not holds(run):
        assert time.monotonic() < end, run
        time.sleep(0.1)
    return run


def test_a_run_from_its_start_to_its_report(tmp_path: Path) -> None:
    with running(tmp_path, "19s") as (process, runs), Follower(runs) as follower:
        until(
            follower,
            lambda run: (
                run.phase is LivePhase.RECORDING
                and [port.quality for port in run.ports] == ["ok"] * 2
            ),
        )
        run = until(follower, shows_loss)
        assert run.ports[1].condition is LiveCondition.STALE  # in the first update that shows it
        assert any(one.event.kind == "link.lost" for one in run.events)
        assert not run.ports[1].temperature.is_known
        until(  # and the other is shown as before; of a recorder that is late, a moment later
            follower,
            lambda run: (
                run.ports[1].condition is LiveCondition.STALE
                and run.ports[0].condition in (LiveCondition.NORMAL, LiveCondition.ATTENTION)
            ),
        )
        run = until(follower, lambda run: run.phase is LivePhase.FINALIZED and run.is_whole)
        _, told = process.communicate(timeout=WAIT_S)
        assert process.returncode in (0, 1), told
        assert {port.condition for port in run.ports} == {LiveCondition.ENDED}
        assert run.verdict is not None
        kept = open_run(run.folder)
        for port in run.ports:
            due = kept.manifest.ledger[port.station]["1"]["temperature_c"]
            assert (port.coverage.due, port.coverage.obtained) == (
                due["due"] - due.get("skipped", 0),
                due["ok"],
            )
        assert [one.event.kind for one in run.events] == kept.events()["kind"].tolist()
        assert check_run(run.folder) == []


def shows_loss(run: RunState) -> bool:
    """Whether the state shows in any way that b is lost; a late answer is no loss."""
    return run.ports[1].temperature.why == DISCONNECTED or any(
        one.event.kind == "link.lost" for one in run.events
    )


class Terminal:
    """`jbclog watch` in a pseudo-terminal."""

    def __init__(self, *words: str) -> None:
        child, self._terminal = pty.fork()
        if child == 0:
            os.environ |= {"TERM": "xterm-256color", "NO_COLOR": "1"}
            os.execv(sys.executable, [sys.executable, "-m", "jbclog", "watch", *words])
        self._child, self._shown = child, b""
        fcntl.ioctl(self._terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 100, 0, 0))

    @property
    def _seen(self) -> str:
        """The text so far; a read may end within a control sequence."""
        return re.sub(rb"\x1b\[[0-9;?]*[A-Za-z]", b"", self._shown).decode(errors="replace")

    def until(self, text: str) -> None:
        end = time.monotonic() + WAIT_S
        while text not in self._seen:
            assert time.monotonic() < end, self._seen[-2000:]
            if select.select([self._terminal], [], [], 0.5)[0]:
                self._shown += os.read(self._terminal, 65_536)

    def type(self, keys: str) -> None:
        os.write(self._terminal, keys.encode())

    def signal(self, number: signal.Signals) -> None:
        os.kill(self._child, number)

    def end(self) -> int:
        """Read the output to its end; return the exit code."""
        end = time.monotonic() + WAIT_S
        while time.monotonic() < end:
            ended, status = os.waitpid(self._child, os.WNOHANG)
            if ended:
                return os.waitstatus_to_exitcode(status)
            if select.select([self._terminal], [], [], 0.1)[0]:
                try:
                    os.read(self._terminal, 65_536)
                except OSError:  # the terminal is closed with its last user
                    time.sleep(0.05)
        raise AssertionError("it did not end")


def test_the_command_in_a_terminal(tmp_path: Path) -> None:
    with running(tmp_path, "60s") as (process, runs):
        terminal = Terminal(str(runs))
        terminal.until("a port 1")
        terminal.until("RECORDING")
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=WAIT_S)
        terminal.until("FINALIZED")
        terminal.type("q")
        assert terminal.end() == 0


def test_it_needs_a_terminal_and_a_folder(tmp_path: Path) -> None:
    done = jbclog("watch", str(tmp_path))
    assert (done.returncode, "needs a terminal" in done.stderr) == (2, True)
    done = jbclog("watch", str(tmp_path / "none"))
    assert (done.returncode, "no such folder" in done.stderr) == (2, True)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_the_command_serves_a_page(tmp_path: Path, number: signal.Signals, code: int) -> None:
    recording = Recording(tmp_path)
    recording.rows(3)
    recording.commit()
    with started("watch", tmp_path, "--web", "--port", "0") as process:
        assert process.stderr is not None
        address = re.search(r"http://127\.0\.0\.1:\d+/", process.stderr.readline())
        assert address is not None
        assert os.getpriority(os.PRIO_PROCESS, process.pid) == min(
            os.getpriority(os.PRIO_PROCESS, 0) + WATCH_NICENESS, 19
        )
        with urllib.request.urlopen(address[0] + "events", timeout=WAIT_S) as events:
            line = events.readline()
            while recording.folder.name.encode() not in line:
                line = events.readline()
            process.send_signal(number)
            assert events.read() is not None
        _, told = process.communicate(timeout=WAIT_S)
    assert (process.returncode, told) == (code, "")
    recording.abandon()


def test_another_address_comes_with_a_token(tmp_path: Path) -> None:
    with started("watch", tmp_path, "--web", "--port", "0", "--address", "0.0.0.0") as process:
        assert process.stderr is not None
        found = re.search(
            r"http://0\.0\.0\.0:(\d+)/\?token=([\w-]{20,});", process.stderr.readline()
        )
        empty = process.stderr.readline()
        process.kill()
    assert empty == f"no run in {tmp_path} yet; it is shown as soon as one begins\n"
    assert found is not None
    done = jbclog("watch", str(tmp_path), "--web", "--token", "short")
    assert (done.returncode, "16 ASCII characters or more (got 5)" in done.stderr) == (2, True)
