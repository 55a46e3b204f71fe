"""`jbclog trend`: a metric over many runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli.options import expect_file_place, is_folder
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.core.errors import RecordError, UsageError

if TYPE_CHECKING:
    from jbclog.analysis.runs import Runs
    from jbclog.analysis.trend import Trend

PICTURES = (".png", ".svg", ".pdf")
MOST_SIGNALS = 10


@ends_with_errors_told
def trend(
    folder: Path = typer.Argument(Path("runs"), metavar="DIR", help="The folder of runs."),
    metric: str = typer.Option("idle_error_c", "--metric", "-m", metavar="NAME", help="Which metric; `list` shows them all."),
    station: str | None = typer.Option(None, "--station", "-s", metavar="NAME", help="Only this station."),
    port: int | None = typer.Option(None, "--port", "-p", min=1, max=4, metavar="N", help="Only this port."),
    lower: float | None = typer.Option(None, metavar="VALUE", help="The lower limit that capability is held against."),
    upper: float | None = typer.Option(None, metavar="VALUE", help="The upper limit."),
    line: str | None = typer.Option(None, metavar="NAME", help="Only runs of this line."),
    recipe: str | None = typer.Option(None, metavar="NAME[@REVISION]", help="Only runs of this recipe."),
    product: str | None = typer.Option(None, metavar="NAME", help="Only runs of this product."),
    order: str | None = typer.Option(None, metavar="NUMBER", help="Only runs of this order."),
    since: str | None = typer.Option(None, metavar="TIME", help="Begun then or later: 2026-11-21, UTC."),
    until: str | None = typer.Option(None, metavar="TIME", help="Begun before then; a day is included."),
    plot: Path | None = typer.Option(None, "--plot", metavar="FILE", help="Draw it: a .png, .svg or .pdf file."),
    html: Path | None = typer.Option(None, "--html", metavar="FILE", help="Write a page with picture and table."),
    as_json: bool = typer.Option(False, "--json", help="One JSON object on stdout."),
) -> None:
    """Show a metric over many runs: control chart, capability.

    A value a run and port, from its record. Control limits want 20 runs, capability 30 and a stated limit; where the values are
    too few, alike from run to run, below their resolution or not stable, the figure is refused with the reason. Such figures
    describe what was recorded; none says that a joint is good.

    \b
    Example:
      jbclog trend runs --metric recovery_s --station dde-1 --upper 4 --plot recovery.png
    """
    if metric == "list":
        _list(as_json=as_json)
        return
    _expect_picture(plot)
    for option, path in (("--plot", plot), ("--html", html)):
        expect_file_place(option, path)
    from jbclog.analysis.trend import trends

    runs = _runs(folder, line, recipe, product, order, since, until)
    found = trends(runs, metric, station, port, lower, upper)
    for one in runs.unreadable:
        note(f"{one.folder}: {one.why}")
    _tell(found, runs, metric, as_json=as_json)
    if plot is not None or html is not None:
        _draw(found, metric, lower, upper, plot, html)


def _runs(
    folder: Path, line: str | None, recipe: str | None, product: str | None, order: str | None, since: str | None, until: str | None
) -> Runs:
    from jbclog.analysis.runs import open_runs
    from jbclog.cli.runs import moment

    if not is_folder(folder):
        raise UsageError(f"{folder}: there is no such folder; runs are in `runs/`, or where --out put them")
    begin, end = moment("--since", since), moment("--until", until, is_end=True)
    return open_runs(folder, line=line, recipe=recipe, product=product, order=order, since=begin, until=end)


def _expect_picture(plot: Path | None) -> None:
    if plot is not None and plot.suffix.lower() not in PICTURES:
        raise UsageError(f"--plot {plot}: give a file that ends in {', '.join(PICTURES)}")


def _list(*, as_json: bool) -> None:
    from jbclog.analysis.run_metrics import definitions

    rows = definitions().to_dict("records")
    if as_json:
        tell_json({"metrics": rows})
        return
    for row in rows:
        tell(f"{row['metric']:28} {row['unit']:6} {row['definition']}")


def _tell(found: list[Trend], runs: Runs, metric: str, *, as_json: bool) -> None:
    from jbclog.analysis.trend import metric_text
    from jbclog.analysis.trend_words import facts, lines

    if as_json:
        body = [facts(one) for one in found]
        tell_json(
            {"folder": str(runs.folder), "runs": len(runs), "metric": metric, "definition": metric_text(metric), "trends": body}
        )
        return
    for one in found:
        for text in lines(one):
            tell(text)
    note(f"{metric}: {metric_text(metric)}" if found else f"{runs.folder}: no run gives {metric}")


def _draw(found: list[Trend], metric: str, lower: float | None, upper: float | None, plot: Path | None, html: Path | None) -> None:
    from jbclog.analysis.plots import trend_figure
    from jbclog.analysis.trend_words import page

    figure = trend_figure(found, lower, upper)
    try:
        if plot is not None:
            figure.savefig(plot, dpi=150)
        if html is not None:
            html.write_text(page(found, metric, figure), encoding="utf-8")
    except OSError as error:
        raise RecordError(f"{plot if html is None else html} cannot be written: {error.strerror or error}") from error
    for path in (plot, html):
        if path is not None:
            note(f"written: {path}")
