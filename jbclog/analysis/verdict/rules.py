"""The rules on a run and its stations, and deviations: not as planned, within limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from time import gmtime, strftime
from typing import TYPE_CHECKING, Final

from jbclog.analysis.port_data import TEMPERATURE, has_tip
from jbclog.analysis.verdict.acceptance import (
    BARE,
    ESTIMATED_LIMITS,
    LIMIT_NAMES,
    is_bare,
)
from jbclog.analysis.verdict.evidence import Event, Evidence, Outcomes, PortLedger
from jbclog.analysis.verdict.rule import Asked, Judged, Result, Rule
from jbclog.core.goal import Goal
from jbclog.core.rows import StationFacts
from jbclog.core.states import StationOutcome
from jbclog.core.text import count_text

if TYPE_CHECKING:  # importing pydantic for a verdict would be slow
    from jbclog.config.recipe_sections import Acceptance

COUNTED_ALARMS = ("alarm.high", "alarm.low")
WITH_FEEDER = ("ale",)

RUN_ENDINGS = {
    "success": (Result.PASS, "The record runs from start to end."),
    "aborted": (
        Result.DEVIATION,
        "Ended before its stated end; the record until then is complete.",
    ),
    "failed": (Result.DEVIATION, "Ended with an error; the record until then is complete."),
    "lost": (
        Result.MISSING,
        "A crash ended the run: the last second before it is missing from the record.",
    ),
}
STATION_ENDINGS: Final[dict[str, tuple[Result, str]]] = {
    StationOutcome.COMPLETED: (Result.PASS, "Recorded to the end."),
    StationOutcome.STOPPED: (Result.FAIL, "Stopped: a setting was changed during the run."),
    StationOutcome.REFUSED: (Result.MISSING, "Refused before sampling began."),
    StationOutcome.GONE: (Result.MISSING, "No answer at the end."),
    StationOutcome.NOT_STARTED: (Result.MISSING, "Ready, but not started."),
    StationOutcome.LEFT_OUT: (Result.DEVIATION, "The run started without it, as allowed."),
    StationOutcome.FAILED: (Result.MISSING, "Its recording failed."),
    StationOutcome.RUNNING: (Result.MISSING, "The record broke off while it was recorded."),
}
CONFIDENCE = "confidence"
JUDGED_BARE = 'The recipe judges figures without their bounds (confidence = "none").'
NEVER_ANSWERED = "The station never answered."
NO_LIMITS = "Its recipe states no limits; it is recorded and not judged."

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
"""Events that are deviations from severity warning on: they break no limit but prevent a plain
ACCEPT.
"""

NOT_SAFE: Final = "safety.not_safe"
OUTAGES: Final = frozenset({"link.flooded", "link.lost", "robot.off"})
BACK: Final = frozenset({"link.back", "robot.on"})
"""Events at the end of an outage; their value is its length in seconds."""

ENDINGS = (
    "station.completed",
    "station.stopped",
    "station.refused",
    "station.gone",
    "station.failed",
)
AT_THE_START = ("station.not_started", "station.left_out")
JUDGED = frozenset({*COUNTED_ALARMS, *ENDINGS, *AT_THE_START, "run.start", "run.end"})
SEVERE = ("error", "critical")
"""Events of these severities are always judged, by a rule or as a deviation."""


def goal_rules(evidence: Evidence) -> Iterator[Rule]:
    """Yield a rule for each goal (units, joints); one of two is enough. Too few is a deviation."""
    is_met = any(goal.is_met for goal in evidence.goals)
    for goal in evidence.goals:
        yield Rule(
            f"goal_{goal.what}",
            None,
            None,
            goal.wanted,
            goal.reached,
            goal.what,
            _result(goal, is_met),
            goal.text,
        )


def _result(goal: Goal, is_met: bool) -> Result:
    if goal.is_met:
        return Result.PASS
    if is_met:
        return Result.NOT_APPLICABLE
    return Result.MISSING if goal.reached is None else Result.DEVIATION


def record_rule(evidence: Evidence) -> Rule:
    """Return the rule that the record covers the whole run."""
    if evidence.lost is not None:
        return Rule(
            "record", None, None, "whole", evidence.exit_status, "", Result.MISSING, evidence.lost
        )
    unknown = (Result.MISSING, "How the run ended is not known.")
    result, text = RUN_ENDINGS.get(evidence.exit_status or "", unknown)
    return Rule("record", None, None, "whole", evidence.exit_status, "", result, text)


def station_rules(
    facts: StationFacts,
    acceptance: Acceptance,
    evidence: Evidence,
    events: Sequence[Event],
    outcomes: Outcomes,
) -> Iterator[Rule]:
    """Yield the rules on a station as a whole."""
    result, text = STATION_ENDINGS.get(
        facts.outcome, (Result.MISSING, "How it ended is not known.")
    )
    if facts.outcome == StationOutcome.GONE and facts.first_tick is None:
        text = NEVER_ANSWERED
    reason = facts.reason.removeprefix(f"{facts.name}: ").rstrip(".")
    if reason and result is not Result.PASS:
        text = f"{text} {reason[:1].upper()}{reason[1:]}."
    seen = "cut off" if facts.outcome == StationOutcome.RUNNING else facts.outcome
    yield Rule("station", facts.name, None, StationOutcome.COMPLETED, seen, "", result, text)
    if facts.outcome == StationOutcome.LEFT_OUT:
        return
    yield settings_rule(facts, outcomes)
    if acceptance.alarms_max is not None:
        yield alarms_rule(facts, acceptance.alarms_max, evidence, events)


def bare_rule(facts: StationFacts, acceptance: Acceptance) -> Iterator[Rule]:
    """Yield a note if the recipe judges figures without their bounds."""
    if is_bare(acceptance) and any(
        getattr(acceptance, name) is not None for name in ESTIMATED_LIMITS
    ):
        yield Rule(CONFIDENCE, facts.name, None, BARE, None, "", Result.NOT_APPLICABLE, JUDGED_BARE)


def settings_rule(facts: StationFacts, outcomes: Outcomes) -> Rule:
    """Return the rule that every setting of the recipe for this family is confirmed."""
    counts, lacking = outcomes.counts, outcomes.lacking
    stated, confirmed = counts.total() + len(lacking), counts["confirmed"] + counts["unchanged"]
    observed: str | None = f"{confirmed} of {stated}"
    if counts["mismatch"] or counts["refused"]:
        result, text = Result.FAIL, "A setting differs from the recipe."
    elif confirmed + len(lacking) < stated:
        result, text = Result.MISSING, "A setting could not be read back."
    elif not stated and facts.first_tick is None and facts.outcome != StationOutcome.COMPLETED:
        observed = None
        result = Result.MISSING
        text = "The record holds no setting of this station."
    elif lacking:
        names = ", ".join(name.replace("_", " ") for name in dict.fromkeys(lacking))
        result = Result.DEVIATION
        text = (
            f"The station does not have: {names}. All other settings of the recipe are confirmed."
        )
    elif facts.outcome == StationOutcome.RUNNING:
        # the record broke off; the recipe may have had more
        result, text = Result.PASS, "Every setting in the record is confirmed."
    else:
        result = Result.PASS
        text = "Every setting of the recipe is confirmed." if stated else "The recipe sets nothing."
    return Rule("settings", facts.name, None, "all read back", observed, "", result, text)


def alarms_rule(
    facts: StationFacts, most: int, evidence: Evidence, events: Sequence[Event]
) -> Rule:
    """Return the rule on the number of alarms; missing evidence if the flags were never read."""
    asked = Asked("alarms", facts.name, None, most, "")
    if not reports(facts, "alarm_high"):
        return asked.not_applicable("alarm flags")
    return asked.rule(_judge_alarms(facts, most, evidence, events))


def _judge_alarms(
    facts: StationFacts, most: int, evidence: Evidence, events: Sequence[Event]
) -> Judged:
    count = sum(event.kind in COUNTED_ALARMS and event.severity in SEVERE for event in events)
    if count > most:
        text = f"{count_text(count, 'alarm')} counted; {most} allowed."
        return Judged(count, Result.FAIL, text)
    unread = [
        port
        for port in used_ports(facts, evidence)
        if not evidence.port_ledger(facts.name, port).get("alarm_high", {}).get("ok")
    ]
    if unread:
        ports = ", ".join(map(str, unread))
        return Judged(None, Result.MISSING, f"The alarm flags of port {ports} were never read.")
    if not facts.ports:
        return Judged(None, Result.MISSING, "No port was read.")
    return Judged(count, Result.PASS, f"{count} counted; {most} allowed.")


def used_ports(facts: StationFacts, evidence: Evidence) -> list[int]:
    """Return the station's ports, without those that never had a tool."""
    return [
        port
        for port in facts.ports
        if not never_had_a_tool(facts, port, evidence.port_ledger(facts.name, port))
    ]


def reports(facts: StationFacts, signal: str) -> bool:
    """Whether the station reports this signal; True if the record does not list its signals."""
    return not facts.signals or signal in facts.signals


def no_limit_applies(facts: StationFacts, acceptance: Acceptance) -> bool:
    """Whether no stated limit applies to a signal of this station."""
    applies = {
        "coverage_percent": True,
        "longest_gap_s": True,
        "idle_error_c": reports(facts, TEMPERATURE),
        "idle_sd_c": reports(facts, TEMPERATURE),
        "alarms_max": reports(facts, "alarm_high"),
        "verification_days": reports(facts, TEMPERATURE),
        "recovery_p95_s": has_tip(facts),
        "recovered_before_next_percent": has_tip(facts),
        "joints_against_counter_percent": has_feeder(facts),
        "reached_within_c": reports(facts, TEMPERATURE),
        "at_work_percent": reports(facts, TEMPERATURE),
    }
    return not any(applies[name] for name in LIMIT_NAMES if getattr(acceptance, name) is not None)


def has_feeder(facts: StationFacts) -> bool:
    """Whether the station counts dispensing cycles."""
    return facts.family in WITH_FEEDER


def never_had_a_tool(facts: StationFacts, port: int, ledger: PortLedger) -> bool:
    """Whether every reading of the temperature reported that no tool was present."""
    temperature = ledger.get("temperature_c", {})
    return (
        port not in facts.touched and not temperature.get("ok") and bool(temperature.get("no_tool"))
    )


def deviations(events: Sequence[Event]) -> Iterator[Rule]:
    """Yield a rule for each kind of deviation on each port: its number, the first event's text; of
    outages also when, how long, and whether the station came back.
    """
    found: dict[tuple[str, str | None, int | None], list[Event]] = {}
    of_links: dict[str | None, list[Event]] = {}
    for event in events:
        if _deviates(event):
            found.setdefault((event.kind, event.station, event.port), []).append(event)
        if event.kind in OUTAGES or event.kind in BACK:
            of_links.setdefault(event.station, []).append(event)
    for (kind, station, port), same in found.items():
        text = same[0].text
        count = len(same)
        if kind in OUTAGES:
            text = f"{text} {_outages_text(same, of_links[station])}"
        if kind == NOT_SAFE:  # each says how often the tool has been ordered by then
            text = same[-1].text
            count = 1
        yield Rule(kind, station, port, None, count, "", Result.DEVIATION, text)


def _outages_text(outages: Sequence[Event], of_link: Sequence[Event]) -> str:
    """Return when the first of these outages began, and whether the station came back: the text of
    its event, in the present tense, would be read as still true.
    """
    kind, is_away, back = outages[0].kind, False, list[Event]()
    for event in of_link:
        if event.kind == kind:
            is_away = True
        elif event.kind in BACK and is_away:
            is_away = False
            back.append(event)
    began = "" if len(outages) == 1 else " first"
    if outages[0].time is not None:
        began += strftime(" at %Y-%m-%d %H:%M:%S UTC", gmtime(outages[0].time // 1_000_000))
    return f"This was{began}; the station was {_back_text(back, is_away=is_away)}."


def _back_text(back: Sequence[Event], *, is_away: bool) -> str:
    if not back:
        return "not back when sampling ended"
    lengths = [event.value for event in back if event.value is not None]
    text = "back"
    if len(lengths) == len(back):
        text += f" after {sum(lengths):.1f} s{' in all' if len(back) > 1 else ''}"
    return f"{text}, but not when sampling ended" if is_away else text


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


def not_judged(facts: StationFacts, text: str = NO_LIMITS) -> Rule:
    """Return a rule for a station that is not judged, because no limit of its recipe applies to
    it.
    """
    return Rule("no_acceptance", facts.name, None, None, None, "", Result.DEVIATION, text)
