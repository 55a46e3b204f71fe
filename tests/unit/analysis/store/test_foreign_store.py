"""A store is anybody's folder: pipes and huge files in it are refused before the library opens
them, no link is followed, and nothing outside of it is read or deleted.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pytest
from deltalake import DeltaTable

from jbclog.analysis.opening import open_run
from jbclog.analysis.store.place import Place, place_of
from jbclog.analysis.store.reader import Store, expect_columns
from jbclog.app.publish.publisher import Publisher
from jbclog.app.publish.upkeep import check, compact, vacuum
from jbclog.core.errors import RecordError, StoreError
from jbclog.core.files import NotReadable
from support.command import jbclog

LONG_AGO_S = 1_000_000_000
HINT = "runs/_delta_log/_last_checkpoint"


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A folder that has nothing to do with the store, with files old enough for `vacuum`."""
    (tmp_path / "mine").mkdir()
    for name in ("thesis.parquet", "thesis.txt"):
        (tmp_path / "mine" / name).write_bytes(b"mine")
        os.utime(tmp_path / "mine" / name, (LONG_AGO_S, LONG_AGO_S))
    return tmp_path / "mine"


def data_file(store: Path, table: str) -> Path:
    return next((store / table).rglob("part-*.parquet"))


def put(path: Path, made: Callable[[Path], None]) -> None:
    path.unlink(missing_ok=True)
    made(path)


def one_gigabyte(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(1 << 30)


@pytest.mark.parametrize(
    "words",
    [["runs", "{}"], ["trend", "{}"], ["store", "compact", "{}"], ["store", "vacuum", "{}"]],
    ids=" ".join,
)
def test_no_command_waits_for_a_pipe(store: Path, words: list[str]) -> None:
    put(store / HINT, os.mkfifo)
    """In a process of its own: the library would wait in this one, deaf to signals."""
    ended = jbclog(*(word.format(store) for word in words))
    assert (ended.returncode, ended.stderr.count("\n")) == (4, 1)
    assert "_last_checkpoint" in ended.stderr or "is a pipe, not a file" in ended.stderr


@pytest.mark.parametrize("reads", [lambda place: Store(place).runs(), check, compact, vacuum])
@pytest.mark.parametrize(
    ("name", "made", "why"),
    [
        (HINT, lambda path: path.symlink_to("/dev/zero"), "is a link, not a file"),
        (HINT, one_gigabyte, "a hint at a checkpoint has at most"),
        ("runs/_delta_log/00000000000000000009.json", one_gigabyte, "a store's log has at most"),
        ("runs/_delta_log/00000000000000000009.json", os.mkfifo, "is a pipe, not a file"),
        ("runs/line=bench/pipe", os.mkfifo, "is a pipe, not a file"),
    ],
)
def test_what_is_no_file_is_refused(
    store: Path,
    reads: Callable[[Place], object],
    name: str,
    made: Callable[[Path], None],
    why: str,
) -> None:
    put(store / name, made)
    with pytest.raises(StoreError, match=why):
        reads(place_of(store))


def test_a_data_file_that_is_a_pipe_is_refused(store: Path) -> None:
    put(data_file(store, "runs"), os.mkfifo)
    with pytest.raises(StoreError, match="is a pipe, not a file"):
        Store(place_of(store)).runs()


def test_one_that_a_publisher_would_read_is_refused(store: Path, run: Path) -> None:
    put(data_file(store, "runs"), os.mkfifo)
    with pytest.raises(StoreError, match="is a pipe, not a file"):
        Store(place_of(store)).newest(run.name)


def test_check_removes_nothing_behind_a_link(store: Path, mine: Path) -> None:
    (mine / "abcdefabcdef" / "sub").mkdir(parents=True)
    (mine / "abcdefabcdef" / "sub" / "file").write_bytes(b"mine")
    os.utime(mine / "abcdefabcdef" / "sub" / "file", (LONG_AGO_S, LONG_AGO_S))
    shutil.rmtree(store / "_publishers")
    (store / "_publishers").symlink_to(mine)
    with pytest.raises(StoreError, match="is not a folder of its own"):
        check(place_of(store))
    assert (mine / "abcdefabcdef" / "sub" / "file").exists()


@pytest.mark.parametrize("where", ["samples/more", "samples/line=bench/more", "units/line=x"])
def test_vacuum_deletes_nothing_behind_a_link(store: Path, mine: Path, where: str) -> None:
    (store / where).parent.mkdir(exist_ok=True)
    (store / where).symlink_to(mine)
    with pytest.raises(StoreError, match="is a link, not a file"):
        vacuum(place_of(store))
    assert sorted(path.name for path in mine.iterdir()) == ["thesis.parquet", "thesis.txt"]


@pytest.mark.parametrize("table", ["runs", "samples", "samples/_delta_log", "_publishers"])
def test_nothing_is_written_behind_a_link(store: Path, mine: Path, run: Path, table: str) -> None:
    held = mine / "elsewhere"
    shutil.move(store / table, held)
    (store / table).symlink_to(held)
    before = sorted(held.rglob("*"))
    with (
        pytest.raises(StoreError, match="is not a folder of its own"),
        Publisher(place_of(store)) as publisher,
    ):
        publisher.publish(run)
    assert sorted(held.rglob("*")) == before


@pytest.mark.parametrize("path", ["../../pipe", "%2e%2e/%2e%2e/pipe", "line=bench/../../../pipe"])
def test_a_log_names_no_file_elsewhere(store: Path, path: str) -> None:
    os.mkfifo(store.parent / "pipe")
    log = store / "runs" / "_delta_log"
    added = {
        "path": path,
        "partitionValues": {"line": "bench", "month": "2026-11"},
        "size": 5000,
        "modificationTime": 1,
        "dataChange": True,
        "stats": '{"numRecords": 1}',
    }
    (log / f"{len([*log.glob('*.json')]):020}.json").write_text(json.dumps({"add": added}))
    for reads in (Store.runs, lambda store: store.newest("x")):
        with pytest.raises(StoreError, match="its log names a file elsewhere"):
            reads(Store(place_of(store)))


def test_a_run_without_its_manifest_is_refused(store: Path, run: Path) -> None:
    """The statistics in the log say that no file has it."""
    for path in (store / "runs" / "_delta_log").glob("*.json"):
        lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        for line in lines:
            if "add" in line:
                deep = '{"a":' * 100_000 + "1" + "}" * 100_000
                line["add"]["stats"] = f'{{"numRecords":1,"minValues":{deep}}}'
        path.write_text("\n".join(map(json.dumps, lines)), encoding="utf-8")
    with pytest.raises(RecordError, match="manifest is not in the store"):
        open_run(store / run.name)


@pytest.mark.parametrize("name", ["run", "version", "manifest_sha256", "operator", "tags"])
def test_rows_that_lack_a_column_or_a_value_are_refused(store: Path, name: str) -> None:
    rows = DeltaTable(store / "runs").to_pyarrow_table()
    expect_columns(rows)
    with pytest.raises(NotReadable, match=f"^runs has no column {name}$"):
        expect_columns(rows.drop_columns([name]))
    field = rows.schema.field(name)
    empty = rows.set_column(
        rows.schema.get_field_index(name),
        field.with_nullable(True),
        pa.nulls(len(rows), field.type),
    )
    if field.nullable:
        expect_columns(empty)
    else:
        with pytest.raises(NotReadable, match=f"^runs has rows without {name}$"):
            expect_columns(empty)


@pytest.mark.parametrize("between", ["\n", "", " \t"])
def test_a_commit_that_names_files_without_end_is_refused(store: Path, between: str) -> None:
    log = store / "runs" / "_delta_log"
    last = max(int(path.stem) for path in log.glob("*.json"))
    added = {
        "path": "x.parquet",
        "partitionValues": {"line": "a", "month": "b"},
        "size": 9,
        "modificationTime": 1,
        "dataChange": True,
    }
    line = json.dumps({"add": added}) + between
    (log / f"{last + 1:020}.json").write_text(line * 110_000, encoding="utf-8")
    with pytest.raises(
        StoreError, match=r"commits since the last checkpoint have 1[01]\d{4} lines"
    ):
        Store(place_of(store)).runs()
    # an incomplete checkpoint in parts is none: the library would read the commits all the same
    part = log / f"{last + 5:020}.checkpoint.0000000001.0000000002.parquet"
    shutil.copy(data_file(store, "runs"), part)
    with pytest.raises(StoreError, match="lines"):
        Store(place_of(store)).runs()
