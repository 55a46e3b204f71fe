"""Chooses a station's sampling rate: the requested one, if it fits the link with the measured
response time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jbclog.config.recipe import Recipe
from jbclog.core.errors import StartRefused
from jbclog.core.rows import StationFacts
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.commands.family import Family
from jbclog.session.run.context import AS_AUTO, AS_FAST_AS_POSSIBLE, AS_FIT, SessionContext
from jbclog.session.run.identify import IDENTITY_READS
from jbclog.session.run.watch import WATCHED_SETTINGS
from jbclog.session.scheduler import (
    AUTO_RATES_HZ,
    KEPT_FOR_REPEATS,
    Demand,
    ScheduledRead,
    identity_readings,
    readings_of,
    watched_readings,
)

SOME_RATES = ", ".join(f"{rate_hz:g}" for rate_hz in AUTO_RATES_HZ[:6]) + " …"


@dataclass(frozen=True, slots=True)
class SamplingPlan:
    """The readings of a run and their period; `paced` is False without pause."""

    readings: list[ScheduledRead]
    period_s: float
    paced: bool


def readings_for(
    family: Family, ports: Sequence[int], recipe: Recipe, line: LineFormat, addressed: bool
) -> list[ScheduledRead]:
    """List everything that a run, or `plan`, reads repeatedly on a station of `family` with
    `ports`.
    """
    sampling = recipe.sampling
    signals = [(signal, family.commands[signal.command]) for signal in family.signals]
    counters = [(counter, family.commands[counter.command]) for counter in family.counters]
    watched = [family.commands[name] for name in WATCHED_SETTINGS if name in family.commands]
    found = readings_of(
        signals,
        counters,
        ports,
        line,
        addressed,
        sampling.alarms_every_s,
        sampling.counters_every_s,
    )
    identity = [family.commands[name] for name in IDENTITY_READS if name in family.commands]
    found += identity_readings(identity, ports, line, addressed, sampling.counters_every_s)
    return found + watched_readings(watched, ports, line, addressed, sampling.counters_every_s)


@dataclass(frozen=True, slots=True)
class ResponseTimes:
    """Response time of a station in seconds: the usual one, and the longest that a rate must still
    fit.
    """

    usual_s: float
    longest_s: float


def response(family: Family, median_s: float, p99_s: float) -> ResponseTimes:
    """Return the response times for choosing a rate; the longest measured one counts where the
    manual prints that it varies.
    """
    return ResponseTimes(median_s, median_s if family.turnaround_ms is None else p99_s)


def asked_rate(rate: float | str | None, recipe: Recipe, family: Family | None) -> float | str:
    """Return the requested rate: that of `--rate`, else the recipe's."""
    return recipe.asked_rate(family) if rate is None else rate


def taken_rate_hz(
    asked: float | str, recipe: Recipe, family: Family, demand: Demand, response: ResponseTimes
) -> float:
    """Return the rate in Hz for `asked` (not ``max``); 0.0 where none fits. A number is taken as it
    is.

    ``auto`` must hold for the whole run, so it allows for the longest response time that the manual
    prints.
    """
    if asked == AS_AUTO:
        printed_s = family.turnaround_ms[1] / 1000 if family.turnaround_ms else 0.0
        return demand.auto_rate_hz(response.usual_s, max(response.longest_s, printed_s))
    if asked == AS_FIT:
        return min(recipe.rate_hz(family), demand.best_rate_hz(response.longest_s))
    return float(asked)


def choose_pace(context: SessionContext) -> SamplingPlan:
    """Choose the rate. Raises `StartRefused` naming the best rate and the maximum response time
    where it does not fit.
    """
    order, facts = context.order, context.facts
    readings = readings_for(
        context.family, list(context.ports), context.recipe, order.line, order.address is not None
    )
    unread = {"software_version"} if facts.software is None else set()  # nothing to compare it with
    readings = [one for one in readings if one.name not in context.not_supported | unread]
    demand, seen = Demand.of(readings), facts.turnaround_us
    usual = response(context.family, seen["median"] / 1e6, seen["p99"] / 1e6)
    asked = facts.asked_rate = asked_rate(order.rate, context.recipe, context.family)
    if asked == AS_FAST_AS_POSSIBLE:
        return SamplingPlan(readings, demand.tick_s(usual.longest_s), False)
    facts.rate_hz = _rate_hz(context, asked, demand, usual)
    facts.period_s = 1 / facts.rate_hz
    return SamplingPlan(readings, facts.period_s, True)


def _rate_hz(
    context: SessionContext, asked: float | str, demand: Demand, response: ResponseTimes
) -> float:
    if demand.best_rate_hz(response.longest_s) <= 0:
        raise StartRefused(
            f"{context.name}: with {response.longest_s * 1000:.1f} ms of turnaround no rate at all"
            " fits its wire"
        )
    taken = taken_rate_hz(asked, context.recipe, context.family, demand, response)
    problem = (
        None if asked == AS_FIT else rate_problem(context.name, taken, demand, response.longest_s)
    )
    if problem and not (context.order.is_replay and taken):
        raise StartRefused(problem)
    return taken


def chosen_text(facts: StationFacts) -> str:
    """Describe how the rate was chosen, after a comma; empty where a number was requested."""
    if facts.rate_hz is None or not isinstance(facts.asked_rate, str):
        return ""
    why = (
        "a fifth of its link stays free"
        if facts.asked_rate == AS_AUTO
        else "the best rate that fits"
    )
    return f", sampled at {facts.rate_hz:g} Hz ({facts.asked_rate}: {why})"


def rate_problem(name: str, rate_hz: float, demand: Demand, turnaround_s: float) -> str | None:
    """Describe why a rate cannot be kept with all readings; None where it can. 0 Hz: ``auto`` found
    none.
    """
    if not rate_hz:
        return nothing_left(name, demand, turnaround_s)
    if demand.is_too_slow(rate_hz):
        return (
            f"{name}: at {rate_hz:g} Hz a tick is too rare for the readings that are due more"
            f" often; the lowest rate is {demand.slowest_rate_hz:.3g} Hz: raise it, or"
            " alarms_every_s in the recipe's [sampling]"
        )
    return (
        None
        if demand.fits(rate_hz, turnaround_s)
        else too_fast(name, rate_hz, demand, turnaround_s)
    )


def too_fast(name: str, rate_hz: float, demand: Demand, turnaround_s: float) -> str:
    """Describe by how much a rate does not fit, and what would."""
    load, best = demand.load(rate_hz, turnaround_s), demand.best_rate_hz(turnaround_s)
    most = demand.greatest_turnaround_s(rate_hz) * 1000
    why = (
        "95 % is the limit"
        if load > 1 - KEPT_FOR_REPEATS
        else "which leaves the slow signals too little to come round in time"
    )
    limit = (
        f"the turnaround may be {most:.2f} ms at most"
        if most >= 0
        else "its bytes alone are too many"
    )
    return (
        f"{name}: {rate_hz:g} Hz does not fit its wire: {load:.1%} in use with"
        f" {turnaround_s * 1000:.2f} ms of turnaround, {why}; at this rate {limit}. The best rate"
        f" is {best:g} Hz: --rate {best:g}, or --rate fit"
    )


def nothing_left(name: str, demand: Demand, turnaround_s: float) -> str:
    """Describe that no rate of ``auto`` leaves a fifth of the link's time free."""
    best = demand.best_rate_hz(turnaround_s)
    by_hand = "" if demand.is_too_slow(best) else f", or name a rate: {best:g} Hz is the best"
    return (
        f'{name}: "auto" finds no rate: none of {SOME_RATES} Hz from {demand.slowest_rate_hz:.3g}'
        " Hz on, which its slow readings "
        f"need, leaves a fifth of its link free with {turnaround_s * 1000:.2f} ms of response time;"
        " raise alarms_every_s in the "
        f"recipe's [sampling]{by_hand}"
    )
