"""`jbclog run`: the main job."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.cli.run_wording import reasons_told
from jbclog.cli.streams import never_wait
from jbclog.cli.unit_lines import listed, source_of, unshown
from jbclog.core.outcome import Exit, in_order, tools_text

if TYPE_CHECKING:
    from jbclog.app.run.plan import Plan, RunOptions
    from jbclog.app.run.run_record import Result
    from jbclog.transport.typed_lines import LineSource

MOST_REASONS = 12  # told on the terminal; all of them are in the manifest and the report


@ends_with_errors_told
def run(
    recipe: Path | None = options.RECIPE,
    line: Path = options.LINE,
    out: Path = options.OUT,
    duration: str | None = options.DURATION,
    until_units: int | None = options.UNTIL_UNITS,
    until_joints: int | None = options.UNTIL_JOINTS,
    rate: str | None = options.RATE,
    stations: list[str] = options.STATION,
    operator: str | None = typer.Option(None, metavar="NAME", help="Who runs it."),
    order: str | None = typer.Option(None, metavar="NUMBER", help="The work order."),
    product: str | None = typer.Option(None, metavar="NAME", help="What is made."),
    unit: list[str] = typer.Option([], metavar="SERIAL", help="A unit that is made; may be repeated."),
    units: str | None = typer.Option(
        None,
        metavar="-|FILE",
        help="Serials of units, a line each, read during the run: what a barcode reader types (-), a pipe or a device. "
        "Of a plain file all lines are units from the start.",
        show_default=False,
    ),
    wire_lot: list[str] = typer.Option([], metavar="LOT", help="The solder wire's lot; may be repeated."),
    flux_lot: list[str] = typer.Option([], metavar="LOT", help="The flux's lot; may be repeated."),
    tip: list[str] = typer.Option(
        [], metavar="[STATION[:PORT]=]ID", help="Which tip is in the tools, or in one station's, or in one; may be repeated."
    ),
    tag: list[str] = typer.Option([], metavar="NAME=VALUE", help="Anything else to keep with the run; may be repeated."),
    wire: bool = typer.Option(False, "--wire", help="Keep every byte with its time in the run's folder, for `jbclog replay`."),
    no_guard: bool = typer.Option(False, "--no-guard", help="Run without the process that makes tools safe if this one dies."),
    allow_omega_write: bool = options.ALLOW_OMEGA_WRITE,
    allow_missing: bool = typer.Option(False, "--allow-missing", help="Start without stations that are missing or refuse."),
    as_json: bool = options.AS_JSON,
) -> None:
    """Apply a recipe, prove that it took, and record until the end.

    All stations start together: first each is read and checked, then what cannot heat is written, then setpoints and status. If
    one fails, none starts. Every setting is read back. Ctrl-C ends the run, puts the tools in their safe state and closes the
    record. The last line of stdout is the run's folder.

    --until-units and --until-joints end the run at that number, --duration at the latest; a run that ends with fewer has exit
    code 1.

    \b
    Example:
      jbclog run profiles/recipes/sn100c-tht.toml --line virtual/line.toml --duration 15m --operator "A. Rossi" --order 88123
    """
    never_wait()
    several = {"--unit": [*unit, *listed(units)], "--tag": tag, "--wire-lot": wire_lot, "--flux-lot": flux_lot, "--tip": tip}
    said = options.metadata(operator, order, product, several)
    source = source_of(units)
    said = replace(said, reads_units=source is not None)
    wanted = options.wanted(line, recipe, stations, duration, rate, said, allow_omega_write=allow_omega_write)
    wanted = replace(
        wanted, allow_missing=allow_missing, wire=wire, guard=not no_guard, until_units=until_units, until_joints=until_joints
    )
    code = record(wanted, out, source, as_json=as_json)
    raise typer.Exit(code)


def record(wanted: RunOptions, out: Path, units: LineSource | None = None, *, as_json: bool) -> int:
    """Carry out the one job that there is, as a batch does each of its own, and tell what came of it; give the exit code."""
    from jbclog.app.run.runner import Job, carry_out
    from jbclog.cli.progress import BackgroundObserver, observer

    shown = BackgroundObserver(observer(wanted.duration_s, quiet=as_json))
    try:
        with unshown(units):
            result = carry_out(Job(wanted, out), shown, units=units, missed=shown.missed, planned=_tell_notes)
    finally:
        shown.close()
    if as_json:
        tell_json(_facts(result))
    else:
        _tell(result)
    return result.exit_code.value


def _tell_notes(plan: Plan) -> None:
    for text in plan.notes:
        note(f"note: {text}")


def _tell(result: Result) -> None:
    for finding in in_order(result.findings):
        note(f"exit {finding.code.value}: {finding.text}")
    if result.exit_code is Exit.NOT_FINE:  # worse ones say already why there is no better verdict
        _tell_reasons(result)
    note(tools_text(result.manifest.stations))
    note(f"verdict: {result.manifest.verdict}; exit code {result.exit_code.value}")
    tell(str(result.folder))


def _tell_reasons(result: Result) -> None:
    reasons = reasons_told(result.manifest.verdict_rules)
    for text in reasons[:MOST_REASONS]:
        note(f"  {text}")
    if len(reasons) > MOST_REASONS:
        note(f"  and {len(reasons) - MOST_REASONS} more: `jbclog report {result.folder}` shows them")


def _facts(result: Result) -> dict[str, object]:
    manifest = result.manifest
    return {
        "run": str(result.folder),
        "verdict": manifest.verdict,
        "exit_code": result.exit_code.value,
        "findings": [{"code": one.code.value, "text": one.text} for one in in_order(result.findings)],
        "rules": [rule for rule in manifest.verdict_rules if rule["result"] != "pass"],
        "goals": [asdict(goal) for goal in manifest.goals],
        "safe_state": {facts.name: facts.safe_state for facts in manifest.stations},
    }
