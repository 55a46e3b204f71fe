"""What happened to a station between two looks: was it reset, and what does each of its counters' differences mean.

A reset is supposed to set every counter of a port to zero. So it is shown by a counter that fell and cannot have rolled over, and
ruled out by one that shows more than can have been counted since the last look. Where neither is so, nobody can know, and what
follows is bounded by both.

All counters of the station are heard together: where one unit cannot have shown all of it without a reset (`units.py`), another
unit may stand there, and of none of its counters is more known than what there was time for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from itertools import groupby
from typing import Final

from jbclog.maintenance.counter_totals.companion import Ratios, by_companion
from jbclog.maintenance.counter_totals.difference import counted_on
from jbclog.maintenance.counter_totals.interval import Interval
from jbclog.maintenance.counter_totals.judgement import Judged, loose, since_zero
from jbclog.maintenance.counter_totals.span import Span
from jbclog.maintenance.counter_totals.totals import Join, Kind
from jbclog.maintenance.counter_totals.traits import DRIFT
from jbclog.maintenance.counter_totals.units import Unit, is_ordinary, unit_of


class Reset(Enum):
    """Whether a port was reset between two looks."""

    NO = "no"
    MAYBE = "maybe"
    YES = "yes"


@dataclass(slots=True)
class Resets:
    """What is known of them: by port (0: all), hours from the look before to one that people stated; by port, the last look that
    found one, and whether it is sure. `other` is the last look since whose last but one another unit may have come."""

    stated: Mapping[int, float] = field(default_factory=dict)
    found: dict[int, tuple[int, Reset]] = field(default_factory=dict)
    other: int = -1

    def stated_h(self, port: int) -> float | None:
        return self.stated.get(port, self.stated.get(0))

    def across(self, span: Span) -> Reset:
        """Whether a look within the span, at which this counter was not read, found one."""
        look, reset = self.found.get(span.port, (-1, Reset.NO))
        return reset if look > span.before.look else Reset.NO


def judge(spans: Sequence[Span], look: int, resets: Resets, ratios: Ratios) -> list[Judged]:
    """All counters of a station at one look; `resets` learns what is found."""
    untimed = [loose(one, "clock_ran_back", Interval(0.0, math.inf)) for one in spans if math.isinf(one.elapsed_h)]
    timed = [one for one in spans if not math.isinf(one.elapsed_h)]
    judged = [_across_another(one, resets.across(one)) for one in timed if one.before.look < resets.other]
    timed = [one for one in timed if one.before.look >= resets.other]
    across = [one for one in timed if resets.across(one) is not Reset.NO]
    fresh = sorted((one for one in timed if resets.across(one) is Reset.NO), key=lambda one: one.port)
    by_port = {port: list(group) for port, group in groupby(fresh, key=lambda one: one.port)}
    unit = _unit(by_port, across, resets)
    found = [_across(one, resets.across(one)) for one in across] + _at_look(by_port, look, resets, ratios)
    if unit is not Unit.SAME:
        resets.other = look
        found = [_or_other(one, unit) for one in found]
    return untimed + judged + found


def judge_doubted(spans: Sequence[Span], look: int, resets: Resets) -> list[Judged]:
    """All counters at a look of which it is known that another unit may have come or gone before it."""
    resets.other = look
    return [_beside_another(one) for one in spans]


def _at_look(by_port: Mapping[int, Sequence[Span]], look: int, resets: Resets, ratios: Ratios) -> list[Judged]:
    verdicts = _verdicts(by_port, resets)
    judged: list[Judged] = []
    for port, group in by_port.items():
        if verdicts[port] is not Reset.NO:
            resets.found[port] = look, verdicts[port]
        judged += _of_port(group, verdicts[port], ratios, resets.stated_h(port))
    return judged


# -- was it another unit ----------------------------------------------------------------------------------------------------------


def _unit(by_port: Mapping[int, Sequence[Span]], across: Sequence[Span], resets: Resets) -> Unit:
    """By all spans; those `across` a look that found a reset, or may have hidden one, are ordinary or end in what it left."""
    odd = [one for one in across if not is_ordinary(one)]
    if not all(one.can_be_reset for one in odd):
        return Unit.OTHER
    unit = unit_of(by_port, {port for port in by_port if resets.stated_h(port) is not None})
    return Unit.EITHER if unit is Unit.SAME and any(resets.across(one) is Reset.MAYBE for one in odd) else unit


OF_RESET: Final = ("fell_since", "reset_with_its_port")
INEXPLICABLE: Final = ("fell_alone", "fell_to_what_cannot_be", "faster_than_time", "faster_than_plausible")


def _or_other(judged: Judged, unit: Unit) -> Judged:
    """As it is judged, or another unit's."""
    span = judged.span
    worked = Interval(0.0, max(judged.delta.high, span.at_most))
    if judged.rule in OF_RESET and unit is Unit.EITHER:
        return loose(span, "reset_or_other_unit", worked, Kind.RESET)
    if judged.rule in INEXPLICABLE:
        return loose(span, judged.rule, worked, judged.kind)
    return loose(span, "beside_what_cannot_be", worked)


def _across_another(span: Span, reset: Reset) -> Judged:
    """A counter that was not read at the look before which another unit may have come."""
    if reset is Reset.YES and span.can_be_reset:
        return loose(span, "reset_or_other_unit", Interval(0.0, span.at_most), Kind.RESET)
    return _beside_another(span)


def _beside_another(span: Span) -> Judged:
    """Of a span that another unit may have come in, though this counter does not tell."""
    return loose(span, "beside_what_cannot_be", Interval(0.0, span.at_most))


# -- was it reset ---------------------------------------------------------------------------------------------------------------


def _verdicts(by_port: Mapping[int, Sequence[Span]], resets: Resets) -> dict[int, Reset]:
    """By port. A reset that no counter shows is thinkable beside a port that was reset, or where the whole station allows it."""
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
    """What the counters of a port that fell, and people, say of it."""
    fallen = [one for one in group if one.fell]
    if not _can_hide(group) or not (fallen or stated_h is not None):
        return Reset.NO
    if stated_h is not None or any(not one.turns(one.most) for one in fallen):
        return Reset.YES
    return Reset.MAYBE


# -- what follows ---------------------------------------------------------------------------------------------------------------


def _of_port(group: Sequence[Span], reset: Reset, ratios: Ratios, stated_h: float | None) -> list[Judged]:
    rest_h = max((one.after.shown.low for one in group if one.trait.is_time), default=0.0)
    if reset is Reset.YES:
        return [_was_reset(one, rest_h, stated_h) for one in group]
    judged = [counted_on(one) for one in group]
    judged = [by_companion(one, judged, ratios) for one in judged]
    return [_or_reset(one, rest_h) for one in judged] if reset is Reset.MAYBE else judged


def _across(span: Span, reset: Reset) -> Judged:
    """A counter that was not read at the look that found the reset."""
    return _was_reset(span, 0.0, None) if reset is Reset.YES and span.can_be_reset else _or_reset(counted_on(span), 0.0)


def _was_reset(span: Span, rest_h: float, stated_h: float | None) -> Judged:
    rule = "stated_reset" if stated_h is not None else "fell_since" if span.fell else "reset_with_its_port"
    lost = Interval(0.0, _lost_at_most(span, rest_h, stated_h))
    return Judged(span, Kind.RESET, rule, Join.FROM_ZERO, lost=lost, is_known=lost.high <= 0)


def _lost_at_most(span: Span, rest_h: float, stated_h: float | None = None) -> float:
    """What can have been worked before the reset: in the time that is left when the hours shown since are taken away.

    Of a counter that can have rolled over since the reset, what can have been worked in all beyond what it shows."""
    if span.at_most >= span.modulus:
        return span.at_most - span.after.shown.low
    hours = max(0.0, span.elapsed_h * DRIFT - rest_h)
    if stated_h is not None and span.before.look == span.after.look - 1:  # it is told from the look before on
        hours = min(hours, stated_h * DRIFT)
    return hours if span.trait.is_time else hours * span.trait.fastest


def _or_reset(judged: Judged, rest_h: float) -> Judged:
    """As it is judged, or reset: whatever both allow."""
    span, went_on = judged.span, judged.delta
    from_zero = since_zero(span)
    high = from_zero.high + _lost_at_most(span, rest_h)
    both = Interval(min(went_on.low, from_zero.low), max(went_on.high, high))
    if span.fell:
        return loose(span, "rolled_over_or_reset", both)
    return loose(span, "can_hide_reset", both, judged.kind)
