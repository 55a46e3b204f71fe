"""`jbclog chart`: control charts within a run or over runs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.loading import drawing, without_collector
from jbclog.cli.options import NO_FOLDER, expect_chart_place, expect_run, is_runs
from jbclog.cli.output import (
    echo,
    echo_json,
    note,
    note_copies,
    note_unreadable,
    reports_errors,
    save_figure,
)
from jbclog.core.errors import UsageError
from jbclog.core.text import exact_figures

if TYPE_CHECKING:
    from jbclog.analysis.charts import Charted
    from jbclog.analysis.control_limits import Limits
    from jbclog.analysis.count_charts import Counted, Ranked


@reports_errors
def chart(
    source: Path = typer.Argument(
        ...,
        metavar="RUN|DIR|TABLE",
        help="Run, folder of runs, or published runs.",
        show_default=False,
    ),
    metric: str = typer.Option(
        "recovery_s",
        "--metric",
        "-m",
        metavar="NAME",
        help="Metric of joints (RUN) or runs (DIR); alarms, rejects, losses.",
    ),
    kind: str | None = typer.Option(
        None,
        "--kind",
        "-k",
        metavar="KIND",
        help="Chart: imr, ewma, cusum, xbar-s; for counts u, p, pareto.",
        show_default=False,
    ),
    station: str | None = options.STATION_OR_ALL,
    port: int | None = options.PORT,
    lower: float | None = options.LOWER,
    upper: float | None = options.UPPER,
    limits: Path | None = typer.Option(
        None,
        "--limits",
        metavar="FILE",
        help="Fixed control limits, from `jbclog limits learn`.",
        show_default=False,
    ),
    size: int = typer.Option(
        5, "--size", min=2, max=1000, metavar="N", help="Subgroup size (xbar-s)."
    ),
    every: str = typer.Option(
        "10m", "--every", metavar="TIME", help="Interval in which a run's alarms are counted."
    ),
    all_tests: bool = typer.Option(
        False, "--all-tests", help="All eight Nelson tests; default: 1, 2, 3, 5."
    ),
    plot: Path | None = options.PLOT,
    as_json: bool = options.AS_JSON,
) -> None:
    """Show control charts and capability within a run or over runs.

    Draws one chart per port, with limits from the distribution that fits the values. Refuses
    limits, and gives the reason, for values that are too few, autocorrelated or not resolved.
    --limits adds fixed limits from a file.

    \b
    Example:
      jbclog chart runs/20261121T013000Z-bench-3-k7qd --metric dwell_s --upper 4 --plot dwell.png
    """
    expect_chart_place(plot)
    from jbclog.analysis.count_charts import COUNTED

    if metric in COUNTED:
        for option, given in (("--limits", limits), ("--lower", lower), ("--upper", upper)):
            if given is not None:
                raise UsageError(f"{option} applies to measured metrics; {metric} are counts")
        found: list[Charted | Counted | Ranked] = [_counted(source, metric, kind, every)]
        cited = None
    else:
        from jbclog.analysis.control_limits import read_limits

        read = None if limits is None else read_limits(limits)
        held = None if read is None else read[0]
        found = [
            *_measured(
                source,
                metric,
                kind or "imr",
                station,
                port,
                lower,
                upper,
                size,
                held,
                all_tests=all_tests,
            )
        ]
        cited = None if read is None else read[1]
    _print(found, source, metric, cited, as_json=as_json)
    if plot is not None:
        with drawing():
            from jbclog.analysis.plots import chart_figure

        save_figure(chart_figure(found), plot)


def _is_run(source: Path) -> bool:
    """Return whether `source` is one run; else it is a folder of runs. Raises `UsageError`."""
    from jbclog.record.published import is_published, is_table
    from jbclog.record.recover import is_run

    if is_published(source):
        return True
    if not is_runs(source):
        raise UsageError(NO_FOLDER.format(source))
    if is_table(source) or not is_run(Path(os.path.realpath(source))):
        return False
    expect_run(source)
    return True


def _measured(
    source: Path,
    metric: str,
    kind: str,
    station: str | None,
    port: int | None,
    lower: float | None,
    upper: float | None,
    size: int,
    limits: Limits | None,
    *,
    all_tests: bool,
) -> list[Charted]:
    with without_collector():
        from jbclog.analysis.charts import OF_VALUES, charted, series_of_run, series_of_runs
        from jbclog.analysis.opening import open_run
        from jbclog.analysis.runs import open_runs
        from jbclog.analysis.spc import ALL_TESTS, DEFAULT_TESTS
        from jbclog.analysis.trend import expect_limits

    if kind not in OF_VALUES:
        raise UsageError(f"--kind {kind}: {metric} has the charts {', '.join(OF_VALUES)}")
    expect_limits(lower, upper)
    if _is_run(source):
        series = series_of_run(open_run(source), metric, station, port)
    else:
        runs = open_runs(source)
        series = series_of_runs(runs, metric, station, port)
        note_unreadable(runs)
        note_copies(runs)
    tests = ALL_TESTS if all_tests else DEFAULT_TESTS
    fixed = [None if limits is None else limits.of(one) for one in series]
    return [
        charted(one, kind, size=size, tests=tests, fixed=its, lower=lower, upper=upper)
        for one, its in zip(series, fixed, strict=True)
    ]


def _counted(source: Path, metric: str, kind: str | None, every: str) -> Counted | Ranked:
    with without_collector():
        from jbclog.analysis import count_charts
        from jbclog.analysis.opening import open_run
        from jbclog.analysis.runs import open_runs
        from jbclog.config.durations import EXAMPLES, span_s

    possible = count_charts.COUNTED[metric]
    if kind not in (None, *possible):
        raise UsageError(f"--kind {kind}: {metric} has the charts {', '.join(possible)}")
    is_run, is_ranked = _is_run(source), (kind or possible[0]) == "pareto"
    rank = count_charts.ranked_alarms if metric == "alarms" else count_charts.ranked_losses
    if not is_run:
        runs = open_runs(source)
        found = (
            count_charts.rejects(runs)
            if metric == "rejects"
            else rank(runs)
            if is_ranked
            else count_charts.alarms_in_runs(runs)
        )
        note_unreadable(runs)
        note_copies(runs)
        return found
    if metric == "rejects":
        raise UsageError("rejects are counted over runs: give a folder of runs")
    if is_ranked:
        return rank(open_run(source))
    seconds = span_s(every)
    if not seconds:
        raise UsageError(f"--every {every}: give {EXAMPLES}")
    return count_charts.alarms_in_run(open_run(source), seconds)


def _print(
    found: list[Charted | Counted | Ranked],
    source: Path,
    metric: str,
    cited: str | None,
    *,
    as_json: bool,
) -> None:
    from jbclog.analysis.chart_words import facts, lines
    from jbclog.record.published import shown_path

    source = shown_path(source)

    if as_json:
        echo_json(
            {
                "source": str(source),
                "metric": metric,
                "limits_sha256": cited,
                "charts": [exact_figures(facts(one)) for one in found],
            }
        )
        return
    for one in found:
        echo(*lines(one))
    if cited is not None:
        echo(f"fixed limits: SHA-256 {cited}")
    if not found:
        note(f"{source}: no values of {metric}")
