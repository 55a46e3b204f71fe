"""Is it another station that answers under this name now? By what it says of itself, by its counters, or because somebody told."""

from __future__ import annotations

from collections.abc import Sequence

from jbclog.maintenance.counter_totals.observed import Identity
from jbclog.maintenance.counter_totals.span import Span
from jbclog.maintenance.counter_totals.units import SURELY_ITS_OWN_H


def replaced(before: Identity | None, now: Identity | None, spans: Sequence[Span], stated: bool) -> str | None:
    """The rule that says so; None where it is the same station."""
    if stated:
        return "stated_replaced"
    if before is not None and now is not None:
        if _differ(before.model, now.model):
            return "other_model"
        if _differ(before.uid, now.uid):
            return "other_uid"
        if _differ(before.software, now.software) and not _goes_on(spans):
            return "other_software"
    strange = [one for one in spans if one.trait.is_time and one.fell and one.is_impossible]
    return "counters_of_another" if len(strange) > 1 else None


def _differ(before: str | None, now: str | None) -> bool:
    return before is not None and now is not None and before != now


def _goes_on(spans: Sequence[Span]) -> bool:
    """Whether every counter went on or rolled over, some hours among them that no other station would happen to have."""
    hours = [one for one in spans if one.trait.is_time and one.before.shown.low >= SURELY_ITS_OWN_H]
    return bool(hours) and all(one.can_go_on or bool(one.turns(one.usual)) for one in spans)
