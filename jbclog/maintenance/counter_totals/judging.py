"""What the readings of a station's counters at one look say of their advance since the readings
before.

1. A counter that did not fall, and is no faster than it can be, continued.
2. A counter that fell, or is faster than it can be, breaks the record of its station: it was reset,
   exchanged, or rolled over. Only a person knows which. Until the answer is recorded
   (`jbclog maintenance`), the elapsed time alone bounds the advance of every counter of the
   station, because another unit can show anything.
3. An answer is believed where the readings allow it. A reset sets every counter of a port to zero.
4. The length of solder wire passes its last number every 105 m. A fall of it alone is a roll-over,
   if another counter of its port rules out a reset.
5. A counter can pass its last number, or be reset, and show more than before. Where its rate and
   the other counters do not rule that out, the bounds hold both cases.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import msgspec

from jbclog.config.task_names import RESET, ROLLED_OVER
from jbclog.maintenance.counter_totals.history import History, Key
from jbclog.maintenance.counter_totals.observed import DRIFT
from jbclog.maintenance.counter_totals.span import NOTHING, Interval, Span
from jbclog.maintenance.counter_totals.totals import CONTINUED, DifferenceKind, Join

BESIDE: Final = "beside_what_cannot_be"
RULES: Final = {
    **CONTINUED,
    "fell": (
        "Reset, exchanged, or rolled over: only the elapsed time bounds its advance until the"
        " answer is recorded."
    ),
    "faster_than_time": "It counted more hours than passed between the readings.",
    "faster_than_plausible": "It counted faster than is plausible.",
    BESIDE: (
        "It fits, but other counters of the station do not: the reading may be another station's."
    ),
    "rolled_over": "Only this counter fell: it rolled over exactly once since the last reading.",
    "rolled_over_unknown_times": "It rolled over, possibly more than once since the last reading.",
    "can_have_rolled_over": (
        "At its usual rate it may have rolled over since the last reading without a trace."
    ),
    "stands_at_top": (
        "It shows its highest number; no manual says whether it stops there or continues from zero."
    ),
    "clock_ran_back": (
        "The host's clock was set back: the time since the last reading is unknown until a later"
        " audit."
    ),
    "stated_reset": (
        "A reset was recorded; the count between the last reading and the reset is lost."
    ),
    "can_hide_reset": (
        "A reset since the last reading would go unnoticed: the station could count all of this in"
        " that time."
    ),
    "other_model": "The station reports another model.",
    "other_uid": "The station has another identifier.",
    "stated_replaced": "A replacement of the station was recorded.",
}
"""The text of each rule."""
BREAKS: Final = frozenset({"fell", "faster_than_time", "faster_than_plausible"})
UNSURE: Final = frozenset({"can_have_rolled_over", "rolled_over_unknown_times"})
"""Rules that a counter's usual rate can narrow."""


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
            return _since_zero(self.span) + self.lost
        return _rolled_over(self.span, self.roll_overs)


@dataclass(slots=True)
class Doubts:
    """What earlier looks leave open, for counters that they did not read: `broken`, the last look
    that broke the record, and the last look before which a port may have been reset unseen.
    """

    broken: int = -1
    hidden: dict[int, int] = field(default_factory=dict)

    def may_hide(self, span: Span) -> bool:
        return span.before.look < self.hidden.get(span.port, -1)


def judge(spans: Sequence[Span], look: int, doubts: Doubts, history: History) -> list[Judged]:
    """Judge all counters of a station at one look; notes in `doubts` what it leaves open."""
    judged: list[Judged] = []
    timed: list[Span] = []
    for span in spans:
        if math.isinf(span.elapsed_h):
            judged.append(_loose(span, "clock_ran_back", Interval(0.0, math.inf)))
        elif span.before.look < doubts.broken:
            judged.append(beside(span))
        else:
            timed.append(span)
    resets = _believed_resets(timed, history)
    rest = [span for span in timed if span.key not in resets]
    if any(_is_break(span, rest, history) for span in rest):
        doubts.broken = look
        return [*judged, *map(_broken, timed)]
    judged += [_was_reset(span, *resets[span.key]) for span in timed if span.key in resets]
    across = [span for span in rest if doubts.may_hide(span)]
    judged += [_or_reset(_counted_on(span), 0.0) for span in across]
    fresh = _by_port(span for span in rest if span not in across)
    hiding = _hiding(fresh, history, is_beside_reset=bool(resets))
    doubts.hidden.update(dict.fromkeys(hiding, look))
    for port, group in fresh.items():
        if port in hiding:
            rest_h = _shown_h(group)
            judged += [_or_reset(_counted_on(span), rest_h) for span in group]
        else:
            judged += [_counted_on(span) for span in group]
    return judged


def _by_port(spans: Iterable[Span]) -> dict[int, list[Span]]:
    by_port: dict[int, list[Span]] = {}
    for span in spans:
        by_port.setdefault(span.port, []).append(span)
    return by_port


def _shown_h(spans: Iterable[Span]) -> float:
    return max((span.after.shown.low for span in spans if span.trait.is_time), default=0.0)


# -- resets ----------------------------------------------------------------------------------------


def _believed_resets(spans: Sequence[Span], history: History) -> dict[Key, tuple[float, float]]:
    """Return the hours shown by the port, and those from the reading before to the last recorded
    reset, of each counter of a port whose every counter can have counted from zero since.
    """
    resets: dict[Key, tuple[float, float]] = {}
    if not history.answers:
        return resets
    for port, group in _by_port(spans).items():
        recorded = {
            span: hours
            for span in group
            if (hours := history.stated_h(RESET, span.before.look, span.after.look, port))
        }
        if all(span.can_be_reset for span in recorded):
            shown_h = _shown_h(recorded)
            resets |= {span.key: (shown_h, max(hours)) for span, hours in recorded.items()}
    return resets


def _hiding(
    by_port: Mapping[int, Sequence[Span]], history: History, *, is_beside_reset: bool
) -> set[int]:
    """Return the ports that may have been reset unseen: beside a port that was reset, or if no
    counter of the station rules it out.
    """
    hiding = {port for port, group in by_port.items() if all(span.can_be_reset for span in group)}
    is_counted = any(span.after.shown.high > 0 for group in by_port.values() for span in group)
    if is_beside_reset or (len(hiding) == len(by_port) and is_counted):
        return {
            port
            for port in hiding
            if not any(_is_stated_roll_over(span, history) for span in by_port[port])
        }
    return set()


# -- breaks ----------------------------------------------------------------------------------------


def _is_break(span: Span, spans: Sequence[Span], history: History) -> bool:
    if span.can_continue:
        return False
    if not span.fell or not span.roll_overs(span.most):
        return True
    return not _is_stated_roll_over(span, history) and not _turned_alone(span, spans)


def _is_stated_roll_over(span: Span, history: History) -> bool:
    stated = history.stated_h(ROLLED_OVER, span.before.look, span.after.look, span.port)
    return span.fell and bool(stated)


def _turned_alone(span: Span, spans: Sequence[Span]) -> bool:
    """Whether a length passed its last number: every other counter continued, and one of its port
    rules out a reset.
    """
    others = [other for other in spans if other is not span]
    return (
        span.trait.turns_often
        and all(other.can_continue for other in others)
        and any(other.port == span.port and not other.can_be_reset for other in others)
    )


def _broken(span: Span) -> Judged:
    if span.fell:
        return _loose(span, "fell", Interval(0.0, span.at_most), DifferenceKind.FELL)
    worked = Interval(0.0, max(span.worked.high, span.at_most))
    if span.can_continue:
        return _loose(span, BESIDE, worked)
    if span.trait.is_time:
        return _loose(span, "faster_than_time", worked, DifferenceKind.IMPOSSIBLE)
    return _loose(span, "faster_than_plausible", worked)


def beside(span: Span) -> Judged:
    """Judge a counter that fits, in a span in which the record of its station is broken."""
    return _loose(span, BESIDE, Interval(0.0, span.at_most))


# -- one counter -----------------------------------------------------------------------------------


def _counted_on(span: Span) -> Judged:
    """Judge a counter of a port that was not reset."""
    if span.after.shown.high >= span.top:
        most = max(span.worked.high, span.most)
        return _loose(span, "stands_at_top", Interval(span.worked.low, most))
    usual = span.roll_overs(span.usual)
    if span.fell:
        if len(usual) == 1:
            return Judged(span, DifferenceKind.ROLL_OVER, "rolled_over", roll_overs=1)
        turns = span.roll_overs(span.most)
        worked = Interval(_rolled_over(span, 1).low, _rolled_over(span, turns[-1]).high)
        return _loose(span, "rolled_over_unknown_times", worked, DifferenceKind.ROLL_OVER)
    if usual:
        most = _rolled_over(span, span.roll_overs(span.most)[-1]).high
        return _loose(span, "can_have_rolled_over", Interval(span.worked.low, most))
    if span.is_unchanged:
        return Judged(span, DifferenceKind.ZERO, "unchanged")
    return Judged(span, DifferenceKind.NORMAL, "went_on")


def _was_reset(span: Span, rest_h: float, reset_h: float) -> Judged:
    lost = Interval(0.0, _lost_at_most(span, rest_h, reset_h))
    return Judged(
        span,
        DifferenceKind.RESET,
        "stated_reset",
        Join.FROM_ZERO,
        lost=lost,
        is_known=lost.high <= 0,
    )


def _or_reset(judged: Judged, rest_h: float) -> Judged:
    """Widen a judgement by the possibility of a reset that no counter shows."""
    span, from_zero = judged.span, _since_zero(judged.span)
    high = from_zero.high + _lost_at_most(span, rest_h)
    both = Interval(min(judged.delta.low, from_zero.low), max(judged.delta.high, high))
    return _loose(span, "can_hide_reset", both, judged.kind)


def _lost_at_most(span: Span, rest_h: float, reset_h: float = math.inf) -> float:
    """Return the greatest possible advance before a reset: in the elapsed time minus the hours
    shown since.

    For a counter that may have rolled over since the reset: all that was possible beyond what it
    shows.
    """
    if span.at_most >= span.modulus:
        return span.at_most - span.after.shown.low
    hours = max(0.0, min(span.elapsed_h * DRIFT - rest_h, reset_h * DRIFT))
    return hours if span.trait.is_time else hours * span.trait.fastest


def _since_zero(span: Span) -> Interval:
    """Return the advance that the last reading stands for, counted from zero."""
    return Interval(span.after.shown.low, span.after.shown.high + span.trait.step)


def _rolled_over(span: Span, times: int) -> Interval:
    """Return the advance with `times` roll-overs."""
    if not times:
        return span.worked
    by, step = times * span.modulus, span.trait.step
    return Interval(max(0.0, span.grown.low + by - step), span.grown.high + by + step)


def _loose(
    span: Span, rule: str, worked: Interval, kind: DifferenceKind = DifferenceKind.SUSPECT
) -> Judged:
    """Return a judgement of which only the bounds `worked` are known."""
    return Judged(span, kind, rule, Join.LOOSE, lost=worked, is_known=False)
