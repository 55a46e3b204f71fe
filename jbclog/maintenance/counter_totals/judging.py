"""Events of a station between two audits, and the resulting advance of each counter.

A reset is assumed to set every counter of a port to zero. A counter that fell and cannot have
rolled over proves one; a counter that shows more than could be counted since the last look rules it
out. Without either, the advance is bounded by both cases.

All counters of a station are judged together: if one unit cannot have shown all of them, it may
have been exchanged, and only the elapsed time bounds each counter.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from itertools import groupby
from typing import Final

from jbclog.maintenance.counter_totals.advance import Ratios, by_companion, counted_on
from jbclog.maintenance.counter_totals.judgement import Judged, loose, since_zero
from jbclog.maintenance.counter_totals.observed import DRIFT, Identity
from jbclog.maintenance.counter_totals.span import Interval, Span
from jbclog.maintenance.counter_totals.totals import DifferenceKind, Join

# -- units -----------------------------------------------------------------------------------------
# Whether one unit can have shown all readings of a station, or was exchanged without a record.
#
# Another unit can show anything, so an exchange is considered only where the unit seen before does
# not explain the readings. No reading reveals an exchange that looks like a continued count.

SURELY_ITS_OWN_H: Final = 24.0  # two units do not agree in more hours by chance
ENOUGH: Final = 2  # hour counters


class Unit(Enum):
    """Which unit was read."""

    SAME = "same"
    EITHER = "either"  # the same one after a reset, or another one that was hardly used
    OTHER = "other"


def unit_of(by_port: Mapping[int, Sequence[Span]], stated: Collection[int]) -> Unit:
    """Return which unit was read, by each port's spans; `stated`: ports with a recorded reset."""
    odd = [port for port, group in by_port.items() if not all(map(is_ordinary, group))]
    if any(not all(one.can_be_reset for one in by_port[port]) for port in odd):
        return Unit.OTHER
    if all(port in stated for port in odd) or any(
        _is_its_own(group) for port, group in by_port.items() if port not in odd
    ):
        return Unit.SAME
    return Unit.EITHER


def is_ordinary(span: Span) -> bool:
    """Whether a continued count, roll-overs included, explains a span."""
    return span.can_continue or bool(span.roll_overs(span.most))


def _is_its_own(group: Sequence[Span]) -> bool:
    """Whether a port shows hours that another unit would not have by chance: then a reset of
    another port is this station's.
    """
    hours = [one for one in group if one.trait.is_time and one.can_continue]
    return (
        sum(one.before.shown.low >= SURELY_ITS_OWN_H and not one.can_be_reset for one in hours)
        >= ENOUGH
    )


# -- replacement -----------------------------------------------------------------------------------
# Whether another station answers under this name now: by its identity, its counters, or a recorded
# replacement.


def replaced(
    before: Identity | None, now: Identity | None, spans: Sequence[Span], stated: bool
) -> str | None:
    """Return the rule by which the station was replaced; None for the same station."""
    if stated:
        return "stated_replaced"
    if before is not None and now is not None:
        if _differ(before.model, now.model):
            return "other_model"
        if _differ(before.uid, now.uid):
            return "other_uid"
        if _differ(before.software, now.software) and not _continue(spans):
            return "other_software"
    strange = [one for one in spans if one.trait.is_time and one.fell and one.is_impossible]
    return "counters_of_another" if len(strange) > 1 else None


def _differ(before: str | None, now: str | None) -> bool:
    return before is not None and now is not None and before != now


def _continue(spans: Sequence[Span]) -> bool:
    """Whether every counter continues or rolled over, with hours among them that no other station
    would have by chance.
    """
    hours = [one for one in spans if one.trait.is_time and one.before.shown.low >= SURELY_ITS_OWN_H]
    return bool(hours) and all(one.can_continue or bool(one.roll_overs(one.usual)) for one in spans)


# -- a look ----------------------------------------------------------------------------------------


class Reset(Enum):
    """Whether a port was reset between two looks."""

    NO = "no"
    MAYBE = "maybe"
    YES = "yes"


@dataclass(slots=True)
class Resets:
    """Known resets.

    - `stated`: port (0: all) -> hours from the look before to a recorded reset
    - `found`: port -> the last look that found a reset, and whether it is certain
    - `other`: the last look before which the unit may have been exchanged
    """

    stated: Mapping[int, float] = field(default_factory=dict)
    found: dict[int, tuple[int, Reset]] = field(default_factory=dict)
    other: int = -1

    def stated_h(self, port: int) -> float | None:
        return self.stated.get(port, self.stated.get(0))

    def across(self, span: Span) -> Reset:
        """Return the reset found by a look within the span that did not read this counter."""
        look, reset = self.found.get(span.port, (-1, Reset.NO))
        return reset if look > span.before.look else Reset.NO


def judge(spans: Sequence[Span], look: int, resets: Resets, ratios: Ratios) -> list[Judged]:
    """Judge all counters of a station at one look; adds the resets found to `resets`."""
    untimed = [
        loose(one, "clock_ran_back", Interval(0.0, math.inf))
        for one in spans
        if math.isinf(one.elapsed_h)
    ]
    timed = [one for one in spans if not math.isinf(one.elapsed_h)]
    across_exchange = [
        _across_another(one, resets.across(one)) for one in timed if one.before.look < resets.other
    ]
    of_unit = [one for one in timed if one.before.look >= resets.other]
    across_reset = [one for one in of_unit if resets.across(one) is not Reset.NO]
    fresh = sorted(
        (one for one in of_unit if resets.across(one) is Reset.NO), key=lambda one: one.port
    )
    by_port = {port: list(group) for port, group in groupby(fresh, key=lambda one: one.port)}
    unit = _unit(by_port, across_reset, resets)
    found = [_across(one, resets.across(one)) for one in across_reset] + _at_look(
        by_port, look, resets, ratios
    )
    if unit is not Unit.SAME:
        resets.other = look
        found = [_or_other(one, unit) for one in found]
    return untimed + across_exchange + found


def judge_doubted(spans: Sequence[Span], look: int, resets: Resets) -> list[Judged]:
    """Judge all counters at a look before which the unit may have been exchanged."""
    resets.other = look
    return [_beside_another(one) for one in spans]


def _at_look(
    by_port: Mapping[int, Sequence[Span]], look: int, resets: Resets, ratios: Ratios
) -> list[Judged]:
    verdicts = _verdicts(by_port, resets)
    judged: list[Judged] = []
    for port, group in by_port.items():
        if verdicts[port] is not Reset.NO:
            resets.found[port] = look, verdicts[port]
        judged += _of_port(group, verdicts[port], ratios, resets.stated_h(port))
    return judged


# -- was it another unit ---------------------------------------------------------------------------


def _unit(by_port: Mapping[int, Sequence[Span]], across: Sequence[Span], resets: Resets) -> Unit:
    """Return which unit was read. Spans `across` a look that found a reset, or may hide one, need
    not be ordinary: they may end in what the reset left.
    """
    odd = [one for one in across if not is_ordinary(one)]
    if not all(one.can_be_reset for one in odd):
        return Unit.OTHER
    unit = unit_of(by_port, {port for port in by_port if resets.stated_h(port) is not None})
    return (
        Unit.EITHER
        if unit is Unit.SAME and any(resets.across(one) is Reset.MAYBE for one in odd)
        else unit
    )


OF_RESET: Final = ("fell_since", "reset_with_its_port")
INEXPLICABLE: Final = (
    "fell_alone",
    "fell_to_what_cannot_be",
    "faster_than_time",
    "faster_than_plausible",
)


def _or_other(judged: Judged, unit: Unit) -> Judged:
    """Widen a judgement by the possibility that another unit was read."""
    span = judged.span
    worked = Interval(0.0, max(judged.delta.high, span.at_most))
    if judged.rule in OF_RESET and unit is Unit.EITHER:
        return loose(span, "reset_or_other_unit", worked, DifferenceKind.RESET)
    if judged.rule in INEXPLICABLE:
        return loose(span, judged.rule, worked, judged.kind)
    return loose(span, "beside_what_cannot_be", worked)


def _across_another(span: Span, reset: Reset) -> Judged:
    """Judge a counter not read at the look before which the unit may have been exchanged."""
    if reset is Reset.YES and span.can_be_reset:
        return loose(span, "reset_or_other_unit", Interval(0.0, span.at_most), DifferenceKind.RESET)
    return _beside_another(span)


def _beside_another(span: Span) -> Judged:
    """Judge a counter that fits, in a span in which the unit may have been exchanged."""
    return loose(span, "beside_what_cannot_be", Interval(0.0, span.at_most))


# -- was it reset ----------------------------------------------------------------------------------


def _verdicts(by_port: Mapping[int, Sequence[Span]], resets: Resets) -> dict[int, Reset]:
    """Return the reset of each port. A reset that no counter shows is possible beside a port that
    was reset, or if every port allows it.
    """
    seen = {port: _shown(group, resets.stated_h(port)) for port, group in by_port.items()}
    can_hide = [port for port, group in by_port.items() if _can_hide(group)]
    counted = any(one.after.shown.high > 0 for group in by_port.values() for one in group)
    if Reset.YES in seen.values() or (len(can_hide) == len(by_port) and counted):
        seen |= {port: Reset.MAYBE for port in can_hide if seen[port] is Reset.NO}
    return seen


def _can_hide(group: Sequence[Span]) -> bool:
    """Whether no counter of a port rules out that it was reset."""
    return all(one.can_be_reset for one in group)


def _shown(group: Sequence[Span], stated_h: float | None) -> Reset:
    """Return the reset of a port by its counters that fell and by the recorded resets."""
    fallen = [one for one in group if one.fell]
    if not _can_hide(group) or not (fallen or stated_h is not None):
        return Reset.NO
    if stated_h is not None or any(not one.roll_overs(one.most) for one in fallen):
        return Reset.YES
    return Reset.MAYBE


# -- what follows ----------------------------------------------------------------------------------


def _of_port(
    group: Sequence[Span], reset: Reset, ratios: Ratios, stated_h: float | None
) -> list[Judged]:
    rest_h = max((one.after.shown.low for one in group if one.trait.is_time), default=0.0)
    if reset is Reset.YES:
        return [_was_reset(one, rest_h, stated_h) for one in group]
    judged = [counted_on(one) for one in group]
    judged = [by_companion(one, judged, ratios) for one in judged]
    return [_or_reset(one, rest_h) for one in judged] if reset is Reset.MAYBE else judged


def _across(span: Span, reset: Reset) -> Judged:
    """Judge a counter that was not read at the look that found the reset."""
    return (
        _was_reset(span, 0.0, None)
        if reset is Reset.YES and span.can_be_reset
        else _or_reset(counted_on(span), 0.0)
    )


def _was_reset(span: Span, rest_h: float, stated_h: float | None) -> Judged:
    rule = (
        "stated_reset"
        if stated_h is not None
        else "fell_since"
        if span.fell
        else "reset_with_its_port"
    )
    lost = Interval(0.0, _lost_at_most(span, rest_h, stated_h))
    return Judged(
        span, DifferenceKind.RESET, rule, Join.FROM_ZERO, lost=lost, is_known=lost.high <= 0
    )


def _lost_at_most(span: Span, rest_h: float, stated_h: float | None = None) -> float:
    """Return the greatest possible advance before the reset: in the elapsed time minus the hours
    shown since.

    For a counter that may have rolled over since the reset: all that was possible beyond what it
    shows.
    """
    if span.at_most >= span.modulus:
        return span.at_most - span.after.shown.low
    hours = max(0.0, span.elapsed_h * DRIFT - rest_h)
    # recorded hours count from the look before
    if stated_h is not None and span.before.look == span.after.look - 1:
        hours = min(hours, stated_h * DRIFT)
    return hours if span.trait.is_time else hours * span.trait.fastest


def _or_reset(judged: Judged, rest_h: float) -> Judged:
    span, from_zero = judged.span, since_zero(judged.span)
    high = from_zero.high + _lost_at_most(span, rest_h)
    both = Interval(min(judged.delta.low, from_zero.low), max(judged.delta.high, high))
    if span.fell:
        return loose(span, "rolled_over_or_reset", both)
    return loose(span, "can_hide_reset", both, judged.kind)
