"""`jbclog plan`: a dry run, which sends no byte."""

from __future__ import annotations

from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.loading import without_collector
from jbclog.cli.output import echo, echo_json, note, reports_errors
from jbclog.core.text import count_text

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
    verbose: bool = typer.Option(
        False, "--verbose", help="Show every setting, and how each rate fits its link."
    ),
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
            echo(*_lines(made, verbose=verbose))


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
            "uom": one.unit,
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


def _lines(made: Plan, *, verbose: bool) -> list[str]:
    lines = [f"Line {made.line.name}: {count_text(len(made.stations), 'station')}. No byte sent."]
    if len(made.stations) > 1:
        lines.append(_start_text(made))
    for station in made.stations:
        lines.append("")
        if verbose:
            lines += _station_lines(station, made)
        else:
            lines += _summary_lines(station, made)
    if not verbose:
        lines += ["", "--verbose shows every setting, and how each rate fits its link."]
    return lines


def _summary_lines(station: StationPlan, made: Plan) -> list[str]:
    """Say what will happen to a station, in two lines; a third for an OMEGA's condition."""
    head = f"{_title(station)}: {_rate_summary(station)}"
    skipped = station.skipped()
    if skipped:
        head += f"; {count_text(len(skipped), 'key')} of the recipe not for it"
    writes = station.writes()
    steps = f"  writes {count_text(len(writes), 'setting')}{_temperatures(station)}"
    if not writes:
        steps = "  writes nothing"
    for order in _orders(station):
        steps += f", then {order.removeprefix('set every tool to ')}"
    lines = [head, f"{steps}; at the end {_end_summary(station)}"]
    condition = station.condition()
    if condition is not None:
        lines.append(f"  compares condition {condition.condition}; {_difference(made)}")
    return lines


def _end_summary(station: StationPlan) -> str:
    if station.family is not None and not station.family.safe_states:
        return "nothing: it has no safe state"
    return f'"{station.recipe.safe_state(station.spec.family)}"'


def _difference(made: Plan) -> str:
    if made.wanted.allow_omega_write:
        return "a difference is written once"
    return "a difference stops the start (--allow-omega-write writes it)"


def _orders(station: StationPlan) -> list[str]:
    """Return what is ordered once the settings are written."""
    recipe = station.recipe
    has_suction = station.family is not None and station.family.status.has_suction
    orders = []
    if recipe.run.status:
        orders.append(f'set every tool to "{recipe.run.status}"')
    if has_suction and (orders or recipe.suction != "keep"):
        orders.append(SUCTION[recipe.suction])
    return orders


def _rate_summary(station: StationPlan) -> str:
    if station.demand is None:
        return "rate not known until the station reports its model"
    if station.rate_hz is None:
        return "sampled without pause"
    load = station.demand.load(station.rate_hz, station.turnaround_s)
    return f"{station.rate_hz:g} Hz, {100 * load:.0f} % of the link"


def _temperatures(station: StationPlan) -> str:
    """List the setpoints that the run writes: `` (port 1: 350 °C, port 2: 330 °C)``."""
    setpoints = [
        f"port {setting.port}: {setting.shown()}"
        for setting in station.writes()
        if setting.command.name == "selected_temperature"
    ]
    return f" ({', '.join(setpoints)})" if setpoints else ""


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


def _title(station: StationPlan) -> str:
    spec = station.spec
    ports = f"port{'s' if len(station.ports) > 1 else ''} {', '.join(map(str, station.ports))}"
    model = f" (accepts model {spec.model})" if spec.model else ""
    return f"{spec.name}  {spec.family}{model}, {ports}"


def _condition_lines(station: StationPlan, made: Plan, *, indent: str) -> list[str]:
    """Describe the condition that an OMEGA must have."""
    condition = station.condition()
    if condition is None:
        return []
    text = f"{condition}; {_difference(made)}"
    return wrap(text, 110, initial_indent=f"{indent}compare   ", subsequent_indent=" " * 12)


def _station_lines(station: StationPlan, made: Plan) -> list[str]:
    recipe = station.recipe
    lines = [
        f"{_title(station)}, {station.spec.url}",
        f"  recipe    {recipe.name} revision {recipe.revision}",
    ]
    lines += _rate_lines(station)
    lines += [f"  write     {_write_text(setting)}" for setting in station.writes()]
    lines += _condition_lines(station, made, indent="  ")
    if station.skipped():
        lines.append(f"  skip      {', '.join(station.skipped())}: this station has none")
    orders = _orders(station)
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
