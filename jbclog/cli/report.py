"""`jbclog report`: the report of a run."""

from __future__ import annotations

from pathlib import Path

import typer

from jbclog.cli import options
from jbclog.cli.loading import drawing
from jbclog.cli.options import expect_run
from jbclog.cli.output import echo, echo_json, reports_errors


@reports_errors
def report(
    run: Path = options.RUN,
    verify: bool = typer.Option(
        False, "--verify", help="Reproduce report and verdict, compare; write nothing."
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Write a run's report: page, PDF to sign, JSON and tables.

    Writes report.html, report.pdf, report.json, figures and tables/*.csv into the run folder: the
    verdict with its rules, joints and recovery, alarm episodes and acknowledgements, tip
    verifications, settings, counters and losses. The page works offline, prints on A4 and zooms
    into its figures. Each file names the manifest it was made from. The same run gives the same
    bytes and the same verdict, by the version of the rules that the run was judged by. --verify
    reproduces both; exit code 1: a file or a rule differs, or the report was made by another
    jbclog, typesetter or drawing library and cannot be compared byte for byte ("agrees": null with
    --json). Make it again to compare it.

    \b
    Example:
      jbclog report runs/20261121T013000Z-bench-3-k7qd
    """
    expect_run(run)
    if verify:
        _verify(run, as_json=as_json)
        return
    with drawing():
        from jbclog.report.write import write_report

    page = write_report(run)
    if as_json:
        echo_json(
            {
                "run": str(run),
                "report": str(page),
                "json": str(page.with_suffix(".json")),
                "pdf": str(page.with_suffix(".pdf")),
            }
        )
    else:
        echo(str(page))


def _verify(run: Path, *, as_json: bool) -> None:
    from jbclog.report.verify import verified

    found = verified(run)
    findings = [*found.differing, *found.not_compared]
    if as_json:
        echo_json(
            {"run": str(run), "agrees": found.agrees, "findings": findings, "notes": found.notes}
        )
    else:
        echo(*found.notes, *(findings or [f"{run}: the report matches its record"]))
    if found.agrees is not True:
        raise typer.Exit(1)
