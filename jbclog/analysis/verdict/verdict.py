"""The verdict of a run from all its rules.

One broken limit is REJECT. Without one, missing evidence is INCONCLUSIVE, which is never accepted.
Without either, anything that was not as planned makes it ACCEPT WITH DEVIATIONS. A run whose
recipes state no limit is NOT JUDGED.

The observed figure decides whether a limit is broken. To keep it, the figure and its 95 % bound, if
it has one (`bounds.py`), must both keep it; if only the figure does, evidence is missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from jbclog.analysis.port_data import TEMPERATURE
from jbclog.analysis.verdict.acceptance import asks_for_anything
from jbclog.analysis.verdict.evidence import (
    Event,
    Evidence,
    Outcomes,
    read_adjustments,
    read_events,
    read_ordered,
    read_outcomes,
)
from jbclog.analysis.verdict.joint_rules import joint_rules
from jbclog.analysis.verdict.port_rules import heat_rules, port_rules, verification_rule
from jbclog.analysis.verdict.rule import Result, Rule
from jbclog.analysis.verdict.rules import (
    bare_rule,
    deviations,
    goal_rules,
    no_limit_applies,
    not_judged,
    record_rule,
    reports,
    station_rules,
    unused_ports,
    used_ports,
)
from jbclog.analysis.verdict.samples import Measures, Measuring, measure
from jbclog.core.rows import StationFacts
from jbclog.core.states import StationOutcome

if TYPE_CHECKING:  # importing pydantic for a verdict would be slow
    from jbclog.config.recipe_sections import Acceptance


class Verdict(StrEnum):
    ACCEPT = "ACCEPT"
    WITH_DEVIATIONS = "ACCEPT WITH DEVIATIONS"
    REJECT = "REJECT"
    INCONCLUSIVE = "INCONCLUSIVE"
    NOT_JUDGED = "NOT JUDGED"


@dataclass(frozen=True, slots=True)
class Judgement:
    """A verdict and the rules behind it."""

    verdict: Verdict
    rules: tuple[Rule, ...]

    def rules_as_dicts(self) -> list[dict[str, object]]:
        """Return the rules as in `manifest.verdict_rules`."""
        return [rule.as_dict() for rule in self.rules]


def judge(
    evidence: Evidence,
    acceptance: Mapping[str, Acceptance | None],
    measuring: Measuring = measure,
) -> Judgement:
    """Judge a sealed run.

    `acceptance`: station -> the limits of its recipe, None if it states none. `measuring` reads the
    samples.
    """
    limits = {
        name: stated
        for name, stated in acceptance.items()
        if stated is not None and asks_for_anything(stated)
    }
    if not limits:
        return Judgement(Verdict.NOT_JUDGED, ())
    rules = tuple(_all_rules(evidence, limits, measuring))
    return Judgement(verdict_of(rules), rules)


def verdict_of(rules: Sequence[Rule]) -> Verdict:
    """Return the verdict of a list of rules; an empty list is missing evidence."""
    results = {rule.result for rule in rules}
    if Result.FAIL in results:
        return Verdict.REJECT
    if Result.MISSING in results or Result.PASS not in results:
        return Verdict.INCONCLUSIVE
    return Verdict.WITH_DEVIATIONS if Result.DEVIATION in results else Verdict.ACCEPT


def _all_rules(
    evidence: Evidence, limits: Mapping[str, Acceptance], measuring: Measuring
) -> Iterator[Rule]:
    judged = [facts for facts in evidence.stations if facts.name in limits]
    within = {
        name: one.reached_within_c
        for name, one in limits.items()
        if one.reached_within_c is not None
    }
    measures = measuring(evidence.folder, {facts.name: facts for facts in judged}, within)
    events, settings = read_events(evidence.folder), _Settings.of(evidence, limits)
    yield record_rule(evidence)
    yield from goal_rules(evidence)
    yield from (_no_facts(name) for name in limits if name not in {facts.name for facts in judged})
    for facts in judged:
        own = [event for event in events if event.station == facts.name]
        yield from _station(
            facts,
            limits[facts.name],
            evidence,
            own,
            settings,
            measures,
        )
    yield from (not_judged(facts) for facts in evidence.stations if facts.name not in limits)
    yield from deviations(
        [event for event in events if event.station is None or event.station in limits]
    )


@dataclass(frozen=True, slots=True)
class _Settings:
    """The table of settings of all stations, read once."""

    outcomes: Mapping[str, Outcomes]
    ordered: set[tuple[str, int]]
    adjustments: Mapping[tuple[str, int], float]

    @classmethod
    def of(cls, evidence: Evidence, limits: Mapping[str, Acceptance]) -> _Settings:
        folder = evidence.folder
        verified = any(one.verification_days is not None for one in limits.values())
        return cls(
            read_outcomes(folder),
            read_ordered(folder),
            read_adjustments(folder) if verified else {},
        )


def _station(
    facts: StationFacts,
    acceptance: Acceptance,
    evidence: Evidence,
    events: Sequence[Event],
    settings: _Settings,
    measures: Measures,
) -> Iterator[Rule]:
    outcomes = settings.outcomes.get(facts.name, Outcomes())
    yield from station_rules(facts, acceptance, evidence, events, outcomes)
    if facts.outcome == StationOutcome.LEFT_OUT:
        return
    yield from bare_rule(facts, acceptance)
    ports = used_ports(facts, evidence)
    if not ports:
        yield Rule(
            "ports",
            facts.name,
            None,
            "one at least",
            0,
            "",
            Result.MISSING,
            "No port was recorded with a tool.",
        )
    for port in ports:
        place = facts.name, port
        seen = measures.get(place)
        yield from port_rules(facts, port, acceptance, evidence.port_ledger(facts.name, port), seen)
        yield from heat_rules(
            facts, port, acceptance, evidence, seen, is_ordered=place in settings.ordered
        )
        if acceptance.verification_days is not None and reports(facts, TEMPERATURE):
            adjusted = settings.adjustments.get(place)
            yield verification_rule(facts, port, acceptance.verification_days, evidence, adjusted)
        yield from joint_rules(facts, port, acceptance, evidence)
    if no_limit_applies(facts, acceptance):
        yield not_judged(facts, "None of its recipe's limits applies to it; recorded, not judged.")
    yield from unused_ports(facts, evidence)


def _no_facts(station: str) -> Rule:
    return Rule(
        "station",
        station,
        None,
        StationOutcome.COMPLETED,
        None,
        "",
        Result.MISSING,
        "The record has nothing of this station.",
    )
