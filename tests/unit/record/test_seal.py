"""Sealing: every row once, whole files or none, whatever fails in between."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jbclog.core.errors import RecordError
from jbclog.core.locks import FolderLock
from jbclog.core.rows import TABLES
from jbclog.record import parts
from jbclog.record.conclude import conclude
from jbclog.record.manifest import Manifest, read_manifest
from jbclog.record.parts import part_paths, part_through, through, write_part
from jbclog.record.schema import SCHEMAS
from jbclog.record.seal import seal_rows
from jbclog.record.seal_child import SealChild
from jbclog.record.store import Segment
from support.campaigns.awaited import SEALING_CHILD_ENDED
from support.records import few_rows


def concluded(folder: Path) -> Manifest:
    seal_rows(folder)
    return conclude(folder, Manifest(folder.name, exit_status="success"), FolderLock.take(folder))


def test_a_sealing_child_that_is_killed_is_a_problem_and_takes_no_row(tmp_path: Path) -> None:
    store = few_rows.begun(tmp_path)
    few_rows.hand_over(store, range(10))
    store.close()
    child = SealChild(store.folder, store.lock)
    os.kill(child.pid, signal.SIGKILL)
    assert child.wait() == f"{SEALING_CHILD_ENDED} -9"
    seal_rows(store.folder)
    assert few_rows.sealed_numbers(store.folder) == list(range(10))
    store.release()


def test_parts_are_encoded_as_measured(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    seal_rows(folder)
    (path,) = part_paths(folder, "samples")
    group = pq.read_metadata(path).row_group(0)
    by_name = {
        group.column(place).path_in_schema: group.column(place)
        for place in range(group.num_columns)
    }
    assert "DELTA_BINARY_PACKED" in by_name["time"].encodings
    assert "BYTE_STREAM_SPLIT" in by_name["temperature_c"].encodings
    assert "RLE_DICTIONARY" in by_name["station"].encodings
    assert {column.compression for column in by_name.values()} == {"ZSTD"}


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
    assert manifest.ended == "2026-09-21T14:13:34.900000Z"  # the last row


def test_a_table_without_rows_reads_like_the_others(tmp_path: Path) -> None:
    store = few_rows.begun(tmp_path)
    store.close()
    seal_rows(store.folder)
    conclude(store.folder, Manifest(store.folder.name), store.lock)
    for table in TABLES:
        frame = pd.read_parquet(store.folder / table)
        assert list(frame.columns) == SCHEMAS[table].names
        assert len(frame) == 0


def test_pandas_reads_parts_as_one_table_also_while_one_is_being_written(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    seal_rows(folder, part=True)
    (folder / "samples" / ".part-0001.parquet").write_bytes(b"PAR1 half written")
    assert len(pd.read_parquet(folder / "samples")) == 150


def test_sealing_twice_adds_nothing(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    seal_rows(folder)
    before = {path: path.read_bytes() for path in folder.rglob("*.parquet")}
    seal_rows(folder)
    seal_rows(folder, part=True)
    assert {path: path.read_bytes() for path in folder.rglob("*.parquet")} == before
    concluded(folder)
    assert few_rows.sealed_numbers(folder) == list(range(150))


def test_a_part_tells_the_last_batch_that_it_holds(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    last = seal_rows(folder)
    assert {through(folder, table) for table in TABLES} == {last}
    assert part_through(part_paths(folder, "samples")[0]) == last


@pytest.mark.parametrize(("last", "what"), [(None, "is missing"), (b"-1", "is b'-1', no number")])
def test_a_part_of_other_software_is_refused_with_the_key_that_it_lacks(
    tmp_path: Path, last: bytes | None, what: str
) -> None:
    """Such as one that a user filtered with pandas and wrote under its name."""
    path = tmp_path / "part-0000.parquet"
    metadata = None if last is None else {b"jbclog.through": last}
    pq.write_table(SCHEMAS["counters"].empty_table().replace_schema_metadata(metadata), path)
    with pytest.raises(RecordError) as refused:
        part_through(path)
    assert str(refused.value).startswith(f"{path} was not written by jbclog, or by other software")
    assert str(refused.value).endswith(f"jbclog.through (number of the last batch) {what}")


def test_a_live_store_that_still_holds_rows_is_not_removed(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    lock = FolderLock.take(folder)
    with pytest.raises(RecordError, match="not sealed yet"):
        conclude(folder, Manifest(folder.name), lock)
    lock.release()
    assert (folder / "live.sqlite").exists()


# -- what must never get a name --------------------------------------------------------------------


def test_what_reads_back_differently_is_not_a_part(tmp_path: Path) -> None:
    values = iter((1.0, 2.0))  # another one each time it is asked

    def groups() -> list[pa.Table]:
        row = {
            "time": 0,
            "station": "a",
            "port": 1,
            "counter": "c",
            "value": next(values),
            "unit": "h",
            "raw": "1",
        }
        return [pa.Table.from_pylist([row], schema=SCHEMAS["counters"])]

    with pytest.raises(RecordError, match="not what was written"):
        write_part(tmp_path, "counters", groups, 1)
    assert list((tmp_path / "counters").iterdir()) == []


@pytest.mark.parametrize("step", ["sync_file", "sync_folder", "_compare", "_write"])
def test_a_step_that_fails_leaves_no_half_part_and_can_be_done_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    def broken(*_: object) -> None:
        raise OSError(28, "No space left on device")

    folder = few_rows.abandoned(tmp_path)
    with monkeypatch.context() as failing:
        failing.setattr(parts, step, broken)
        with pytest.raises(RecordError, match="No space left"):
            seal_rows(folder)
    assert list(folder.rglob(".part*")) == []
    concluded(folder)
    assert few_rows.sealed_numbers(folder) == list(range(150))
    assert few_rows.sealed_events(folder) == list(range(0, 150, 7))


def interrupted_after(calls: int, real: Callable[..., object]) -> Callable[..., object]:
    left = [calls]

    def step(*arguments: object, **more: object) -> object:
        if not left[0]:
            raise sqlite3.OperationalError("interrupted")
        left[0] -= 1
        return real(*arguments, **more)

    return step


@pytest.mark.parametrize("transactions", range(3))
def test_batches_in_both_part_and_store_count_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, transactions: int
) -> None:
    """Deleting what was sealed is cut off after none, one, two of its transactions."""
    folder = few_rows.abandoned(tmp_path, commits=60, rows=5)
    with monkeypatch.context() as cut:
        cut.setattr(Segment, "_transaction", interrupted_after(transactions, Segment._transaction))
        with pytest.raises(RecordError, match="interrupted"):
            seal_rows(folder, part=True)
    manifest = concluded(folder)
    assert few_rows.sealed_numbers(folder) == list(range(300))
    assert few_rows.sealed_events(folder) == list(range(0, 300, 7))
    assert manifest.lost is None


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
