"""What the difference of a counter means that was not reset: it went on, rolled over, or nobody can tell."""

from __future__ import annotations

from jbclog.maintenance.counter_totals.interval import Interval
from jbclog.maintenance.counter_totals.judgement import Judged, loose, turned
from jbclog.maintenance.counter_totals.span import Span
from jbclog.maintenance.counter_totals.totals import Kind


def counted_on(span: Span) -> Judged:
    """A span of a port that was not reset."""
    if span.after.shown.high >= span.top:
        return loose(span, "stands_at_top", Interval(span.worked.low, max(span.worked.high, span.most)))
    if span.fell:
        return _rolled_over(span, span.turns(span.usual))
    if not span.can_go_on:
        return _too_fast(span)
    turns = span.turns(span.usual)
    if turns:
        return loose(span, "can_have_rolled_over", Interval(span.worked.low, turned(span, span.turns(span.most)[-1]).high))
    return Judged(span, Kind.ZERO if span.is_unchanged else Kind.NORMAL, "unchanged" if span.is_unchanged else "went_on")


def _rolled_over(span: Span, turns: range) -> Judged:
    if len(turns) == 1:
        return Judged(span, Kind.ROLL_OVER, "fell_from_near_its_top", turns=1)
    possible = span.turns(span.most)
    if possible:
        worked = Interval(turned(span, 1).low, turned(span, possible[-1]).high)
        return loose(span, "rolled_over_unknown_times", worked, Kind.ROLL_OVER)
    return loose(span, "fell_alone" if span.can_be_reset else "fell_to_what_cannot_be", Interval(0.0, max(0.0, span.most)))


def _too_fast(span: Span) -> Judged:
    worked = Interval(0.0, max(span.worked.high, span.most))
    if span.trait.is_time:
        return loose(span, "faster_than_time", worked, Kind.IMPOSSIBLE)
    return loose(span, "faster_than_plausible", worked)
