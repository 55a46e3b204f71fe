"""Can one unit have shown all of this, or did another come to stand there that nobody told of?

Asked of all counters of a station together. Another unit can show anything, so it is thought of only where the one that stood
there does not explain what is read: an exchange that looks like a unit that just went on is told by no reading.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from enum import Enum
from typing import Final

from jbclog.maintenance.counter_totals.span import Span

SURELY_ITS_OWN_H: Final = 24.0  # more hours than two units agree in by chance
ENOUGH: Final = 2  # counters of hours


class Unit(Enum):
    """Which unit was read."""

    SAME = "same"
    EITHER = "either"  # the same one after a reset, or another that was hardly used
    OTHER = "other"


def unit_of(by_port: Mapping[int, Sequence[Span]], stated: Collection[int]) -> Unit:
    """By the spans of each port. `stated` are ports that were reset, as people told."""
    odd = [port for port, group in by_port.items() if not all(map(is_ordinary, group))]
    if any(not all(one.can_be_reset for one in by_port[port]) for port in odd):
        return Unit.OTHER
    if all(port in stated for port in odd) or any(_is_its_own(group) for port, group in by_port.items() if port not in odd):
        return Unit.SAME
    return Unit.EITHER


def is_ordinary(span: Span) -> bool:
    """Whether it can just have gone on, over its last number too."""
    return span.can_go_on or bool(span.turns(span.most))


def _is_its_own(group: Sequence[Span]) -> bool:
    """Whether a port shows hours that no other unit would happen to have: a reset of another port is then one of this station."""
    hours = [one for one in group if one.trait.is_time and one.can_go_on]
    return sum(one.before.shown.low >= SURELY_ITS_OWN_H and not one.can_be_reset for one in hours) >= ENOUGH
