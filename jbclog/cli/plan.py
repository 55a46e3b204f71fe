"""`jbclog plan`: a dry run; no byte is sent."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json

if TYPE_CHECKING:
    from jbclog.plan import Plan, StationPlan
    from jbclog.recipe.settings import Setting


@ends_with_errors_told
def plan(
    recipe: Path | None = options.RECIPE,
    line: Path = options.LINE,
    stations: list[str] = options.STATION,
    rate: str | None = options.RATE,
    as_json: bool = options.AS_JSON,
) -> None:
    """Show what a run would write, and whether its rate fits the wire.

    No byte is sent. Every error in the files is told at once. Turnaround is the line file's, or 0 where it has none: `run`
    measures it.

    \b
    Example:
      jbclog plan profiles/recipes/sn100c-tht.toml --line profiles/lines/bench.toml
    """
    from jbclog.plan import make_plan

    made = make_plan(options.wanted(line, recipe, stations, None, rate))
    for text in made.notes:
        note(f"note: {text}")
    if as_json:
        tell_json({"line": made.line.name, "stations": [_facts(station) for station in made.stations]})
    else:
        tell(_text(made))


def _facts(station: StationPlan) -> dict[str, object]:
    from jbclog.quantities import text_of

    demand, rate_hz, turnaround = station.demand, station.rate_hz, station.turnaround_s
    known: dict[str, object] = {} if demand is None else {"best_rate_hz": demand.best_rate_hz(turnaround)}
    if demand is not None and rate_hz is not None:
        known |= {
            "wire_ms_per_tick": round(1000 * (demand.fast_s + demand.fast_reads * turnaround), 3),
            "load": round(demand.load(rate_hz, turnaround), 4),
            "greatest_turnaround_ms": round(1000 * demand.greatest_turnaround_s(rate_hz), 3),
        }
    writes = [
        {"port": one.port, "setting": one.command.name, "value": text_of(one.value), "key": one.key} for one in station.writes()
    ]
    return {
        "name": station.spec.name,
        "url": station.spec.url,
        "family": station.spec.family,
        "ports": list(station.ports),
        "recipe": str(station.recipe.path),
        "rate_hz": rate_hz,
        **known,
        "writes": writes,
        "unsupported": station.skipped(),
        "status": station.recipe.run.status,
    }


def _text(made: Plan) -> str:
    sections = [f"Line {made.line.name}: {len(made.stations)} station{'s' if len(made.stations) > 1 else ''}. No byte was sent."]
    sections += [_station_text(station) for station in made.stations]
    return "\n\n".join(sections)


def _station_text(station: StationPlan) -> str:
    spec, recipe = station.spec, station.recipe
    ports = f"port{'s' if len(station.ports) > 1 else ''} {', '.join(map(str, station.ports))}"
    lines = [f"{spec.name}  {spec.family}, {ports}, {spec.url}", f"  recipe    {recipe.name} revision {recipe.revision}"]
    lines += _rate_lines(station)
    lines += [f"  write     {_write_text(one)}" for one in station.writes()]
    if station.skipped():
        lines.append(f"  skip      {', '.join(station.skipped())}: not on this station")
    if recipe.run.status:
        lines.append(f"  then      put every tool to {recipe.run.status}, and record")
    lines.append(f"  at last   put every tool to {recipe.safe_state(spec.family)}, whatever happens")
    return "\n".join(lines)


def _write_text(setting: Setting) -> str:
    place = "" if setting.port is None else f"port {setting.port}: "
    return f"{place}{setting.command.name.replace('_', ' ')} = {setting.command.shown(setting.value)}"


def _rate_lines(station: StationPlan) -> list[str]:
    demand, rate_hz, turnaround = station.demand, station.rate_hz, station.turnaround_s
    if demand is None:
        return ["  rate      known when the station has told its model"]
    if rate_hz is None:
        return ["  rate      without pause"]
    tick_ms = 1000 * (demand.fast_s + demand.fast_reads * turnaround)
    measured = f"with {turnaround * 1000:g} ms of turnaround" if turnaround else "without any turnaround (`run` measures it)"
    return [
        f"  rate      {rate_hz:g} Hz: {tick_ms:.1f} of {1000 / rate_hz:.0f} ms a tick, "
        f"{demand.load(rate_hz, turnaround):.1%} of the wire {measured}",
        f"  fits      up to {1000 * demand.greatest_turnaround_s(rate_hz):.2f} ms of turnaround; "
        f"the best rate is {demand.best_rate_hz(turnaround):g} Hz",
    ]
