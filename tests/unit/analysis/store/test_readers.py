"""Every reader of many runs takes a store, and says what it says of the same runs in a folder."""

from __future__ import annotations

import json
import re
from importlib.util import find_spec
from pathlib import Path

import pandas as pd
import pytest
from deltalake import DeltaTable

import jbclog
from jbclog.analysis.store.place import Place
from jbclog.analysis.store.reader import Store
from jbclog.analysis.store.schema import DATA
from jbclog.analysis.trend import trends
from jbclog.core.errors import RecordError, UsageError
from support.invoked import invoked
from support.lazy import duckdb
from support.lazy import polars as pl
from support.readers.texts import ROOT
from support.records.many_runs import many_runs, one_run, told
from support.records.plant_store import published

RUNS = 4


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs")
    many_runs(out, [0.2, 0.9, -0.4], metadata=told(order="88123", tips=["T-1"]))
    one_run(out, RUNS - 1)
    return out


@pytest.fixture(scope="module")
def place(home: Path, tmp_path_factory: pytest.TempPathFactory) -> Place:
    return published(tmp_path_factory.mktemp("plant") / "store", home)


def said(*words: object) -> dict[str, object]:
    ended = invoked(*words, "--json")
    assert ended.exit_code == 0, ended.output
    return json.loads(ended.stdout)


def test_the_same_runs_with_the_same_facts(home: Path, place: Place) -> None:
    here, there = jbclog.open_runs(home), jbclog.open_runs(place.url)
    pd.testing.assert_frame_equal(
        there.manifests().drop(columns="folder"), here.manifests().drop(columns="folder")
    )
    assert [run.manifest for run in there] == [run.manifest for run in here]
    assert there[0].place == f"{place}/{here[0].name}"


@pytest.mark.parametrize(
    "wanted",
    [
        {"order": "88123"},
        {"line": "bench", "since": "2026-09-21T07:30", "until": "2026-09-21T08:30"},
        {"line": "ben*"},
        {"line": "other"},
        {"since": "2026-10-01", "until": "2026-11-01"},
        {"station": "dde-1", "recipe": "sn100c-tht@7"},
    ],
)
def test_filters_find_the_same(home: Path, place: Place, wanted: dict[str, str]) -> None:
    names = [run.name for run in jbclog.open_runs(home, **wanted)]
    assert [run.name for run in jbclog.open_runs(place.url, **wanted)] == names


def test_an_unknown_filter_is_an_error(place: Place) -> None:
    with pytest.raises(UsageError, match="colour"):
        jbclog.open_runs(place.url, colour="red")


def test_metrics_joints_and_samples_of_all(home: Path, place: Place) -> None:
    here, there = jbclog.open_runs(home), jbclog.open_runs(place.url)
    pd.testing.assert_frame_equal(there.metrics(), here.metrics())
    pd.testing.assert_frame_equal(there.joints("dde-1"), here.joints("dde-1"))
    wanted = {
        "columns": ["tick", "temperature_c"],
        "station": "dde-1",
        "start": "2026-09-21T14:13:25",
    }
    pd.testing.assert_frame_equal(
        *(pd.concat(runs.samples(**wanted), ignore_index=True) for runs in (here, there))
    )
    with pytest.raises(UsageError, match="no station"):
        there[0].samples("dde-9")


@pytest.mark.parametrize("metric", ["idle_error_c", "recovery_s"])
def test_the_same_trend(home: Path, place: Place, metric: str) -> None:
    here, there = (trends(jbclog.open_runs(folder), metric) for folder in (home, place.url))
    assert [one.points for one in here] != []
    assert [one.points for one in there] == [one.points for one in here]
    by_command = (
        said("trend", folder, "--metric", metric)["trends"] for folder in (home, place.url)
    )
    assert next(by_command) == next(by_command)


def test_the_same_list(home: Path, place: Place) -> None:
    here, there = (invoked("runs", folder).stdout for folder in (home, place.url))
    assert there.replace(place.url, "") == here.replace(str(home), "")
    assert len(there.splitlines()) == RUNS + 1


def test_the_same_comparison(home: Path, place: Place) -> None:
    names = [run.name for run in jbclog.open_runs(home)][:2]
    here, there = (
        said("compare", *(f"{folder}/{name}" for name in names)) for folder in (home, place.url)
    )
    assert (there.pop("first"), there.pop("second")) == tuple(f"{place}/{name}" for name in names)
    assert [here.pop("first"), here.pop("second")] != []
    assert there == here


@pytest.mark.parametrize("one", [True, False])
def test_the_same_charts(home: Path, place: Place, one: bool) -> None:
    name = f"/{jbclog.open_runs(home)[0].name}" if one else ""
    metric = "dwell_s" if one else "idle_error_c"
    here, there = (
        invoked("chart", f"{folder}{name}", "--metric", metric) for folder in (home, place.url)
    )
    assert (there.exit_code, there.output) == (
        here.exit_code,
        here.output.replace(str(home), place.url),
    )
    assert here.exit_code != 2, here.output


def test_the_same_uses_of_a_tip(home: Path, place: Place) -> None:
    words = ("--station", "dde-1", "--since", "2026-09-21T07:30")
    here, there = (said("where-used", folder, *words) for folder in (home, place.url))
    for found in (here, there):
        for one in found["runs"]:
            one["run"] = Path(one["run"]).name
    assert here["runs"] != []
    assert there == here


def test_a_store_has_no_verifications(place: Place) -> None:
    ended = invoked("where-used", place.url, "--station", "dde-1")
    assert ended.exit_code == 2
    assert "--verifications" in ended.output


def test_a_run_that_is_not_there_is_named(place: Place) -> None:
    with pytest.raises(RecordError, match="no run 20260101T000000Z-bench-aaaa"):
        jbclog.open_run(f"{place}/20260101T000000Z-bench-aaaa")


def test_a_run_is_read_from_its_own_files(place: Place) -> None:
    """The files of other runs are not opened."""
    store = Store(place)
    one, *_ = store.runs()
    assert len(store._fragments("samples", one, pc_publication(one.record))) == 1
    assert len([*store.dataset("samples").get_fragments()]) == RUNS


def test_a_run_is_looked_up_in_its_own_file(place: Place, home: Path) -> None:
    """And not among all files of `runs`, of which a large store has thousands. It says the same."""
    store = Store(place)
    for one in store.runs():
        assert len([*store._with_run(one.identity.run).get_fragments()]) == 1
        assert store.newest(one.identity.run) == one
    assert len([*store.dataset("runs").get_fragments()]) == RUNS
    assert store.newest("20260101T000000Z-bench-aaaa") is None


def pc_publication(name: str) -> object:
    import pyarrow.compute as pc

    return pc.field("publication") == name


# -- other programs --------------------------------------------------------------------------------


def expected(home: Path) -> list[tuple[str, int, object]]:
    found = pd.concat(jbclog.open_runs(home).samples(columns=["tick", "temperature_c"]))
    rows = found.astype(object).where(found.notna(), None).itertuples(index=False)
    return [tuple(row) for row in rows]


def test_duckdb(home: Path, place: Place) -> None:
    """By the query of the page. DuckDB's own extension for Delta Lake is a download, so `deltalake`
    hands the tables over.
    """
    connection = duckdb.connect()
    for name in ("samples", "runs"):
        connection.register(name, DeltaTable(place.of(name)).to_pyarrow_dataset())
    (query,) = re.findall(
        r"```sql\n(.*?)```",
        (ROOT / "docs" / "how-to" / "plant-store.md").read_text("utf-8"),
        re.DOTALL,
    )
    assert connection.sql(
        f'SELECT run, tick, temperature_c FROM ({query}) ORDER BY run, "row"'
    ).fetchall() == expected(home)


def test_polars(home: Path, place: Place) -> None:
    runs, samples = (pl.scan_delta(place.of(name)) for name in ("runs", "samples"))
    newest = runs.filter(pl.col("version") == pl.col("version").max().over("run")).select(
        pl.col("record").alias("publication")
    )
    found = (
        samples.join(newest, on="publication", how="semi")
        .sort("run", "row")
        .select("run", "tick", "temperature_c")
        .collect()
    )
    assert found.rows() == expected(home)


def published_rows(samples: pd.DataFrame, newest: set[str]) -> list[tuple[object, ...]]:
    found = samples[samples["publication"].isin(newest)].sort_values(["run", "row"])[
        ["run", "tick", "temperature_c"]
    ]
    return [
        tuple(row)
        for row in found.astype(object).where(found.notna(), None).itertuples(index=False)
    ]


def test_pandas(home: Path, place: Place) -> None:
    runs, samples = (DeltaTable(place.of(name)).to_pandas() for name in ("runs", "samples"))
    newest = runs.loc[runs.groupby("run")["version"].idxmax(), "record"]
    assert published_rows(samples, set(newest)) == expected(home)


def test_dask(home: Path, place: Place) -> None:
    """From the files that the log lists: Dask reads Parquet."""
    import dask
    import pyarrow.parquet as pq

    newest = {one.record for one in Store(place).runs()}
    files = DeltaTable(place.of("samples")).file_uris()
    parts = [
        dask.delayed(lambda path: pq.read_table(path, partitioning=None).to_pandas())(path)
        for path in files
    ]
    found = pd.concat(dask.compute(*parts, scheduler="synchronous"))
    assert published_rows(found, newest) == expected(home)


if find_spec("pyspark") is not None:  # not among the test dependencies: it needs Java, and 400 MB

    def test_spark(home: Path, place: Place) -> None:
        """From the files that the log lists; Spark's own reader of Delta Lake is a download of
        Maven's.
        """
        from pyspark.sql import SparkSession

        session = (
            SparkSession.builder.master("local[1]")
            .config("spark.sql.session.timeZone", "UTC")
            .getOrCreate()
        )
        found = session.read.parquet(*DeltaTable(place.of("samples")).file_uris()).select(
            "run", "row", "tick", "temperature_c"
        )
        assert [(row[0], row[2], row[3]) for row in sorted(found.collect())] == expected(home)
        session.stop()


def test_every_row_has_its_run(place: Place) -> None:
    names = {run.name for run in jbclog.open_runs(place.url)}
    for table in DATA:
        found = DeltaTable(place.of(table)).to_pyarrow_dataset().to_table(columns=["run"])["run"]
        assert found.null_count == 0
        assert {*found.to_pylist()} <= names
