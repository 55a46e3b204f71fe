"""The tables of a run as other programs read them, without jbclog: pandas, DuckDB and Polars, cell
by cell.

DuckDB gives a time with a zone in the session's zone, Polars and pandas in UTC; the moment is the
same.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pandas as pd
import pytest

from support.lazy import duckdb
from support.lazy import polars as pl
from support.product import STORED_SCHEMAS, STORED_TABLES, Run, open_run
from support.records import small_run

Cells = list[dict[str, object]]
Read = Callable[[Path], Cells]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """With drop-outs, nulls of every kind, two parts of samples."""
    return open_run(small_run.make_run(tmp_path_factory.mktemp("runs"), 40.0))


def told(run: Run, table: str) -> Cells:
    """What jbclog gives, in Python's own values; times as microseconds."""
    frame = {
        "samples": run.samples,
        "events": run.events,
        "settings": run.settings,
        "counters": run.counters,
    }[table]()
    return cells(frame.astype(object).where(frame.notna(), None).to_dict("records"))


def cells(rows: Cells) -> Cells:
    return [{name: plain(value) for name, value in row.items()} for row in rows]


def plain(value: object) -> object:
    if isinstance(value, datetime):
        assert value.tzinfo is not None
        away = value.astimezone(UTC) - datetime(1970, 1, 1, tzinfo=UTC)
        return (away.days * 86400 + away.seconds) * 1_000_000 + away.microseconds
    return value


def by_pandas(folder: Path) -> Cells:
    frame = pd.read_parquet(folder)
    return cells(frame.astype(object).where(frame.notna(), None).to_dict("records"))


def by_duckdb(folder: Path) -> Cells:
    found = (
        duckdb.connect().sql(f"SELECT * FROM read_parquet('{folder}/*.parquet')").to_arrow_table()
    )
    return cells(found.to_pylist())


def by_polars(folder: Path) -> Cells:
    return cells(pl.read_parquet(folder / "*.parquet").to_dicts())


def by_lazy_polars(folder: Path) -> Cells:
    return cells(pl.scan_parquet(folder).collect().to_dicts())


READERS = {
    "pandas": by_pandas,
    "DuckDB": by_duckdb,
    "Polars": by_polars,
    "Polars, lazily": by_lazy_polars,
}


@pytest.mark.parametrize("table", STORED_TABLES)
@pytest.mark.parametrize("reader", READERS)
def test_every_cell_of_every_table_is_the_same(run: Run, reader: str, table: str) -> None:
    expected = told(run, table)
    assert expected
    found = READERS[reader](run.folder / table)
    assert list(found[0]) == STORED_SCHEMAS[table].names
    assert found == expected


def test_nulls_are_nulls_and_not_zero(run: Run) -> None:
    samples = run.samples()
    nulls = {name: int(samples[name].isna().sum()) for name in samples}
    assert min(nulls["temperature_c"], nulls["setpoint_c"], nulls["alarm_high"]) > 0
    by_duck = (
        duckdb.connect().sql(f"SELECT * FROM '{run.folder}/samples/*.parquet'").to_arrow_table()
    )
    assert {name: by_duck[name].null_count for name in by_duck.column_names} == nulls
    assert pl.read_parquet(run.folder / "samples" / "*.parquet").null_count().to_dicts() == [nulls]


def test_types_and_the_zone_come_through(run: Run) -> None:
    schema = pl.read_parquet_schema(next((run.folder / "samples").iterdir()))
    types = (schema["time"], schema["tick"], schema["station"], schema["alarm_high"])
    assert types == (pl.Datetime("us", "UTC"), pl.Int64, pl.String, pl.Boolean)
    described = (
        duckdb.connect()
        .execute(f"DESCRIBE SELECT * FROM '{run.folder}/samples/*.parquet'")
        .fetchall()
    )
    by_name = {name: kind for name, kind, *_ in described}
    found = [by_name[name] for name in ("time", "tick", "station", "temperature_c", "alarm_high")]
    assert found == ["TIMESTAMP WITH TIME ZONE", "BIGINT", "VARCHAR", "BIGINT", "BOOLEAN"]


def test_a_question_in_sql_has_the_answer_that_pandas_gives(run: Run) -> None:
    asked = f"""
        SELECT station, port, count(temperature_c) AS n, avg(temperature_c) AS mean
        FROM '{run.folder}/samples/*.parquet' WHERE quality = 'ok' GROUP BY ALL ORDER BY ALL
    """
    samples = run.samples()
    by = samples[samples["quality"] == "ok"].groupby(["station", "port"])["temperature_c"]
    expected = [
        (station, port, n, pytest.approx(mean))
        for (station, port), n, mean in zip(by.groups, by.count(), by.mean(), strict=True)
    ]
    assert duckdb.connect().execute(asked).fetchall() == expected
    lazily = (
        pl.scan_parquet(run.folder / "samples")
        .filter(pl.col("quality") == "ok")
        .group_by("station", "port")
    )
    means = (
        lazily.agg(pl.len().alias("rows"), pl.col("temperature_c").mean().alias("mean"))
        .sort("station", "port")
        .collect()
    )
    assert means["mean"].to_list() == [row[3] for row in expected]


def test_pandas_needs_no_jbclog(run: Run) -> None:
    asked = (
        f"import pandas, sys; print(len(pandas.read_parquet({str(run.folder / 'samples')!r})),"
        " 'jbclog' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    assert done.stdout == f"{len(run.samples())} False\n"
