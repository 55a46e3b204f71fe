"""`jbclog plan`: a dry run, which sends no byte."""

from __future__ import annotations

from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

from jbclog.cli import options
from jbclog.cli.loading import without_collector
from jbclog.cli.output import echo, echo_json, note, reports_errors

if TYPE_CHECKING:
    from jbclog.app.run.plan import Plan, StationPlan
    from jbclog.config.recipe_settings import Setting
    from jbclog.session.scheduler import Demand


@reports_errors
def plan(
    recipe: Path | None = options.RECIPE,
    line: Path = options.LINE,
    stations: list[str] = options.STATION,
    rate: str | None = options.RATE,
    allow_omega_write: bool = options.ALLOW_OMEGA_WRITE,
    as_json: bool = options.AS_JSON,
) -> None:
    """Show what a run would write, and which rate fits.

    Sends no byte. Reports every error in the files at once. Assumes the response time of the line
    file (turnaround_ms), or 0; `run` measures it.

    \b
    Example:
      jbclog plan profiles/recipes/sn100c-tht.toml --line profiles/lines/bench.toml
    """
    with without_collector():
        from jbclog.app.run.plan import make_plan

        made = make_plan(
            options.wanted(line, recipe, stations, None, rate, allow_omega_write=allow_omega_write)
        )
        for text in made.notes:
            note(f"note: {text}")
        if as_json:
            echo_json(_all_facts(made))
        else:
            echo(*_lines(made))


def _all_facts(made: Plan) -> dict[str, object]:
    return {
        "line": made.line.name,
        "on_missing": "continue" if made.starts_without_missing else "stop",
        "stations": [_facts(station, made) for station in made.stations],
    }


def _facts(station: StationPlan, made: Plan) -> dict[str, object]:
    from jbclog.core.quantities import text_of

    writes = [
        {
            "port": one.port,
            "setting": one.command.name,
            "value": text_of(one.value),
            "unit": one.unit,
            "key": one.key,
        }
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
        "rate_hz": station.rate_hz,
        "assumed_turnaround_ms": round(1000 * station.turnaround_s, 3),
        **_rate_facts(station),
        "writes": writes,
        "condition": _condition_facts(station, made),
        "unsupported": station.skipped(),
        "status": station.recipe.run.status,
    }


def _rate_facts(station: StationPlan) -> dict[str, object]:
    """Return how its rate fits the link, and the best rate."""
    from jbclog.session.rates import AS_AUTO
    from jbclog.session.scheduler import KEPT_BY_AUTO

    demand, rate_hz, turnaround = station.demand, station.rate_hz, station.turnaround_s
    known: dict[str, object] = (
        {} if demand is None else {"best_rate_hz": demand.best_rate_hz(turnaround)}
    )
    if demand is not None and station.slowest_s is not None:
        known["best_rate_at_slowest_hz"] = demand.best_rate_hz(station.slowest_s)
    if demand is not None and rate_hz is not None:
        known |= {
            "wire_ms_per_tick": round(1000 * (demand.fast_s + demand.fast_reads * turnaround), 3),
            "load": round(demand.load(rate_hz, turnaround), 4),
            "greatest_turnaround_ms": round(1000 * demand.greatest_turnaround_s(rate_hz), 3),
        }
        if station.asked_rate == AS_AUTO:
            known["auto_up_to_turnaround_ms"] = round(
                1000 * demand.greatest_turnaround_s(rate_hz, KEPT_BY_AUTO), 3
            )
    return known


def _condition_facts(station: StationPlan, made: Plan) -> dict[str, object] | None:
    condition = station.condition()
    if condition is None:
        return None
    values = {name: value for name, _, value in condition.values()}
    return {
        "condition": condition.condition,
        **values,
        "may_be_written": made.wanted.allow_omega_write,
    }


def _lines(made: Plan) -> list[str]:
    lines = [
        f"Line {made.line.name}: {len(made.stations)}"
        f" station{'s' if len(made.stations) > 1 else ''}. No byte sent."
    ]
    lines += [_start_text(made)] if len(made.stations) > 1 else []
    return [
        *lines,
        *(line for station in made.stations for line in ("", *_station_lines(station, made))),
    ]


SUCTION = {"keep": "keep suction", "on": "switch suction on", "off": "switch suction off"}


def _start_text(made: Plan) -> str:
    if made.starts_without_missing:
        return (
            "The run starts without stations that are missing or refuse; its verdict is then at"
            " best ACCEPT WITH DEVIATIONS."
        )
    return (
        "All stations start together, or none (--allow-missing starts without those that are"
        " missing or refuse)."
    )


def _station_lines(station: StationPlan, made: Plan) -> list[str]:
    spec, recipe, condition = station.spec, station.recipe, station.condition()
    ports = f"port{'s' if len(station.ports) > 1 else ''} {', '.join(map(str, station.ports))}"
    model = f" (accepts model {spec.model})" if spec.model else ""
    lines = [
        f"{spec.name}  {spec.family}{model}, {ports}, {spec.url}",
        f"  recipe    {recipe.name} revision {recipe.revision}",
    ]
    lines += _rate_lines(station)
    lines += [f"  write     {_write_text(one)}" for one in station.writes()]
    if condition is not None:
        written = (
            "is written once"
            if made.wanted.allow_omega_write
            else "stops the start (--allow-omega-write writes it)"
        )
        lines += wrap(
            f"{condition}; a difference {written}",
            110,
            initial_indent="  compare   ",
            subsequent_indent=" " * 12,
        )
    if station.skipped():
        lines.append(f"  skip      {', '.join(station.skipped())}: this station has none")
    has_suction = station.family is not None and station.family.status.has_suction
    orders = [f'set every tool to "{recipe.run.status}"'] if recipe.run.status else []
    orders += (
        [SUCTION[recipe.suction]] if has_suction and (orders or recipe.suction != "keep") else []
    )
    if orders:
        lines.append(f"  then      {', '.join(orders)}, and record")
    return [*lines, _last_line(station)]


def _last_line(station: StationPlan) -> str:
    if station.family is not None and not station.family.safe_states:
        return "  at end    nothing: the station has no safe state"
    has_suction = station.family is not None and station.family.status.has_suction
    suction = f", {SUCTION[station.recipe.run.safe_suction]}" if has_suction else ""
    return (
        "  at end    set every tool to"
        f' "{station.recipe.safe_state(station.spec.family)}"{suction}, whatever happens'
    )


def _write_text(setting: Setting) -> str:
    place = "" if setting.port is None else f"port {setting.port}: "
    return f"{place}{setting.command.name.replace('_', ' ')} = {setting.shown()}"


def _rate_lines(station: StationPlan) -> list[str]:
    demand, rate_hz, turnaround = station.demand, station.rate_hz, station.turnaround_s
    if demand is None:
        return ["  rate      not known until the station reports its model"]
    if rate_hz is None:
        return ["  rate      without pause"]
    tick_ms = 1000 * (demand.fast_s + demand.fast_reads * turnaround)
    given = station.spec.turnaround_ms is not None
    measured = (
        f"at {turnaround * 1000:g} ms response time"
        if given
        else "at 0 ms response time (`run` measures it)"
    )
    return [
        (
            f"  rate      {rate_hz:g} Hz: readings take {tick_ms:.1f} of {1000 / rate_hz:.0f} ms, "
            f"{100 * demand.load(rate_hz, turnaround):.1f} % of the link {measured}"
        ),
        (
            f"  fits      up to {1000 * demand.greatest_turnaround_s(rate_hz):.2f} ms response"
            f" time; highest rate {demand.best_rate_hz(turnaround):g} Hz"
        ),
        *_auto_lines(station, demand, rate_hz),
        *_slowest_line(station, demand, rate_hz),
        *_faster_line(station),
    ]


def _faster_line(station: StationPlan) -> list[str]:
    """Return a note on a measured response time of 0: the link is faster than its line format."""
    if station.spec.turnaround_ms != 0:
        return []
    return [
        f"  reserve   at 0 ms the link may be faster than {station.spec.line_format}, and a higher"
        " rate may fit"
    ]


def _auto_lines(station: StationPlan, demand: Demand, rate_hz: float) -> list[str]:
    """Return the basis of an automatic rate, and up to which response time it stays the same."""
    from jbclog.session.rates import AS_AUTO, SOME_RATES
    from jbclog.session.scheduler import KEPT_BY_AUTO

    if station.asked_rate != AS_AUTO:
        return []
    assumed = (
        "turnaround_ms of the line file"
        if station.spec.turnaround_ms is not None
        else "0 ms: the line file has no turnaround_ms"
    )
    most_ms = 1000 * demand.greatest_turnaround_s(rate_hz, KEPT_BY_AUTO)
    return [
        (
            f"  auto      the highest of {SOME_RATES} Hz that leaves a fifth of the link free:"
            f" {rate_hz:g} Hz up to {most_ms:.2f} ms response time"
        ),
        f"  assumed   {assumed}; `run` measures the response time, then chooses",
    ]


def _slowest_line(station: StationPlan, demand: Demand, rate_hz: float) -> list[str]:
    """Return the load at the longest response time in the family's manual."""
    slowest_s = station.slowest_s
    if slowest_s is None or slowest_s <= station.turnaround_s:
        return []
    load, best = demand.load(rate_hz, slowest_s), demand.best_rate_hz(slowest_s)
    return [
        f"  slowest   {100 * load:.1f} % of the link at {1000 * slowest_s:g} ms, the manual's"
        f" maximum; highest rate {best:g} Hz"
    ]
