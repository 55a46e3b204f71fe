"""How fast a station is sampled: the rate asked for, if it fits the wire with the turnaround just measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jbclog.commands.family import Family
from jbclog.errors import StartRefused
from jbclog.recipe.model import Recipe
from jbclog.scheduler import KEPT_FOR_REPEATS, Demand, Reading, readings_of, watched_readings
from jbclog.session.order import AS_FAST_AS_POSSIBLE, AS_FIT, Desk
from jbclog.session.watch import WATCHED_SETTINGS
from jbclog.wire import LineFormat


@dataclass(frozen=True, slots=True)
class Pace:
    """What is read repeatedly and at which period; `paced` is False where the station is asked without pause."""

    readings: list[Reading]
    period_s: float
    paced: bool


def readings_for(family: Family, ports: Sequence[int], recipe: Recipe, line: LineFormat, addressed: bool) -> list[Reading]:
    """Everything that a run reads repeatedly on a station of `family` with `ports`; also for `plan`."""
    sampling = recipe.sampling
    signals = [(signal, family.commands[signal.command]) for signal in family.signals]
    counters = [(counter, family.commands[counter.command]) for counter in family.counters]
    watched = [family.commands[name] for name in WATCHED_SETTINGS if name in family.commands]
    found = readings_of(signals, counters, ports, line, addressed, sampling.alarms_every_s, sampling.counters_every_s)
    return found + watched_readings(watched, ports, line, addressed, sampling.counters_every_s)


def choose_pace(desk: Desk) -> Pace:
    """Decide the rate. Raises `StartRefused` naming the best rate and the greatest turnaround where it does not fit."""
    order, facts = desk.order, desk.facts
    readings = readings_for(desk.family, list(desk.ports), desk.recipe, order.line, order.address is not None)
    demand, turnaround_s = Demand.of(readings), _turnaround_s(desk)
    if order.rate == AS_FAST_AS_POSSIBLE:
        return Pace(readings, demand.tick_s(turnaround_s), False)
    rate_hz = _rate_hz(desk, demand, turnaround_s)
    facts.period_s = 1 / rate_hz
    return Pace(readings, 1 / rate_hz, True)


def _turnaround_s(desk: Desk) -> float:
    """What a rate is held against: the usual turnaround, or the longest seen where the manual prints that it varies."""
    return desk.facts.turnaround_us["median" if desk.family.turnaround_ms is None else "p99"] / 1e6


def _rate_hz(desk: Desk, demand: Demand, turnaround_s: float) -> float:
    asked, best = desk.order.rate, demand.best_rate_hz(turnaround_s)
    if best <= 0:
        raise StartRefused(f"{desk.name}: with {turnaround_s * 1000:.1f} ms of turnaround no rate at all fits its wire")
    wished = desk.recipe.rate_hz(desk.family) if asked is None or isinstance(asked, str) else asked
    if asked == AS_FIT:
        return min(wished, best)
    problem = rate_problem(desk.name, wished, demand, turnaround_s)
    if problem and not desk.order.is_replay:
        raise StartRefused(problem)
    return wished


def rate_problem(name: str, rate_hz: float, demand: Demand, turnaround_s: float) -> str | None:
    """Why a rate cannot be kept with all that is to be read, or None."""
    if rate_hz < demand.slowest_rate_hz * (1 - 1e-9):
        return (
            f"{name}: at {rate_hz:g} Hz a tick is too rare for the readings that are due more often; the lowest rate is "
            f"{demand.slowest_rate_hz:.3g} Hz: raise it, or alarms_every_s in the recipe's [sampling]"
        )
    return None if demand.fits(rate_hz, turnaround_s) else too_fast(name, rate_hz, demand, turnaround_s)


def too_fast(name: str, rate_hz: float, demand: Demand, turnaround_s: float) -> str:
    """The sentence that says by how much a rate does not fit, and what would."""
    load, best = demand.load(rate_hz, turnaround_s), demand.best_rate_hz(turnaround_s)
    most = demand.greatest_turnaround_s(rate_hz) * 1000
    why = "95 % is the limit" if load > 1 - KEPT_FOR_REPEATS else "which leaves the slow signals too little to come round in time"
    limit = f"the turnaround may be {most:.2f} ms at most" if most >= 0 else "its bytes alone are too many"
    return (
        f"{name}: {rate_hz:g} Hz does not fit its wire: {load:.1%} in use with {turnaround_s * 1000:.2f} ms of turnaround, "
        f"{why}; at this rate {limit}. The best rate is {best:g} Hz: --rate {best:g}, or --rate fit"
    )
