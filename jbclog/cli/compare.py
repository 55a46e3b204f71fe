"""`jbclog compare`: two runs side by side."""

from __future__ import annotations

from pathlib import Path

import typer

from jbclog.cli import options
from jbclog.cli.loading import drawing, without_collector
from jbclog.cli.options import expect_chart_place, expect_run_or_published
from jbclog.cli.output import echo, echo_json, reports_errors, save_figure
from jbclog.core.text import exact_figures


@reports_errors
def compare(
    first: Path = typer.Argument(
        ..., metavar="RUN", help="Run folder, or TABLE/RUN.", show_default=False
    ),
    second: Path = typer.Argument(
        ..., metavar="RUN", help="Other run folder, or TABLE/RUN.", show_default=False
    ),
    margin: float = typer.Option(2.0, metavar="C", help="Equivalence margin of idle means, in °C."),
    plot: Path | None = options.PLOT,
    as_json: bool = options.AS_JSON,
) -> None:
    """Compare two runs side by side.

    Differences are second minus first. Tests the equivalence of two idle temperatures by two
    one-sided tests within --margin (TOST, 5 %): equivalent, different or not known. Finding no
    difference does not prove equality.

    \b
    Example:
      jbclog compare runs/20261121T013000Z-bench-3-k7qd runs/20261122T013000Z-bench-3-m4tz --plot both.png
    """  # noqa: E501  # a command is copied as one line
    for run in (first, second):
        expect_run_or_published(run)
    expect_chart_place(plot)
    with without_collector():
        from jbclog.analysis.compare import compare as compared
        from jbclog.analysis.compare_words import facts, lines
        from jbclog.analysis.opening import open_run

    found = compared(open_run(first), open_run(second), margin)
    if as_json:
        echo_json(exact_figures(facts(found)))
    else:
        echo(*lines(found))
    if plot is not None:
        with drawing():
            from jbclog.analysis.plots import overlay

        save_figure(overlay(found), plot)
