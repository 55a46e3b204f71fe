"""The derived tables of a run: what is in them, and how other programs read their files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.dataset as ds
import pyarrow.parquet as pq
import pytest

import jbclog
from jbclog.analysis.derived_schemas import ACCOUNTING_SCHEMA, DERIVED_SCHEMAS, REASONS
from jbclog.analysis.joints.doubt import Doubt
from jbclog.analysis.metrics.joint_figures import counted
from jbclog.analysis.run_derived import accounting_of, tips_of
from jbclog.app.publish import publish
from jbclog.core.rows import EventRow, Severity, StationFacts
from jbclog.record.folder import DERIVED, DERIVED_TABLES, derived_file
from jbclog.record.manifest import Manifest, Metadata
from jbclog.record.published import Tree
from support.lazy import duckdb
from support.lazy import polars as pl
from support.records import sealed_run, small_run
from support.records.derived import derive
from support.records.sealed_run import micros

EMPTY = ("tips", "units")
"""Tables of a run without tips and units that have no row."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two runs: one of all kinds, and one with hardly anything."""
    out = tmp_path_factory.mktemp("runs")
    derive(small_run.make_run(out, 40.0))
    derive(few_rows_run(out))
    return out


def few_rows_run(out: Path) -> Path:
    facts = sealed_run.station(rows=20)
    columns = sealed_run.samples(20)
    return sealed_run.seal(out, [facts], sealed_run.table(columns), metadata=Metadata())


@pytest.fixture
def run(runs: Path) -> jbclog.Run:
    """The run of all kinds."""
    return max(jbclog.open_runs(runs), key=lambda run: len(run.joints()))


# -- as other programs read them -------------------------------------------------------------------


def test_plain_pandas_gives_numbers_and_truth_with_missing_values(run: jbclog.Run) -> None:
    joints = pd.read_parquet(run.folder / derived_file("joints"))
    recovered = joints["recovered"]
    assert (~recovered).sum() == recovered.notna().sum() - recovered.sum()
    assert joints[["fed", "recovered"]].dtypes.map(str).tolist() == ["boolean"] * 2
    units = pd.read_parquet(run.folder / derived_file("units"))
    assert units[["joints", "alarms"]].dtypes.map(str).tolist() == ["Int64"] * 2
    alarms = pd.read_parquet(run.folder / derived_file("alarms"))
    assert str(alarms["start"].dtype) == "datetime64[us, UTC]"
    for name in DERIVED_TABLES:
        table = pd.read_parquet(run.folder / derived_file(name))
        assert list(table.columns) == DERIVED_SCHEMAS[name].names
        assert set(table["run"]) <= {run.name}


def test_files_are_what_the_methods_give(run: jbclog.Run) -> None:
    given = {
        "joints": run.joints(),
        "alarms": run.alarms(),
        "units": run.units(),
        "metrics": run.metrics(),
        "gaps": run.gaps(),
    }
    for name, table in given.items():
        assert len(table) > 0
        pd.testing.assert_frame_equal(pd.read_parquet(run.folder / derived_file(name)), table)


def by_pandas(pattern: Path) -> list[dict[str, Any]]:
    files = sorted(pattern.parent.parent.parent.glob(f"*/{DERIVED}/{pattern.name}"))
    return pd.concat(map(pd.read_parquet, files)).to_dict("records")


def by_duckdb(pattern: Path) -> list[dict[str, Any]]:
    return duckdb.connect().sql(f"SELECT * FROM '{pattern}'").to_arrow_table().to_pylist()


def by_polars(pattern: Path) -> list[dict[str, Any]]:
    return pl.read_parquet(pattern).to_dicts()


@pytest.mark.parametrize("read", [by_pandas, by_duckdb, by_polars])
@pytest.mark.parametrize("name", DERIVED_TABLES)
def test_three_readers_read_a_table_of_all_runs(runs: Path, name: str, read: Any) -> None:
    rows = read(runs / "*" / DERIVED / f"{name}.parquet")
    counts = [pq.read_metadata(path).num_rows for path in runs.glob(f"*/{derived_file(name)}")]
    assert len(counts) == 2
    assert len(rows) == sum(counts)
    assert {*rows[0]} == {*DERIVED_SCHEMAS[name].names} if rows else name in EMPTY


@pytest.mark.parametrize("name", DERIVED_TABLES)
def test_a_run_without_rows_has_the_same_types(runs: Path, name: str, tmp_path: Path) -> None:
    first, second = (pq.read_schema(path) for path in runs.glob(f"*/{derived_file(name)}"))
    assert first.equals(second)
    assert first.equals(DERIVED_SCHEMAS[name])
    described = [
        duckdb.connect().execute(f"DESCRIBE SELECT * FROM '{path}'").fetchall()
        for path in runs.glob(f"*/{derived_file(name)}")
    ]
    assert described[0] == described[1]


def test_a_published_tree_is_one_dataset_a_table(runs: Path, tmp_path: Path) -> None:
    tree = Tree.at(tmp_path / "plant")
    for folder in runs.iterdir():
        publish(folder, tree)
    for name in DERIVED_TABLES:
        place = Path(tree.url, name)
        table = ds.dataset(place, partitioning="hive").to_table()
        count = sum(
            pq.read_metadata(path).num_rows for path in runs.glob(f"*/{derived_file(name)}")
        )
        assert table.num_rows == count
        assert [*table.schema.names] == [*DERIVED_SCHEMAS[name].names, "line", "month"]
        assert pl.scan_parquet(place, hive_partitioning=True).collect().height == count
        sql = f"SELECT count(*) FROM read_parquet('{place}/**/*.parquet', hive_partitioning = true)"
        assert duckdb.connect().sql(sql).fetchall() == [(count,)]
    published = jbclog.open_runs(tree.path)
    assert [len(run.joints()) for run in published] == [
        len(run.joints()) for run in jbclog.open_runs(runs)
    ]


def test_files_are_small_and_nothing_is_in_them_twice(run: jbclog.Run) -> None:
    sizes = {name: (run.folder / derived_file(name)).stat().st_size for name in DERIVED_TABLES}
    assert sizes["tips"] < 1000
    assert sum(sizes.values()) < 40_000
    footer = pq.read_metadata(run.folder / derived_file("joints"))
    assert b"ARROW:schema" not in footer.metadata
    assert not footer.row_group(0).column(0).is_stats_set


# -- what is in them -------------------------------------------------------------------------------

WATTS, ROWS = 100.0, 600


def with_units(
    out: Path, units: Sequence[tuple[float, str, str]], lost: Sequence[slice] = ()
) -> jbclog.Run:
    """A minute at constant power of 10 %, of a station of 1 kW, with these events of units."""
    facts = replace(sealed_run.station(rows=ROWS), rated_power_w=1000.0)
    columns = sealed_run.samples(ROWS)
    columns["power_permille"] = np.full(ROWS, WATTS)
    columns["temperature_c"] = np.full(ROWS, 350.0)
    for rows in lost:
        sealed_run.lose(columns, rows)
    events = [
        EventRow(micros(second), kind, Severity.INFO, kind, raw=serial)
        for second, kind, serial in units
    ]
    folder = sealed_run.seal(out, [facts], sealed_run.table(columns), events, metadata=Metadata())
    return jbclog.open_run(folder)


BENCH = [
    (10.0, "unit.begin", "SN-1"),
    (20.0, "unit.begin", "SN-2"),
    (30.0, "unit.end", "SN-2"),
    (40.0, "unit.begin", "SN-3"),
]


def test_a_unit_has_the_energy_of_its_time(tmp_path: Path) -> None:
    units = with_units(tmp_path, BENCH).units()
    assert list(units["unit"]) == ["SN-1", "SN-2", "SN-3"]
    assert units["energy_j"][:2].tolist() == pytest.approx([1000, 1000], abs=3)
    assert (units["coverage"][:2] == 100).all()
    assert (units["alarms"][:2] == 0).all()
    last = units.iloc[2]  # nobody knows when it left
    assert last[["stop", "joints", "energy_j", "coverage", "alarms"]].isna().all()
    assert set(units["run"]) == {sealed_run.NAME}


def test_what_a_gap_may_hide_is_null_in_its_unit_alone(tmp_path: Path) -> None:
    units = with_units(tmp_path, BENCH, [slice(250, 260), slice(150, 151)]).units()
    assert units["energy_j"][:2].isna().tolist() == [False, True]
    assert units["joints"].isna()[1]
    assert units["coverage"][:2].tolist() == pytest.approx([99, 90], abs=0.1)
    assert units["energy_j"][0] == pytest.approx(1000, abs=3)  # one reading is bridged


def test_of_units_that_were_only_named_nothing_is_known(tmp_path: Path) -> None:
    columns = sealed_run.samples(ROWS)
    facts = replace(sealed_run.station(rows=ROWS), rated_power_w=1000.0)
    rows = sealed_run.table(columns)
    said = Metadata(units=["SN-1", "SN-2"])
    folder = sealed_run.seal(tmp_path / "two", [facts], rows, metadata=said)
    two = jbclog.open_run(folder).units()
    assert two[["start", "stop", "joints", "energy_j", "coverage", "alarms"]].isna().all().all()
    said = Metadata(units=["SN-1"])
    folder = sealed_run.seal(tmp_path / "one", [facts], rows, metadata=said)
    run = jbclog.open_run(folder)
    (one,) = run.units().itertuples()
    assert one.joints == len(run.joints()) > 5
    metrics = run.metrics().set_index("metric")["value"]
    assert one.energy_j == pytest.approx(metrics["energy_j"], rel=1e-3)
    assert (run.joints()["unit"] == "SN-1").all()


def test_alarms_count_in_every_unit_in_which_they_were_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = jbclog.open_run(small_run.make_run(tmp_path / "plain", 40.0))
    alarm = plain.alarms().iloc[0]
    assert pd.isna(alarm["stop"])  # it lasts until the end
    start_us = round(alarm["start"].timestamp() * 1e6)
    first_us = round(plain.samples()["time"].iloc[0].timestamp() * 1e6)
    times_us = {
        "SN-0": first_us,
        "SN-1": start_us - 500_000,
        "SN-2": start_us + 500_000,
        "SN-3": start_us + 900_000,
    }
    before = small_run.events
    told = [
        EventRow(time, "unit.begin", Severity.INFO, "A unit.", raw=serial)
        for serial, time in times_us.items()
    ]
    monkeypatch.setattr(
        small_run,
        "events",
        lambda seconds: sorted([*before(seconds), *told], key=lambda event: event.time),
    )
    run = jbclog.open_run(small_run.make_run(tmp_path / "units", 40.0))
    alarms = run.alarms()
    units = run.units().set_index("unit")
    assert (
        units["alarms"]["SN-0"]
        == alarms[alarms["start"] < units["stop"]["SN-0"]]["incident"].nunique()
    )
    assert units["alarms"]["SN-1"] == units["alarms"]["SN-0"] + 1
    assert units["alarms"]["SN-2"] >= 1


def test_a_tip_that_was_named_for_a_station_is_in_each_port() -> None:
    stations = [
        StationFacts("dde-1", "a", "dde", ports=[1, 2]),
        StationFacts("dde-2", "b", "dde", ports=[1]),
        StationFacts("ale-1", "c", "ale", ports=[1]),
    ]
    said = Metadata(tips=["dde-1=T-1", "dde-1:2=T-2", "ale-1=T-3", "ale-1=T-4"])
    table = tips_of(Manifest("name", stations=stations, metadata=said)).to_pylist()
    assert [(row["station"], row["port"], row["tip"]) for row in table] == [
        ("dde-1", 1, "T-1"),
        ("dde-1", 2, "T-2"),
    ]


def test_due_is_obtained_and_all_reasons(run: jbclog.Run) -> None:
    rows = pd.read_parquet(run.folder / derived_file("accounting"))
    assert (rows["due"] == rows["obtained"] + rows[[*REASONS]].sum(axis=1)).all()
    assert rows["due"].sum() == sum(
        counts["due"]
        for ports in run.manifest.ledger.values()
        for signals in ports.values()
        for counts in signals.values()
    )
    assert (rows["due"] > rows["obtained"]).any()


def test_refusals_are_one_reason_and_an_unknown_one_is_kept() -> None:
    counts = {"due": 10, "ok": 4, "nak1": 1, "nak3": 2, "timeout": 1, "of_later": 2}
    ledger = {"dde-1": {"station": {"plugged_minutes": counts}}}
    (row,) = accounting_of(Manifest("name", ledger=ledger)).to_pylist()
    assert (row["port"], row["due"], row["obtained"]) == (None, 10, 4)
    missing = {name: row[name] for name in REASONS if row[name]}
    assert missing == {"nak": 3, "timeout": 1, "other": 2}
    assert [*ACCOUNTING_SCHEMA.names][6:] == [*REASONS]


def test_a_value_lies_in_its_range(run: jbclog.Run) -> None:
    metrics = run.metrics()
    both = metrics.dropna(subset=["low", "high"])
    assert {"joints", "tip_capacity_permille_s_per_k"} <= {*both["metric"]}
    known = both.dropna(subset=["value"])
    assert known["value"].between(known["low"], known["high"]).all()


def test_a_count_that_is_not_known_has_no_range_of_one_number() -> None:
    temperature = SimpleNamespace(coverage=100.0)
    port: Any = SimpleNamespace(
        found=SimpleNamespace(joints=[None] * 6), totals=SimpleNamespace(temperature=temperature)
    )
    some_come_as_many_go = counted(port, 6, "33 % of them come or go.", (6, 6))
    assert (some_come_as_many_go.low, some_come_as_many_go.high) == (None, None)
    doubtful = counted(port, 6, "33 % of them come or go.", (5, 7))
    assert (doubtful.low, doubtful.high) == (5.0, 7.0)


def test_energy_with_a_gap_has_a_lower_bound(tmp_path: Path) -> None:
    metrics = with_units(tmp_path, [], [slice(250, 260)]).metrics().set_index("metric")
    whole, recorded = metrics.loc["energy_permille_s"], metrics.loc["energy_recorded_permille_s"]
    assert pd.isna(whole["value"])
    assert whole["low"] == recorded["value"]
    assert metrics.loc["energy_j"]["low"] == pytest.approx(recorded["value"])
    assert pd.isna(whole["high"])


def test_a_range_found_in_a_part_holds_for_all_joints() -> None:
    doubt = Doubt(share=0.1, least=8, most=12, looked_at=10, seen_from=100.0)
    assert doubt.range_of(10) == (8, 12)
    assert doubt.range_of(20) == (16, 24)
