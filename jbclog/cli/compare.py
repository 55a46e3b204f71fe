"""`jbclog compare`: two runs side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.options import expect_file_place, expect_run
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.core.errors import RecordError, UsageError

if TYPE_CHECKING:
    from jbclog.analysis.compare import Comparison

PICTURES = (".png", ".svg", ".pdf")


@ends_with_errors_told
def compare(
    first: Path = typer.Argument(..., metavar="RUN", help="A run's folder.", show_default=False),
    second: Path = typer.Argument(..., metavar="RUN", help="The other run's folder.", show_default=False),
    margin: float = typer.Option(2.0, metavar="C", help="How far apart idle means may be, in °C, to count as equivalent."),
    plot: Path | None = typer.Option(None, "--plot", metavar="FILE", help="Draw both: a .png, .svg or .pdf file."),
    as_json: bool = options.AS_JSON,
) -> None:
    """Show two runs side by side, and what differs.

    Differences are the second minus the first. Whether two tips idle the same is asked by two one-sided tests within --margin
    (TOST, 5 %): equivalent, different, or not known. That nothing was found to differ is no proof that nothing does.

    \b
    Example:
      jbclog compare runs/20261121T013000Z-bench-3-k7qd runs/20261122T013000Z-bench-3-m4tz --plot both.png
    """
    for run in (first, second):
        expect_run(run)
    if plot is not None and plot.suffix.lower() not in PICTURES:
        raise UsageError(f"--plot {plot}: give a file that ends in {', '.join(PICTURES)}")
    expect_file_place("--plot", plot)
    from jbclog.analysis.compare import compare as compared
    from jbclog.analysis.compare import facts, lines
    from jbclog.analysis.run import open_run

    found = compared(open_run(first), open_run(second), margin)
    if as_json:
        tell_json(facts(found))
    else:
        for text in lines(found):
            tell(text)
    if plot is not None:
        _draw(found, plot)


def _draw(found: Comparison, plot: Path) -> None:
    from jbclog.analysis.plots import overlay

    try:
        overlay(found).savefig(plot, dpi=150)
    except OSError as error:
        raise RecordError(f"{plot} cannot be written: {error.strerror or error}") from error
    note(f"written: {plot}")
