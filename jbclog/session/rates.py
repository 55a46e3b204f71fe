"""The sampling rate requested for a station, and whether it fits the link, from files and a
response time, without a session.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from jbclog.config.recipe import Recipe
from jbclog.config.schema import AUTO
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.signals import UsageCounter
from jbclog.session.scheduler import (
    AUTO_RATES_HZ,
    KEPT_FOR_REPEATS,
    Demand,
    ScheduledRead,
    period_s,
    read_wire_s,
)

AS_AUTO = AUTO
AS_FIT = "fit"
AS_FAST_AS_POSSIBLE = "max"
SOME_RATES = ", ".join(f"{rate_hz:g}" for rate_hz in AUTO_RATES_HZ[:6]) + " …"

# reads of the identity that stay constant during a run
IDENTITY_READS: Final = ("model", "software_version")
WATCHED_SETTINGS: Final = (
    "alarm_high_limit",
    "alarm_low_limit",
    "alarm_high_delay",
    "alarm_low_delay",
    "selected_external_temperature",
    "work_mode",
)
"""Settings without a column, read periodically during a run."""


def readings_for(
    family: Family, ports: Sequence[int], recipe: Recipe, line: LineFormat, addressed: bool
) -> list[ScheduledRead]:
    """List everything that a run, or `plan`, reads periodically on a station of `family` with
    `ports`; station-wide signals once, in the first port's row.
    """
    sampling = recipe.sampling
    seldom_s = sampling.counters_every_s
    readings: list[ScheduledRead] = []

    def add(
        name: str,
        command: Command,
        port: int,
        every_s: float | None,
        *,
        columns: tuple[str, ...] = (),
        counter: UsageCounter | None = None,
        is_identity: bool = False,
    ) -> None:
        asks_port = None if command.scope is Scope.STATION else port
        wire_s = read_wire_s(line, command, addressed)
        readings.append(
            ScheduledRead(
                name, command, port, asks_port, wire_s, every_s, columns, counter, is_identity
            )
        )

    for signal in family.signals:
        command = family.commands[signal.command]
        every_s = period_s(signal.interval, sampling.alarms_every_s, seldom_s)
        for port in ports[:1] if command.scope is Scope.STATION else ports:
            add(signal.name, command, port, every_s, columns=signal.columns)
    for counter in family.counters:
        command = family.commands[counter.command]
        interval_s = period_s(counter.interval, sampling.alarms_every_s, seldom_s)
        every_s = seldom_s if interval_s is None else min(interval_s, seldom_s)
        for port in ports:
            add(counter.name, command, port, every_s, counter=counter)
    for name in IDENTITY_READS:
        if name in family.commands:
            add(name, family.commands[name], ports[0], seldom_s, is_identity=True)
    for name in WATCHED_SETTINGS:
        if name in family.commands:
            for port in ports:
                add(name, family.commands[name], port, seldom_s)
    return readings


@dataclass(frozen=True, slots=True)
class ResponseTimes:
    """Response time of a station in seconds: the usual one, and the longest that a rate must still
    fit.
    """

    usual_s: float
    longest_s: float


def response(family: Family, median_s: float, p99_s: float) -> ResponseTimes:
    """Return the response times for choosing a rate; the longest measured one counts if the manual
    prints that it varies.
    """
    return ResponseTimes(median_s, median_s if family.turnaround_ms is None else p99_s)


def asked_rate(rate: float | str | None, recipe: Recipe, family: Family | None) -> float | str:
    """Return the requested rate: that of `--rate`, else the recipe's."""
    return recipe.asked_rate(family) if rate is None else rate


def taken_rate_hz(
    asked: float | str, recipe: Recipe, family: Family, demand: Demand, response: ResponseTimes
) -> float:
    """Return the rate in Hz for `asked` (not ``max``); 0.0 if none fits. A number is returned
    unchanged.

    ``auto`` must hold for the whole run, so it allows for the longest response time in the manual.
    """
    if asked == AS_AUTO:
        printed_s = family.turnaround_ms[1] / 1000 if family.turnaround_ms else 0.0
        return demand.auto_rate_hz(response.usual_s, max(response.longest_s, printed_s))
    if asked == AS_FIT:
        return min(recipe.rate_hz(family), demand.best_rate_hz(response.longest_s))
    return float(asked)


def rate_problem(name: str, rate_hz: float, demand: Demand, turnaround_s: float) -> str | None:
    """Describe why a rate cannot be kept with all readings; None if it can. 0 Hz: ``auto`` found
    none.
    """
    if not rate_hz:
        return nothing_left(name, demand, turnaround_s)
    if demand.is_too_slow(rate_hz):
        return (
            f"{name}: {rate_hz:g} Hz is too slow for the readings that are due more often; the"
            f" lowest rate is {demand.slowest_rate_hz:.3g} Hz: raise the rate, or alarms_every_s in"
            " the recipe's [sampling]"
        )
    return (
        None
        if demand.fits(rate_hz, turnaround_s)
        else too_fast(name, rate_hz, demand, turnaround_s)
    )


def too_fast(name: str, rate_hz: float, demand: Demand, turnaround_s: float) -> str:
    """Describe by how much a rate does not fit, and which one would."""
    load, best = demand.load(rate_hz, turnaround_s), demand.best_rate_hz(turnaround_s)
    most = demand.greatest_turnaround_s(rate_hz) * 1000
    why = (
        "95 % is the limit"
        if load > 1 - KEPT_FOR_REPEATS
        else "which leaves too little time for the slow signals"
    )
    limit = (
        f"the response time may be {most:.2f} ms at most"
        if most >= 0
        else "the bytes alone are too many for the link"
    )
    return (
        f"{name}: {rate_hz:g} Hz does not fit its serial link: {100 * load:.1f} % of it in use at"
        f" {turnaround_s * 1000:.2f} ms response time, {why}; at this rate {limit}. The best rate"
        f" is {best:g} Hz: --rate {best:g}, or --rate fit"
    )


def nothing_left(name: str, demand: Demand, turnaround_s: float) -> str:
    """Say that no rate of ``auto`` leaves a fifth of the link's time free."""
    best = demand.best_rate_hz(turnaround_s)
    by_hand = "" if demand.is_too_slow(best) else f", or name a rate: {best:g} Hz is the best"
    return (
        f'{name}: "auto" finds no rate: its slow readings need {demand.slowest_rate_hz:.3g} Hz or'
        f" more, and none of {SOME_RATES} Hz leaves a fifth of its link free at"
        f" {turnaround_s * 1000:.2f} ms response time; raise alarms_every_s in the recipe's"
        f" [sampling]{by_hand}"
    )
