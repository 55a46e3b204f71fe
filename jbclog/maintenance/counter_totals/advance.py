"""Meaning of the difference of a counter that was not reset: it advanced, rolled over, was misread,
or is in doubt.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final

from jbclog.maintenance.counter_totals.judgement import Judged, loose, rolled_over
from jbclog.maintenance.counter_totals.span import Interval, Reading, Span
from jbclog.maintenance.counter_totals.totals import DifferenceKind


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
    """Return the looks whose reading of this counter is ignored as misread."""
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
"""Port and counter -> range of its advance per count of its companion, with a margin."""

COMPANION: Final = {"dispensed_mm": "dispensed_cycles"}
OPEN: Final = ("can_have_rolled_over", "rolled_over_unknown_times")
LEAST_COUNTS: Final = 100.0
LEAST_SEEN: Final = 3
MARGIN: Final = 2.5  # factor by which another product may take more or less


def ratios_of(looks: Iterable[Iterable[Judged]]) -> dict[tuple[int, str], Interval]:
    """Return the ratios seen in known differences; none for a counter with fewer than
    `LEAST_SEEN`.
    """
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
    """Return `judged`, or its roll-overs if only one number of them fits its companion's count."""
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
