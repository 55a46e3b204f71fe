"""`jbclog check` compares the joints in a run's tables with what its raw power allows."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from jbclog.analysis.derived_files import MetricRow
from jbclog.analysis.joint_bounds import beyond_bounds
from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import computed_metrics
from support.invoked import invoked
from support.records import small_run
from support.records.derived import write_metrics

FORGED = {"joint_share_percent": 96.0, "joint_dwell_s": 3.1, "tip_loss_permille_per_k": 3.0}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[MetricRow]]:
    """A sealed run, and its metrics."""
    run = small_run.make_run(tmp_path_factory.mktemp("made"), 40.0)
    return run, computed_metrics(open_run(run))


def stored(made: tuple[Path, list[MetricRow]], out: Path, values: dict[str, float]) -> Path:
    """Return a copy of the run with its metrics stored, some of them with these values."""
    folder = Path(shutil.copytree(made[0], out / made[0].name))
    rows = [
        replace(row, value=values[row.metric], why=None) if row.metric in values else row
        for row in made[1]
    ]
    write_metrics(folder, rows)
    return folder


def test_what_the_record_gives_is_within_its_bounds(
    made: tuple[Path, list[MetricRow]], tmp_path: Path
) -> None:
    folder = stored(made, tmp_path, {})
    assert beyond_bounds(open_run(folder)) == []
    assert invoked("check", folder).exit_code == 0


def test_joints_that_take_more_than_the_power_allows_are_a_finding(
    made: tuple[Path, list[MetricRow]], tmp_path: Path
) -> None:
    folder = stored(made, tmp_path, FORGED)
    found = beyond_bounds(open_run(folder))
    assert found
    assert all("joints take 96.0 % of the working time, but the power" in text for text in found)
    ended = invoked("check", folder)
    assert ended.exit_code == 1
    assert "make the tables again with `jbclog report`" in ended.output


def test_a_dwell_that_is_not_known_is_not_compared(
    made: tuple[Path, list[MetricRow]], tmp_path: Path
) -> None:
    rows = [
        replace(row, value=None, why="Not known.") if row.metric == "joint_dwell_s" else row
        for row in made[1]
    ]
    folder = stored((made[0], rows), tmp_path, {"joint_share_percent": 96.0})
    assert beyond_bounds(open_run(folder)) == []
