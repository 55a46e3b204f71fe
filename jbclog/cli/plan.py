"""`jbclog plan`: a dry run; no byte is sent."""

from __future__ import annotations

from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json

if TYPE_CHECKING:
    from jbclog.app.run.plan import Plan, StationPlan
    from jbclog.config.recipe_settings import Setting
    from jbclog.session.scheduler import Demand


@ends_with_errors_told
def plan(
    recipe: Path | None = options.RECIPE,
    line: Path = options.LINE,
    stations: list[str] = options.STATION,
    rate: str | None = options.RATE,
    allow_omega_write: bool = options.ALLOW_OMEGA_WRITE,
    as_json: bool = options.AS_JSON,
) -> None:
    """Show what a run would write, and which rate fits.

    Sends no byte. Reports every error in the files at once. The response time is the line file's turnaround_ms, or 0 without it:
    `run` measures it.

    \b
    Example:
      jbclog plan profiles/recipes/sn100c-tht.toml --line profiles/lines/bench.toml
    """
    from jbclog.app.run.plan import make_plan

    made = make_plan(options.wanted(line, recipe, stations, None, rate, allow_omega_write=allow_omega_write))
    for text in made.notes:
        note(f"note: {text}")
    if as_json:
        on_missing = "continue" if made.starts_without_missing else "stop"
        tell_json(
            {"line": made.line.name, "on_missing": on_missing, "stations": [_facts(station, made) for station in made.stations]}
        )
    else:
        tell(*_lines(made))


def _facts(station: StationPlan, made: Plan) -> dict[str, object]:
    from jbclog.core.quantities import text_of
    from jbclog.session.run.context import AS_AUTO
    from jbclog.session.scheduler import KEPT_BY_AUTO

    demand, rate_hz, turnaround = station.demand, station.rate_hz, station.turnaround_s
    known: dict[str, object] = {} if demand is None else {"best_rate_hz": demand.best_rate_hz(turnaround)}
    if demand is not None and station.slowest_s is not None:
        known["best_rate_at_slowest_hz"] = demand.best_rate_hz(station.slowest_s)
    if demand is not None and rate_hz is not None:
        known |= {
            "wire_ms_per_tick": round(1000 * (demand.fast_s + demand.fast_reads * turnaround), 3),
            "load": round(demand.load(rate_hz, turnaround), 4),
            "greatest_turnaround_ms": round(1000 * demand.greatest_turnaround_s(rate_hz), 3),
        }
        if station.asked_rate == AS_AUTO:
            known["auto_up_to_turnaround_ms"] = round(1000 * demand.greatest_turnaround_s(rate_hz, KEPT_BY_AUTO), 3)
    writes = [
        {"port": one.port, "setting": one.command.name, "value": text_of(one.value), "unit": one.unit, "key": one.key}
        for one in station.writes()
    ]
    return {
        "name": station.spec.name,
        "url": station.spec.url,
        "family": station.spec.family,
        "model": station.spec.model,
        "ports": list(station.ports),
        "recipe": str(station.recipe.path),
        "asked_rate": station.asked_rate,
        "rate_hz": rate_hz,
        "assumed_turnaround_ms": round(1000 * turnaround, 3),
        **known,
        "writes": writes,
        "condition": _condition_facts(station, made),
        "unsupported": station.skipped(),
        "status": station.recipe.run.status,
    }


def _condition_facts(station: StationPlan, made: Plan) -> dict[str, object] | None:
    condition = station.condition()
    if condition is None:
        return None
    values = {name: value for name, _, value in condition.values()}
    return {"condition": condition.condition, **values, "may_be_written": made.wanted.allow_omega_write}


def _lines(made: Plan) -> list[str]:
    lines = [f"Line {made.line.name}: {len(made.stations)} station{'s' if len(made.stations) > 1 else ''}. No byte was sent."]
    lines += [_start_text(made)] if len(made.stations) > 1 else []
    return [*lines, *(line for station in made.stations for line in ("", *_station_lines(station, made)))]


SUCTION = {"keep": "keep suction as it is", "on": "switch suction on", "off": "switch suction off"}


def _start_text(made: Plan) -> str:
    if made.starts_without_missing:
        return "A station that is missing or refuses at the start is left out; the verdict is then at best ACCEPT WITH DEVIATIONS."
    return "All start together: if one is missing or refuses, none starts (--allow-missing starts without it)."


def _station_lines(station: StationPlan, made: Plan) -> list[str]:
    spec, recipe, condition = station.spec, station.recipe, station.condition()
    ports = f"port{'s' if len(station.ports) > 1 else ''} {', '.join(map(str, station.ports))}"
    model = f" (model {spec.model} is accepted)" if spec.model else ""
    lines = [f"{spec.name}  {spec.family}{model}, {ports}, {spec.url}", f"  recipe    {recipe.name} revision {recipe.revision}"]
    lines += _rate_lines(station)
    lines += [f"  write     {_write_text(one)}" for one in station.writes()]
    if condition is not None:
        written = "written once" if made.wanted.allow_omega_write else "a reason to stop; with --allow-omega-write it is written"
        lines += wrap(f"{condition}; a difference is {written}", 110, initial_indent="  compare   ", subsequent_indent=" " * 12)
    if station.skipped():
        lines.append(f"  skip      {', '.join(station.skipped())}: not on this station")
    has_suction = station.family is not None and station.family.status.has_suction
    orders = [f'tell every tool "{recipe.run.status}"'] if recipe.run.status else []
    orders += [SUCTION[recipe.suction]] if has_suction and (orders or recipe.suction != "keep") else []
    if orders:
        lines.append(f"  then      {', '.join(orders)}, and record")
    return [*lines, _last_line(station)]


def _last_line(station: StationPlan) -> str:
    if station.family is not None and not station.family.safe_states:
        return "  at last   leave it as it is: it has no safe state that could be ordered"
    has_suction = station.family is not None and station.family.status.has_suction
    suction = f", {SUCTION[station.recipe.run.safe_suction]}" if has_suction else ""
    return f'  at last   tell every tool "{station.recipe.safe_state(station.spec.family)}"{suction}, whatever happens'


def _write_text(setting: Setting) -> str:
    place = "" if setting.port is None else f"port {setting.port}: "
    return f"{place}{setting.command.name.replace('_', ' ')} = {setting.shown()}"


def _rate_lines(station: StationPlan) -> list[str]:
    demand, rate_hz, turnaround = station.demand, station.rate_hz, station.turnaround_s
    if demand is None:
        return ["  rate      known when the station has told its model"]
    if rate_hz is None:
        return ["  rate      without pause"]
    tick_ms = 1000 * (demand.fast_s + demand.fast_reads * turnaround)
    given = station.spec.turnaround_ms is not None
    measured = f"with {turnaround * 1000:g} ms of response time" if given else "with no response time (`run` measures it)"
    return [
        f"  rate      {rate_hz:g} Hz: {tick_ms:.1f} of {1000 / rate_hz:.0f} ms a tick, "
        f"{demand.load(rate_hz, turnaround):.1%} of the link {measured}",
        f"  fits      up to {1000 * demand.greatest_turnaround_s(rate_hz):.2f} ms of response time; "
        f"the best rate is {demand.best_rate_hz(turnaround):g} Hz",
        *_auto_lines(station, demand, rate_hz),
        *_slowest_line(station, demand, rate_hz),
        *_faster_line(station),
    ]


def _faster_line(station: StationPlan) -> list[str]:
    """A measured response time of 0: only a link that is faster than its line format gives that."""
    if station.spec.turnaround_ms != 0:
        return []
    return [
        f"  reserve   with 0 ms measured its link may be faster than {station.spec.line_format}, and more may fit than is reckoned"
    ]


def _auto_lines(station: StationPlan, demand: Demand, rate_hz: float) -> list[str]:
    """What a rate that is to be chosen rests on, and up to where the choice stays the same."""
    from jbclog.session.run.context import AS_AUTO
    from jbclog.session.run.pace import SOME_RATES
    from jbclog.session.scheduler import KEPT_BY_AUTO

    if station.asked_rate != AS_AUTO:
        return []
    assumed = (
        "turnaround_ms of the line file" if station.spec.turnaround_ms is not None else "0 ms: the line file has no turnaround_ms"
    )
    most_ms = 1000 * demand.greatest_turnaround_s(rate_hz, KEPT_BY_AUTO)
    return [
        f"  auto      the highest of {SOME_RATES} Hz that leaves a fifth of the link free: {rate_hz:g} Hz up to {most_ms:.2f} ms "
        "of response time",
        f"  assumed   {assumed}; `run` measures the response time, then chooses",
    ]


def _slowest_line(station: StationPlan, demand: Demand, rate_hz: float) -> list[str]:
    """What becomes of it at the longest turnaround that the family's manual prints."""
    slowest_s = station.slowest_s
    if slowest_s is None or slowest_s <= station.turnaround_s:
        return []
    load, best = demand.load(rate_hz, slowest_s), demand.best_rate_hz(slowest_s)
    return [
        f"  slowest   {load:.1%} with {1000 * slowest_s:g} ms, the most that its manual prints: there {best:g} Hz is the best rate"
    ]
