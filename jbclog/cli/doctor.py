"""`jbclog doctor`: diagnose this machine's setup."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import echo, echo_json, note, reports_errors
from jbclog.core.text import count_text

if TYPE_CHECKING:
    from jbclog.app.doctor import Looked

LINE = typer.Option(
    None,
    "--line",
    "-l",
    metavar="FILE",
    help="Line file: also check its stations.",
    show_default=False,
)


@reports_errors
def doctor(
    ctx: typer.Context,
    line: Path | None = LINE,
    out: Path = typer.Option(
        Path("runs"), "--out", "-o", metavar="DIR", help="Folder of runs to check."
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Diagnose this machine's setup and suggest fixes.

    Checks the folder of runs, the clock and the USB serial ports; with --line also each station, by
    queries only. Skips ports in use. Exit code 1: at least one finding.

    \b
    Example:
      jbclog doctor --line line.toml
    """
    from jbclog.app.doctor import Fine, examine
    from jbclog.config.line import load_line

    loaded = load_line(line) if line else None
    if loaded and not as_json:
        note(f"checking the stations of {loaded.path}; one that does not answer takes up to 30 s")
    looked = examine(loaded, out, access=options.port_access(ctx))
    findings = [one for one in looked if not isinstance(one, Fine)]
    if as_json:
        echo_json({"fine": not findings, "looked": [_facts(one) for one in looked]})
    else:
        _print(looked)
        echo(count_text(len(findings), "finding") if findings else "no findings")
    if findings:
        raise typer.Exit(1)


def _print(looked: list[Looked]) -> None:
    from jbclog.app.doctor import Fine

    for one in looked:
        if isinstance(one, Fine):
            echo(f"fine     {one.where}: {one.what}")
        else:
            echo(f"FINDING  {one.where}: {one.what}")
            echo(f"  step   {one.step}")


def _facts(one: Looked) -> dict[str, object]:
    from jbclog.app.doctor import Fine

    step = None if isinstance(one, Fine) else one.step
    return {"kind": one.kind, "where": one.where, "what": one.what, "step": step}
