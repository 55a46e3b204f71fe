"""A station of a long run is read in narrow columns: text, figures and numbers of its report are those from whole rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd
import pytest

from jbclog.analysis.run import Run, open_run
from jbclog.app.run.plan import RunOptions, make_plan
from jbclog.report import gather
from jbclog.report.joints import joints_of
from jbclog.report.write import as_document, figures_of
from support.records import small_run
from support.virtual.lines import AIR
from support.virtual.recorded_run import RecordedRun
from support.virtual.virtual_run import RECIPE, line_text


def small(home: Path) -> Path:
    return small_run.make_run(home, 20.0)


def hot_air(home: Path) -> Path:
    sim = "tool = 1\n[[station.sim.fault]]\nkind = 'silence'\nat_s = 4\nfor_s = 2\n"
    (home / "line.toml").write_text(line_text(sim).replace("dde", "jtse"))
    (home / "recipe.toml").write_text(AIR)
    plan = make_plan(RunOptions(home / "line.toml", home / "recipe.toml", duration_s=10.0))
    return RecordedRun(plan, home / "runs").result.folder


def free(home: Path) -> Path:
    """With ``--rate max`` the rows have no grid, only times."""
    (home / "line.toml").write_text(line_text())
    (home / "recipe.toml").write_text(RECIPE)
    plan = make_plan(RunOptions(home / "line.toml", home / "recipe.toml", duration_s=5.0, rate="max"))
    return RecordedRun(plan, home / "runs").result.folder


@pytest.mark.parametrize("made", [small, hot_air, free])
def test_a_long_run_has_the_report_of_its_whole_rows(
    made: Callable[[Path], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(made(tmp_path))
    joints = joints_of(run)
    whole = gather.gather(run, joints)
    read: list[str] = []
    compact = gather._compact

    def noted(run: Run, station: str, columns: Sequence[str]) -> pd.DataFrame:
        read.append(station)
        return compact(run, station, columns)

    monkeypatch.setattr(gather, "MOST_ROWS", 0)
    monkeypatch.setattr(gather, "_compact", noted)
    narrow = gather.gather(run, joints)
    assert read == [facts.name for facts in run.manifest.stations]
    assert as_document(narrow) == as_document(whole)
    assert figures_of(narrow) == figures_of(whole)
