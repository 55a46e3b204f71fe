"""Sealing: every row once, whole files or none, whatever fails in between."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from jbclog.core.errors import RecordError
from jbclog.core.locks import FolderLock
from jbclog.core.rows import TABLES
from jbclog.record.conclude import conclude
from jbclog.record.manifest import Manifest, read_manifest
from jbclog.record.schema import SCHEMAS
from jbclog.record.seal import seal_journal
from jbclog.record.seal_child import SealChild
from support.campaigns.awaited import SEALING_CHILD_ENDED
from support.records import few_rows


def concluded(folder: Path) -> Manifest:
    seal_journal(folder)
    return conclude(folder, Manifest(folder.name, exit_status="success"), FolderLock.take(folder))


def test_a_sealing_child_that_is_killed_is_a_problem_and_takes_no_row(tmp_path: Path) -> None:
    store = few_rows.begun(tmp_path)
    few_rows.hand_over(store, range(10))
    store.close()
    child = SealChild(store.folder, store.lock)
    os.kill(child.pid, signal.SIGKILL)
    assert child.wait() == f"{SEALING_CHILD_ENDED} -9"
    seal_journal(store.folder)
    assert few_rows.sealed_numbers(store.folder) == list(range(10))
    store.release()


def test_a_sealed_run_has_the_listed_files_and_nothing_else(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    manifest = concluded(folder)
    assert sorted(path.name for path in folder.iterdir()) == [
        "counters",
        "events",
        "manifest.json",
        "samples",
        "settings",
    ]
    assert {file.path for file in manifest.files} == {
        f"{table}/part-0000.parquet" for table in TABLES
    }
    assert [file.rows for file in manifest.files] == [150, 22, 1, 2]
    assert read_manifest(folder) == manifest
    assert manifest.state == "sealed"
    assert manifest.lost is None
    assert manifest.stop == "2026-09-21T14:13:34.900000Z"  # the last row


def test_a_table_without_rows_reads_like_the_others(tmp_path: Path) -> None:
    store = few_rows.begun(tmp_path)
    store.close()
    seal_journal(store.folder)
    conclude(store.folder, Manifest(store.folder.name), store.lock)
    for table in TABLES:
        frame = pd.read_parquet(store.folder / table)
        assert list(frame.columns) == SCHEMAS[table].names
        assert len(frame) == 0


def test_pandas_reads_parts_as_one_table_also_while_one_is_being_written(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    seal_journal(folder)
    (folder / "samples" / ".part-0001.parquet").write_bytes(b"PAR1 half written")
    assert len(pd.read_parquet(folder / "samples")) == 150


def test_sealing_twice_adds_nothing(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    seal_journal(folder)
    before = {path: path.read_bytes() for path in folder.rglob("*.parquet")}
    seal_journal(folder)
    assert {path: path.read_bytes() for path in folder.rglob("*.parquet")} == before
    concluded(folder)
    assert few_rows.sealed_numbers(folder) == list(range(150))


def test_a_journal_that_still_holds_rows_is_not_removed(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    lock = FolderLock.take(folder)
    with pytest.raises(RecordError, match="not sealed yet"):
        conclude(folder, Manifest(folder.name), lock)
    lock.release()
    assert (folder / "live-0000.journal").exists()


# -- the child -------------------------------------------------------------------------------------


def test_the_child_by_hand(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    command = [sys.executable, "-W", "error", "-m", "jbclog.record.seal", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert few_rows.sealed_numbers(folder) == list(range(150))


def test_the_child_is_refused_while_a_recorder_is_at_work(tmp_path: Path) -> None:
    store = few_rows.begun(tmp_path)
    command = [sys.executable, "-m", "jbclog.record.seal", str(store.folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 4
    assert "is being written by process" in done.stderr
    assert "Traceback" not in done.stderr
    store.close()
    store.release()


def test_the_child_loads_no_pandas(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    program = (
        f"import sys; from jbclog.record.seal import main; main([{str(folder)!r}]); print('pandas'"
        " in sys.modules)"
    )
    assert (
        subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, check=True
        ).stdout
        == "False\n"
    )


def test_the_manifest_lists_what_ran(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    (folder / "line.toml").write_text("x")
    (folder / "recipes").mkdir()
    (folder / "recipes" / "a.toml").write_text("y")
    files = {file.path: file for file in concluded(folder).files}
    assert (
        files["line.toml"].sha256
        == "2d711642b726b04401627ca9fbac32f5c8530fb1903cc4db02258717921a4881"
    )
    assert files["recipes/a.toml"].rows is None
    assert (
        json.loads((folder / "manifest.json").read_text())["files"][-1]["path"] == "recipes/a.toml"
    )
