"""`jbclog annotate`: permanent notes on a sealed run."""

from __future__ import annotations

from pathlib import Path

import typer

from jbclog.cli import options
from jbclog.cli.options import expect_run
from jbclog.cli.output import echo, echo_json, note, reports_errors, run_facts
from jbclog.core.errors import UsageError


@reports_errors
def annotate(
    run: Path = options.RUN,
    text: str | None = typer.Argument(None, metavar="TEXT", help="Note.", show_default=False),
    by: str | None = typer.Option(
        None,
        "--by",
        metavar="WHO",
        help="Author.  [required with TEXT or --unit]",
        show_default=False,
    ),
    reason: str | None = typer.Option(
        None,
        "--reason",
        metavar="TEXT",
        help="Reason.  [required with TEXT or --unit]",
        show_default=False,
    ),
    unit: str | None = typer.Option(
        None,
        "--unit",
        metavar="SERIAL",
        help="Instead of TEXT: a unit of this run.",
        show_default=False,
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Add a permanent note to a sealed run.

    Appends to annotations.jsonl in the run's folder; the record never changes. Each line holds the
    hash of the one before it, so `check` detects changes. Correct a note by another note. Prints
    the new fingerprint; a copy kept elsewhere also proves the last line. Without TEXT, lists the
    notes. --unit adds a serial: `runs` finds the run by it, and joints without a known unit count
    as its joints.

    \b
    Example:
      jbclog annotate runs/20261121T013000Z-bench-3-k7qd "SN-0012 was scrapped" --by "A. Rossi" --reason "cracked joint"
    """  # noqa: E501  # a command is copied as one line
    expect_run(run)
    if text is not None and unit is not None:
        raise UsageError("annotate: give TEXT or --unit, not both")
    if unit is not None:
        from jbclog.record.annotations import LATE

        _add(run, "--unit", unit, by, reason, as_json=as_json, kind=LATE)
    elif text is None:
        if by is not None or reason is not None:
            raise UsageError(
                "annotate: --by and --reason are of a note: give its TEXT, or --unit SERIAL;"
                " nothing was added"
            )
        _show(run, as_json=as_json)
    else:
        _add(run, "TEXT", text, by, reason, as_json=as_json)


def _add(
    run: Path,
    option: str,
    text: str,
    by: str | None,
    reason: str | None,
    *,
    as_json: bool,
    kind: str = "note",
) -> None:
    from jbclog.record.annotations import append
    from jbclog.record.chains import short_head

    who, why = options.signed("annotate", by, reason)
    if not text.strip():
        raise UsageError(f"annotate: {option} is empty; nothing was added")
    options.check_text(option, text)
    head = append(run, who=who, what=text.strip(), why=why, kind=kind)
    if as_json:
        echo_json({**run_facts(run), "head": head})
    else:
        echo(f"{run}: note added (annotations fingerprint {short_head(head)})")


def _show(run: Path, *, as_json: bool) -> None:
    from dataclasses import asdict

    from jbclog.record.annotations import read

    found = read(run)
    if as_json:
        echo_json(
            {**run_facts(run), "said": [asdict(one) for one in found.said], "head": found.head}
        )
    else:
        for one in found.said:
            what = f"unit {one.what}" if one.kind == "unit.late" else one.what
            echo(f"{one.time[:19].replace('T', ' ')}  {one.who}: {what} ({one.why})")
        if not found.said:
            echo(f"{run}: no notes")
    for number, wrong in found.wrong:
        note(f"annotations.jsonl: line {number} {wrong}")
    if found.wrong:
        raise typer.Exit(1)
