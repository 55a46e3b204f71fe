"""A run as objects: its verdict, duration, stations and units, its joints with their slice of the
samples, and its figure.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.patches import PathPatch
from matplotlib.path import Path as MatplotlibPath

import jbclog
from jbclog.analysis.derived_schemas import JOINTS_SCHEMA
from jbclog.analysis.run_joints import RunJoint
from jbclog.core.errors import UsageError
from jbclog.record.annotations import append
from jbclog.record.manifest import Metadata
from support.records import event_run, small_run
from support.records.few_rows import T0

READ = [(10, "unit.begin", "SN-1"), (20, "unit.end", "SN-1"), (30, "unit.begin", "SN-2")]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> jbclog.Run:
    return jbclog.open_run(small_run.make_run(tmp_path_factory.mktemp("runs"), 40.0))


def at(second: float) -> pd.Timestamp:
    return pd.Timestamp(T0 + round(second * 1e6), unit="us", tz="UTC")


def test_verdict_duration_and_stations_are_those_of_the_manifest(run: jbclog.Run) -> None:
    manifest = run.manifest
    assert run.verdict == manifest.verdict is not None
    assert run.stations == manifest.stations
    assert run.duration == pd.Timestamp(manifest.stop) - pd.Timestamp(manifest.start)


def test_a_run_without_an_end_has_no_duration_and_no_verdict(tmp_path: Path) -> None:
    run = jbclog.open_run(event_run.run_with(tmp_path, READ, Metadata(), crashes=True))
    assert (run.duration, run.verdict) == (None, None)


@pytest.mark.parametrize("crashes", [False, True])
def test_units_have_their_time_on_the_bench(tmp_path: Path, *, crashes: bool) -> None:
    units = jbclog.open_run(
        event_run.run_with(tmp_path, READ, Metadata(units=["SN-0"]), crashes=crashes)
    ).units()
    assert list(units["unit"]) == ["SN-1", "SN-2", "SN-0"]
    assert list(units["start"][:2]) == [at(10), at(30)]
    assert units["stop"][0] == at(20)
    assert units.loc[1:, "stop"].isna().all()
    assert pd.isna(units["start"][2])  # it was only named: nobody knows when it was there


def test_one_unit_that_was_named_is_there_for_the_whole_run_of_several_nobody_knows(
    tmp_path: Path,
) -> None:
    run = jbclog.open_run(event_run.run_with(tmp_path, [], Metadata(units=["SN-0"])))
    (row,) = run.units().itertuples()
    assert (row.unit, row.start, row.stop) == (
        "SN-0",
        pd.Timestamp(run.manifest.start),
        pd.Timestamp(run.manifest.stop),
    )
    append(run.folder, who="A. Rossi", what="SN-7", why="the reader was off", kind="unit.late")
    both = run.units()
    assert list(both["unit"]) == ["SN-0", "SN-7"]
    assert both[["start", "stop"]].isna().all().all()


def test_a_run_without_units_has_an_empty_table_of_the_same_types(tmp_path: Path) -> None:
    empty = jbclog.open_run(event_run.run_with(tmp_path / "none", [], Metadata())).units()
    some = jbclog.open_run(event_run.run_with(tmp_path / "some", READ, Metadata())).units()
    assert len(empty) == 0
    assert list(empty.dtypes) == list(some.dtypes)


def test_joints_are_the_rows_of_the_table_as_objects(run: jbclog.Run) -> None:
    table, joints = run.joints(), run.each_joint()
    assert {one.name for one in fields(RunJoint)} == {*JOINTS_SCHEMA.names}
    assert len(joints) == len(table) > 10
    for name in JOINTS_SCHEMA.names[1:]:
        values = [getattr(joint, name) for joint in joints]
        assert [None if pd.isna(value) else value for value in table[name]] == values
    assert run.each_joint("dde-1", 2) == [
        one for one in joints if (one.station, one.port) == ("dde-1", 2)
    ]


def test_a_joint_has_its_unit(tmp_path: Path) -> None:
    run = jbclog.open_run(small_run.make_run(tmp_path, 40.0))
    append(run.folder, who="A. Rossi", what="SN-7", why="the reader was off", kind="unit.late")
    expected = run.unit_at(run.joints()["start"])
    assert [one.unit for one in run.each_joint()] == [
        None if pd.isna(unit) else unit for unit in expected
    ]


def test_a_joint_has_its_slice_of_the_samples(run: jbclog.Run) -> None:
    joint = run.each_joint("dde-1", 1)[3]
    own = joint.samples()
    assert (own["time"].iloc[0], own["time"].iloc[-1]) == (joint.start, joint.stop)
    assert set(zip(own["station"], own["port"], strict=True)) == {("dde-1", 1)}
    around = joint.samples(before_s=0.5, after_s=2.0, columns=["time", "temperature_c"])
    assert list(around.columns) == ["time", "temperature_c"]
    assert len(around) == len(own) + 5 + 20
    assert around["temperature_c"].min() == joint.lowest_c
    with pytest.raises(UsageError, match="before_s is -1 s"):
        joint.samples(before_s=-1)


def test_the_figure_has_one_scale_a_panel(run: jbclog.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jbclog.analysis.figures.port._knee", lambda *_: 300.0)
    assert {axes.get_yscale() for axes in run.plot("dde-1", 1).axes} == {"linear"}


def test_the_figure_shows_joints_setpoint_and_alarm_limits(run: jbclog.Run) -> None:
    temperature = run.plot("dde-1", 1).axes[0]
    drawn = {artist.get_gid(): artist for artist in temperature.get_children() if artist.get_gid()}
    back = drawn["joint back"]
    assert isinstance(back, PathPatch)
    begun = np.count_nonzero(back.get_path().codes == MatplotlibPath.MOVETO)
    assert begun == sum(joint.recovered is True for joint in run.each_joint("dde-1", 1)) > 5
    assert {"set", "high"} <= set(drawn)
