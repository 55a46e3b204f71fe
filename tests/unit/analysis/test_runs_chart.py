"""`Runs.chart`: the chart that `jbclog chart` gives, drawn, or its refusal in the axes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import jbclog
from jbclog import spc
from jbclog.core.errors import UsageError
from support.records.many_runs import many_runs

METRIC = "idle_error_c"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> jbclog.Runs:
    out = tmp_path_factory.mktemp("runs")
    many_runs(out, list(np.random.default_rng(5).normal(1.5, 0.8, 24)))
    return jbclog.open_runs(out)


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> jbclog.Runs:
    out = tmp_path_factory.mktemp("few")
    many_runs(out, [1.0, 1.2, 0.8])
    return jbclog.open_runs(out)


def written(figure: Figure) -> str:
    """All texts of the figure."""
    texts = [text for axes in figure.get_axes() for text in (*axes.texts, axes.title)]
    return " ".join(" ".join(text.get_text().split()) for text in texts)


def test_it_has_the_value_of_each_run(runs: jbclog.Runs) -> None:
    chart = runs.chart(METRIC, "dde-1", 1)
    metrics = runs.metrics("dde-1", 1)
    of_metric = metrics[metrics["metric"] == METRIC]
    assert chart.series.values == pytest.approx(of_metric["value"].to_numpy())
    assert chart.series.names == list(of_metric["run"])
    individuals, moving_range = chart.charts
    assert individuals.points == pytest.approx(chart.series.values)
    assert len(moving_range.points) == 23


def test_it_is_drawn_with_its_limits(runs: jbclog.Runs) -> None:
    figure = runs.chart(METRIC, "dde-1", 1).plot()
    individuals = figure.get_axes()[0]
    assert individuals.get_title("left") == f"dde-1 port 1: {METRIC} in °C, individuals"
    assert len(individuals.lines) >= 4  # values, centre, two limits
    assert "No control limits" not in written(figure)


def test_a_refusal_stands_in_the_axes(few: jbclog.Runs) -> None:
    chart = few.chart(METRIC, "dde-1", 1)
    assert isinstance(chart.charts, spc.Refused)
    figure = chart.plot()
    assert f"No control limits. {chart.charts.text}" in written(figure)
    assert len(figure.get_axes()[0].lines) == 1  # the values, without limits
    with pytest.raises(UsageError, match="There are 3 values"):
        _, _ = chart.charts


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (("dwel_s", "dde-1", 1), r"there is no metric 'dwel_s'.*There are .*recovery_s"),
        ((METRIC, "dde-9", 1), "no run has a station 'dde-9'; there are dde-1"),
        ((METRIC, "dde-1", 2), "no run has a port 2 of 'dde-1'; there are 1"),
        ((METRIC, "dde-1", None), "of one port of one station; port is None"),
        ((METRIC, None, 1), "of one port of one station; station is None"),
    ],
)
def test_a_mistake_lists_what_there_is(
    few: jbclog.Runs, arguments: tuple[Any, Any, Any], match: str
) -> None:
    with pytest.raises(UsageError, match=match):
        few.chart(*arguments)
