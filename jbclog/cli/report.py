"""`jbclog report`: what a run was, on a page."""

from __future__ import annotations

from pathlib import Path

import typer

from jbclog.cli import options
from jbclog.cli.options import expect_run
from jbclog.cli.output import ends_with_errors_told, tell, tell_json


@ends_with_errors_told
def report(
    run: Path = options.RUN,
    verify: bool = typer.Option(False, "--verify", help="Write nothing: make report and verdict again and compare."),
    as_json: bool = options.AS_JSON,
) -> None:
    """Write a run's report: page, PDF to sign, JSON and tables.

    The verdict with its rules, joints and their recovery, alarms as episodes with what was acknowledged, the tip verification of
    each port, and all that was read, set, counted and lost. report.html, report.pdf, report.json, the figures and, for
    spreadsheets, tables/*.csv are put into the run's folder. The page opens without a network, prints on A4, and its figures can
    be looked at closer; all of them name the manifest that they were made from. Made again from the same run it has the same
    bytes, and the verdict comes out the same: --verify does both, writes nothing, and ends with 1 where a file or a rule differs.
    A run of an earlier version of the rules is judged by that version.

    \b
    Example:
      jbclog report runs/20261121T013000Z-bench-3-k7qd
    """
    expect_run(run)
    if verify:
        _verify(run, as_json=as_json)
        return
    from jbclog.report.write import write_report

    page = write_report(run)
    if as_json:
        tell_json(
            {"run": str(run), "report": str(page), "json": str(page.with_suffix(".json")), "pdf": str(page.with_suffix(".pdf"))}
        )
    else:
        tell(str(page))


def _verify(run: Path, *, as_json: bool) -> None:
    from jbclog.report.write import verify_report

    differing = verify_report(run)
    if as_json:
        tell_json({"run": str(run), "agrees": not differing, "findings": differing})
    else:
        for text in differing or [f"{run}: the report is what its record gives"]:
            tell(text)
    if differing:
        raise typer.Exit(1)
