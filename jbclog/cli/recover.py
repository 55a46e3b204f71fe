"""`jbclog recover`: finish what a crash left open."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.options import is_folder
from jbclog.cli.output import ends_with_errors_told, tell, tell_json
from jbclog.core.errors import RecordError, Unsafe, UsageError

if TYPE_CHECKING:
    from jbclog.record.recover import Recovery


@ends_with_errors_told
def recover(
    folder: Path = typer.Argument(..., metavar="DIR", help="A run's folder, or a folder of runs.", show_default=False),
    as_json: bool = options.AS_JSON,
) -> None:
    """Finish runs that a crash left open.

    Every row that was committed is sealed; the manifest of such a run says that it was lost, and what of it may be missing.
    Doing it twice changes nothing. A run in progress is left alone. Ends with 5 where tools of a run may still be hot.

    \b
    Example:
      jbclog recover runs
    """
    from jbclog.record.recover import Outcome, recover_all

    if not is_folder(folder):
        raise UsageError(f"{folder}: there is no such folder")
    done = recover_all(folder)
    if as_json:
        tell_json({"runs": [_facts(one) for one in done]})
    else:
        for one in done:
            tell(one.text)
        if not done:
            tell(f"{folder}: no runs in it")
    if not all(one.is_safe for one in done):
        raise typer.Exit(Unsafe.exit_code)
    if any(one.outcome is Outcome.REFUSED for one in done):
        raise typer.Exit(RecordError.exit_code)


def _facts(one: Recovery) -> dict[str, object]:
    return {"run": str(one.folder), "outcome": one.outcome.value, "text": one.text, "rows": dict(one.rows), "safe": one.is_safe}
