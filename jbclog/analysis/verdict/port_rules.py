"""The rules on the readings of one port: coverage, longest gap, idle tip, setpoint reached, tip
verification.

A reading that the computer skipped is missing evidence and breaks no limit. A percentage is judged
with the resolution of the run: one missing reading of few does not break it. An estimated figure
keeps its limit only together with its 95 % bound.

A run names the verification of each tip that was valid when it began (`TipCheck` in the manifest).
A failed one breaks the limit; none, one that is too old, of another tip, or made with another
adjustment than the run's is missing evidence.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from jbclog.analysis.verdict.acceptance import REACHED_LIMITS, is_bare
from jbclog.analysis.verdict.bounds import Bound
from jbclog.analysis.verdict.evidence import Evidence, PortLedger
from jbclog.analysis.verdict.idle import NOT_IDLE
from jbclog.analysis.verdict.reached import (
    AT_WORK_PERCENT,
    ORDERS_WORK,
    WITHIN_C,
    Limit,
    Targets,
    reached_rule,
)
from jbclog.analysis.verdict.reached import RULE as REACHED
from jbclog.analysis.verdict.rule import RESOLVES, Result, Rule, allowed_misses, floored, shown
from jbclog.analysis.verdict.rules import not_applicable, reports
from jbclog.analysis.verdict.samples import SKIPPED, TEMPERATURE, PortMeasure, judged_signals
from jbclog.core.rows import StationFacts, TipCheck

if TYPE_CHECKING:  # importing pydantic for a verdict would be slow
    from jbclog.config.recipe_sections import Acceptance

EXPIRED = "expired"
ADJUSTED = "adjusted since"
NO_STATE = "Every answer lacked the digit of the state, so no state is known."


def port_rules(
    facts: StationFacts,
    port: int,
    acceptance: Acceptance,
    ledger: PortLedger,
    measure: PortMeasure | None,
) -> Iterator[Rule]:
    """Yield the rules on a port, in reading order."""
    station = facts.name
    if acceptance.coverage_percent is not None:
        rule = coverage_rule(facts, port, acceptance.coverage_percent, ledger, measure)
        yield _without_host(rule, facts, ledger)
    if acceptance.longest_gap_s is not None:
        seen = None if measure is None else measure.gap_s
        gap = f"Longest gap in {'temperature' if reports(facts, TEMPERATURE) else 'readings'}"
        rule = _at_most("longest_gap", station, port, acceptance.longest_gap_s, seen, "s", gap)
        if seen is None and _any_says_no_state(facts, ledger):
            rule = replace(rule, text=NO_STATE)
        yield _gap_without_host(rule, measure)
    yield from idle_rules(facts, port, acceptance, measure)


def heat_rules(
    facts: StationFacts,
    port: int,
    acceptance: Acceptance,
    evidence: Evidence,
    measure: PortMeasure | None,
    *,
    is_ordered: bool,
) -> Iterator[Rule]:
    """Yield the rule `reached` if the recipe sets a temperature or states such a limit."""
    targets, percent = evidence.targets.get(facts.name, Targets()), acceptance.at_work_percent
    if port not in targets.heated and all(
        getattr(acceptance, name) is None for name in REACHED_LIMITS
    ):
        return
    limit = AT_WORK_PERCENT if percent is None else percent
    if not reports(facts, TEMPERATURE):
        yield not_applicable(REACHED, facts.name, port, limit, "%", "temperature")
        return
    within = WITHIN_C if acceptance.reached_within_c is None else acceptance.reached_within_c
    orders_work = is_ordered and targets.status in ORDERS_WORK
    yield reached_rule(
        facts.name,
        port,
        Limit(within, limit, orders_work),
        targets,
        None if measure is None else measure.heat,
    )


def idle_rules(
    facts: StationFacts, port: int, acceptance: Acceptance, measure: PortMeasure | None
) -> Iterator[Rule]:
    """Yield the rules on idle error and idle standard deviation."""
    stated = (("idle_error", acceptance.idle_error_c), ("idle_sd", acceptance.idle_sd_c))
    limits = {name: limit for name, limit in stated if limit is not None}
    if not reports(facts, TEMPERATURE):
        yield from (
            not_applicable(name, facts.name, port, limit, "°C", "temperature")
            for name, limit in limits.items()
        )
        return
    if measure is None or measure.idle.mean_c is None:
        yield from (
            Rule(name, facts.name, port, limit, None, "°C", Result.MISSING, NOT_IDLE)
            for name, limit in limits.items()
        )
        return
    bounds = measure.idle.bounds()
    mean_bound = bounds if isinstance(bounds, str) else bounds.mean
    sd_bound = bounds if isinstance(bounds, str) else bounds.sd
    if "idle_error" in limits:
        rule = idle_error_rule(facts.name, port, limits["idle_error"], measure.idle.mean_c)
        yield bounded(rule, mean_bound, bare=is_bare(acceptance))
    if "idle_sd" in limits:
        rule = _at_most(
            "idle_sd",
            facts.name,
            port,
            limits["idle_sd"],
            measure.idle.sd_c,
            "°C",
            "Idle standard deviation",
        )
        yield bounded(rule, sd_bound, bare=is_bare(acceptance))


def bounded(rule: Rule, bound: Bound | str, *, bare: bool = False) -> Rule:
    """Return the rule with the bound of its figure, or with the sentence why there is none.

    The limit is kept if figure and bound keep it. If only the figure keeps it, or there is no
    bound, evidence is missing, unless figures are judged `bare`.
    """
    if rule.result is Result.MISSING:
        return rule
    if isinstance(bound, str):
        return (
            rule
            if bare or rule.result is Result.FAIL
            else replace(rule, result=Result.MISSING, text=f"{rule.text} {bound}")
        )
    assert isinstance(rule.limit, int | float)
    if bare or rule.result is Result.FAIL or bound.keeps(rule.limit):
        return replace(rule, bound=bound)
    text = (
        f"{rule.text} The 95 % bound is {shown(_furthest(bound))} {rule.unit}: a longer record is"
        " needed."
    )
    return replace(rule, bound=bound, result=Result.MISSING, text=text)


def _furthest(bound: Bound) -> float:
    return bound.high if bound.low is None else max(bound.low, bound.high, key=abs)


def coverage_rule(
    facts: StationFacts, port: int, least: float, ledger: PortLedger, measure: PortMeasure | None
) -> Rule:
    """Return the rule on readings of temperature or state obtained, in per cent of those due."""
    station, what = facts.name, _what_is_read(facts)
    counts = _judged_counts(facts, ledger)
    due, counted = (sum(one.get(word, 0) for one in counts) for word in ("due", "ok"))
    readings = 0 if measure is None else measure.readings
    if not due:
        why = f"{what}: no reading was due."
        if _any_says_no_state(facts, ledger):
            why = NO_STATE
        return Rule("coverage", station, port, least, None, "%", Result.MISSING, why)
    if readings != counted:
        text = f"{what}: the accounting has {counted} readings, the samples {readings}."
        return Rule("coverage", station, port, least, None, "%", Result.MISSING, text)
    percent = 100 * readings / due
    result = Result.PASS if percent >= least else Result.FAIL
    text = (
        f"{what} coverage {shown(floored(percent))} % ({readings} of {due}), required"
        f" {shown(least)} %."
    )
    return Rule("coverage", station, port, least, percent, "%", result, text)


def _judged_counts(facts: StationFacts, ledger: PortLedger) -> list[Mapping[str, int]]:
    """Return the accounting of each judged signal; leaves out a signal that never had a state."""
    return [
        one for signal in judged_signals(facts) if not says_no_state(one := ledger.get(signal, {}))
    ]


def _any_says_no_state(facts: StationFacts, ledger: PortLedger) -> bool:
    return any(says_no_state(ledger.get(signal, {})) for signal in judged_signals(facts))


def says_no_state(counts: Mapping[str, int]) -> bool:
    """Whether every answer lacked a state: an OMEGA that answers `a` alone (manual 003, 11.3.1).

    Such a signal is not judged.
    """
    return bool(counts.get("no_digit")) and not counts.get("ok")


def _without_host(rule: Rule, facts: StationFacts, ledger: PortLedger) -> Rule:
    """Judge coverage with the run's resolution. Readings that the computer skipped are missing
    evidence and break no limit.
    """
    if not isinstance(rule.observed, float) or not isinstance(rule.limit, int | float):
        return rule
    counts = _judged_counts(facts, ledger)
    due, obtained = (sum(one.get(word, 0) for one in counts) for word in ("due", "ok"))
    skipped = sum(skipped_by_host(facts, one.get(SKIPPED, 0)) for one in counts)
    missing, allowed = due - obtained, allowed_misses(due, rule.limit)
    if missing <= (0 if due < RESOLVES and rule.observed < rule.limit else allowed):
        kept = (
            ""
            if rule.observed >= rule.limit
            else f" One reading is {shown(100 / due)} %: within the resolution."
        )
        return replace(rule, result=Result.PASS, text=f"{rule.text}{kept}")
    text = (
        f"{rule.text} The recorder was too late for {skipped} of them (busy or stopped)."
        if skipped
        else rule.text
    )
    if missing - skipped > allowed:
        return replace(rule, result=Result.FAIL, text=text)
    if missing <= allowed:
        return replace(
            rule, result=Result.MISSING, text=f"{text} {due} readings are too few to decide."
        )
    text = f"{text} Their values are not known; less load on the computer, or a lower rate, helps."
    return replace(rule, result=Result.MISSING, text=text)


def skipped_by_host(facts: StationFacts, skipped: int) -> int:
    """Return how many of a signal's skipped readings the computer caused; all of them if the record
    does not say.
    """
    return (
        skipped
        if facts.skipped_by_host is None
        else min(skipped, facts.skipped_by_host + facts.skipped)
    )


def _gap_without_host(rule: Rule, measure: PortMeasure | None) -> Rule:
    """Judge the longest gap. If only readings that the computer skipped break the limit, evidence
    is missing.
    """
    others = None if measure is None else measure.gap_of_others_s
    if (
        rule.result is not Result.FAIL
        or others is None
        or not isinstance(rule.limit, int | float)
        or others > rule.limit
    ):
        return rule
    text = (
        f"{rule.text} The recorder was too late for some readings (busy or stopped); without these"
        f" it is {shown(others)} s."
    )
    return replace(rule, result=Result.MISSING, text=text)


def _what_is_read(facts: StationFacts) -> str:
    if not reports(facts, TEMPERATURE):
        return "State"
    return "Air temperature" if "external_c" in facts.signals else "Tip temperature"


def idle_error_rule(station: str, port: int, most: float, mean: float) -> Rule:
    """Return the rule on the idle tip's mean difference from its setpoint, on both sides."""
    result = Result.PASS if abs(mean) <= most else Result.FAIL
    text = f"Idle error {round(mean, 1) + 0.0:+.1f} °C (mean), allowed ±{shown(most)} °C."
    return Rule("idle_error", station, port, most, mean, "°C", result, text)


def _at_most(
    name: str, station: str, port: int, most: float, seen: float | None, unit: str, what: str
) -> Rule:
    if seen is None:
        return Rule(name, station, port, most, None, unit, Result.MISSING, "Nothing was recorded.")
    result = Result.PASS if seen <= most else Result.FAIL
    return Rule(
        name,
        station,
        port,
        most,
        seen,
        unit,
        result,
        f"{what} {shown(seen)} {unit}, allowed {shown(most)} {unit}.",
    )


def verification_rule(
    facts: StationFacts, port: int, most_days: float, evidence: Evidence, adjusted_c: float | None
) -> Rule:
    """Return the rule on a port's tip verification.

    `most_days`: the maximum age at the run's start. `adjusted_c`: the adjustment that the run had,
    °C; None if not read.
    """
    place = (facts.name, port)
    found = next((one for one in evidence.verifications if (one.station, one.port) == place), None)
    observed, result, text = _verified(found, most_days, adjusted_c)
    return Rule("verification", facts.name, port, most_days, observed, "d", result, text)


def _verified(
    found: TipCheck | None, most_days: float, adjusted_c: float | None
) -> tuple[float | str | None, Result, str]:
    if found is None or found.days is None or found.time is None:
        state = "none" if found is None else found.state
        return (
            state,
            Result.MISSING,
            "No valid verification of its tip." if found is None else found.text,
        )
    verified = (
        f"The tip was last verified {_age(found.days)} before the run, at {found.time[:16]}Z, with"
        f" {found.instrument}"
    )
    if found.state == "fail":
        return "fail", Result.FAIL, f"{verified}, and failed: {found.text}"
    if found.state != "pass":
        return found.state, Result.MISSING, found.text
    if found.adjust_c is not None and adjusted_c is not None and found.adjust_c != adjusted_c:
        text = (
            f"{verified}, with an adjustment of {found.adjust_c:g} °C; the run had"
            f" {adjusted_c:g} °C."
        )
        return ADJUSTED, Result.MISSING, text
    if found.days > most_days:
        return EXPIRED, Result.MISSING, f"{verified}: too long ago, {most_days:g} days allowed."
    return (
        found.days,
        Result.PASS,
        f"{verified}, and passed ({found.offset_c or 0.0:+.1f} °C); {most_days:g} days allowed.",
    )


def _age(days: float) -> str:
    return f"{days:.1f} days" if days >= 1 else f"{days * 24:.1f} h"
