"""A disk that fills while a run on it is followed: by a viewer, by one without write permission,
and by one that was stopped in the middle of a read.

docs/reference/faults.md, F-23. The recorder must not notice them, and they show what has happened.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import pytest

from support.command import until
from support.faults.guarded import TOLD_S, TOOLS, begun, only_run
from support.faults.small_disk import fill, small_disk
from support.oracles.invariants import Ended, violations
from support.product import (
    STOPPED_FOLLOWER,
    Follower,
    LiveCondition,
    LivePhase,
    RunState,
    bytes_kept_for_readers,
    check_run,
    open_run,
    read_manifest,
    recover_run,
)
from support.virtual.served_line import ServedLine
from support.virtual.station_log import heard_in

MOST_LOG: Final = 5 << 20
WAIT_S: Final = 60.0
NOBODY: Final = 65_534
ENDED = (LivePhase.CRASHED, LivePhase.FINALIZED)
LOOKING = """
import os, sys
from jbclog.live import Phase, follow
with follow(sys.argv[1]) as follower:
    follower.poll()  # late imports may be in a folder that only this user can read
os.setgid(int(sys.argv[2]))
os.setuid(int(sys.argv[2]))
with follow(sys.argv[1]) as follower:
    for run in follower.stream(0.1):
        if not run.ports:
            continue
        print(run.phase, *run.problems, flush=True)
        if run.phase in (Phase.CRASHED, Phase.FINALIZED):
            break
"""


@contextmanager
def process(code: str, *words: object) -> Iterator[subprocess.Popen[str]]:
    """Start a separate follower, which has begun to read."""
    command = [sys.executable, "-c", code, *map(str, words)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as one:
        try:
            assert one.stdout is not None
            assert one.stdout.readline(), one.stderr and one.stderr.read()
            yield one
        finally:
            one.kill()


class Watcher:
    """Looks at a run repeatedly; `log` is the largest log that it saw, `shown` the number of
    readings of each port that it has shown.
    """

    def __init__(self, follower: Follower) -> None:
        self._follower, self.log = follower, 0
        self.shown: dict[tuple[str, int], int] = {}

    def look(self) -> RunState | None:
        run = self._follower.poll()
        if run is None:
            return None
        self.log = max(self.log, bytes_kept_for_readers(run.folder))
        for port in run.ports:
            place = port.station, port.port
            self.shown[place] = max(self.shown.get(place, 0), port.coverage.obtained)
        return run

    def until_ended(self) -> RunState:
        end = time.monotonic() + WAIT_S
        while (run := self.look()) is None or run.phase not in ENDED or not run.is_whole:
            assert time.monotonic() < end, run
            if run is not None and run.phase is not LivePhase.RECORDING:
                assert LiveCondition.NORMAL not in {port.condition for port in run.ports}
            time.sleep(0.1)
        return run


@pytest.mark.usefixtures("own_state")
def test_a_disk_that_fills_while_the_run_is_followed(tmp_path: Path) -> None:
    with (
        ServedLine(tmp_path, logs=True) as line,
        TemporaryDirectory() as place,  # other users cannot read pytest's own folders
        small_disk(Path(place) / "disk", "24m") as disk,
    ):
        out = disk / "runs"
        out.mkdir()
        Path(place).chmod(0o755)
        run = begun(line, out)
        try:
            with Follower(out) as follower:
                watcher = Watcher(follower)
                assert until(
                    lambda: (
                        line.at_work() == TOOLS
                        and watcher.look() is not None
                        and len(watcher.shown) == TOOLS
                        and min(watcher.shown.values()) > 0
                    ),
                    WAIT_S,
                ), run.communicate(timeout=5)
                with (
                    process(LOOKING, out, NOBODY) as other,
                    process(STOPPED_FOLLOWER, out) as stopped,
                ):
                    filler = fill(disk)
                    last = watcher.until_ended()
                    told, wrong = other.communicate(timeout=WAIT_S)
                    assert stopped.poll() is None  # still in the middle of its read
                _, said = run.communicate(timeout=WAIT_S)
        finally:
            run.kill()
            run.communicate()
        assert (run.returncode, "full" in said) == (4, True), said
        assert until(lambda: line.at_work() == 0, TOLD_S)
        assert watcher.log < MOST_LOG
        assert LiveCondition.NORMAL not in {port.condition for port in last.ports}
        assert "full" in f"{last.problems} {[one.event.text for one in last.events]}"
        assert (wrong, told.splitlines()[-1].split()[0]) == ("", str(last.phase))
        folder = only_run(out)
        filler.unlink()
        recover_run(folder)
        assert line.log is not None
        assert violations(folder, heard_in(line.log, 0), ended=Ended(run.returncode, said)) == []
        assert check_run(folder) == []
        samples = open_run(folder).samples(columns=["station", "port", "temperature_c"])
        kept = samples.dropna().groupby(["station", "port"], observed=True).size()
        for place, shown in watcher.shown.items():  # everything shown was acknowledged, so it stays
            assert kept[place] >= shown
        assert read_manifest(folder).exit_status in ("failed", "lost")
