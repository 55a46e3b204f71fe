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

from support.command import is_sampling, jbclog, until
from support.faults.guarded import begun, only_run
from support.faults.killed_run import folders
from support.faults.small_disk import fill, small_disk, take_inodes
from support.oracles.invariants import Ended, violations
from support.product import MAIN, REFUSED_WITHOUT_INODES, check_run, read_manifest, recover_run
from support.virtual.served_line import ServedLine
from support.virtual.station_log import heard_in

pytestmark = pytest.mark.usefixtures("own_state")  # no other test is to name these disks
SEED = random.randrange(1 << 32)
TOOLS = 6
SAFE_S = 5.0  # from the first failed commit, which comes within a second


@contextmanager
def sampling(line: ServedLine, out: Path, *more: str) -> Iterator[subprocess.Popen[str]]:
    """A run with all tools at work and rows in its record."""
    run = begun(line, out, *more)
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
        recover_run(folder)
        assert line.log is not None
        assert (
            violations(folder, heard_in(line.log, begin), ended=Ended(run.returncode, said)) == []
        )
        manifest = read_manifest(folder)
        assert manifest.exit_status in ("failed", "lost")
        assert "record.failed" in said_in(folder) or manifest.lost is not None
        jbclog("run", line.recipe, "--line", line.path, "--out", out, "-d", "1s", "-s", "dde-1")
        (again,) = folders(out) - {folder}  # nothing blocks the next run
        assert (read_manifest(again).state, check_run(again)) == ("sealed", [])


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
        MAIN,
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
        recover_run(folder)
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
    folder = run_folder(said)
    assert findings_of(said) == [
        (
            f"exit 4: {folder} was removed during the run. If it was moved, `jbclog recover`"
            " finishes it where it is now; if it was deleted, nothing of it is left"
        )
    ]
    assert said.splitlines()[-1] == NEXT_GONE
    assert "Traceback" not in said


NEXT_GONE = "Next: jbclog recover FOLDER, if you moved the run there; if you deleted it, run again"


def run_folder(said: str) -> str:
    return said.splitlines()[0].removeprefix("recording into ")


def findings_of(said: str) -> list[str]:
    return [line for line in said.splitlines() if line.startswith("exit ")]


def test_a_run_that_was_moved_is_finished_where_it_is(line: ServedLine, tmp_path: Path) -> None:
    """Asked for a report, too: there is none of what is not finished, and the run's end is shown
    all the same.
    """
    out = tmp_path / "runs"
    with sampling(line, out, "--report") as run:
        there = only_run(out).rename(tmp_path / "elsewhere")
        assert_made_safe(line)
        _, said = run.communicate(timeout=200)
    assert run.returncode == 4, said
    assert said.splitlines()[-2:] == ["6 tools are in their safe state, as read back", NEXT_GONE]
    assert jbclog("recover", there).returncode == 5  # its tools were made safe after the move
    assert check_run(there) == []


# -- no inodes -------------------------------------------------------------------------------------

NO_INODES = "no inodes left on the disk at {} (`df -i`); remove old files from it"


@pytest.mark.parametrize(
    ("inodes", "what"),
    [
        (3, "{out} cannot hold a record"),
        (5, "{folder}/line.toml cannot be written"),
        *REFUSED_WITHOUT_INODES,
    ],
)
def test_without_inodes_no_station_is_asked(
    line: ServedLine, tmp_path: Path, inodes: int, what: str
) -> None:
    with small_disk(tmp_path / "disk", "30m", inodes) as disk:
        before, out = line.questions(), disk / "runs"
        _, said = begun(line, out).communicate(timeout=200)
        assert line.questions() == before
        folder = next(out.iterdir(), out)
        where = what.format(out=out, folder=folder)
        assert said.startswith(f"error: {where}: {NO_INODES.format(disk)}"), said
        assert len(said.splitlines()) == 1


def test_inodes_that_run_out_during_a_run_are_named_once_and_recover_is_next(
    line: ServedLine, tmp_path: Path
) -> None:
    with small_disk(tmp_path / "disk", "30m", 64) as disk:
        out = disk / "runs"
        with sampling(line, out, "--report") as run:
            fillers = take_inodes(disk)
            run.terminate()
            _, said = run.communicate(timeout=200)
        folder = only_run(out)
        assert run.returncode == 4, said
        assert [text for text in findings_of(said) if text.startswith("exit 4")] == [
            (
                f"exit 4: {folder} cannot be sealed: {NO_INODES.format(disk)};"
                f" `jbclog recover {folder}` tries again"
            )
        ]
        assert said.splitlines()[-1] == f"Next: jbclog recover {folder}"
        again = jbclog("recover", folder)
        assert again.returncode == 4
        assert NO_INODES.format(disk) in again.stdout + again.stderr
        shutil.rmtree(fillers)
        assert jbclog("recover", folder).returncode == 0
        assert check_run(folder) == []


def test_on_a_disk_that_is_read_only_no_station_is_asked(line: ServedLine, tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "8m") as disk:
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        before = line.questions()
        run = begun(line, disk / "runs")
        _, said = run.communicate(timeout=200)
        assert (run.returncode, line.questions()) == (4, before), said
        assert "Read-only file system. No station was touched." in said
