"""Stations of one line that may have been mixed up: swapped cables, and units that nothing on the
link tells apart. Compares what the sessions know; sends nothing.

A session sees one cable only. That another station answers on it says that *something* is wrong;
two sessions that each see the other's station say what: the cables are swapped.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations

from jbclog.protocol.commands.family import Family, family_of
from jbclog.session.run.context import Identity, SessionContext


def identity_of(context: SessionContext) -> Identity:
    """Return the identity of the station that the run started with."""
    hours = {port: known for port, (known, _) in context.plugged_hours.items()}
    return Identity(context.facts.model, context.facts.software, hours)


def swapped(contexts: Sequence[SessionContext]) -> Iterator[tuple[SessionContext, SessionContext]]:
    """Yield pairs of stations of which each answers as the other."""
    strange = [context for context in contexts if context.answers_as is not None]
    for first, second in combinations(strange, 2):
        if _stands_for(first, second) and _stands_for(second, first):
            yield first, second


def _stands_for(found: SessionContext, meant: SessionContext) -> bool:
    """Return True if the station on the cable of `found` can be the one of `meant`."""
    answer = found.answers_as
    if answer is None:
        return False
    if meant.has_identity:
        return answer.may_be(identity_of(meant))
    if meant.order.model is not None:
        return answer.model == meant.order.model
    return _proves(meant.order.family, answer.model)


def _proves(family: Family | None, model: str | None) -> bool:
    proven = None if model is None else family_of(model)
    return family is not None and proven is not None and proven.name == family.name


def swapped_text(first: SessionContext, second: SessionContext) -> str:
    """Say that the cables of two stations look swapped, and what to do."""
    return (
        f"the cables of {first.name} and {second.name} look swapped: {first.order.url} leads to"
        f" {second.name}, {second.order.url} to {first.name}; compare with the labels on the"
        " stations, and exchange the two cables or the two urls"
    )


def alike(contexts: Iterable[SessionContext]) -> dict[str, list[str]]:
    """Return station -> the others of the line that nothing on the link tells from it."""
    of_kind: defaultdict[tuple[str | None, str | None], list[SessionContext]] = defaultdict(list)
    for context in contexts:
        if context.has_identity and context.facts.model is not None:
            of_kind[context.facts.model, context.facts.software].append(context)
    names: dict[str, list[str]] = {}
    for group in of_kind.values():
        for first, second in combinations(group, 2):
            if identity_of(first).may_be(identity_of(second)):
                names.setdefault(first.name, []).append(second.name)
                names.setdefault(second.name, []).append(first.name)
    return names
