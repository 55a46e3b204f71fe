"""`jbclog report`: what a run was, on a page."""

from __future__ import annotations

from pathlib import Path

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, tell, tell_json


@ends_with_errors_told
def report(
    run: Path = typer.Argument(..., help="A run's folder.", show_default=False),
    as_json: bool = options.AS_JSON,
) -> None:
    """Write report.html and report.json into a run's folder.

    The page opens without a network and prints on A4. It names the manifest that it was made from.

    Example: jbclog report runs/20261121T013000Z-bench-3-k7qd
    """
    from jbclog.report import write_report

    page = write_report(run)
    if as_json:
        tell_json({"run": str(run), "report": str(page), "json": str(page.with_suffix(".json"))})
    else:
        tell(str(page))
