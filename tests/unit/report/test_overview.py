"""The run at a glance: a cold tip is no ordinary level line."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from jbclog.analysis.figures.from_samples import trace
from jbclog.analysis.figures.trace import Grid
from jbclog.analysis.run import open_run
from jbclog.app.run.options import RunOptions
from jbclog.app.run.plan import make_plan
from jbclog.report.overview import Overview
from jbclog.report.write import write_report
from support.records.verdict_corpus import ONLY_COVERAGE, SOLDERING, STATION, WORKING
from support.virtual.lines import fault
from support.virtual.recorded_run import RecordedRun


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two ports that are never at work, one that works, one that does not get hot; 60 s."""
    home = tmp_path_factory.mktemp("cold")
    one, two = (
        STATION.format(family="dde", sim=sim)
        for sim in ("tool = 2", "tool = 2\n" + fault("stuck", at_s=0.0, port=1))
    )
    one = one.replace("family =", 'recipe = "cold.toml"\nfamily =')
    (home / "line.toml").write_text(
        '[line]\nname = "bench"\n' + one + two.replace("dde-1", "dde-2")
    )
    for name, parts in (
        ("cold", (SOLDERING, ONLY_COVERAGE)),
        ("hot", (SOLDERING, WORKING, ONLY_COVERAGE)),
    ):
        (home / f"{name}.toml").write_text("".join(parts).format(name=name))
    plan = make_plan(RunOptions(home / "line.toml", home / "hot.toml", duration_s=60.0, rate=4.0))
    folder = RecordedRun(plan, home / "runs").result.folder
    write_report(folder)
    return folder


def words(report: Path) -> list[str]:
    svg = (report / "figures" / "overview.svg").read_text("utf-8")
    return re.findall(r">([^<>]+)</text>", svg)


def test_it_is_said_in_the_figure(report: Path) -> None:
    told = words(report)
    assert told.count("not at work") == 2
    assert told.count("not reached") == 1
    assert told.count("23 °C") == 3  # in the fields of those that are cold from beginning to end
    assert "100 %" in told  # the one that works says what it read, as always


def test_it_is_said_in_words(report: Path) -> None:
    caption = json.loads((report / "report.json").read_text())["overview"]["caption"]
    assert "shaded: more than 40 °C away, with the temperature" in caption
    assert caption.endswith("Never at the setpoint: dde-1 · 1, dde-1 · 2, dde-2 · 1.")
    assert "Never at the setpoint" in (report / "report.html").read_text("utf-8")


def test_what_is_cold_has_no_curve(report: Path) -> None:
    run, overview = open_run(report), Overview(0)
    for station, port in (("dde-1", 1), ("dde-2", 2)):
        overview.add(station, trace(run.samples(station=station, port=port), Grid(0, 0.25)), 100.0)
    cold, hot = overview.strips
    assert [span.word for span in cold.far] == ["23 °C"]
    assert cold.far[0].seconds > 57
    assert not np.isfinite(cold.curve.high).any()
    assert hot.far == []
    assert np.isfinite(hot.curve.high).all()


def test_the_table_names_one_that_did_not_reach_it_as_the_worst(report: Path) -> None:
    summary = json.loads((report / "report.json").read_text())["verdict"]["summary"]
    (line,) = [one for one in summary if one["name"] == "reached"]
    assert (line["worst"], line["kept"], line["of"]) == ("not reached", 1, 4)
    assert (line["station"], line["port"], line["result"]) == ("dde-2", 1, "fail")
