"""`jbclog trend`: control chart and capability of a metric over runs."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.loading import drawing, without_collector
from jbclog.cli.options import NO_FOLDER, expect_chart_place, expect_file_place, is_runs
from jbclog.cli.output import echo, echo_json, echo_table, note, note_unreadable, reports_errors
from jbclog.cli.times import are_local, range_text, typed_moment
from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.text import exact_figures

if TYPE_CHECKING:
    from jbclog.analysis.runs import Runs
    from jbclog.analysis.trend import Trend


@reports_errors
def trend(
    folder: Path = options.RUNS_OR_TABLE,
    metric: str = typer.Option(
        "idle_error_c", "--metric", "-m", metavar="NAME", help="Metric; `list` shows all."
    ),
    station: str | None = options.STATION_OR_ALL,
    port: int | None = options.PORT,
    lower: float | None = options.LOWER,
    upper: float | None = options.UPPER,
    line: str | None = options.LINE_NAME,
    recipe: str | None = options.RECIPE_NAME,
    product: str | None = options.PRODUCT,
    order: str | None = options.ORDER,
    since: str | None = typer.Option(None, metavar="TIME", help="Earliest start: 2026-11-21."),
    until: str | None = options.UNTIL,
    plot: Path | None = options.PLOT,
    html: Path | None = typer.Option(
        None, "--html", metavar="FILE", help="HTML page with chart and table."
    ),
    scheduler: str | None = typer.Option(
        None, metavar="ADDRESS", help="Dask scheduler whose workers read the runs: tcp://HOST:8786."
    ),
    no_cache: bool = options.NO_CACHE,
    as_json: bool = options.AS_JSON,
) -> None:
    """Show a metric over many runs: control chart, capability.

    Takes one value per run and port. Control limits require 20 runs, capability 30 and a
    specification limit. Refuses a figure, and gives the reason, if the values are too few,
    autocorrelated, not resolved or not stable. The figures describe the record; none proves that a
    joint is good. TIME without a zone is local on a terminal; in a pipe, a file and with --json it
    is UTC.

    \b
    Example:
      jbclog trend runs --metric recovery_s --station dde-1 --upper 4 --plot recovery.png
    """
    if metric == "list":
        _list(as_json=as_json)
        return
    expect_chart_place(plot)
    expect_file_place("--html", html)
    with without_collector():
        from jbclog.analysis.runs import Records
        from jbclog.analysis.trend import trends

    is_local = are_local(as_json=as_json)
    begin = typed_moment("--since", since, is_local=is_local)
    end = typed_moment("--until", until, is_local=is_local, is_end=True)
    source = Records(stored=not no_cache)
    runs = _runs(folder, line, recipe, product, order, begin, end, scheduler).through(source)
    found = trends(runs, metric, station, port, lower, upper)
    note_unreadable(runs)
    _print(found, runs, metric, range_text(begin, end), as_json=as_json)
    if plot is not None or html is not None:
        _draw(found, metric, lower, upper, plot, html)


def _runs(
    folder: Path,
    line: str | None,
    recipe: str | None,
    product: str | None,
    order: str | None,
    since: datetime | None,
    until: datetime | None,
    scheduler: str | None,
) -> Runs:
    with without_collector():
        from jbclog.analysis.runs import open_runs

    if not is_runs(folder):
        raise UsageError(NO_FOLDER.format(folder))
    return open_runs(
        folder,
        line=line,
        recipe=recipe,
        product=product,
        order=order,
        since=since,
        until=until,
        scheduler=scheduler,
    )


def _list(*, as_json: bool) -> None:
    from jbclog.analysis.run_metrics import definitions

    rows = definitions().to_dict("records")
    if as_json:
        echo_json({"metrics": rows})
        return
    echo_table(
        ("metric", "uom", "definition"),
        [(row["metric"], row["uom"], row["definition"]) for row in rows],
    )


def _print(found: list[Trend], runs: Runs, metric: str, sought: str, *, as_json: bool) -> None:
    from jbclog.analysis.trend import metric_text
    from jbclog.analysis.trend_words import facts, lines

    if as_json:
        body = [exact_figures(facts(one)) for one in found]
        echo_json(
            {
                "folder": str(runs.folder),
                "runs": len(runs),
                "metric": metric,
                "definition": metric_text(metric),
                "trends": body,
            }
        )
        return
    for one in found:
        echo(*lines(one))
    note(
        f"{metric}: {metric_text(metric)}"
        if found
        else f"{runs.folder}: no run has {metric}{sought}"
    )


def _draw(
    found: list[Trend],
    metric: str,
    lower: float | None,
    upper: float | None,
    plot: Path | None,
    html: Path | None,
) -> None:
    with drawing():
        from jbclog.analysis.plots import trend_figure
        from jbclog.analysis.trend_words import page

    figure = trend_figure(found, lower, upper)
    try:
        if plot is not None:
            figure.savefig(plot, dpi=150)
        if html is not None:
            html.write_text(page(found, metric, figure), encoding="utf-8")
    except OSError as error:
        path = plot if html is None else html
        assert path is not None
        raise RecordError(f"{path}: cannot write: {write_failure(error, path)}") from error
    for path in (plot, html):
        if path is not None:
            note(f"written: {path}")
