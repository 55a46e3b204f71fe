"""Software and parameters that are not what they were at the audit before, or not what the fleet has.

Alike are stations of one model (software), and ports of one family with one tool (parameters). An odd one out is told where at
least three of a group, and three quarters of it, have one other value. Where a fleet has recipes of several kinds, no value has
such a majority, and nobody drifts.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from jbclog.maintenance.counter_totals.observed import Observation
from jbclog.maintenance.fleet import BEFORE, FLEET, Drift

FEWEST: Final = 3
MAJORITY: Final = 3 / 4


@dataclass(frozen=True, slots=True)
class Said:
    """One value that a station has, under its own name, and what it can be compared among."""

    station: str
    name: str
    value: str
    alike: tuple[str, ...]


def drifts(looks: Mapping[str, Sequence[Observation]]) -> dict[str, tuple[Drift, ...]]:
    """For each station whatever drifted; of the looks that saw it, oldest first, the last two count."""
    said = {name: list(_said(seen[-1])) for name, seen in looks.items() if seen}
    groups: dict[tuple[str, ...], Counter[str]] = defaultdict(Counter)
    for one in (one for all_of_it in said.values() for one in all_of_it):
        groups[one.alike][one.value] += 1
    return {name: (*_since(looks[name]), *_apart(ones, groups)) for name, ones in said.items()}


def _said(look: Observation) -> Iterator[Said]:
    if look.identity is None:
        return
    kind = look.identity.model or look.identity.family
    if look.identity.software is not None:
        yield Said(look.station, "software", look.identity.software, ("software", kind))
    for name, value in sorted(look.parameters.items()):
        port, _, setting = name.rpartition(".")
        tool = look.tools.get(int(port), "") if port.isdecimal() else ""
        yield Said(look.station, name, value, (setting, look.identity.family, tool))


def _since(seen: Sequence[Observation]) -> Iterator[Drift]:
    if len(seen) < 2:
        return
    before = {one.name: one for one in _said(seen[-2])}
    for one in _said(seen[-1]):
        was = before.get(one.name)
        if was is not None and was.alike == one.alike and was.value != one.value:
            yield Drift(one.name, one.value, was.value, BEFORE)


def _apart(said: Sequence[Said], groups: Mapping[tuple[str, ...], Counter[str]]) -> Iterator[Drift]:
    for one in said:
        group = groups[one.alike]
        value, held_by = group.most_common(1)[0]
        if value != one.value and held_by >= max(FEWEST, MAJORITY * group.total()):
            yield Drift(one.name, one.value, value, FLEET, held_by, group.total() - 1)
