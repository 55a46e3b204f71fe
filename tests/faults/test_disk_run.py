"""Real disks under real runs: full, read-only, taken away. The tools go to their safe state, and
the stored record is whole.

docs/reference/faults.md, F-23 and F-24. The stations survive, and their own logs decide what was
sent to them.
"""

from __future__ import annotations

import errno
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from jbclog.record.check import check
from jbclog.record.manifest import read_manifest
from jbclog.record.recover import recover
from support.command import is_sampling, jbclog, until
from support.faults.guarded import begun, only_run
from support.faults.killed_run import folders
from support.faults.small_disk import fill, small_disk
from support.oracles.invariants import Ended, violations
from support.virtual.served_line import ServedLine
from support.virtual.station_log import heard_in

pytestmark = pytest.mark.usefixtures("own_state")  # no other test is to name these disks
SEED = random.randrange(1 << 32)
TOOLS = 6
SAFE_S = 5.0  # from the first failed commit, which comes within a second


@contextmanager
def sampling(line: ServedLine, out: Path) -> Iterator[subprocess.Popen[str]]:
    """A run with all tools at work and rows in its record."""
    run = begun(line, out)
    try:
        assert until(lambda: line.at_work() == TOOLS and is_sampling(out)), run.communicate(
            timeout=5
        )
        yield run
    finally:
        run.kill()
        run.communicate()


def begin_of(line: ServedLine) -> int:
    assert line.log is not None
    return line.log.stat().st_size


def assert_made_safe(line: ServedLine) -> None:
    began = time.monotonic()
    assert until(lambda: line.at_work() == 0, SAFE_S + 1.0), "tools were left at work"
    print(f"all tools in their safe state {time.monotonic() - began:.2f} s later")


@pytest.mark.campaign
def test_a_disk_that_is_filled_while_the_run_goes_on(line: ServedLine, tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "24m") as disk:
        out, begin = disk / "runs", begin_of(line)
        with sampling(line, out) as run:
            filler = fill(disk)
            assert_made_safe(line)
            _, said = run.communicate(timeout=200)
        assert run.returncode == 4, said
        assert "full" in said
        folder = only_run(out)
        filler.unlink()
        recover(folder)
        assert line.log is not None
        assert (
            violations(folder, heard_in(line.log, begin), ended=Ended(run.returncode, said)) == []
        )
        manifest = read_manifest(folder)
        assert manifest.exit_status in ("failed", "lost")
        assert "record.failed" in said_in(folder) or manifest.lost is not None
        jbclog("run", line.recipe, "--line", line.path, "--out", out, "-d", "1s", "-s", "dde-1")
        (again,) = folders(out) - {folder}  # nothing blocks the next run
        assert (read_manifest(again).state, check(again)) == ("sealed", [])


# of each process of a short run: the recorder, its guard, the child that seals
MOST_OPERATIONS = 150


def failing(
    line: ServedLine, out: Path, library: Path, nth: int, error: int, again: int
) -> list[str]:
    """Record on a disk whose operation `nth` fails in each process of the run; return violations
    afterwards.
    """
    assert line.log is not None
    begin, began, before = begin_of(line), time.monotonic(), folders(out)
    settings = {
        "LD_PRELOAD": library,
        "FAILING_FOLDER": out,
        "FAILING_NTH": nth,
        "FAILING_ERROR": error,
        "FAILING_AGAIN": again,
    }
    command = [
        sys.executable,
        "-c",
        "from jbclog.cli import main; main()",
        "run",
        line.recipe,
        "--line",
        line.path,
    ]
    command += ["--out", out, "-d", "2s", "--capture"]
    environment = os.environ | {name: str(value) for name, value in settings.items()}
    run = subprocess.run(
        list(map(str, command)),
        capture_output=True,
        text=True,
        check=False,
        env=environment,
        timeout=60,
    )
    wrong = [] if line.at_work() == 0 else [f"unsafe: {line.at_work()} tools were left at work"]
    for folder in folders(out) - before:
        recover(folder)
        wrong += violations(
            folder, heard_in(line.log, begin), ended=Ended(run.returncode, run.stderr)
        )
    if run.returncode not in (0, 1, 3, 4) or (run.returncode == 3 and line.orders(began)):
        wrong.append(f"exit code {run.returncode}: {run.stderr}")
    return wrong


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("part", range(4))
def test_anything_fails_under_a_real_run(
    line: ServedLine, tmp_path: Path, failing_library: Path, part: int, counted: Callable[..., None]
) -> None:
    rng, found, out = random.Random(SEED + part), [], tmp_path / "runs"
    out.mkdir()
    for trial in range(25):
        nth, error, again = (
            rng.randint(1, MOST_OPERATIONS),
            rng.choice([errno.EIO, errno.ENOSPC]),
            rng.randint(0, 1),
        )
        wrong = failing(line, out, failing_library, nth, error, again)
        print(
            f"seed {SEED + part}, trial {trial}: operation {nth}, {errno.errorcode[error]}, again"
            f" {again}:",
            *(wrong or ["nothing wrong"]),
        )
        found += wrong
    assert found == []
    counted(real_runs_on_failing_disks=25, violations=0)


def said_in(folder: Path) -> list[str]:
    import pyarrow.parquet as pq

    return [
        kind
        for path in (folder / "events").glob("part-*")
        for kind in pq.read_table(path)["kind"].to_pylist()
    ]


def test_a_folder_that_is_removed_while_the_run_goes_on(line: ServedLine, tmp_path: Path) -> None:
    out = tmp_path / "runs"
    with sampling(line, out) as run:
        shutil.rmtree(only_run(out))
        assert_made_safe(line)
        _, said = run.communicate(timeout=200)
    assert run.returncode == 4, said
    assert "was removed during the run" in said
    assert "if it was deleted, nothing of it is left" in said
    assert "tries again" not in said
    assert "Traceback" not in said


def test_on_a_disk_that_is_read_only_no_station_is_asked(line: ServedLine, tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "8m") as disk:
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        before = line.questions()
        run = begun(line, disk / "runs")
        _, said = run.communicate(timeout=200)
        assert (run.returncode, line.questions()) == (4, before), said
        assert "Read-only file system. No station was touched." in said
