"""What broke no limit and was still not as planned: it keeps a run from a plain ACCEPT, by name.

Every event that is an error is either judged by a rule or named here; nothing severe passes unmentioned.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from jbclog.analysis.verdict.evidence import Evidence
from jbclog.analysis.verdict.rule import Result, Rule
from jbclog.analysis.verdict.rules import COUNTED_ALARMS, never_had_a_tool
from jbclog.analysis.verdict.tables import Event
from jbclog.core.rows import StationFacts

NOT_AS_PLANNED = frozenset(
    {
        "alarm.unconfirmed",  # a flag that no temperature bore out
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
"""Kinds that are deviations at any severity from warning on."""

ENDINGS = ("station.completed", "station.stopped", "station.refused", "station.gone", "station.failed")
AT_THE_START = ("station.not_started", "station.left_out")
JUDGED = frozenset({*COUNTED_ALARMS, *ENDINGS, *AT_THE_START, "run.start", "run.end"})
SEVERE = ("error", "critical")


def deviations(events: Sequence[Event]) -> Iterator[Rule]:
    """One line for each kind of deviation on each port, with how often it happened and its first sentence."""
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
    """Ports that had no tool from start to end: recorded as such, and not judged."""
    for port in facts.ports:
        if never_had_a_tool(facts, port, evidence.port_ledger(facts.name, port)):
            text = "There was no tool in the port; it was not put to work and is not judged."
            yield Rule("no_tool", facts.name, port, None, None, "", Result.DEVIATION, text)


NO_LIMITS = "Its recipe states no limits; it is recorded and not judged."


def not_judged(facts: StationFacts, text: str = NO_LIMITS) -> Rule:
    """A station whose recipe states no limits, beside others that do, or none that is about it."""
    return Rule("no_acceptance", facts.name, None, None, None, "", Result.DEVIATION, text)
