"""Tables of several runs as people read them without jbclog: each row says its run, in the folder
of runs as in a published tree.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pyarrow.dataset as ds
import pytest

import jbclog
from jbclog.app.publish import publish
from jbclog.core.rows import TABLES
from jbclog.record.published import Tree
from support.lazy import duckdb
from support.lazy import polars as pl
from support.records import small_run

SECONDS = (10.0, 14.0)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs")
    for seconds in SECONDS:
        small_run.make_run(out, seconds)
    return out


@pytest.fixture(scope="module")
def tree(home: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("plant")
    for run in home.iterdir():
        publish(run, Tree.at(out))
    return out


def rows_of(home: Path, table: str) -> dict[str, int]:
    return {run.name: len(getattr(run, table)()) for run in jbclog.open_runs(home)}


@pytest.mark.parametrize("table", TABLES)
def test_pandas_reads_one_table_of_a_run(home: Path, table: str) -> None:
    run = jbclog.open_runs(home)[0]
    rows = pd.read_parquet(run.folder / table)
    pd.testing.assert_frame_equal(rows, getattr(run, table)())
    assert [*rows][:2] == ["run", "seq"]
    assert rows["run"].unique().tolist() == [run.name]
    whole = [name for name in rows if name in ("seq", "port", "temperature_c", "code", "nak")]
    assert all(pd.api.types.is_integer_dtype(rows[name]) for name in whole)
    if table == "samples":
        assert not (~rows["alarm_high"]).isna().all()  # a flag, not an object


def test_rows_of_several_runs_are_joined_and_grouped(home: Path) -> None:
    rows = pd.concat(run.samples() for run in jbclog.open_runs(home))
    assert rows["run"].dtype == jbclog.open_runs(home)[0].samples()["station"].dtype
    assert rows.groupby("run").size().to_dict() == rows_of(home, "samples")


@pytest.mark.parametrize("table", TABLES)
def test_one_table_of_all_runs(home: Path, table: str) -> None:
    files = f"{home}/*/{table}/*.parquet"
    expected = rows_of(home, table)
    asked = f"SELECT run, count(*) FROM '{files}' GROUP BY run"
    assert dict(duckdb.connect().execute(asked).fetchall()) == expected
    by_polars = pl.read_parquet(files).group_by("run").len()
    assert dict(by_polars.iter_rows()) == expected


@pytest.mark.parametrize("table", TABLES)
def test_one_table_of_a_published_tree(home: Path, tree: Path, table: str) -> None:
    expected = rows_of(home, table)
    assert len(expected) == len(SECONDS)
    whole = ds.dataset(tree / table, partitioning="hive").to_table()
    assert whole.to_pandas().groupby("run").size().to_dict() == expected
    asked = (
        f"SELECT run, line, count(*) FROM read_parquet('{tree}/{table}/**/*.parquet',"
        " hive_partitioning = true) GROUP BY ALL"
    )
    found = duckdb.connect().execute(asked).fetchall()
    assert {run: rows for run, _, rows in found} == expected
    assert {line for _, line, _ in found} == {"bench"}
    by_polars = pl.scan_parquet(tree / table, hive_partitioning=True).group_by("run").len()
    assert dict(by_polars.collect().iter_rows()) == expected
