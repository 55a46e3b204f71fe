"""What a difference was judged to be, before it is put into words."""

from __future__ import annotations

from dataclasses import dataclass

from jbclog.maintenance.counter_totals.interval import NOTHING, Interval
from jbclog.maintenance.counter_totals.span import Span
from jbclog.maintenance.counter_totals.totals import Join, Kind


@dataclass(slots=True)  # as `Span`: made too often to be frozen
class Judged:
    """A span and what it means. `lost` is, of a counter that was reset, what it had counted since the last reading before it;
    where the join is loose, all that is known."""

    span: Span
    kind: Kind
    rule: str
    join: Join = Join.ON
    turns: int = 0
    lost: Interval = NOTHING
    is_known: bool = True

    @property
    def delta(self) -> Interval:
        """What was worked."""
        if self.join is Join.LOOSE:
            return self.lost
        if self.join is Join.FROM_ZERO:
            return since_zero(self.span) + self.lost
        return turned(self.span, self.turns)


def since_zero(span: Span) -> Interval:
    """What the last reading stands for where it counted from zero."""
    return Interval(span.after.shown.low, span.after.shown.high + span.trait.step)


def turned(span: Span, turns: int) -> Interval:
    """What was worked if it rolled over so often."""
    if not turns:
        return span.worked
    by, step = turns * span.modulus, span.trait.step
    return Interval(max(0.0, span.grown.low + by - step), span.grown.high + by + step)


def loose(span: Span, rule: str, worked: Interval, kind: Kind = Kind.SUSPECT) -> Judged:
    """Only bounds are known."""
    return Judged(span, kind, rule, Join.LOOSE, lost=worked, is_known=False)
