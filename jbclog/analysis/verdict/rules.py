"""The rules of a verdict, and what broke none and was not as planned."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from jbclog.analysis.verdict.acceptance import BARE, ESTIMATED_LIMITS, LIMIT_NAMES, REACHED_LIMITS, Acceptance, is_bare
from jbclog.analysis.verdict.bounds import Bound
from jbclog.analysis.verdict.evidence import Event, Evidence, Outcomes, PortLedger
from jbclog.analysis.verdict.idle import NOT_IDLE, NOT_SEEN_IDLE, RESOLVES, allowed_misses
from jbclog.analysis.verdict.idle import floored as _floor
from jbclog.analysis.verdict.idle import shown as _shown
from jbclog.analysis.verdict.reached import AT_WORK_PERCENT, ORDERS_WORK, WITHIN_C, Asks, Limit, reached_rule
from jbclog.analysis.verdict.reached import RULE as REACHED
from jbclog.analysis.verdict.rule import Result, Rule
from jbclog.analysis.verdict.samples import SKIPPED, TEMPERATURE, WITHOUT_TIP, PortMeasure, judged_signals
from jbclog.analysis.verdict.versions import BOUNDS_HOLD
from jbclog.core.rows import Goal, StationFacts


def goal_rules(evidence: Evidence) -> Iterator[Rule]:
    """Yield a rule for each goal (units, joints); of two goals one is enough. Falling short is a deviation."""
    is_met = any(goal.is_met for goal in evidence.goals)
    for goal in evidence.goals:
        yield Rule(f"goal_{goal.what}", None, None, goal.wanted, goal.reached, goal.what, _result(goal, is_met), goal.text)


def _result(goal: Goal, is_met: bool) -> Result:
    if goal.is_met:
        return Result.PASS
    if is_met:
        return Result.NOT_APPLICABLE
    return Result.MISSING if goal.reached is None else Result.DEVIATION


COUNTED_ALARMS = ("alarm.high", "alarm.low")
COUNTED_SEVERITIES = ("error", "critical")
WITH_FEEDER = ("ale",)

RUN_ENDINGS = {
    "success": (Result.PASS, "The record runs from start to end."),
    "aborted": (Result.DEVIATION, "Ended before its stated end; the record until then is complete."),
    "failed": (Result.DEVIATION, "Ended with an error; the record until then is complete."),
    "lost": (Result.MISSING, "A crash ended the run: the last second before it is missing from the record."),
}
STATION_ENDINGS = {
    "completed": (Result.PASS, "Recorded to the end."),
    "stopped": (Result.FAIL, "Stopped: a setting was changed during the run."),
    "refused": (Result.MISSING, "Refused before sampling began."),
    "gone": (Result.MISSING, "No answer at the end."),
    "not_started": (Result.MISSING, "Ready, but not started."),
    "left_out": (Result.DEVIATION, "The run started without it, as allowed."),
    "failed": (Result.MISSING, "Its recording failed."),
    "running": (Result.MISSING, "The record broke off while it was recorded."),
}
CONFIDENCE = "confidence"
JUDGED_BARE = 'The recipe judges figures without their bounds (confidence = "none").'
NEVER_ANSWERED = "The station never answered."


def record_rule(evidence: Evidence) -> Rule:
    """Return the rule that the record covers the whole run."""
    if evidence.lost is not None:
        return Rule("record", None, None, "whole", evidence.exit_status, "", Result.MISSING, evidence.lost)
    unknown = (Result.MISSING, "How the run ended is not known.")
    result, text = RUN_ENDINGS.get(evidence.exit_status or "", unknown)
    return Rule("record", None, None, "whole", evidence.exit_status, "", result, text)


def station_rules(
    facts: StationFacts, acceptance: Acceptance, evidence: Evidence, events: Sequence[Event], outcomes: Outcomes
) -> Iterator[Rule]:
    """Yield the rules about a station as a whole."""
    result, text = STATION_ENDINGS.get(facts.outcome, (Result.MISSING, "How it ended is not known."))
    if facts.outcome == "gone" and facts.first_tick is None:
        text = NEVER_ANSWERED
    reason = facts.reason.removeprefix(f"{facts.name}: ").rstrip(".")
    if reason and result is not Result.PASS:
        text = f"{text} {reason[:1].upper()}{reason[1:]}."
    seen = "cut off" if facts.outcome == "running" else facts.outcome
    yield Rule("station", facts.name, None, "completed", seen, "", result, text)
    if facts.outcome == "left_out":
        return
    yield settings_rule(facts, outcomes)
    if acceptance.alarms_max is not None:
        yield alarms_rule(facts, acceptance.alarms_max, evidence, events)


def settings_rule(facts: StationFacts, outcomes: Outcomes) -> Rule:
    """Return the rule that every setting of the recipe is confirmed. Settings of other families do not count."""
    station, counts, lacking = facts.name, outcomes.counts, outcomes.lacking
    asked = counts.total() + len(lacking)
    held = counts["confirmed"] + counts["unchanged"]
    observed = f"{held} of {asked}"
    if counts["mismatch"] or counts["refused"]:
        return Rule("settings", station, None, "all read back", observed, "", Result.FAIL, "A setting differs from the recipe.")
    if held + len(lacking) < asked:
        return Rule("settings", station, None, "all read back", observed, "", Result.MISSING, "A setting could not be read back.")
    if not asked and facts.first_tick is None and facts.outcome != "completed":
        text = "The record holds no setting of this station."
        return Rule("settings", station, None, "all read back", None, "", Result.MISSING, text)
    if lacking:
        names = ", ".join(name.replace("_", " ") for name in dict.fromkeys(lacking))
        text = f"The station does not have: {names}. All other settings of the recipe are confirmed."
        return Rule("settings", station, None, "all read back", observed, "", Result.DEVIATION, text)
    text = "Every setting of the recipe is confirmed." if asked else "The recipe sets nothing."
    if facts.outcome == "running":  # the record broke off; the recipe may have had more
        text = "Every setting in the record is confirmed."
    return Rule("settings", station, None, "all read back", observed, "", Result.PASS, text)


def alarms_rule(facts: StationFacts, most: int, evidence: Evidence, events: Sequence[Event]) -> Rule:
    """Return the rule about the number of high and low alarms; missing evidence if the flags were never read."""
    if not tells(facts, "alarm_high"):
        return not_applicable("alarms", facts.name, None, most, "", "alarm flags")
    count = sum(event.kind in COUNTED_ALARMS and event.severity in COUNTED_SEVERITIES for event in events)
    if count > most:
        text = f"{count} alarm{'s' * (count != 1)} counted; {most} allowed."
        return Rule("alarms", facts.name, None, most, count, "", Result.FAIL, text)
    unread = [
        port for port in used_ports(facts, evidence) if not evidence.port_ledger(facts.name, port).get("alarm_high", {}).get("ok")
    ]
    if unread or not facts.ports:
        text = f"The alarm flags of port {', '.join(map(str, unread))} were never read." if unread else "No port was read."
        return Rule("alarms", facts.name, None, most, None, "", Result.MISSING, text)
    return Rule("alarms", facts.name, None, most, count, "", Result.PASS, f"{count} counted; {most} allowed.")


def used_ports(facts: StationFacts, evidence: Evidence) -> list[int]:
    """Return the station's ports, without those that never had a tool."""
    return [port for port in facts.ports if not never_had_a_tool(facts, port, evidence.port_ledger(facts.name, port))]


NO_STATE_TOLD = "Every answer lacked the digit of the state, so no state is known."


def tells(facts: StationFacts, signal: str) -> bool:
    """Whether the station reports this signal; True if the record does not list its signals."""
    return not facts.signals or signal in facts.signals


def no_limit_applies(facts: StationFacts, acceptance: Acceptance) -> bool:
    """Whether no stated limit is about a signal of this station."""
    applies = {
        "coverage_percent": True,
        "longest_gap_s": True,
        "idle_error_c": tells(facts, TEMPERATURE),
        "idle_sd_c": tells(facts, TEMPERATURE),
        "alarms_max": tells(facts, "alarm_high"),
        "verification_days": tells(facts, TEMPERATURE),
        "recovery_p95_s": has_tip(facts),
        "recovered_before_next_percent": has_tip(facts),
        "joints_against_counter_percent": has_feeder(facts),
        "reached_within_c": tells(facts, TEMPERATURE),
        "at_work_percent": tells(facts, TEMPERATURE),
    }
    return not any(applies[name] for name in LIMIT_NAMES if getattr(acceptance, name) is not None)


def has_tip(facts: StationFacts) -> bool:
    """Whether joints show in its signals: hot air and OMEGA have no tip."""
    return facts.family not in WITHOUT_TIP


def has_feeder(facts: StationFacts) -> bool:
    """Whether it counts feeds."""
    return facts.family in WITH_FEEDER


def not_applicable(name: str, station: str, port: int | None, limit: float, unit: str, what: str) -> Rule:
    """Return a rule about a signal that the station does not report."""
    text = f"The station does not report {what}; the limit does not apply."
    return Rule(name, station, port, limit, None, unit, Result.NOT_APPLICABLE, text)


def never_had_a_tool(facts: StationFacts, port: int, ledger: PortLedger) -> bool:
    """Whether every reading of the temperature reported that no tool was present."""
    temperature = ledger.get("temperature_c", {})
    return port not in facts.touched and not temperature.get("ok") and bool(temperature.get("no_tool"))


def port_rules(
    facts: StationFacts, port: int, acceptance: Acceptance, ledger: PortLedger, measure: PortMeasure | None, by: int
) -> Iterator[Rule]:
    """Yield the rules about a port, in reading order."""
    station = facts.name
    if acceptance.coverage_percent is not None:
        rule = coverage_rule(facts, port, acceptance.coverage_percent, ledger, measure)
        yield rule if by == 1 else _without_host(rule, facts, ledger)
    if acceptance.longest_gap_s is not None:
        seen = None if measure is None else measure.gap_s
        gap = f"Longest gap in {'temperature' if tells(facts, TEMPERATURE) else 'readings'}"
        rule = _at_most("longest_gap", station, port, acceptance.longest_gap_s, seen, "s", gap)
        if seen is None and _any_says_no_state(facts, ledger):
            rule = replace(rule, text=NO_STATE_TOLD)
        yield rule if by == 1 else _gap_without_host(rule, measure)
    yield from idle_rules(facts, port, acceptance, measure, by)


def heat_rules(
    facts: StationFacts, port: int, acceptance: Acceptance, evidence: Evidence, measure: PortMeasure | None, *, is_ordered: bool
) -> Iterator[Rule]:
    """Yield the rule `reached`, where the recipe sets a temperature or states such a limit."""
    asks, percent = evidence.asks.get(facts.name, Asks()), acceptance.at_work_percent
    if port not in asks.heated and all(getattr(acceptance, name) is None for name in REACHED_LIMITS):
        return
    limit = AT_WORK_PERCENT if percent is None else percent
    if not tells(facts, TEMPERATURE):
        yield not_applicable(REACHED, facts.name, port, limit, "%", "temperature")
        return
    within = WITHIN_C if acceptance.reached_within_c is None else acceptance.reached_within_c
    told = is_ordered and asks.status in ORDERS_WORK
    yield reached_rule(facts.name, port, Limit(within, limit, told), asks, None if measure is None else measure.heat)


def bare_rule(facts: StationFacts, acceptance: Acceptance) -> Iterator[Rule]:
    """Yield a note where the recipe judges figures without their bounds."""
    if is_bare(acceptance) and any(getattr(acceptance, name) is not None for name in ESTIMATED_LIMITS):
        yield Rule(CONFIDENCE, facts.name, None, BARE, None, "", Result.NOT_APPLICABLE, JUDGED_BARE)


def idle_rules(facts: StationFacts, port: int, acceptance: Acceptance, measure: PortMeasure | None, by: int) -> Iterator[Rule]:
    """Yield the rules about idle error and idle standard deviation."""
    station, (mean_bound, sd_bound) = facts.name, _bounds(measure, by)
    if by >= BOUNDS_HOLD and tells(facts, TEMPERATURE) and (measure is None or measure.idle.mean_c is None):
        for name, limit in (("idle_error", acceptance.idle_error_c), ("idle_sd", acceptance.idle_sd_c)):
            if limit is not None:
                yield Rule(name, station, port, limit, None, "°C", Result.MISSING, NOT_IDLE)
        return
    if not tells(facts, TEMPERATURE):
        for name, limit in (("idle_error", acceptance.idle_error_c), ("idle_sd", acceptance.idle_sd_c)):
            if limit is not None:
                yield not_applicable(name, station, port, limit, "°C", "temperature")
        return
    if acceptance.idle_error_c is not None:
        mean = None if measure is None else measure.idle.mean_c
        rule = idle_error_rule(station, port, acceptance.idle_error_c, mean)
        yield bounded(rule, mean_bound, bare=is_bare(acceptance))
    if acceptance.idle_sd_c is not None:
        spread = None if measure is None else measure.idle.sd_c
        rule = _at_most("idle_sd", station, port, acceptance.idle_sd_c, spread, "°C", "Idle standard deviation")
        yield bounded(rule, sd_bound, bare=is_bare(acceptance))


def _bounds(measure: PortMeasure | None, by: int) -> tuple[Bound | str | None, Bound | str | None]:
    """Return the bounds of idle error and standard deviation: a sentence why there is none, or None where the rules need none."""
    if measure is None:
        return None, None
    if by < BOUNDS_HOLD:
        return measure.idle.bounds or (None, None)
    found = measure.idle.known()
    return (found, found) if isinstance(found, str) else (found.mean, found.sd)


def bounded(rule: Rule, bound: Bound | str | None, *, bare: bool = False) -> Rule:
    """Return the rule with the bound of its figure, or with the sentence why there is none.

    The limit is kept if figure and bound keep it. If only the figure keeps it, or without a bound, evidence is missing, unless
    figures are judged `bare`. A `bound` of None belongs to rules that need none.
    """
    if bound is None or rule.result is Result.MISSING:
        return rule
    if isinstance(bound, str):
        return rule if bare or rule.result is Result.FAIL else replace(rule, result=Result.MISSING, text=f"{rule.text} {bound}")
    assert isinstance(rule.limit, int | float)
    if bare or rule.result is Result.FAIL or bound.keeps(rule.limit):
        return replace(rule, bound=bound)
    text = f"{rule.text} The 95 % bound is {_shown(_furthest(bound))} {rule.unit}: a longer record is needed."
    return replace(rule, bound=bound, result=Result.MISSING, text=text)


def _furthest(bound: Bound) -> float:
    return bound.high if bound.low is None else max(bound.low, bound.high, key=abs)


def coverage_rule(facts: StationFacts, port: int, least: float, ledger: PortLedger, measure: PortMeasure | None) -> Rule:
    """Return the rule about readings of temperature or state obtained, in per cent of those due."""
    station, what = facts.name, _what_is_read(facts)
    counts = [one for signal in judged_signals(facts) if not says_no_state(one := ledger.get(signal, {}))]
    due, counted = (sum(one.get(word, 0) for one in counts) for word in ("due", "ok"))
    there = 0 if measure is None else measure.readings
    if not due:
        why = f"{what}: no reading was due."
        if _any_says_no_state(facts, ledger):
            why = NO_STATE_TOLD
        return Rule("coverage", station, port, least, None, "%", Result.MISSING, why)
    if there != counted:
        text = f"{what}: the accounting has {counted} readings, the samples {there}."
        return Rule("coverage", station, port, least, None, "%", Result.MISSING, text)
    percent = 100 * there / due
    result = Result.PASS if percent >= least else Result.FAIL
    text = f"{what} coverage {_shown(_floor(percent))} % ({there} of {due}), required {_shown(least)} %."
    return Rule("coverage", station, port, least, percent, "%", result, text)


def _any_says_no_state(facts: StationFacts, ledger: PortLedger) -> bool:
    return any(says_no_state(ledger.get(signal, {})) for signal in judged_signals(facts))


def says_no_state(counts: Mapping[str, int]) -> bool:
    """Whether every answer lacked a state: an OMEGA that answers `a` alone (003, 11.3.1). Such a signal is not judged."""
    return bool(counts.get("no_digit")) and not counts.get("ok")


def _without_host(rule: Rule, facts: StationFacts, ledger: PortLedger) -> Rule:
    """Judge coverage with the run's resolution. Readings that the computer skipped are missing evidence and break no limit."""
    if not isinstance(rule.observed, float) or not isinstance(rule.limit, int | float):
        return rule
    counts = [one for signal in judged_signals(facts) if not says_no_state(one := ledger.get(signal, {}))]
    due, there = (sum(one.get(word, 0) for one in counts) for word in ("due", "ok"))
    skipped = sum(skipped_by_host(facts, one.get(SKIPPED, 0)) for one in counts)
    allowed, few = allowed_misses(due, rule.limit), due < RESOLVES
    if due - there <= (0 if few and rule.observed < rule.limit else allowed):
        kept = "" if rule.observed >= rule.limit else f" One reading is {_shown(100 / due)} %: within the resolution."
        return replace(rule, result=Result.PASS, text=f"{rule.text}{kept}")
    text = f"{rule.text} The computer was busy and skipped {skipped} of them." if skipped else rule.text
    if due - there - skipped > allowed:
        return replace(rule, result=Result.FAIL, text=text)
    if due - there <= allowed:
        return replace(rule, result=Result.MISSING, text=f"{text} {due} readings are too few to decide.")
    text = f"{text} Their values are not known; less load on the computer, or a lower rate, helps."
    return replace(rule, result=Result.MISSING, text=text)


def skipped_by_host(facts: StationFacts, skipped: int) -> int:
    """Return how many of a signal's skipped readings the computer caused; all of them if the record does not say."""
    return skipped if facts.skipped_by_host is None else min(skipped, facts.skipped_by_host + facts.skipped)


def _gap_without_host(rule: Rule, measure: PortMeasure | None) -> Rule:
    """Judge the longest gap. If only readings that the computer skipped break the limit, evidence is missing."""
    others = None if measure is None else measure.gap_of_others_s
    if rule.result is not Result.FAIL or others is None or not isinstance(rule.limit, int | float) or others > rule.limit:
        return rule
    text = f"{rule.text} The computer was busy and skipped readings; without these it is {_shown(others)} s."
    return replace(rule, result=Result.MISSING, text=text)


def _what_is_read(facts: StationFacts) -> str:
    if not tells(facts, TEMPERATURE):
        return "State"
    return "Air temperature" if "external_c" in facts.signals else "Tip temperature"


def idle_error_rule(station: str, port: int, most: float, mean: float | None) -> Rule:
    """Return the rule about the mean difference of the idle tip from its setpoint, in either direction."""
    if mean is None:
        return _not_idle("idle_error", station, port, most)
    result = Result.PASS if abs(mean) <= most else Result.FAIL
    text = f"Idle error {round(mean, 1) + 0.0:+.1f} °C (mean), allowed ±{_shown(most)} °C."
    return Rule("idle_error", station, port, most, mean, "°C", result, text)


def _at_most(name: str, station: str, port: int, most: float, seen: float | None, unit: str, what: str) -> Rule:
    if seen is None and name == "idle_sd":
        return _not_idle(name, station, port, most)
    if seen is None:
        return Rule(name, station, port, most, None, unit, Result.MISSING, "Nothing was recorded.")
    result = Result.PASS if seen <= most else Result.FAIL
    return Rule(name, station, port, most, seen, unit, result, f"{what} {_shown(seen)} {unit}, allowed {_shown(most)} {unit}.")


def _not_idle(name: str, station: str, port: int, most: float) -> Rule:
    return Rule(name, station, port, most, None, "°C", Result.MISSING, NOT_SEEN_IDLE)


# Deviations break no limit but keep a run from a plain ACCEPT. Every event that is an error is judged by a rule or listed here.

NOT_AS_PLANNED = frozenset(
    {
        "alarm.unconfirmed",  # a flag without a matching temperature
        "alarm.unknown",  # a lost answer: there may have been a flag
        "clock.step",
        "host.suspended",
        "link.flooded",
        "link.lost",
        "safety.no_cooldown",  # allow_no_cooldown was used
        "setting.changed",
        "tool.changed",
    }
)
"""Kinds of events that are deviations from severity warning on."""

ENDINGS = ("station.completed", "station.stopped", "station.refused", "station.gone", "station.failed")
AT_THE_START = ("station.not_started", "station.left_out")
JUDGED = frozenset({*COUNTED_ALARMS, *ENDINGS, *AT_THE_START, "run.start", "run.end"})
SEVERE = ("error", "critical")


def deviations(events: Sequence[Event]) -> Iterator[Rule]:
    """Yield a rule for each kind of deviation on each port, with its number and the first event's text."""
    found: dict[tuple[str, str | None, int | None], list[Event]] = {}
    for event in events:
        if _deviates(event):
            found.setdefault((event.kind, event.station, event.port), []).append(event)
    for (kind, station, port), these in found.items():
        yield Rule(kind, station, port, None, len(these), "", Result.DEVIATION, these[0].text)


def _deviates(event: Event) -> bool:
    if event.kind in JUDGED or event.severity == "info":
        return False
    return event.kind in NOT_AS_PLANNED or event.severity in SEVERE


def unused_ports(facts: StationFacts, evidence: Evidence) -> Iterator[Rule]:
    """Yield a rule for each port that never had a tool; it is not judged."""
    for port in facts.ports:
        if never_had_a_tool(facts, port, evidence.port_ledger(facts.name, port)):
            text = "No tool in this port during the whole run; not judged."
            yield Rule("no_tool", facts.name, port, None, None, "", Result.DEVIATION, text)


NO_LIMITS = "Its recipe states no limits; it is recorded and not judged."


def not_judged(facts: StationFacts, text: str = NO_LIMITS) -> Rule:
    """A station whose recipe states no limits, beside others that do, or none that is about it."""
    return Rule("no_acceptance", facts.name, None, None, None, "", Result.DEVIATION, text)
