"""Readings that belong to nothing: they fit neither the one before nor the one after, while these two fit each other.

A digit that was wrong on the wire in two readings alike, or another station that answered for once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from jbclog.maintenance.counter_totals.span import Reading, Span

MakeSpan = Callable[[Reading, Reading], Span]


def misread(readings: Sequence[Reading], span: MakeSpan) -> set[int]:
    """The looks whose reading of this counter is to be left out."""
    wrong: set[int] = set()
    before = 0
    for place in range(1, len(readings) - 1):
        if _is_wrong(readings[before], readings[place], readings[place + 1], span):
            wrong.add(readings[place].look)
        else:
            before = place
    return wrong


def _is_wrong(before: Reading, this: Reading, after: Reading, span: MakeSpan) -> bool:
    if before.shown.low <= this.shown.high and this.shown.low <= after.shown.high:  # most are
        return False
    there, back = span(before, this), span(this, after)
    if not there.is_impossible or back.can_go_on:  # one that fell to what it can have counted since a reset may be right
        return False
    return span(before, after).can_go_on
