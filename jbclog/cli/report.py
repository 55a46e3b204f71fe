"""`jbclog report`: the report of a run."""

from __future__ import annotations

from pathlib import Path

from jbclog.cli import options
from jbclog.cli.loading import drawing
from jbclog.cli.options import expect_run
from jbclog.cli.output import echo, echo_json, reports_errors, run_facts


@reports_errors
def report(
    run: Path = options.RUN,
    as_json: bool = options.AS_JSON,
) -> None:
    """Write a run's report: page, PDF to sign, JSON and tables.

    Writes report.html, report.pdf, report.json, figures and tables/*.csv into the run folder: the
    verdict with its rules, joints and recovery, alarm episodes and acknowledgements, tip
    verifications, settings, counters and losses. The page works offline, prints on A4 and zooms
    into its figures. Each file names the manifest it was made from. The same run and the same
    versions of jbclog, typesetter and drawing library give the same bytes. `check` compares the
    files with their hashes.

    \b
    Example:
      jbclog report runs/20261121T013000Z-bench-3-k7qd
    """
    expect_run(run)
    with drawing():
        from jbclog.report.write import write_report

    page = write_report(run)
    if as_json:
        echo_json(
            {
                **run_facts(run),
                "report": str(page),
                "json": str(page.with_suffix(".json")),
                "pdf": str(page.with_suffix(".pdf")),
            }
        )
    else:
        echo(str(page))
