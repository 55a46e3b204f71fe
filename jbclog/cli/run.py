"""`jbclog run`: the main job."""

from __future__ import annotations

from pathlib import Path

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.plan import Metadata, Wanted


@ends_with_errors_told
def run(
    recipe: Path | None = options.RECIPE,
    line: Path = options.LINE,
    out: Path = options.OUT,
    duration: str | None = options.DURATION,
    rate: str | None = options.RATE,
    stations: list[str] = options.STATION,
    operator: str | None = typer.Option(None, help="Who runs it."),
    order: str | None = typer.Option(None, help="The work order."),
    product: str | None = typer.Option(None, help="What is made."),
    unit: list[str] = typer.Option([], help="Serial number of a unit; may be repeated."),
    tag: list[str] = typer.Option([], help="NAME=VALUE; may be repeated."),
    as_json: bool = options.AS_JSON,
) -> None:
    """Apply a recipe to the stations of a line, prove that it took, and record until the end.

    Every setting is read back before sampling begins. Ctrl-C ends the run: tools are put in their safe state, the record
    is closed. The last line of stdout is the run's folder.

    Example: jbclog run profiles/recipes/sn100c-tht.toml --line line.toml --duration 15m --operator "A. Rossi" --order 88123
    """
    metadata = Metadata(operator, order, product, tuple(unit), options.tags(tag))
    code = record(options.wanted(line, recipe, stations, duration, rate, metadata), out, as_json=as_json)
    raise typer.Exit(code)


def record(wanted: Wanted, out: Path, *, as_json: bool) -> int:
    """Run and tell what came of it; give the exit code."""
    from jbclog.cli.progress import observer
    from jbclog.conduct import conduct
    from jbclog.plan import make_plan

    shown = observer(wanted.duration_s, quiet=as_json)
    try:
        result = conduct(make_plan(wanted), out, shown)
    finally:
        shown.close()
    for finding in result.findings:
        note(f"exit {finding.code.value}: {finding.text}")
    note(f"verdict: {result.manifest.verdict}; exit code {result.exit_code.value}")
    if as_json:
        found = [{"code": one.code.value, "text": one.text} for one in result.findings]
        tell_json(
            {"run": str(result.folder), "verdict": result.manifest.verdict, "exit_code": result.exit_code.value, "findings": found}
        )
    else:
        tell(str(result.folder))
    return result.exit_code.value
