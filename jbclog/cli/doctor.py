"""`jbclog doctor`: diagnose this machine's setup."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json

if TYPE_CHECKING:
    from jbclog.app.doctor import Looked

LINE = typer.Option(None, "--line", "-l", metavar="FILE", help="Ask the stations of this line file, too.", show_default=False)


@ends_with_errors_told
def doctor(
    line: Path | None = LINE,
    out: Path = typer.Option(Path("runs"), "--out", "-o", metavar="DIR", help="The folder that runs are to be recorded in."),
    as_json: bool = options.AS_JSON,
) -> None:
    """Diagnose this machine's setup and suggest fixes.

    Looks at the folder for runs, the clock and the USB serial ports; with a line file, at each of its stations, with questions
    only. A port that a run or another program holds is left alone. Ends with 1 where there is a finding.

    \b
    Example:
      jbclog doctor --line line.toml
    """
    from jbclog.app.doctor import Fine, examine
    from jbclog.config.line import load_line

    loaded = load_line(line) if line else None
    if loaded and not as_json:
        note(f"asking the stations of {loaded.path}; one that does not answer takes half a minute")
    looked = examine(loaded, out)
    findings = [one for one in looked if not isinstance(one, Fine)]
    if as_json:
        tell_json({"fine": not findings, "looked": [_facts(one) for one in looked]})
    else:
        _tell(looked)
        tell(f"{len(findings)} finding{'' if len(findings) == 1 else 's'}" if findings else "everything is fine")
    if findings:
        raise typer.Exit(1)


def _tell(looked: list[Looked]) -> None:
    from jbclog.app.doctor import Fine

    for one in looked:
        if isinstance(one, Fine):
            tell(f"fine     {one.where}: {one.what}")
        else:
            tell(f"FINDING  {one.where}: {one.what}")
            tell(f"  step   {one.step}")


def _facts(one: Looked) -> dict[str, object]:
    from jbclog.app.doctor import Fine

    step = None if isinstance(one, Fine) else one.step
    return {"kind": one.kind, "where": one.where, "what": one.what, "step": step}
