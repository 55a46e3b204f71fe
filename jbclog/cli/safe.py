"""`jbclog safe`: every tool of a line in its safe state, now."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.cli.streams import never_wait
from jbclog.core.errors import Unsafe, UsageError

if TYPE_CHECKING:
    from jbclog.app.safe_state import EndedRun
    from jbclog.session.manual.safe import MadeSafe, StationMadeSafe


COLD_C = 60.0
NOT_COLD = 1  # exit code: it ended, and something in it is not fine
ORDERED = {"stand": "told to stand", "extractor": "told to extract", "cooling": "told to cool", "off": "told to switch off"}
ALREADY = {
    "stand": "stands already",
    "sleep": "sleeps already",
    "hibernation": "hibernates already",
    "extractor": "in its extractor state already",
}


@ends_with_errors_told
def safe(
    line: Path = options.LINE,
    wait: bool = typer.Option(False, "--wait", help="Wait until every tool is below the limit, at most 30 min."),
    below: float | None = typer.Option(
        None, "--below", metavar="C", min=1, max=600, help="With --wait: the limit, °C. Default: 60.", show_default=False
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Put every tool of a line in its safe state, now.

    Asks a run that holds the line to end, and ends it after 3 s. Then stops the feeders, orders each tool into its safe state and
    reads it back; leaves a tool alone that rests already. Safe is not cold: prints each tool's temperature and when it sleeps by
    itself. Exit code 5: a tool is not known to be safe; 1: with --wait, a tool is not known to be below the limit after 30 min.

    \b
    Example:
      jbclog safe --line virtual/line.toml --wait
    """
    from jbclog.app.safe_state import close_leases, end_runs, make_line_safe, wait_until_cold
    from jbclog.config.line import load_line

    if below is not None and not wait:
        raise UsageError("--below needs --wait; nothing was sent")
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
        note(f"the run {folder} left tools hot; its record now says so")
    for made in stations:
        if made.note:
            note(f"note: {made.target.name}: {made.note}")
        for text in troubles(made):
            note(f"error: {text}")
    limit_c = COLD_C if below is None else below
    waited_s = wait_until_cold(stations, limit_c, note) if wait else None
    if waited_s is not None:
        _tell_wait(stations, limit_c, waited_s, as_json=as_json)
    code = _exit_code(stations)
    if as_json:
        waiting = {} if waited_s is None else {"below_c": limit_c, "waited_s": round(waited_s, 1)}
        tell_json(_facts(runs, stations, code) | waiting)
    if code:
        raise typer.Exit(code)


def _exit_code(stations: list[StationMadeSafe]) -> int:
    """5 where something is not safe; else 1 where a tool that was waited for is not known to be cold."""
    if not all(made.is_safe for made in stations):
        return Unsafe.exit_code
    return NOT_COLD if any(tool.is_cold is False for made in stations for tool in made.tools) else 0


def _tell_wait(stations: list[StationMadeSafe], limit_c: float, waited_s: float, *, as_json: bool) -> None:
    """What is below the limit, and what is not, with its last temperature."""
    from jbclog.session.manual.safe import duration

    for made in stations:
        for tool in made.tools:
            place, celsius = f"{made.target.name} port {tool.port}", _celsius(tool)
            if not tool.is_cold:
                last = "" if tool.temperature_c is not None or tool.last_c is None else f" (last read {tool.last_c:g} °C)"
                note(f"error: {place}: {celsius}{last}, not known to be below {limit_c:g} °C after {duration(waited_s)}")
            elif not as_json:
                tell(f"{place} ({tool.tool or 'tool unknown'}): {celsius}, below {limit_c:g} °C after {duration(waited_s)}")


def lines(made: StationMadeSafe) -> list[str]:
    """What came of a station, a line for each tool."""
    name = made.target.name
    found = [f"{name}: feeder {made.feeder}"] if made.feeder else []
    found += [f"{name} port {tool.port} ({tool.tool or 'tool unknown'}): {_state(tool)}" for tool in made.tools]
    found += [f"{name} port {port}: no tool" for port in made.empty]
    if not found and made.family is not None and made.problem:
        return [f"{name}: NOT SAFE, it has no safe state, temperature not known"]
    return found or [f"{name}: NOT SAFE" if made.problem else f"{name}: no port answers"]


def _state(tool: MadeSafe) -> str:
    """What is known of a tool: ``told to stand, 370 °C, sleeps in 2 min 56 s``."""
    if tool.state is None:
        return f"NOT SAFE, {_celsius(tool)}"
    parts = ["NOT SAFE"] if not tool.is_safe else []
    parts.append(ALREADY.get(tool.state, f"{tool.state} already") if tool.rested else _told(tool))
    parts.append(_celsius(tool))
    if tool.state.startswith("extractor"):
        parts.append("seen cold or cooling")
    elif tool.cooling is not None:
        parts.append(tool.cooling.text())
    parts += ["suction on"] if tool.suction else []
    parts += [tool.fell_back] if tool.fell_back else []
    return ", ".join(parts)


def _told(tool: MadeSafe) -> str:
    told = ORDERED.get(tool.ordered or "", f"told {tool.ordered}")
    return told if tool.state == tool.ordered else f"{told} ({tool.state} was read back)"


def _celsius(tool: MadeSafe) -> str:
    return "temperature not known" if tool.temperature_c is None else f"{tool.temperature_c:g} °C"


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
    cooling = tool.cooling
    return {
        "port": tool.port,
        "tool": tool.tool,
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
