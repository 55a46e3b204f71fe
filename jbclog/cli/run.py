"""`jbclog run`: apply a recipe, confirm it and record, with the serials of `--units`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from jbclog.cli import options
from jbclog.cli.loading import drawing, without_collector
from jbclog.cli.options import Color, check_text
from jbclog.cli.output import echo, echo_json, is_terminal, note, reports_errors, run_facts
from jbclog.cli.streams import never_wait
from jbclog.core.errors import UsageError
from jbclog.core.outcome import VERDICT_FINDING, Exit, in_order, tools_text

if TYPE_CHECKING:
    from jbclog.app.run.options import RunOptions
    from jbclog.app.run.plan import Plan
    from jbclog.app.run.run_record import Result
    from jbclog.transport.typed_lines import LineSource, TypedLine


@reports_errors
def run(
    recipe: Path | None = options.RECIPE,
    line: Path = options.LINE,
    out: Path = options.OUT,
    duration: str | None = options.DURATION,
    until_units: int | None = options.UNTIL_UNITS,
    until_joints: int | None = options.UNTIL_JOINTS,
    rate: str | None = options.RATE,
    stations: list[str] = options.STATION,
    operator: str | None = typer.Option(None, metavar="NAME", help="Operator."),
    order: str | None = typer.Option(None, metavar="NUMBER", help="Work order."),
    product: str | None = typer.Option(None, metavar="NAME", help="Product."),
    unit: list[str] = typer.Option([], metavar="SERIAL", help="Serial of a unit; repeatable."),
    units: str | None = typer.Option(
        None,
        metavar="-|FILE",
        help="Serials, one per line, from a barcode reader (-), pipe or file.",
        show_default=False,
    ),
    wire_lot: list[str] = typer.Option(
        [], metavar="LOT", help="Lot of the solder wire; repeatable."
    ),
    flux_lot: list[str] = typer.Option([], metavar="LOT", help="Lot of the flux; repeatable."),
    tip: list[str] = typer.Option(
        [],
        metavar="[STATION[:PORT]=]ID",
        help="Tip of all tools, one station or one port; repeatable.",
    ),
    tag: list[str] = typer.Option(
        [], metavar="NAME=VALUE", help="Tag stored with the run; repeatable."
    ),
    capture: bool = typer.Option(
        False, "--capture", help="Record a serial capture, for `jbclog check --from-capture`."
    ),
    wire: bool = typer.Option(False, "--wire", hidden=True),  # as older scripts call it
    no_guard: bool = typer.Option(False, "--no-guard", help="Run without the guard process."),
    allow_omega_write: bool = options.ALLOW_OMEGA_WRITE,
    allow_missing: bool = typer.Option(
        False, "--allow-missing", help="Start without stations that are missing or refuse."
    ),
    report: bool = typer.Option(
        False, "--report", help="Write the report at the end, as `jbclog report` does."
    ),
    color: Color = options.COLOR,
    as_json: bool = options.AS_JSON,
) -> None:
    """Apply a recipe, confirm every setting, and record.

    Starts all stations together, or none: reads and checks each, writes what cannot heat, then
    setpoints and status, and reads every setting back. Ctrl-C ends the run, puts the tools in their
    safe state and closes the record. The last line of stdout is the run folder. The lines of a
    regular --units file are units from the start; other sources are read during the run.

    --until-units and --until-joints end the run at that number, --duration at the latest; exit code
    1: the run ends with fewer.

    \b
    Example:
      jbclog run profiles/recipes/sn100c-tht.toml --line virtual/line.toml --duration 15m --operator "A. Rossi" --order 88123
    """  # noqa: E501  # a command is copied as one line
    never_wait()
    with without_collector():  # until the recorder begins
        mistakes = options.Mistakes()
        no_serials: list[str] = []
        several = {
            "--unit": [*unit, *mistakes.read(lambda: listed(units), no_serials)],
            "--tag": tag,
            "--wire-lot": wire_lot,
            "--flux-lot": flux_lot,
            "--tip": tip,
        }
        said = mistakes.read(lambda: options.metadata(operator, order, product, several), None)
        source = mistakes.read(lambda: source_of(units), None)
        if said is not None:
            said = replace(said, reads_units=source is not None)
        wanted = options.wanted(
            line,
            recipe,
            stations,
            duration,
            rate,
            said,
            allow_omega_write=allow_omega_write,
            mistakes=mistakes,
        )
        wanted = replace(
            wanted,
            allow_missing=allow_missing,
            wire=capture or wire,
            guard=not no_guard,
            until_units=until_units,
            until_joints=until_joints,
        )
        raise typer.Exit(record(wanted, out, source, color, report=report, as_json=as_json))


def record(
    wanted: RunOptions,
    out: Path,
    units: LineSource | None,
    color: Color,
    *,
    report: bool,
    as_json: bool,
) -> int:
    """Run the job, print its result and return its exit code."""
    from jbclog.app.run.runner import Job, carry_out
    from jbclog.cli.progress import BackgroundObserver, observer

    shown = BackgroundObserver(
        observer(wanted.duration_s, color, quiet=as_json, known=wanted.metadata)
    )
    try:
        with without_echo(units):
            result = carry_out(
                Job(wanted, out), shown, units=units, missed=shown.missed, planned=_print_notes
            )
    finally:
        shown.close()
    # what is not sealed is finished by `recover` first
    page = _report(result) if report and result.manifest.is_sealed else None
    if as_json:
        echo_json(_facts(result) | ({"report": str(page)} if page else {}))
    else:
        _print(result, page)
    return result.exit_code.value


def _report(result: Result) -> Path:
    with drawing():
        # only now, because it imports pandas and matplotlib
        from jbclog.report.write import write_report

    return write_report(result.folder)


def _print_notes(plan: Plan) -> None:
    for text in plan.notes:
        note(f"note: {text}")


def _print(result: Result, page: Path | None) -> None:
    """Print a line for each station with findings, and three for the verdict."""
    for text in _finding_lines(result):
        note(text)
    note(
        f"verdict: {result.manifest.verdict}; exit code"
        f" {result.exit_code.value}{_first_reason(result)}"
    )
    note(tools_text(result.manifest.stations))
    note(f"report: {page}" if page else f"Next: {_next_step(result)}")
    echo(str(result.folder))


def _next_step(result: Result) -> str:
    from jbclog.record.manifest import NAME

    if result.manifest.is_sealed:
        return f"jbclog report {result.folder}"
    if (result.folder / NAME).exists():
        return f"jbclog recover {result.folder}"
    return "jbclog recover FOLDER, if you moved the run there; if you deleted it, run again"


def _finding_lines(result: Result) -> list[str]:
    """Return the findings, most severe first; those of one station on one line."""
    names = [facts.name for facts in result.manifest.stations]
    lines: dict[str, str] = {}
    for finding in in_order(result.findings):
        if finding.text == VERDICT_FINDING.format(result.manifest.verdict):
            continue  # has a line of its own
        name = next((name for name in names if finding.text.startswith(f"{name}: ")), finding.text)
        text = (
            finding.text.removeprefix(f"{name}: ")
            if name in lines
            else f"exit {finding.code.value}: {finding.text}"
        )
        lines[name] = f"{lines[name]}; {text}" if name in lines else text
    return list(lines.values())


def _first_reason(result: Result) -> str:
    """Return the most severe reason of the verdict, and the number of the others; nothing if
    another finding explains it.
    """
    reasons = (
        verdict_reasons(result.manifest.verdict_rules) if result.exit_code is Exit.NOT_FINE else []
    )
    if not reasons:
        return ""
    return f". {reasons[0]}{f', and {len(reasons) - 1} more' if len(reasons) > 1 else ''}"


def _facts(result: Result) -> dict[str, object]:
    manifest = result.manifest
    return {
        **run_facts(result.folder),
        "verdict": manifest.verdict,
        "exit_code": result.exit_code.value,
        "findings": [
            {"code": one.code.value, "text": one.text} for one in in_order(result.findings)
        ],
        "rules": [rule for rule in manifest.verdict_rules if rule["result"] != "pass"],
        "goals": [asdict(goal) for goal in manifest.goals],
        "safe_state": {facts.name: facts.safe_state for facts in manifest.stations},
    }


# -- units -----------------------------------------------------------------------------------------

LONGEST_LIST: Final = 1_000_000  # bytes of a plain file


def listed(name: str | None) -> list[str]:
    """Return the serials of a regular file; none for a source that is read during the run.

    Raises `UsageError`.
    """
    from jbclog.transport.typed_lines import is_plain_file, lines_of_file

    if name is None or not is_plain_file(name):
        return []
    return list(dict.fromkeys(_serial(name, line) for line in lines_of_file(name, LONGEST_LIST)))


def _serial(name: str, line: TypedLine) -> str:
    """Return the serial. Raises `UsageError` if it is too long or has hidden characters."""
    if not line.is_whole:
        raise UsageError(
            f"--units {name}: {line.text:.60}…: more than {len(line.text)} characters; put one"
            " serial on each line"
        )
    if not line.is_clear:
        raise UsageError(
            f"--units {name}: {line.text:.60}: a hidden character, shown as an escape; remove it"
        )
    check_text(f"--units {name}", line.text)
    return line.text


def source_of(name: str | None) -> LineSource | None:
    """Return the source of serials during the run. Raises `UsageError`."""
    from jbclog.transport.typed_lines import is_plain_file, open_source

    return None if name is None or is_plain_file(name) else open_source(name)


@contextmanager
def without_echo(source: LineSource | None) -> Iterator[None]:
    """Switch the terminal's echo off: a barcode reader's input must not spoil the live table."""
    if source is None or source.name != "stdin" or not source.is_typed or not is_terminal():
        yield
        return
    from jbclog.transport.typed_lines import echo_off

    with echo_off():
        yield


# -- reasons of a verdict --------------------------------------------------------------------------

MOST_SEVERE_FIRST = ("fail", "missing", "deviation")

RuleFacts = dict[str, object]
"""An entry of the manifest's `verdict_rules`."""


def verdict_reasons(rules: Iterable[RuleFacts]) -> list[str]:
    """Return each failed or missing rule's sentence once with its places, most severe first."""
    broken = sorted((rule for rule in rules if rule["result"] in MOST_SEVERE_FIRST), key=_severity)
    same: dict[tuple[str, str], list[RuleFacts]] = {}
    for rule in broken:
        same.setdefault((str(rule["result"]), _sentence(rule)), []).append(rule)
    return [_reason(result, sentence, alike) for (result, sentence), alike in same.items()]


def _severity(rule: RuleFacts) -> int:
    return MOST_SEVERE_FIRST.index(str(rule["result"]))


def _sentence(rule: RuleFacts) -> str:
    text = str(rule["text"])
    bare = text.removeprefix(f"Port {rule['port']}: ")
    return text if bare == text else bare[:1].upper() + bare[1:]


def _reason(result: str, sentence: str, rules: list[RuleFacts]) -> str:
    places = "; ".join(_places(rules))
    names = ", ".join(dict.fromkeys(str(rule["name"]) for rule in rules))
    return f"{result}: {places + ': ' if places else ''}{sentence} ({names})"


def _places(rules: Iterable[RuleFacts]) -> Iterator[str]:
    """Yield ``dde-1 ports 1, 2``, ``ucr-1``."""
    ports: dict[str, dict[str, None]] = {}
    for rule in rules:
        if rule["station"] is not None:
            own = ports.setdefault(str(rule["station"]), {})
            own |= {} if rule["port"] is None else {str(rule["port"]): None}
    for station, own in ports.items():
        yield f"{station} port{'s' if len(own) > 1 else ''} {', '.join(own)}" if own else station
