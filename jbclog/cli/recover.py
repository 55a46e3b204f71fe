"""`jbclog recover`: finalize runs that a crash left open."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.options import is_folder
from jbclog.cli.output import echo, echo_json, reports_errors, run_facts
from jbclog.core.errors import RecordError, Unsafe, UsageError

if TYPE_CHECKING:
    from jbclog.record.recover import Recovery


@reports_errors
def recover(
    folder: Path = typer.Argument(
        ..., metavar="DIR", help="Run folder, or folder of runs.", show_default=False
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Finish runs that a crash left open.

    Finalizes every committed row and notes in the manifest that the run was lost and what may be
    missing. Running it again changes nothing. Skips a run in progress. Exit code 5: tools of a run
    may still be hot.

    \b
    Example:
      jbclog recover runs
    """
    from jbclog.record.recover import Outcome, recover_all

    if not is_folder(folder):
        raise UsageError(f"{folder}: no such folder")
    done = recover_all(folder)
    if as_json:
        echo_json({"runs": [_facts(one) for one in done]})
    else:
        echo(*_lines(folder, done))
    if not all(one.is_safe for one in done):
        raise typer.Exit(Unsafe.exit_code)
    if any(one.outcome is Outcome.REFUSED for one in done):
        raise typer.Exit(RecordError.exit_code)


def _lines(folder: Path, done: list[Recovery]) -> list[str]:
    """Return a line for each run that was not finished before."""
    from jbclog.record.recover import FINISHED

    lines = [one.text for one in done if not (one.is_safe and one.text.endswith(FINISHED))]
    return lines or [f"{folder}: {'nothing to recover' if done else 'no runs'}"]


def _facts(one: Recovery) -> dict[str, object]:
    return {
        **run_facts(one.folder),
        "outcome": one.outcome.value,
        "text": one.text,
        "rows": dict(one.rows),
        "safe": one.is_safe,
    }
