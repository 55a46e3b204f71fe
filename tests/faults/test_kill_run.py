"""`jbclog run` and `jbclog recover`, really killed at random moments and at each step, while the
stations live on.

After each kill: no committed row is missing, at most the stated second of data is lost, sealed rows
equal stored rows, every event that was shown is recorded, a second recovery changes nothing, every
tool was ordered to stand within 5 s, and I1 to I9 hold (`invariants`). All runs of a series record
into one folder, and none may block the next. Seeds are printed. `test_kill.py` does the same to the
store alone, thousands of times.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from support import program
from support.campaigns.awaited import SEALING_CHILD_ENDED
from support.command import until
from support.faults import crash, killed_run
from support.faults.killed_run import (
    Death,
    differences,
    keepsake,
    killed,
    sealed_rows,
    told_and_not_kept,
    told_late,
)
from support.oracles.invariants import Ended, violations
from support.product import MAIN, SEALING_PROCESS, check_run, read_manifest, recover_run
from support.virtual.served_line import ServedLine
from support.virtual.station_log import heard_in

SEED = random.randrange(1 << 32)
LEAST_STEPS = 20  # in every recovery
DURATION_S = 2.0
LATEST_S = {"start": 1.5, "questions": DURATION_S + 1.5}
PROGRAM = [sys.executable, "-c", MAIN]


@dataclass
class Series:
    """Runs on one line into one folder, each killed and examined."""

    line: ServedLine
    home: Path
    wrong: list[str] = field(default_factory=list)
    looked: dict[str, int] = field(default_factory=dict)

    @property
    def out(self) -> Path:
        return self.home / "runs"

    def command(self, *program: str) -> list[str]:
        rest = [
            "run",
            self.line.recipe,
            "--line",
            self.line.path,
            "--out",
            self.out,
            "-d",
            f"{DURATION_S:g}s",
        ]
        return [*(program or PROGRAM), *map(str, rest)]

    def kill(
        self,
        what: str,
        command: list[str],
        is_time: Callable[[float], bool],
        notes: Path | None = None,
    ) -> Death:
        assert self.line.log is not None
        begin = self.line.log.stat().st_size
        death = killed(command, self.out, is_time)
        if notes is not None and notes.exists():
            death = Death(
                death.folder, death.began, float(notes.read_text()), death.code, death.said
            )
        found = self._found(death, begin)
        self.wrong += [f"{what}: {text}" for text in found]
        print(
            what,
            f"after {death.died - death.began:.3f} s:",
            *(found or ["nothing wrong"]),
            sep="\n    ",
        )
        return death

    def _found(self, death: Death, begin: int) -> list[str]:
        assert self.line.log is not None
        late = told_late(self.line, death)
        if death.folder is None:
            return (
                late
                if death.was_killed
                else [*late, f"it ended by itself, without a record: {death.said}"]
            )
        kept = keepsake(death.folder, self.home / "copies")
        recover_run(death.folder)
        once = crash.contents(death.folder)
        recover_run(death.folder)
        again = (
            []
            if crash.contents(death.folder) == once
            else ["recovered twice is not recovered once"]
        )
        sealed = sealed_rows(death.folder)
        empty = "" if sealed["samples"] else ", no samples"
        state = f"{read_manifest(death.folder).exit_status}{empty}"
        self.looked[state] = self.looked.get(state, 0) + 1
        ended = Ended(death.code, death.said)
        died_at = death.died if death.was_killed else None
        lost = violations(
            death.folder, heard_in(self.line.log, begin), ended=ended, died_at=died_at
        )
        shutil.rmtree(death.folder) if not (late or lost) else None
        return [
            *late,
            *differences(kept, sealed),
            *again,
            *told_and_not_kept(death.said, sealed),
            *lost,
        ]


@pytest.fixture
def series(line: ServedLine, tmp_path: Path) -> Series:
    return Series(line, tmp_path)


def at_random(
    series: Series, seed: int, count: int, phases: Sequence[str] = ("start", *3 * ["questions"])
) -> None:
    rng = random.Random(seed)
    for trial in range(count):
        phase = rng.choice(phases)
        moment = rng.random() * LATEST_S[phase]
        command = [*series.command(), *rng.choice([[], ["--capture"]])]
        series.kill(
            f"seed {seed}, trial {trial}, {phase} + {moment:.3f} s",
            command,
            _Moment(series.line, phase, moment),
        )
    print(f"{count} kills: {series.looked}")
    assert series.wrong == []


@dataclass
class _Moment:
    """A time after the start of the program, or after the first question to a station."""

    line: ServedLine
    phase: str
    seconds: float
    questions: int = -1
    asked: float | None = None

    def __call__(self, passed: float) -> bool:
        if self.phase == "start":
            return passed >= self.seconds
        if self.questions < 0:
            self.questions = self.line.questions()
        if self.asked is None and self.line.questions() > self.questions:
            self.asked = time.monotonic()
        return self.asked is not None and time.monotonic() >= self.asked + self.seconds


def at_steps(series: Series, first: int, stride: int, last: int = 10_000) -> int:
    """Kill it before its step FIRST, FIRST + STRIDE ..., until it ends by itself; return the number
    of kills.
    """
    kills = 0
    for step in range(first, last, stride):
        notes = series.home / f"death-{step}"
        command = program("faults.killed_run", step, notes)
        death = series.kill(
            f"step {step}", series.command(*command), lambda passed: passed > 60, notes
        )
        if not death.was_killed:
            break
        kills += 1
    print(f"kills at steps: {series.looked}")
    assert series.wrong == []
    return kills


def test_killed_at_random_moments(series: Series) -> None:
    at_random(series, SEED, 1, ["questions"])


@pytest.mark.campaign
def test_killed_at_a_step(series: Series) -> None:
    step = 4 + SEED % 60
    assert at_steps(series, step, 1, step + 1) == 1


@pytest.mark.campaign
def test_a_sealing_child_that_is_killed_loses_nothing(series: Series) -> None:
    """The recorder reports it and leaves the record unchanged; a recovery seals all of it."""
    assert series.line.log is not None
    begin = series.line.log.stat().st_size
    run = subprocess.Popen(
        series.command(), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    try:
        assert until(lambda: _kill_child(run.pid, SEALING_PROCESS), 30, 0.002)
    finally:
        _, said = run.communicate(timeout=200)
    (folder,) = killed_run.folders(series.out)
    assert run.returncode == 4, said
    assert f"{SEALING_CHILD_ENDED} -9" in said
    kept = keepsake(folder, series.home / "copies")
    recover_run(folder)
    assert differences(kept, sealed_rows(folder)) == []
    found = violations(folder, heard_in(series.line.log, begin), ended=Ended(run.returncode, said))
    assert found == []


def _kill_child(parent: int, name: bytes) -> bool:
    """Kill the child of `parent` with `name` in its command line; return whether there was one."""
    with suppress(OSError):
        for child in Path(f"/proc/{parent}/task/{parent}/children").read_text().split():
            if name in Path(f"/proc/{child}/cmdline").read_bytes():
                os.kill(int(child), signal.SIGKILL)
                return True
    return False


@pytest.fixture(scope="module")
def cut_off(
    line: ServedLine, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, killed_run.Rows]:
    """The folder of a run killed while it sampled, and the rows that a recovery makes of it."""
    home = tmp_path_factory.mktemp("cut-off")
    series = Series(line, home)
    death = killed([*series.command(), "--capture"], series.out, _Moment(line, "questions", 2.5))
    assert death.folder is not None
    copy = Path(shutil.copytree(death.folder, home / "copy" / death.folder.name))
    recover_run(copy)
    return death.folder, sealed_rows(copy)


def recover_killed(
    cut_off: tuple[Path, killed_run.Rows], home: Path, first: int, stride: int, last: int = 10_000
) -> int:
    """Kill `jbclog recover` before its step FIRST, FIRST + STRIDE ..., and recover again; return
    the number of kills.
    """
    base, expected = cut_off
    kills = 0
    for step in range(first, last, stride):
        folder = Path(shutil.copytree(base, home / str(step) / base.name))
        notes = home / f"death-{step}"
        command = program("faults.killed_run", step, notes, "recover", folder)
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=200)
        killed_it = done.returncode == -signal.SIGKILL
        assert killed_it or done.returncode in (0, 4, 5), done.stderr
        recover_run(folder)
        once = crash.contents(folder)
        recover_run(folder)
        assert (sealed_rows(folder), check_run(folder), crash.contents(folder)) == (
            expected,
            [],
            once,
        ), step
        shutil.rmtree(folder.parent)
        if not killed_it:
            break
        kills += 1
    return kills


def test_a_recovery_killed_at_a_step(cut_off: tuple[Path, killed_run.Rows], tmp_path: Path) -> None:
    step = 3 + SEED % LEAST_STEPS
    assert recover_killed(cut_off, tmp_path, step, 1, step + 1) == 1


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("part", range(2))
def test_a_recovery_killed_at_every_step(
    cut_off: tuple[Path, killed_run.Rows], tmp_path: Path, part: int, counted: Callable[..., None]
) -> None:
    kills = recover_killed(cut_off, tmp_path, 1 + part, 2)
    assert kills >= 20
    counted(kills_of_recovery=kills, violations=0)


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("part", range(6))
def test_killed_at_three_hundred_random_moments(
    series: Series, part: int, counted: Callable[..., None]
) -> None:
    at_random(series, SEED + part, 50)
    counted(kills=50, violations=len(series.wrong))


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("part", range(4))
def test_killed_at_every_step(series: Series, part: int, counted: Callable[..., None]) -> None:
    kills = at_steps(series, 1 + part, 4)
    assert kills >= 10
    counted(kills=kills, violations=len(series.wrong))
