"""A run read at the moment it is sealed: each row once, no error, and the reader leaves nothing
behind.
"""

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
from jbclog.record.check import check
from jbclog.record.conclude import conclude
from jbclog.record.manifest import Manifest, read_manifest, write_manifest
from jbclog.record.recover import recover
from jbclog.record.seal import seal_rows
from support.faults.beside_sealing import READING, Sealing, meanwhile
from support.records import few_rows

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
    return few_rows.closed(tmp_path_factory.mktemp("closed"), ROWS, few_rows.facts())


@pytest.fixture(scope="module")
def sealing_steps(closed: Path, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    sealing = Sealing(Path(shutil.copytree(closed, tmp_path_factory.mktemp("whole") / closed.name)))
    sealing()
    return sealing.told


def test_the_steps_of_sealing_are_those_that_can_be_seen(sealing_steps: list[str]) -> None:
    """Each part, then the manifest, then the store before its log and index, which nobody opens
    without it.
    """
    assert [step.split()[0] for step in sealing_steps[:5]] == ["replace"] * 5
    assert all(".part-0000.parquet" in step for step in sealing_steps[:4])
    assert "manifest.json" in sealing_steps[4]
    assert sealing_steps[5:] == [
        "unlink live.sqlite",
        "unlink live.sqlite-shm",
        "unlink live.sqlite-wal",
        "unlink live.lock",
    ]


def sealed_meanwhile(closed: Path, home: Path, step: str, until: int | None) -> None:
    """Seal up to a step (None: to the end), after which the sealing process may have died, too."""
    folder = Path(shutil.copytree(closed, home / f"{until}" / closed.name))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with meanwhile(step, Sealing(folder, until)) as done:
            ticks = list(open_run(folder).samples(columns=["tick"])["tick"])
    assert step in done
    assert ticks == list(range(ROWS)), (step, until)
    recover(folder)
    assert check(folder) == [], (step, until)
    assert list(folder.glob("live*")) == [], (step, until)


@pytest.mark.parametrize("step", READING)
def test_it_may_be_sealed_at_a_step_of_a_reader(
    closed: Path, sealing_steps: list[str], tmp_path: Path, step: str
) -> None:
    """Completely, and up to every third step of sealing, at every third step of a reader."""
    for until in (*range(READING.index(step) % 3, len(sealing_steps), 3), None):
        sealed_meanwhile(closed, tmp_path, step, until)


@pytest.mark.campaign
@pytest.mark.parametrize("step", READING)
def test_it_may_be_sealed_at_any_step_of_a_reader(
    closed: Path, sealing_steps: list[str], tmp_path: Path, step: str, counted: Callable[..., None]
) -> None:
    for until in range(len(sealing_steps)):
        sealed_meanwhile(closed, tmp_path, step, until)
    counted(steps=len(sealing_steps), wrong=0)


@pytest.mark.parametrize("step", [step for step in READING if step != "parts"])
def test_what_is_known_of_its_stations_is_not_lost_either(
    closed: Path, tmp_path: Path, step: str
) -> None:
    folder = Path(shutil.copytree(closed, tmp_path / closed.name))
    with meanwhile(step, Sealing(folder)):
        assert [facts.name for facts in open_run(folder).stations] == ["a"]


def test_a_reader_leaves_nothing_in_a_run_that_is_sealed_meanwhile(
    closed: Path, tmp_path: Path
) -> None:
    """SQLite makes a log and an index for a reader, too, and `check` would report them as
    leftovers.
    """
    folder = Path(shutil.copytree(closed, tmp_path / closed.name))

    def seal() -> None:
        Sealing(folder)()
        (folder / "live.sqlite-wal").touch()
        (folder / "live.sqlite-shm").write_bytes(bytes(32_768))

    with meanwhile("moment", seal):
        open_run(folder).samples()
    assert read_manifest(folder).state == "sealed"
    assert check(folder) == []


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
                seal_rows(store.folder)
                conclude(store.folder, Manifest(store.folder.name), store.lock)
        finally:
            (tmp_path / "done").touch()
        looks, told = reader.communicate(timeout=200)
    assert (reader.returncode, told) == (0, "")
    assert int(looks) > 0
    assert [path for path in tmp_path.glob("2*") if check(path)] == []
