"""Whether a run came to the number of units or joints that it was to end with; where two were wanted, either is enough."""

from __future__ import annotations

from collections.abc import Iterator

from jbclog.analysis.verdict.evidence import Evidence
from jbclog.analysis.verdict.rule import Result, Rule
from jbclog.core.rows import Goal


def goal_rules(evidence: Evidence) -> Iterator[Rule]:
    """A line for each number. A run that fell short is whole in what it recorded, and not as planned."""
    is_met = any(goal.is_met for goal in evidence.goals)
    for goal in evidence.goals:
        yield Rule(f"goal_{goal.what}", None, None, goal.wanted, goal.reached, goal.what, _result(goal, is_met), goal.text)


def _result(goal: Goal, is_met: bool) -> Result:
    if goal.is_met:
        return Result.PASS
    if is_met:
        return Result.NOT_APPLICABLE
    return Result.MISSING if goal.reached is None else Result.DEVIATION
