"""What happened to a station between two audits, and the resulting advance of each counter.

A reset is assumed to set every counter of a port to zero. A counter that fell and cannot have
rolled over proves one; a counter that shows more than could be counted since the last look rules it
out. Without either, the advance is bounded by both cases.

All counters of a station are judged together: if one unit cannot have shown all of them, it may
have been exchanged, and only the elapsed time bounds each counter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from itertools import groupby
from typing import Final

import msgspec

from jbclog.maintenance.counter_totals.observed import DRIFT, Identity
from jbclog.maintenance.counter_totals.span import NOTHING, Interval, Reading, Span
from jbclog.maintenance.counter_totals.totals import DifferenceKind, Join

# -- judgement -------------------------------------------------------------------------------------
# What a difference is, before its text is made.


class Judged(msgspec.Struct, frozen=True, gc=False):
    """A span and what it means. `lost`: the advance between the last reading and the reset; for a
    loose join the whole advance.
    """

    span: Span
    kind: DifferenceKind
    rule: str
    join: Join = Join.ON
    roll_overs: int = 0
    lost: Interval = NOTHING
    is_known: bool = True

    @property
    def delta(self) -> Interval:
        """The advance between the readings."""
        if self.join is Join.LOOSE:
            return self.lost
        if self.join is Join.FROM_ZERO:
            return since_zero(self.span) + self.lost
        return rolled_over(self.span, self.roll_overs)


def since_zero(span: Span) -> Interval:
    """Return the advance that the last reading stands for, counted from zero."""
    return Interval(span.after.shown.low, span.after.shown.high + span.trait.step)


def rolled_over(span: Span, times: int) -> Interval:
    """Return the advance with so many roll-overs."""
    if not times:
        return span.worked
    by, step = times * span.modulus, span.trait.step
    return Interval(max(0.0, span.grown.low + by - step), span.grown.high + by + step)


def loose(
    span: Span, rule: str, worked: Interval, kind: DifferenceKind = DifferenceKind.SUSPECT
) -> Judged:
    """Return a judgement of which only the bounds `worked` are known."""
    return Judged(span, kind, rule, Join.LOOSE, lost=worked, is_known=False)


# -- rules -----------------------------------------------------------------------------------------

RULES: Final = {
    "unchanged": "Unchanged.",
    "went_on": "It advanced at a plausible rate.",
    "fell_from_near_its_top": (
        "It alone fell: at its usual rate it rolled over exactly once since the last reading."
    ),
    "fits_its_companion": (
        "Only this number of roll-overs fits the wire feeds counted since, at the length per feed"
        " seen before."
    ),
    "rolled_over_unknown_times": "It rolled over, possibly more than once since the last reading.",
    "can_have_rolled_over": (
        "At its usual rate it may have rolled over since the last reading without a trace."
    ),
    "stands_at_top": (
        "It shows its last number; no manual says whether it stops there or continues from zero."
    ),
    "fell_alone": (
        "It alone fell, from too low a number for a roll-over, and other counters rule out a reset."
    ),
    "fell_to_what_cannot_be": (
        "It fell to more than could be counted since the last reading: neither a reset nor a"
        " roll-over."
    ),
    "faster_than_time": "It counted more hours than passed between the readings.",
    "beside_what_cannot_be": (
        "It fits, but other counters of the station do not: the reading may be another station's."
    ),
    "faster_than_plausible": "It counted faster than is plausible.",
    "clock_ran_back": (
        "The host's clock was set back: the time since the last reading is unknown until a later"
        " audit."
    ),
    "fell_since": (
        "It was reset: it fell to what could be counted since the last reading. Its count before"
        " the reset is lost."
    ),
    "reset_or_other_unit": (
        "It was reset, or exchanged for a hardly used unit: only the elapsed time bounds its"
        " advance."
    ),
    "reset_with_its_port": (
        "Other counters of its port were reset, and it shows no more than could be counted since."
    ),
    "stated_reset": (
        "A reset was recorded; the count between the last reading and the reset is lost."
    ),
    "can_hide_reset": (
        "A reset since the last reading would not show: the station could count all of it in that"
        " time."
    ),
    "rolled_over_or_reset": (
        "It fell: it rolled over or was reset, and no other counter shows which."
    ),
    "left_out": (
        "It fits neither the reading before nor the one after, and those two fit each other:"
        " ignored."
    ),
    "other_model": "The station reports another model.",
    "other_uid": "The station has another identifier.",
    "other_software": (
        "The software changed, and the counters do not continue from the last reading."
    ),
    "stated_replaced": "A replacement of the station was recorded.",
    "counters_of_another": (
        "Several counters fell to more than could be counted since the last reading: another"
        " station."
    ),
}
"""The text of each rule."""


# -- difference ------------------------------------------------------------------------------------
# What the difference of a counter that was not reset means: it advanced, rolled over, or is in
# doubt.


def counted_on(span: Span) -> Judged:
    """Judge a span of a port that was not reset."""
    if span.after.shown.high >= span.top:
        return loose(
            span, "stands_at_top", Interval(span.worked.low, max(span.worked.high, span.most))
        )
    if span.fell:
        return _fallen(span)
    if not span.can_continue:
        return _too_fast(span)
    if span.roll_overs(span.usual):
        most = rolled_over(span, span.roll_overs(span.most)[-1]).high
        return loose(span, "can_have_rolled_over", Interval(span.worked.low, most))
    if span.is_unchanged:
        return Judged(span, DifferenceKind.ZERO, "unchanged")
    return Judged(span, DifferenceKind.NORMAL, "went_on")


def _fallen(span: Span) -> Judged:
    if len(span.roll_overs(span.usual)) == 1:
        return Judged(span, DifferenceKind.ROLL_OVER, "fell_from_near_its_top", roll_overs=1)
    possible = span.roll_overs(span.most)
    if possible:
        worked = Interval(rolled_over(span, 1).low, rolled_over(span, possible[-1]).high)
        return loose(span, "rolled_over_unknown_times", worked, DifferenceKind.ROLL_OVER)
    return loose(
        span,
        "fell_alone" if span.can_be_reset else "fell_to_what_cannot_be",
        Interval(0.0, max(0.0, span.most)),
    )


def _too_fast(span: Span) -> Judged:
    worked = Interval(0.0, max(span.worked.high, span.most))
    if span.trait.is_time:
        return loose(span, "faster_than_time", worked, DifferenceKind.IMPOSSIBLE)
    return loose(span, "faster_than_plausible", worked)


# -- misread ---------------------------------------------------------------------------------------
# Readings that fit neither the one before nor the one after, while those two fit each other: a
# digit wrong in two reads alike, or an answer of another station.

MakeSpan = Callable[[Reading, Reading], Span]


def misread(readings: Sequence[Reading], span: MakeSpan) -> set[int]:
    """Return the looks whose reading of this counter is to be left out."""
    wrong: set[int] = set()
    before = 0
    for place in range(1, len(readings) - 1):
        if _is_wrong(readings[before], readings[place], readings[place + 1], span):
            wrong.add(readings[place].look)
        else:
            before = place
    return wrong


def _is_wrong(before: Reading, this: Reading, after: Reading, span: MakeSpan) -> bool:
    # the common case
    if before.shown.low <= this.shown.high and this.shown.low <= after.shown.high:
        return False
    there, back = span(before, this), span(this, after)
    # a fall to what could be counted since a reset may be right
    if not there.is_impossible or back.can_continue:
        return False
    return span(before, after).can_continue


# -- companion -------------------------------------------------------------------------------------
# Two counters that advance together: millimetres and feeds. The one that rarely rolls over shows
# how often the other did.

Ratios = Mapping[tuple[int, str], Interval]
"""By port and counter: the range of its advance for each count of its companion, with a margin."""

COMPANION: Final = {"dispensed_mm": "dispensed_cycles"}
OPEN: Final = ("can_have_rolled_over", "rolled_over_unknown_times")
LEAST_COUNTS: Final = 100.0
LEAST_SEEN: Final = 3
MARGIN: Final = 2.5  # factor by which another product may take more or less


def ratios_of(looks: Iterable[Iterable[Judged]]) -> dict[tuple[int, str], Interval]:
    """Return the ratios seen in known differences; none for one with fewer than `LEAST_SEEN`."""
    seen: dict[tuple[int, str], list[float]] = {}
    for judged in map(list, looks):
        for one in judged:
            beside = _beside(one, judged)
            if beside is not None and one.is_known:
                seen.setdefault((one.span.port, one.span.counter), []).append(
                    one.delta.middle / beside.delta.middle
                )
    return {
        key: Interval(min(all_) / MARGIN, max(all_) * MARGIN)
        for key, all_ in seen.items()
        if len(all_) >= LEAST_SEEN
    }


def by_companion(judged: Judged, others: Iterable[Judged], ratios: Ratios) -> Judged:
    """Return `judged`, or its roll-overs if only one number fits its companion's count."""
    span = judged.span
    ratio = ratios.get((span.port, span.counter)) if judged.rule in OPEN else None
    beside = _beside(judged, others) if ratio is not None else None
    if ratio is None or beside is None:
        return judged
    possible = ([] if span.fell else [0]) + list(span.roll_overs(span.most))
    fitting = [times for times in possible if _fits(rolled_over(span, times), beside.delta, ratio)]
    if len(fitting) != 1:
        return judged
    kind = DifferenceKind.ROLL_OVER if fitting[0] else DifferenceKind.NORMAL
    return Judged(span, kind, "fits_its_companion", roll_overs=fitting[0])


def _beside(judged: Judged, others: Iterable[Judged]) -> Judged | None:
    """Return its companion over the same time; None unless that is known and advanced enough."""
    name, begin = COMPANION.get(judged.span.counter), judged.span.before.look
    for one in others if name else ():
        if (one.span.counter, one.span.port, one.span.before.look) == (
            name,
            judged.span.port,
            begin,
        ):
            return one if one.is_known and one.delta.low >= LEAST_COUNTS else None
    return None


def _fits(worked: Interval, counted: Interval, ratio: Interval) -> bool:
    return worked.high >= ratio.low * counted.low and worked.low <= ratio.high * counted.high


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
    EITHER = "either"  # the same one after a reset, or a hardly used other one
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
    """Whether a continued count explains it, roll-overs included."""
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


# -- judging ---------------------------------------------------------------------------------------


class Reset(Enum):
    """Whether a port was reset between two looks."""

    NO = "no"
    MAYBE = "maybe"
    YES = "yes"


@dataclass(slots=True)
class Resets:
    """Known resets. `stated`: hours from the look before to a recorded reset, by port (0: all).
    `found`: the last look that found a reset, and whether it is certain, by port. `other`: the last
    look before which the unit may have been exchanged."""

    stated: Mapping[int, float] = field(default_factory=dict)
    found: dict[int, tuple[int, Reset]] = field(default_factory=dict)
    other: int = -1

    def stated_h(self, port: int) -> float | None:
        return self.stated.get(port, self.stated.get(0))

    def across(self, span: Span) -> Reset:
        """Return the reset that a look within the span found without reading this counter."""
        look, reset = self.found.get(span.port, (-1, Reset.NO))
        return reset if look > span.before.look else Reset.NO


def judge(spans: Sequence[Span], look: int, resets: Resets, ratios: Ratios) -> list[Judged]:
    """Judge all counters of a station at one look; enters the resets that it finds in `resets`."""
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
    not be ordinary: they may end in what the reset left."""
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
    """Widen a judgement by the chance that another unit was read."""
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
    """Return the reset by port. One that no counter shows is possible beside a port that was reset,
    or if every port allows it.
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
    """Return the greatest possible advance before the reset: in the elapsed time less the hours
    shown since.

    For a counter that may have rolled over since the reset: all that was possible beyond what it
    shows."""
    if span.at_most >= span.modulus:
        return span.at_most - span.after.shown.low
    hours = max(0.0, span.elapsed_h * DRIFT - rest_h)
    # recorded hours count from the look before
    if stated_h is not None and span.before.look == span.after.look - 1:
        hours = min(hours, stated_h * DRIFT)
    return hours if span.trait.is_time else hours * span.trait.fastest


def _or_reset(judged: Judged, rest_h: float) -> Judged:
    """Widen a judgement by the chance of a reset."""
    span, from_zero = judged.span, since_zero(judged.span)
    high = from_zero.high + _lost_at_most(span, rest_h)
    both = Interval(min(judged.delta.low, from_zero.low), max(judged.delta.high, high))
    if span.fell:
        return loose(span, "rolled_over_or_reset", both)
    return loose(span, "can_hide_reset", both, judged.kind)
