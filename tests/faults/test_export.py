"""Exports onto a full disk, and by a process that is killed: no partial export appears under its
name.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from support.command import jbclog
from support.faults.small_disk import small_disk
from support.product import HALF_AN_EXPORT
from support.records.sealed_run import samples, seal, station, table


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return seal(tmp_path_factory.mktemp("runs"), [station(rows=6000)], table(samples(6000)))


@pytest.mark.parametrize("to", ["csv", "xlsx", "mf4", "qdas"])
def test_a_full_disk_leaves_the_old_export_and_nothing_of_the_new_one(
    run: Path, tmp_path: Path, to: str
) -> None:
    with small_disk(tmp_path / "disk", "64k") as disk:
        out = disk / "out"
        if to in ("csv", "qdas"):
            out.mkdir()
        old = out / "old.csv" if out.is_dir() else out
        old.write_text("the old one")
        (disk / "ballast").write_bytes(b"x" * 48_000)
        ended = jbclog("export", run, "--to", to, "--out", out, "--force", "--unchecked")
        assert ended.returncode == 4, ended.stderr
        assert "cannot be written" in ended.stderr
        assert "nothing of it is left" in ended.stderr
        assert "Traceback" not in ended.stderr
        assert sorted(path.name for path in disk.iterdir()) == ["ballast", "out"]
        assert old.read_text() == "the old one"


def test_a_killed_export_leaves_the_old_one_as_it_was(tmp_path: Path) -> None:
    out = tmp_path / "run.xlsx"
    out.write_text("the old one")
    with subprocess.Popen(
        [sys.executable, "-c", HALF_AN_EXPORT, str(out)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "written\n"
        process.send_signal(signal.SIGKILL)
    deadline = time.monotonic() + 10
    while process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert out.read_text() == "the old one"
    aside = [path.name for path in tmp_path.iterdir() if path != out]
    assert len(aside) == 1
    assert aside[0].startswith(".run.xlsx.")
    assert aside[0].endswith(".tmp")
