"""`jbclog safe`: put every tool of a line in its safe state."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import echo, echo_json, note, reports_errors, run_facts
from jbclog.cli.streams import never_wait
from jbclog.core.errors import Unsafe, UsageError

if TYPE_CHECKING:
    from jbclog.app.port_access import PortAccess
    from jbclog.app.safe_state import EndedRun, GuardsAtWork
    from jbclog.config.line import Line
    from jbclog.session.manual.safe import MadeSafe, StationMadeSafe


COLD_C = 60.0
NOT_COLD = 1  # exit code
ORDERED = {
    "stand": "set to stand",
    "extractor": "set to extractor",
    "cooling": "set to cool",
    "off": "switched off",
}
ALREADY = {
    "stand": "already in stand",
    "sleep": "already asleep",
    "hibernation": "already in hibernation",
}


@reports_errors
def safe(
    ctx: typer.Context,
    line: Path = options.LINE,
    out: Path = options.OUT,
    wait: bool = typer.Option(
        False, "--wait", help="Wait until every tool is below --below, 30 min at most."
    ),
    below: float | None = typer.Option(
        None,
        "--below",
        metavar="C",
        min=1,
        max=600,
        help="Temperature limit of --wait, °C; default: 60.",
        show_default=False,
    ),
    unanswered: bool = typer.Option(
        False,
        "--unanswered",
        help="Order stations that do not answer, after a question.",
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Put every tool of a line in its safe state, now.

    Ends a run that holds the line, by force after 3 s; a guard at work on it tries again first.
    Then stops the feeders, sets each tool to its safe state and reads it back; leaves a resting
    tool as it is. Notes that in runs that left these tools hot: those below --out, and those in
    this user's list. Safe is not cold: prints each tool's temperature and when it goes to sleep.
    With --unanswered, asks once whether to order the stations that do not answer. Exit code 5: a
    tool is not confirmed safe; 1: with --wait, a tool is not known to be below the limit after
    30 min.

    \b
    Example:
      jbclog safe --line virtual/line.toml --wait
    """
    from jbclog.app.safe_state import (
        GuardsAtWork,
        close_leases,
        end_runs,
        make_line_safe,
        wait_until_cold,
    )
    from jbclog.config.line import load_line

    if below is not None and not wait:
        raise UsageError("--below requires --wait; nothing sent")
    never_wait()
    loaded = load_line(line)
    runs = end_runs(loaded, note)
    stations: list[StationMadeSafe] = []

    def done(made: StationMadeSafe) -> None:
        stations.append(made)
        if not as_json:
            echo(*lines(made))

    access = options.port_access(ctx)
    guards = GuardsAtWork(loaded, note)
    try:
        make_line_safe(loaded, done, access, guards)
        if unanswered:
            _insist(loaded, stations, guards, access, as_json=as_json)
        for folder in close_leases(stations, out):
            note(f"run {folder} left tools hot; noted in its record")
    finally:
        guards.close()
    for made in stations:
        if made.note:
            note(f"note: {made.target.name}: {made.note}")
        for text in troubles(made):
            note(f"error: {text}")
    limit_c = COLD_C if below is None else below
    waited_s = wait_until_cold(stations, limit_c, note, access) if wait else None
    if waited_s is not None:
        _print_wait(stations, limit_c, waited_s, as_json=as_json)
    code = _exit_code(stations)
    if as_json:
        waiting = {} if waited_s is None else {"below_c": limit_c, "waited_s": round(waited_s, 1)}
        echo_json(_facts(runs, stations, code) | waiting)
    if code:
        raise typer.Exit(code)


def _insist(
    line: Line,
    stations: list[StationMadeSafe],
    guards: GuardsAtWork,
    access: PortAccess,
    *,
    as_json: bool,
) -> None:
    """Ask once whether to order the stations that do not answer, and do it."""
    from jbclog.app.safe_state import insist, unanswered, why_mixed

    for made in stations:
        report = guards.report(made.target.url)
        if report is not None and report[1].orders:
            run, unsafe = report
            note(
                f"{made.target.name}: the guard of the run {run} has ordered it"
                f" {unsafe.orders} times without an answer; --unanswered sends no further order,"
                " because each begins the sleep delay again"
            )
    silent = unanswered(stations, guards)
    if not silent:
        return
    names = ", ".join(f"{made.target.name} ({made.target.url})" for made in silent)
    mixed = why_mixed(line)
    if mixed is not None:
        note(f"no order sent to {names}: {mixed}. Switch the station off")
        return
    note(
        f"No answer from {names}. An order may be sent all the same. The cable may lead to another"
        " station by now, and a tip that rests would be warmed."
    )
    if not _is_confirmed():
        note("No order sent. Switch the station off")
        return
    insist(silent, access)
    for made in silent if not as_json else ():
        echo(*lines(made))


def _is_confirmed() -> bool:
    try:
        return typer.confirm("Send the safe order once?", default=False, err=True)
    except typer.Abort:  # no terminal, or Ctrl-D
        return False


def _exit_code(stations: list[StationMadeSafe]) -> int:
    """Return 5 if a tool is not confirmed safe, else 1 if one is not known to be below the
    limit.
    """
    if not all(made.is_safe for made in stations):
        return Unsafe.exit_code
    return NOT_COLD if any(tool.is_cold is False for made in stations for tool in made.tools) else 0


def _print_wait(
    stations: list[StationMadeSafe], limit_c: float, waited_s: float, *, as_json: bool
) -> None:
    """Print for each tool whether it is below the limit."""
    from jbclog.session.manual.safe import duration

    for made in stations:
        for tool in made.tools:
            place, celsius = f"{made.target.name} port {tool.port}", _celsius(tool)
            if not tool.is_cold:
                last = (
                    ""
                    if tool.temperature_c is not None or tool.last_c is None
                    else f" (last read {tool.last_c:g} °C)"
                )
                note(
                    f"error: {place}: {celsius}{last}, not known to be below {limit_c:g} °C after"
                    f" {duration(waited_s)}"
                )
            elif not as_json:
                echo(
                    f"{place} ({tool.tool_name or 'tool unknown'}): {celsius}, below {limit_c:g} °C"
                    f" after {duration(waited_s)}"
                )


def lines(made: StationMadeSafe) -> list[str]:
    """Return the result of a station, a line per tool."""
    name = made.target.name
    found = [f"{name}: feeder {made.feeder}"] if made.feeder else []
    found += [
        f"{name} port {tool.port} ({tool.tool_name or 'tool unknown'}): {_state(tool)}"
        for tool in made.tools
    ]
    found += [f"{name} port {port}: no tool" for port in made.empty]
    if not found and made.family is not None and made.problem:
        return [f"{name}: NOT SAFE, no safe state, temperature not known"]
    return found or [f"{name}: NOT SAFE" if made.problem else f"{name}: no port answers"]


def _state(tool: MadeSafe) -> str:
    """Return the state of a tool: ``set to stand, 370 °C, sleeps in 2 min 56 s``."""
    if tool.state is None:
        return f"NOT SAFE, {_celsius(tool)}"
    parts = ["NOT SAFE"] if not tool.is_safe else []
    parts.append(
        ALREADY.get(tool.state, f"already in {tool.state}") if tool.rested else _ordered(tool)
    )
    parts.append(_celsius(tool))
    if tool.state.startswith("extractor"):
        parts.append("cold or cooling")
    elif tool.cooling is not None:
        parts.append(tool.cooling.text())
    parts += ["suction on"] if tool.suction else []
    parts += [tool.fell_back] if tool.fell_back else []
    return ", ".join(parts)


def _ordered(tool: MadeSafe) -> str:
    order = ORDERED.get(tool.ordered or "", f"set to {tool.ordered}")
    return order if tool.state == tool.ordered else f"{order} (read back: {tool.state})"


def _celsius(tool: MadeSafe) -> str:
    return "temperature not known" if tool.temperature_c is None else f"{tool.temperature_c:g} °C"


def troubles(made: StationMadeSafe) -> list[str]:
    """Return a line for everything that is not confirmed safe."""
    name = made.target.name
    found = [f"{name}: {made.problem}"] if made.problem else []
    if made.feeder == "running":
        found.append(f"{name}: feeder not stopped; switch the station off")
    return found + [
        f"{name} port {tool.port}: {tool.problem}" for tool in made.tools if tool.problem
    ]


def _facts(runs: list[EndedRun], stations: list[StationMadeSafe], code: int) -> dict[str, object]:
    return {
        "runs": [{**run_facts(run.folder), "how": run.how} for run in runs],
        "stations": [_station_facts(made) for made in stations],
        "exit_code": code,
    }


def _station_facts(made: StationMadeSafe) -> dict[str, object]:
    return {
        "station": made.target.name,
        "url": made.target.url,
        "model": made.model,
        "family": made.family,
        "safe": made.is_safe,
        "feeder": made.feeder,
        "problem": made.problem,
        "note": made.note,
        "tools": [_tool_facts(tool) for tool in made.tools],
        "without_tool": made.empty,
    }


def _tool_facts(tool: MadeSafe) -> dict[str, object]:
    cooling = tool.cooling
    return {
        "port": tool.port,
        "tool_name": tool.tool_name,
        "safe": tool.is_safe,
        "state": tool.state,
        "rested": tool.rested,
        "temperature_c": tool.temperature_c,
        "problem": tool.problem,
        "told": tool.ordered,
        "fell_back": tool.fell_back or None,
        "next": cooling.follows[0] if cooling is not None and cooling.follows else None,
        "next_in_s": cooling.in_s if cooling is not None else None,
        "never": list(cooling.never) if cooling is not None and cooling.never is not None else None,
        "suction": tool.suction,
        "cold": tool.is_cold,
        "text": _state(tool),
    }
