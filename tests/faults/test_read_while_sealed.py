"""A run read at the moment it is sealed, as once an hour or at its end: each row once, no error."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

from jbclog.analysis.run import open_run
from jbclog.core.errors import RecordError
from jbclog.core.rows import TABLES
from jbclog.record.check import check
from jbclog.record.conclude import conclude
from jbclog.record.manifest import Manifest, write_manifest
from jbclog.record.recover import recover
from jbclog.record.seal import seal_journal
from support.faults.beside_sealing import READING, Sealing, meanwhile
from support.records import few_rows
from support.records.journals import journal

ROWS = 60
READER = """
import sys, warnings
from collections.abc import Callable
from pathlib import Path
from jbclog.analysis.run import open_run
from jbclog.record.manifest import read_manifest

warnings.simplefilter("error")
out, rows, looks = Path(sys.argv[1]), list(range(int(sys.argv[2]))), 0
(out / "ready").touch()
while not (out / "done").exists():
    for folder in sorted(path.parent for path in out.glob("2*/manifest.json"))[-1:]:
        try:
            ticks = list(open_run(folder).samples(columns=["tick"])["tick"])
        except Exception as error:
            sys.exit(f"{folder.name}, look {looks}: {type(error).__name__}: {error}")
        if ticks != rows:
            sys.exit(f"{folder.name}, look {looks}: {len(ticks)} rows")
        looks += 1
print(looks)
"""


@pytest.fixture(scope="module")
def closed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that its recorder has ended; nothing is sealed."""
    return few_rows.closed(tmp_path_factory.mktemp("closed"), ROWS, few_rows.facts())


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in its third segment; nothing is sealed."""
    commits = [(ROWS // 6, 1)] * 2
    folder = journal(tmp_path_factory.mktemp("recorded"), [commits] * 3).folder
    write_manifest(folder, Manifest(folder.name))
    return folder


def steps_of(run: Path, home: Path, *, is_open: bool) -> list[str]:
    sealing = Sealing(Path(shutil.copytree(run, home / run.name)), is_open=is_open)
    sealing()
    return sealing.told


@pytest.fixture(scope="module")
def closed_steps(closed: Path, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    return steps_of(closed, tmp_path_factory.mktemp("whole"), is_open=False)


@pytest.fixture(scope="module")
def hourly_steps(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    return steps_of(recorded, tmp_path_factory.mktemp("hourly"), is_open=True)


def test_the_steps_of_sealing_are_those_that_can_be_seen(
    closed_steps: list[str], hourly_steps: list[str]
) -> None:
    """Each part and its line; a segment goes when its parts have their lines, the last one when
    the manifest is there.
    """
    tables = len(TABLES)
    assert [step.split()[0] for step in closed_steps[: 2 * tables]] == ["replace", "add"] * tables
    assert "manifest.json" in closed_steps[2 * tables]
    assert closed_steps[2 * tables + 1 :] == [
        "unlink live-0000.journal",
        "unlink parts.jsonl",
        "unlink live.lock",
    ]
    of_segment = ["replace", "add"] * 2 + ["unlink"]
    assert [step.split()[0] for step in hourly_steps] == of_segment * 2


def sealed_meanwhile(
    run: Path, home: Path, step: str, until: int | None, *, is_open: bool, time: int = 1
) -> None:
    """Seal up to a step (None: to the end), after which the sealing process may have died, too."""
    folder = Path(shutil.copytree(run, home / f"{step}-{time}-{until}" / run.name))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with meanwhile(step, Sealing(folder, until, is_open), time):
            ticks = list(open_run(folder).samples(columns=["tick"])["tick"])
    assert ticks == list(range(ROWS)), (step, until)
    recover(folder)
    assert few_rows.sealed_numbers(folder) == list(range(ROWS)), (step, until)
    assert check(folder) == [], (step, until)
    assert list(folder.glob("live*")) == [], (step, until)


@pytest.mark.parametrize("step", READING)
def test_it_may_be_sealed_at_a_step_of_a_reader(
    closed: Path, closed_steps: list[str], tmp_path: Path, step: str
) -> None:
    """Completely, and up to every third step of sealing, at every third step of a reader."""
    first = [*READING].index(step) % 3
    for until in (*range(first, len(closed_steps), 3), None):
        sealed_meanwhile(closed, tmp_path, step, until, is_open=False)


@pytest.mark.parametrize("step", READING)
def test_segments_may_be_sealed_at_a_step_of_a_reader(
    recorded: Path, hourly_steps: list[str], tmp_path: Path, step: str
) -> None:
    first = [*READING].index(step) % 3
    for until in (*range(first, len(hourly_steps), 3), None):
        sealed_meanwhile(recorded, tmp_path, step, until, is_open=True)


@pytest.mark.parametrize("time", [1, 2, 3])
def test_segments_may_be_sealed_before_any_of_them_is_opened(
    recorded: Path, tmp_path: Path, time: int
) -> None:
    sealed_meanwhile(recorded, tmp_path, "open", None, is_open=True, time=time)


@pytest.mark.campaign
@pytest.mark.parametrize("is_open", [False, True], ids=["end", "hourly"])
@pytest.mark.parametrize("step", READING)
def test_it_may_be_sealed_at_any_step_of_a_reader(
    closed: Path,
    recorded: Path,
    closed_steps: list[str],
    hourly_steps: list[str],
    tmp_path: Path,
    step: str,
    is_open: bool,
    counted: Callable[..., None],
) -> None:
    run, steps = (recorded, hourly_steps) if is_open else (closed, closed_steps)
    for until in range(len(steps)):
        sealed_meanwhile(run, tmp_path, step, until, is_open=is_open)
    counted(steps=len(steps), wrong=0)


@pytest.mark.parametrize("step", ["list", "open", "chain", "segment", "manifest"])
def test_what_is_known_of_its_stations_is_not_lost_either(
    closed: Path, tmp_path: Path, step: str
) -> None:
    folder = Path(shutil.copytree(closed, tmp_path / closed.name))
    with meanwhile(step, Sealing(folder)):
        assert [facts.name for facts in open_run(folder).stations] == ["a"]


@pytest.mark.parametrize(
    "runs", [12, pytest.param(500, marks=[pytest.mark.campaign, pytest.mark.timeout(600)])]
)
def test_another_process_reads_without_pause_while_runs_are_sealed(
    tmp_path: Path, runs: int
) -> None:
    command = [sys.executable, "-c", READER, str(tmp_path), str(ROWS)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as reader:
        try:
            while not (tmp_path / "ready").exists() and reader.poll() is None:
                time.sleep(0.01)
            for _ in range(runs):
                store = few_rows.begun(tmp_path)
                few_rows.hand_over(store, range(ROWS))
                store.commit_now()
                write_manifest(store.folder, Manifest(store.folder.name))
                store.close()
                seal_journal(store.folder)
                conclude(store.folder, Manifest(store.folder.name), store.lock)
        finally:
            (tmp_path / "done").touch()
        looks, told = reader.communicate(timeout=200)
    assert (reader.returncode, told) == (0, "")
    assert int(looks) > 0
    assert [path for path in tmp_path.glob("2*") if check(path)] == []


def test_a_run_whose_folder_is_removed_meanwhile_is_not_looked_for_for_ever(
    closed: Path, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(closed, tmp_path / closed.name))
    with meanwhile("open", lambda: shutil.rmtree(folder)), pytest.raises(RecordError):
        open_run(folder).samples()
