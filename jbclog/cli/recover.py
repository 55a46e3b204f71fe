"""`jbclog recover`: finish what a crash left open."""

from __future__ import annotations

from pathlib import Path

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, tell, tell_json


@ends_with_errors_told
def recover(
    folder: Path = typer.Argument(..., help="A run's folder, or a folder of runs.", show_default=False),
    as_json: bool = options.AS_JSON,
) -> None:
    """Seal runs that a crash left open, with every row that was committed; doing it twice changes nothing.

    The manifest of such a run says that it was lost, and what of it may be missing. A run in progress is left alone.

    Example: jbclog recover runs
    """
    from jbclog.record.recover import recover as recover_runs

    for line in recover_runs(folder):
        tell(str(line))
