"""`jbclog safe`: every tool of a line in its safe state, now."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.cli.unheld import never_wait
from jbclog.errors import Unsafe

if TYPE_CHECKING:
    from jbclog.byhand.safe import MadeSafe, StationMadeSafe
    from jbclog.line_safe import EndedRun


@ends_with_errors_told
def safe(line: Path = options.LINE, as_json: bool = options.AS_JSON) -> None:
    """Put every tool of a line in its safe state, now.

    A run that holds the line is asked to end, and ended after three seconds. Then every station is asked what tools it has, its
    feeder is stopped, each tool is told to rest, and read back; one that rests already is left alone. Ends with 5 where a tool
    is not known to be safe.

    \b
    Example:
      jbclog safe --line virtual/line.toml
    """
    from jbclog.line_safe import close_leases, end_runs, make_line_safe
    from jbclog.recipe.line import load_line

    never_wait()
    loaded = load_line(line)
    runs = end_runs(loaded, note)
    stations: list[StationMadeSafe] = []

    def done(made: StationMadeSafe) -> None:
        stations.append(made)
        if not as_json:
            for text in lines(made):
                tell(text)

    make_line_safe(loaded, done)
    for folder in close_leases(stations):
        note(f"the run {folder} had left tools hot and is told so in its record")
    for made in stations:
        if made.note:
            note(f"note: {made.target.name}: {made.note}")
        for text in troubles(made):
            note(f"error: {text}")
    is_safe = all(made.is_safe for made in stations)
    if as_json:
        tell_json(_facts(runs, stations, 0 if is_safe else Unsafe.exit_code))
    if not is_safe:
        raise typer.Exit(Unsafe.exit_code)


def lines(made: StationMadeSafe) -> list[str]:
    """What came of a station, a line for each tool."""
    name = made.target.name
    found = [f"{name}: feeder {made.feeder}"] if made.feeder else []
    found += [f"{name} port {tool.port} ({tool.tool or 'tool unknown'}): {_state(tool)}" for tool in made.tools]
    found += [f"{name} port {port}: no tool" for port in made.empty]
    return found or [f"{name}: NOT SAFE" if made.problem else f"{name}: no port answers"]


def _state(tool: MadeSafe) -> str:
    now = "" if tool.temperature_c is None else f", {tool.temperature_c:g} °C now"
    if not tool.is_safe:
        return f"NOT SAFE{now}"
    return f"{tool.state}{', as it was already' if tool.rested else ', as read back'}{now}"


def troubles(made: StationMadeSafe) -> list[str]:
    """A sentence for everything that is not known to be safe."""
    name = made.target.name
    found = [f"{name}: {made.problem}"] if made.problem else []
    if made.feeder == "running":
        found.append(f"{name}: its feeder could not be stopped: switch the station off")
    return found + [f"{name} port {tool.port}: {tool.problem}" for tool in made.tools if tool.problem]


def _facts(runs: list[EndedRun], stations: list[StationMadeSafe], code: int) -> dict[str, object]:
    return {
        "runs": [{"run": str(run.folder), "ended": run.how} for run in runs],
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
    return {
        "port": tool.port,
        "tool": tool.tool,
        "safe": tool.is_safe,
        "state": tool.state,
        "rested": tool.rested,
        "temperature_c": tool.temperature_c,
        "problem": tool.problem,
    }
