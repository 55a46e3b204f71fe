"""Joints and metrics of runs in their folders: as virtual stations were recorded, sealed, open; the
derived tables.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jbclog.analysis import run_metrics
from jbclog.analysis.derived_schemas import JOINTS_SCHEMA
from jbclog.analysis.metrics.measures import METRICS, PortMeasuring
from jbclog.analysis.run import open_run
from jbclog.core.errors import UsageError
from jbclog.record.folder import derived_file
from jbclog.record.manifest import manifest_sha256
from jbclog.report.write import write_report
from support.records import sealed_run
from support.records.alarm_series import Series, being_recorded
from support.virtual.recorded_run import run_in
from support.virtual.virtual_run import RECIPE, line_text

FEEDER = "\n[feeder]\nmode = 'discontinuous'\nlength_mm = 5.0\nspeed_mm_s = 10.0\n"
OMEGA = "[recipe]\nname = 'states'\nrevision = 1\nfamilies = ['omega']\n[sampling]\nrate_hz = 1\n"
AIR = (
    "[recipe]\nname = 'air'\nrevision = 1\nfamilies = ['jtse']\n[air]\ntemperature_c ="
    " 300\n[run]\nstatus = 'on'\n"
)


@pytest.fixture(scope="module")
def soldered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two minutes of a virtual station that solders twelve joints a minute."""
    line = line_text(
        "joints_per_minute = 12\njoint_seconds = 1.5\nseed = 3", "ports = [1]\nrated_power_w = 130"
    )
    return run_in(tmp_path_factory.mktemp("soldered"), line, duration_s=120.0)


def values(table: pd.DataFrame) -> dict[str, object]:
    return dict(zip(table["metric"], table["value"], strict=True))


def test_the_joints_of_a_virtual_station_are_those_of_its_schedule(soldered: Path) -> None:
    joints = open_run(soldered).joints()
    assert len(joints) in (23, 24)  # of 24, the first may fall into heating up
    apart = np.diff(joints["start_s"])
    assert apart.min() > 3.5
    assert apart.max() < 6.5  # none between is missing
    assert joints["dwell_s"].between(1.0, 1.8).all()
    assert (joints["confidence"] > 0.5).all()
    assert joints["start"].dt.tz is not None
    assert (joints["energy_j"] / joints["energy_permille_s"]).dropna().sub(0.13).abs().max() < 1e-3


def test_metrics_of_a_virtual_station(soldered: Path) -> None:
    run = open_run(soldered)
    table = run.metrics()
    assert list(table["metric"]) == [*METRICS]
    assert (table["value"].isna() == table["why"].notna()).all()
    found = values(table)
    assert found["joints"] == len(run.joints())
    assert 2.0 < float(str(found["heat_up_time_s"])) < 6.0  # 130 W at 1.2 J/K
    assert np.isnan(found["idle_error_c"])  # it is never at rest: a joint every 5 s
    assert found["energy_j"] == pytest.approx(float(str(found["energy_permille_s"])) * 0.13)
    assert set(run.metric_definitions()["metric"]) == set(found)


def test_the_file_is_what_was_found_and_names_its_manifest(
    soldered: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(soldered)
    before = run.joints()
    metrics = run.metrics()
    write_report(soldered)
    path = soldered / derived_file("joints")
    first = path.read_bytes()
    path.unlink()
    write_report(soldered)
    assert path.read_bytes() == first
    schema = pq.read_schema(path)
    assert schema.metadata[b"jbclog.manifest_sha256"].decode() == manifest_sha256(soldered)
    assert schema.equals(JOINTS_SCHEMA)
    computed: list[int] = []
    monkeypatch.setattr(
        run_metrics, "PortMeasuring", lambda *those: computed.append(1) or PortMeasuring(*those)
    )
    pd.testing.assert_frame_equal(run.joints(), before)
    pd.testing.assert_frame_equal(run.metrics(), metrics)
    pd.testing.assert_frame_equal(run.metrics("dde-1"), metrics)
    with pytest.raises(UsageError, match="has no station 'another'; it has dde-1"):
        run.metrics("another")
    assert not computed
    # of this manifest, with these columns, and not what was written
    cut = pq.read_table(pa.BufferReader(first)).slice(1)
    for number, made_up in enumerate((b"no parquet", parquet_of(cut)), 1):
        path.write_bytes(made_up)
        pd.testing.assert_frame_equal(run.joints(), before)
        assert len(computed) == number


def parquet_of(table: pa.Table) -> bytes:
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink)
    return bytes(sink.getvalue().to_pybytes())


def test_wire_of_an_ale(tmp_path: Path) -> None:
    sim = "joints_per_minute = 12\njoint_seconds = 1.5\nfeed_each_joint = true"
    line = line_text(sim).replace('"dde"', '"ale"')
    folder = run_in(tmp_path, line, RECIPE + FEEDER, duration_s=200.0)
    run = open_run(folder)
    found = values(run.metrics())
    assert run.joints()["fed"].all()
    assert found["wire_per_feed_mm"] == pytest.approx(5.0, rel=0.05)
    assert found["wire_delivered_percent"] == pytest.approx(100, rel=0.05)
    assert found["wire_per_joint_mm"] == pytest.approx(5.0, rel=0.1)
    assert found["wire_speed_mm_s"] == pytest.approx(10.0, rel=0.25)
    assert found["wire_clog_suspicions"] == 0


def test_stations_that_report_little(tmp_path: Path) -> None:
    for name, recipe in (("omega", OMEGA), ("jtse", AIR)):
        (tmp_path / name).mkdir()
        folder = run_in(
            tmp_path / name, line_text().replace('"dde"', f'"{name}"'), recipe, duration_s=60.0
        )
        table = open_run(folder).metrics()
        assert len(open_run(folder).joints()) == 0
        assert table.set_index("metric").loc["joints", "why"]
        assert table["value"].isna().all() == (name == "omega")


def test_a_run_at_the_highest_rate_has_no_grid_and_the_same_joints(tmp_path: Path) -> None:
    line = line_text("joints_per_minute = 12\njoint_seconds = 1.5\nseed = 3", "ports = [1]")
    joints = open_run(run_in(tmp_path, line, rate="max", duration_s=60.0)).joints()
    assert len(joints) in (11, 12)
    assert np.diff(joints["start_s"]).max() < 6.5


def test_a_run_that_is_still_open_has_joints_and_metrics(tmp_path: Path) -> None:
    series = Series().add(350, times=100)
    with being_recorded(series, tmp_path) as (folder, _):
        run = open_run(folder)
        assert len(run.joints()) == 0
        assert values(run.metrics())["idle_error_c"] is not None


def test_a_gap_in_a_sealed_run(tmp_path: Path) -> None:
    columns = sealed_run.samples(1200)
    sealed_run.lose(columns, slice(600, 620))
    folder = sealed_run.seal(tmp_path, [sealed_run.station(rows=1200)], sealed_run.table(columns))
    table = open_run(folder).metrics("dde-1").set_index("metric")
    assert pd.isna(table.loc["energy_permille_s", "value"])
    assert "gap" in str(table.loc["energy_permille_s", "why"])
    assert table.loc["energy_recorded_permille_s", "value"] > 0
