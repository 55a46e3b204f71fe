"""Measure a station's response time, and choose its sampling rate: the requested one, if it fits
the link.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from jbclog.core.errors import StartRefused
from jbclog.core.rows import StationFacts
from jbclog.protocol.client.timing import LEAST_ANSWERED, READS, response_time
from jbclog.session.rates import (
    AS_AUTO,
    AS_FAST_AS_POSSIBLE,
    AS_FIT,
    ResponseTimes,
    asked_rate,
    rate_problem,
    readings_for,
    response,
    taken_rate_hz,
)
from jbclog.session.run.context import SessionContext
from jbclog.session.scheduler import Demand, ScheduledRead

# At a start the run reads all stations without pause, and a computer that serves hundreds of them
# processes an answer some milliseconds after it arrived. That looks like a slow station. So a rate
# is refused only if the station is too slow even with pauses between reads, in which the computer
# catches up. If the manual prints that answers vary, the longest one counts, and more readings are
# no evidence against it.
APART_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class SamplingPlan:
    """The readings of a run and their period; `paced` is False without pause."""

    readings: list[ScheduledRead]
    period_s: float
    paced: bool


async def measure_pace(context: SessionContext) -> SamplingPlan:
    """Measure the response time and choose the rate; measure again before refusing a rate. Raises
    `StartRefused`.
    """
    await measure_turnaround(context)
    try:
        return choose_pace(context)
    except StartRefused:
        if context.state.family.turnaround_ms is not None:
            raise
    await measure_turnaround(context, apart_s=APART_S)
    return choose_pace(context)


async def measure_turnaround(context: SessionContext, *, apart_s: float = 0.0) -> None:
    """Measure the response time in µs, from the signals of a port read so far and from harmless
    reads `apart_s` apart. A repeated measurement uses the harmless reads alone.
    """
    state = context.state
    port = min(state.ports)
    answers, context.reads.answer_times = context.reads.answer_times, None
    seen = [
        time
        for name, time in ([] if answers is None else answers[port])
        if state.family.signal_of(name)
    ]
    measured, answered = await response_time(
        context.station, state.family, port, seen, apart_s=apart_s
    )
    if measured is None or answered < LEAST_ANSWERED:
        raise StartRefused(
            f"{context.name}: only {answered} of {READS} questions were answered; the link is too"
            " unreliable to start"
        )
    state.facts.turnaround_us = {
        "median": round(measured.median, 1),
        "p99": round(measured.longest, 1),
        "n": len(measured.took),
    }
    for name in measured.ignored:
        state.not_supported.add(state.family.signal_of(name) or name)
    state.link_is_faster = measured.faster_text(context.order.line)
    if measured.is_faster:
        state.facts.turnaround_us["faster_by"] = round(measured.wire - measured.whole, 1)


def choose_pace(context: SessionContext) -> SamplingPlan:
    """Choose the rate. If it does not fit, raises `StartRefused` naming the best rate and the
    maximum response time.
    """
    state = context.state
    order, facts = context.order, state.facts
    readings = readings_for(
        state.family,
        list(state.ports),
        context.order.recipe,
        order.line,
        order.address is not None,
    )
    unread = {"software_version"} if facts.software is None else set()  # nothing to compare it with
    readings = [one for one in readings if one.name not in state.not_supported | unread]
    demand, seen = Demand.of(readings), facts.turnaround_us
    usual = response(state.family, seen["median"] / 1e6, seen["p99"] / 1e6)
    asked = facts.asked_rate = asked_rate(order.rate, context.order.recipe, state.family)
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
            f"{context.name}: no rate fits its serial link at"
            f" {response.longest_s * 1000:.1f} ms response time"
        )
    taken = taken_rate_hz(asked, context.order.recipe, context.state.family, demand, response)
    problem = (
        None if asked == AS_FIT else rate_problem(context.name, taken, demand, response.longest_s)
    )
    if problem:
        raise StartRefused(problem)
    return taken


def chosen_text(facts: StationFacts) -> str:
    """Describe how the rate was chosen, after a comma; empty if a number was requested."""
    if facts.rate_hz is None or not isinstance(facts.asked_rate, str):
        return ""
    why = (
        "a fifth of its link stays free"
        if facts.asked_rate == AS_AUTO
        else "the best rate that fits"
    )
    return f", sampled at {facts.rate_hz:g} Hz ({facts.asked_rate}: {why})"
