"""`jbclog where-used`: the runs that stood on a tip that turned out bad."""

from __future__ import annotations

from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli.options import is_folder
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.maintenance.verification import Suspect, Used

LAST_GOOD = "LAST_GOOD"


@ends_with_errors_told
def where_used(
    folder: Path = typer.Argument(Path("runs"), metavar="DIR", help="The folder of runs."),
    station: str = typer.Option(..., "--station", "-s", metavar="NAME", help="Which station.", show_default=False),
    port: int | None = typer.Option(None, "--port", "-p", min=1, max=4, metavar="N", help="Only this port.", show_default=False),
    tip: str | None = typer.Option(
        None, metavar="ID", help="Only this tip; runs that do not say which tip they had are shown, too.", show_default=False
    ),
    since: str = typer.Option(
        LAST_GOOD, metavar="TIME", help="Since then: a day or a time, UTC. Default: the last good verification."
    ),
    as_json: bool = typer.Option(False, "--json", help="One JSON object on stdout."),
) -> None:
    """Show the runs that used a tip since it was last good.

    The last verification that failed is the bad one. Every run that was on between the last that passed before it and the next
    that passed after it is shown with its units, where they are known. Ends with 1 where a manifest, or the file of
    verifications, cannot be read: the list may then miss some.

    \b
    Example:
      jbclog where-used --station dde-1 --port 1
    """
    from jbclog.maintenance.verification import where_used as suspects

    if not is_folder(folder):
        raise UsageError(f"{folder}: there is no such folder; runs are in `runs/`, or where --out put them")
    found = suspects(folder, station, port, tip, _moment(since))
    if as_json:
        tell_json(facts(found))
    else:
        note(found.why)
        for used in found.runs:
            tell(row(used))
        if not found.runs:
            note("no run")
    for number, wrong in found.wrong:
        note(f"verifications.jsonl: line {number} {wrong}")
    for one in found.unreadable:
        note(f"{one.folder}: {one.why}")
    if found.wrong or found.unreadable:
        raise typer.Exit(1)


def _moment(text: str) -> datetime | None:
    from jbclog.cli.runs import moment

    return None if text == LAST_GOOD else moment("--since", text)


def row(used: Used) -> str:
    """A run on a line: when, ports with tips, order, units, verdict, folder."""
    places = ", ".join(f"port {port} {tip or '(tip not named)'}" for port, tip in zip(used.ports, used.tips, strict=True))
    units = f"{len(used.units)} units: {', '.join(used.units)}" if used.units else "units not known"
    order = f"order {used.order}" if used.order else "no order"
    return f"{(used.started or '-')[:16].replace('T', ' ')}  {places}  {order}  {units}  {used.verdict or '-'}  {used.folder}"


def facts(found: Suspect) -> dict[str, object]:
    """As one JSON object; a run's folder is its key `run`."""
    runs = [
        {"run": str(used.folder), **{key: value for key, value in asdict(used).items() if key != "folder"}} for used in found.runs
    ]
    return {
        "bad": None if found.bad is None else asdict(found.bad),
        "since": None if found.since is None else found.since.isoformat(),
        "until": None if found.until is None else found.until.isoformat(),
        "why": found.why,
        "runs": runs,
        "unreadable": [{"run": str(one.folder), "why": one.why} for one in found.unreadable],
        "wrong": [f"line {number} {text}" for number, text in found.wrong],
    }
