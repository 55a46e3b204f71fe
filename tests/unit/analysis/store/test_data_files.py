"""Limits of a store's data files and checkpoints: what other programs write well is read, by
batches where its row groups are large; what is too much, or holds values that no table may, is
refused.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import jbclog
from jbclog.analysis.store import data_files, rows
from jbclog.analysis.store.parquet_sizes import sizes_of
from jbclog.analysis.store.place import place_of
from jbclog.analysis.store.reader import Store
from jbclog.app.publish.upkeep import compact
from jbclog.core.errors import RecordError, StoreError
from support.faults.store_bombs import WORD, data_file, told

ROWS = 300


def rewritten(store: Path, table: str, **columns: pa.Array | None) -> None:
    """The data file of a table with other columns (None: without it), as another program writes."""
    path = data_file(store, table)
    found = pq.ParquetFile(path).read()
    for name, values in columns.items():
        place = found.schema.get_field_index(name)
        found = found.remove_column(place)
        found = found if values is None else found.add_column(place, name, values)
    pq.write_table(found, path, compression="snappy", store_schema=False)
    told(store, table)


def test_large_row_groups_are_read_by_batches(
    store: Path, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rewritten(store, "samples", motor=None)
    monkeypatch.setattr(rows, "UNPACKED_ROWS", ROWS - 1)
    monkeypatch.setattr(rows, "BATCH_ROWS", 128)
    (read,) = jbclog.open_runs(store)
    pd.testing.assert_frame_equal(read.samples(), jbclog.open_run(run).samples())
    found = jbclog.open_runs(store).statistics(by=["run"])
    assert found["n"].tolist() == [read.samples()["temperature_c"].count()]


@pytest.mark.parametrize(
    ("table", "column", "values"),
    [
        ("samples", "time", pa.array([2**62] * ROWS, pa.timestamp("us", tz="UTC"))),
        ("samples", "tick", pa.array([2**63 - 1] * ROWS)),
        ("samples", "status", pa.array([b"\xff\xfe"] * ROWS).view(pa.utf8())),
        ("runs", "started", pa.array([2**62], pa.timestamp("us", tz="UTC"))),
        ("runs", "operator", pa.array([b"\xff\xfe"]).view(pa.utf8())),
        ("runs", "rules", pa.array([2**63 - 1])),
    ],
)
def test_values_that_no_table_may_hold(
    store: Path, table: str, column: str, values: pa.Array
) -> None:
    rewritten(store, table, **{column: values})
    with pytest.raises((RecordError, StoreError)) as refused:
        jbclog.open_runs(store)[0].samples()
    assert "\n" not in str(refused.value)


def test_a_file_is_looked_at_once_until_it_changes(
    store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = []
    measured = data_files.sizes_of
    monkeypatch.setattr(
        data_files, "sizes_of", lambda data: (looks.append(data), measured(data))[1]
    )
    for _ in range(2):
        assert len(Store(place_of(store)).runs()) == 1
    assert len(looks) == 1
    rewritten(store, "runs")
    assert len(Store(place_of(store)).runs()) == 1
    assert len(looks) == 2


def test_small_files_together_have_one_allowance(
    store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thousand bombs below the limit are one above it."""
    limits = {**data_files.LIMITS, "runs": data_files.Limits(1, 0, 1 << 30)}
    monkeypatch.setattr(data_files, "LIMITS", limits)
    looks = Store(place_of(store)).data_files("runs")
    path = str(data_file(store, "runs").relative_to(store / "runs"))
    looks.expect_bounded([path])
    with pytest.raises(StoreError, match="more than 1 rows"):
        looks.expect_bounded([path, path])


@pytest.mark.parametrize(
    ("texts", "why"), [([""] * 200_000, "rows in"), ([WORD] * 100, "unpacks to")]
)
def test_a_checkpoint_that_takes_too_much(store: Path, texts: list[str], why: str) -> None:
    log = store / "runs" / "_delta_log"
    pq.write_table(pa.table({"x": texts}), log / f"{1:020}.checkpoint.parquet", compression="zstd")
    for reads in (lambda place: Store(place).runs(), compact):
        with pytest.raises(StoreError, match=why):
            reads(place_of(store))


def test_the_library_s_own_checkpoint_is_read(store: Path) -> None:
    Store(place_of(store)).table("runs").create_checkpoint()
    assert [*(store / "runs" / "_delta_log").glob("*.parquet")] != []
    assert len(Store(place_of(store)).runs()) == 1


@pytest.mark.parametrize("encoding", ["PLAIN", "DELTA_LENGTH_BYTE_ARRAY", "DELTA_BYTE_ARRAY"])
def test_what_texts_take_is_no_less_than_they_do(tmp_path: Path, encoding: str) -> None:
    """In the last encoding each repeats the beginning of the one before: 2 MB of text in a page of
    10 kB.
    """
    path, texts = tmp_path / "a.parquet", pa.table({"name": ["x" * 10_000] * 200})
    pq.write_table(texts, path, use_dictionary=False, column_encoding={"name": encoding})
    with path.open("rb") as data:
        assert sizes_of(data).written(["name"]) >= 200 * 10_000
