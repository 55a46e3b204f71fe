"""The joints of a run that goes on are counted as those of the whole record are found afterwards."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pytest

from jbclog.analysis.joints.joints import FoundJoints, find_joints
from jbclog.analysis.joints.parameters import JointOptions
from jbclog.analysis.joints.series import Series
from jbclog.analysis.run import Run, open_run
from jbclog.analysis.run_metrics import joint_count, joints_and_metrics
from jbclog.app.run.joint_counter import ENDED_S
from jbclog.app.run.plan import RunOptions, make_plan
from support.virtual.recorded_run import RecordedRun
from support.virtual.virtual_run import RECIPE, line_text

SECONDS = 120.0


class Begun(Run):
    """A run as far as it had come at `until`."""

    def __init__(self, run: Run, until: pd.Timestamp) -> None:
        super().__init__(run.folder)
        self.until = until

    def groups(self, table: str, columns: list[str]) -> Iterator[pa.Table]:
        until = pa.scalar(self.until.to_pydatetime(), pa.timestamp("us", tz="UTC"))
        return (group.filter(pc.less(group["time"], until)) for group in super().groups(table, columns))


@pytest.fixture(scope="module")
def soldered(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Two minutes in which two ports solder twenty joints a minute each."""
    home = tmp_path_factory.mktemp("soldered")
    (home / "line.toml").write_text(line_text("joints_per_minute = 20\njoint_seconds = 1.0\nseed = 5"), encoding="utf-8")
    (home / "recipe.toml").write_text(RECIPE, encoding="utf-8")
    plan = make_plan(RunOptions(home / "line.toml", home / "recipe.toml", duration_s=SECONDS))
    return open_run(RecordedRun(plan, home / "runs").result.folder)


def test_the_whole_record_has_as_many_as_its_table(soldered: Run) -> None:
    assert joint_count(soldered) == len(soldered.joints()) > 60


@pytest.mark.parametrize("second", [30, 70, 110])
def test_during_a_run_joints_that_have_ended_are_counted(soldered: Run, second: int) -> None:
    until = pd.Timestamp(soldered.manifest.started) + pd.Timedelta(seconds=second)
    ended = soldered.joints()["end"] <= until - pd.Timedelta(seconds=ENDED_S)
    assert joint_count(Begun(soldered, until), ENDED_S) == int(ended.sum())


def test_during_a_run_the_feeder_is_evidence_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """The recorded example with a feeder: the count during a run is made with its feeds, too."""
    run = open_run(next((Path(__file__).parents[3] / "notebooks" / "data" / "joints").glob("2*")))
    assert any(row["wire_decides"] for row in joints_and_metrics(run)[2])
    seen: list[bool] = []

    def looked(series: Series, asked: JointOptions | None = None) -> FoundJoints:
        seen.append(find_joints(series, asked).settings.wire_decides)
        return find_joints(series, asked)

    monkeypatch.setattr("jbclog.analysis.run_metrics.find_joints", looked)
    assert joint_count(run) == len(run.joints())
    assert any(seen)
