"""`jbclog annotate`: what is said of a run after it was sealed."""

from __future__ import annotations

from pathlib import Path

import typer

from jbclog.cli import options
from jbclog.cli.options import expect_run
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.core.errors import UsageError


@ends_with_errors_told
def annotate(
    run: Path = options.RUN,
    text: str | None = typer.Argument(None, metavar="TEXT", help="The note.", show_default=False),
    by: str | None = typer.Option(None, "--by", metavar="WHO", help="Who writes it.", show_default=False),
    reason: str | None = typer.Option(None, "--reason", metavar="TEXT", help="Why.", show_default=False),
    unit: str | None = typer.Option(
        None, "--unit", metavar="SERIAL", help="In place of TEXT: a unit of this run, added late.", show_default=False
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Add a permanent note to a sealed run.

    The record itself never changes. Each note is added to annotations.jsonl in the run's folder, each line with the
    hash of the one before it; `check` finds what was changed there. Nothing can be removed: correct a note with another one.
    Prints the new head: a note of it elsewhere proves the last line too. Without TEXT it shows the notes so far.
    With --unit the run is found by that serial, and its joints are that unit's where no other is known.

    \b
    Example:
      jbclog annotate runs/20261121T013000Z-bench-3-k7qd "SN-0012 was scrapped" --by "A. Rossi" --reason "cracked joint"
    """
    expect_run(run)
    if text is not None and unit is not None:
        raise UsageError("annotate: a TEXT or a --unit, not both in one line")
    if unit is not None:
        from jbclog.record.annotations import LATE

        _say(run, "--unit", unit, by, reason, as_json=as_json, kind=LATE)
    elif text is None:
        if by is not None or reason is not None:
            raise UsageError("annotate: --by and --reason need a TEXT to stand beside")
        _show(run, as_json=as_json)
    else:
        _say(run, "TEXT", text, by, reason, as_json=as_json)


def _say(run: Path, option: str, text: str, by: str | None, reason: str | None, *, as_json: bool, kind: str = "note") -> None:
    from jbclog.record.annotations import append
    from jbclog.record.chains import short_head

    who, why = _given("--by", by), _given("--reason", reason)
    options.check_text(option, text)
    head = append(run, who=who, what=_given(option, text).strip(), why=why, kind=kind)
    if as_json:
        tell_json({"run": str(run), "head": head})
    else:
        tell(f"{run}: said (head of the annotations {short_head(head)})")


def _given(option: str, text: str | None) -> str:
    """Raises `UsageError` where there is nothing, or what could not be shown as it is."""
    if text is None or not text.strip():
        raise UsageError(f"annotate: {option} is needed: who says something, what, and why")
    options.check_text(option, text)
    return text


def _show(run: Path, *, as_json: bool) -> None:
    from dataclasses import asdict

    from jbclog.record.annotations import read

    found = read(run)
    if as_json:
        tell_json({"run": str(run), "said": [asdict(one) for one in found.said], "head": found.head})
    else:
        for one in found.said:
            what = f"unit {one.what}" if one.kind == "unit.late" else one.what
            tell(f"{one.time[:19].replace('T', ' ')}  {one.who}: {what} ({one.why})")
        if not found.said:
            tell(f"{run}: nothing was said of it since it was sealed")
    for number, wrong in found.wrong:
        note(f"annotations.jsonl: line {number} {wrong}")
    if found.wrong:
        raise typer.Exit(1)
