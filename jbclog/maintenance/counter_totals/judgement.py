"""Judgement of the difference between two readings of a counter, before its text is made, and the
rules that decide it.
"""

from __future__ import annotations

from typing import Final

import msgspec

from jbclog.maintenance.counter_totals.span import NOTHING, Interval, Span
from jbclog.maintenance.counter_totals.totals import CONTINUED, DifferenceKind, Join


class Judged(msgspec.Struct, frozen=True, gc=False):
    """A span and its meaning. `lost`: the advance between the last reading and the reset; for a
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
    """Return the advance with `times` roll-overs."""
    if not times:
        return span.worked
    by, step = times * span.modulus, span.trait.step
    return Interval(max(0.0, span.grown.low + by - step), span.grown.high + by + step)


def loose(
    span: Span, rule: str, worked: Interval, kind: DifferenceKind = DifferenceKind.SUSPECT
) -> Judged:
    """Return a judgement of which only the bounds `worked` are known."""
    return Judged(span, kind, rule, Join.LOOSE, lost=worked, is_known=False)


RULES: Final = {
    **CONTINUED,
    "fell_from_near_its_top": (
        "Only this counter fell: at its usual rate it rolled over exactly once since the last"
        " reading."
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
        "It shows its highest number; no manual says whether it stops there or continues from zero."
    ),
    "fell_alone": (
        "Only this counter fell, from too low a number for a roll-over, and other counters rule out"
        " a reset."
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
        "A reset since the last reading would go unnoticed: the station could count all of this in"
        " that time."
    ),
    "rolled_over_or_reset": (
        "It fell: it rolled over or was reset, and no other counter shows which."
    ),
    "left_out": (
        "Ignored: it fits neither the reading before nor the one after, and those two fit each"
        " other."
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
