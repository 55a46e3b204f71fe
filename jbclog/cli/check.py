"""`jbclog check`: does a record still say what it said?"""

from __future__ import annotations

from pathlib import Path

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, tell, tell_json
from jbclog.cli.place import expect_run


@ends_with_errors_told
def check(
    run: Path = options.RUN,
    as_json: bool = options.AS_JSON,
) -> None:
    """Derive hashes, row counts and ledger again, and compare.

    The chain of events too. Says what does not agree, and ends with 1 where anything does not.

    \b
    Example:
      jbclog check runs/20261121T013000Z-bench-3-k7qd
    """
    from jbclog.record.check import check as check_run

    expect_run(run)
    found = check_run(run)
    if as_json:
        tell_json({"run": str(run), "agrees": not found, "findings": [str(finding) for finding in found]})
    else:
        for finding in found:
            tell(str(finding))
        tell(f"{run}: {len(found)} finding{'s' if len(found) > 1 else ''}" if found else f"{run}: everything agrees")
    if found:
        raise typer.Exit(1)
