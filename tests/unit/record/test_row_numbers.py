"""`seq` and `run`: every row has the number that it was given when it came, in parts, in the store,
in a successor of a store that failed, and after a crash; a row that was lost leaves its number.
"""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from support.product import (
    STORED_TABLES,
    Manifest,
    RunStore,
    conclude_run,
    fail_next_commit,
    files_of_rows,
    lose_commit,
    open_run,
    part_paths,
    recover_run,
    seal,
    seal_part,
)
from support.records import few_rows
from support.records.few_rows import begun

WHOLE = 300


def hand_over(store: RunStore, rows: range) -> None:
    """Rows of every table."""
    few_rows.hand_over(store, rows)
    store.setting(few_rows.setting(rows.start))


def numbers(folder: Path, table: str) -> list[int]:
    rows = few_rows.table(folder, table)
    assert set(rows["run"].to_pylist()) == {folder.name}
    return list(map(int, rows["seq"].to_pylist()))


def concluded(store: RunStore) -> Path:
    store.close()
    seal(store.folder)
    conclude_run(store.folder, Manifest(store.folder.name, exit_status="success"), store.lock)
    return store.folder


def expect_whole(folder: Path) -> None:
    assert few_rows.sealed_numbers(folder) == [*range(WHOLE)]
    for table in STORED_TABLES:
        rows = numbers(folder, table)
        assert rows == [*range(len(rows))], table
    assert numbers(folder, "samples") == [*range(WHOLE)]


def test_rows_are_numbered_over_the_hours(tmp_path: Path) -> None:
    store = begun(tmp_path)
    for first in (0, 100, 200):
        hand_over(store, range(first, first + 100))
        store.commit_now()
        seal_part(store.folder)
    folder = concluded(store)
    assert len(part_paths(folder, "samples")) == 3
    expect_whole(folder)


def test_rows_are_numbered_on_in_the_successor_of_a_store_that_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = begun(tmp_path)
    hand_over(store, range(100))
    store.commit_now()
    hand_over(store, range(100, 200))
    fail_next_commit(monkeypatch)
    store.commit_now()
    hand_over(store, range(200, 300))
    store.commit_now()
    assert len(files_of_rows(store.folder)) == 2
    expect_whole(concluded(store))


def test_a_run_in_progress_has_run_and_seq_too(tmp_path: Path) -> None:
    store = begun(tmp_path)
    hand_over(store, range(100))
    store.commit_now()
    seal_part(store.folder)
    hand_over(store, range(100, WHOLE))
    store.commit_now()
    for table in STORED_TABLES:
        rows = getattr(open_run(store.folder), table)()
        assert set(rows["run"]) == {store.folder.name}
        assert rows["seq"].tolist() == [*range(len(rows))], table
    assert len(open_run(store.folder).samples()) == WHOLE
    expect_whole(concluded(store))


def test_what_a_crash_took_leaves_its_numbers(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    lose_commit(folder, "samples", 1)
    recover_run(folder)
    assert numbers(folder, "samples") == [*range(50), *range(100, 150)]
    assert few_rows.sealed_numbers(folder) == numbers(folder, "samples")


def test_numbers_and_the_run_cost_nearly_nothing(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path, commits=4, rows=5000)
    recover_run(folder)
    (path,) = part_paths(folder, "samples")
    with pq.ParquetFile(path) as part:
        group = part.metadata.row_group(0)
        sizes = {
            group.column(place).path_in_schema: group.column(place).total_compressed_size
            for place in (0, 1)
        }
    assert sizes["run"] < 200
    assert sizes["seq"] < 0.2 * 20_000
