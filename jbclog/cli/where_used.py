"""`jbclog where-used`: the runs that used a tip which failed its verification."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.options import NO_FOLDER, is_folder
from jbclog.cli.output import echo_json, echo_table, note, reports_errors, run_facts
from jbclog.cli.times import are_local, head_of_times, range_text, shown_moment, typed_moment
from jbclog.core.errors import UsageError
from jbclog.core.text import count_text

if TYPE_CHECKING:
    from jbclog.maintenance.suspect_runs import Suspect, Used

HEADS = ("tips", "order", "units", "verdict", "run")


@reports_errors
def where_used(
    folder: Path = options.RUNS,
    station: str = typer.Option(
        ..., "--station", "-s", metavar="NAME", help="Station name.", show_default=False
    ),
    port: int | None = typer.Option(
        None, "--port", "-p", min=1, max=4, metavar="N", help="Port number.", show_default=False
    ),
    tip: str | None = typer.Option(
        None, metavar="ID", help="Tip; runs without a named tip are included.", show_default=False
    ),
    since: str | None = typer.Option(
        None,
        metavar="TIME",
        help="Day or time; default: the last passed verification.",
        show_default=False,
    ),
    verifications: Path | None = typer.Option(
        None,
        "--verifications",
        metavar="DIR",
        help="Folder with verifications.jsonl; default: DIR.",
        show_default=False,
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """List the runs that used a tip since its last pass.

    Starts from the last failed verification: lists every run between the pass before it and the
    pass after it, with its units where they are known. Exit code 1: a manifest or the file of
    verifications cannot be read, so the list may be incomplete. On a terminal, times are local, and
    TIME without a zone is; in a pipe, a file and with --json they are UTC.

    \b
    Example:
      jbclog where-used --station dde-1 --port 1
    """
    from jbclog.maintenance.suspect_runs import where_used as suspects
    from jbclog.record.find_runs import find

    if not is_folder(folder):
        raise UsageError(NO_FOLDER.format(folder))
    is_local = are_local(as_json=as_json)
    begin = typed_moment("--since", since, is_local=is_local)
    found = suspects(folder, station, port, tip, begin, find, verifications)
    if as_json:
        echo_json(facts(found))
    else:
        note(found.why)
        if found.runs:
            heads = (head_of_times("start", is_local=is_local), *HEADS)
            echo_table(heads, [row(used, is_local=is_local) for used in found.runs])
        else:
            note(f"no runs{range_text(found.since, found.until)}")
    for number, wrong in found.wrong:
        note(f"verifications.jsonl: line {number} {wrong}")
    for one in found.unreadable:
        note(f"{one.folder}: {one.why}")
    if found.wrong or found.unreadable:
        raise typer.Exit(1)


def row(used: Used, *, is_local: bool) -> tuple[str, ...]:
    """Return a run as a row: its start, then `HEADS`."""
    places = ", ".join(
        f"port {port} {tip or '(tip not named)'}"
        for port, tip in zip(used.ports, used.tips, strict=True)
    )
    listed = f"{count_text(len(used.units), 'unit')}: {', '.join(used.units)}"
    units = listed if used.units else "units not known"
    started = shown_moment(used.start, is_local=is_local)
    return started, places, used.order or "no order", units, used.verdict or "-", str(used.folder)


def facts(found: Suspect) -> dict[str, object]:
    """Return the result as JSON data."""
    runs = [
        {
            **run_facts(used.folder),
            **{key: value for key, value in asdict(used).items() if key != "folder"},
        }
        for used in found.runs
    ]
    return {
        "bad": None if found.bad is None else asdict(found.bad),
        "since": None if found.since is None else found.since.isoformat(),
        "until": None if found.until is None else found.until.isoformat(),
        "why": found.why,
        "runs": runs,
        "unreadable": [{**run_facts(one.folder), "why": one.why} for one in found.unreadable],
        "wrong": [f"line {number} {text}" for number, text in found.wrong],
    }
