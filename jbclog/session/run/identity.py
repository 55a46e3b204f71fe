"""Decide whether it is still the same station: adapters swap names, and people swap cables.

Checked after every disconnection. The model proves little on a production line of equal units, so
the software version and the plugged hours are compared too (docs/reference/faults.md, F-16 and
F-17). Hours are compared at every reading, because two cables can be swapped between two requests;
model and software are read as often as the counters. Nothing in the manuals distinguishes two units
of one model and software with equal hours. OMEGA reports none of these.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations

from jbclog.core.errors import LinkError, NotSupported, OtherStation, StationError
from jbclog.core.quantities import Value
from jbclog.core.rows import Severity
from jbclog.protocol.client.confirmed_reads import read_confirmed, unanswered_read
from jbclog.protocol.commands.family import family_of
from jbclog.protocol.commands.plugged_hours import can_be
from jbclog.session.rates import IDENTITY_READS
from jbclog.session.run.context import SessionContext
from jbclog.session.run.state import Identity


async def learn_identity(context: SessionContext) -> None:
    """Store the plugged hours of each port, with model and software, to recognize the station
    later.
    """
    state = context.state
    state.identity_at = dict.fromkeys(IDENTITY_READS, context.now)
    state.has_identity = True
    for number in state.ports:
        hours = await _hours(context, number)
        if hours is not None:
            state.plugged_hours[number] = (hours, context.now)
            state.ports[number].counted[state.family.counters[0].name] = hours


async def recognise(context: SessionContext, model: str | None) -> bool:
    """Return True if the station with the name `model` is this run's. Another one is reported once,
    and neither read nor written.

    Raises `StationError` or `LinkError` if it cannot be read.
    """
    state = context.state
    state.answers_as = None
    if model != state.facts.model:
        state.answers_as = Identity(model)
        other: str | None = f"a {model}, not the {state.facts.model}"
    else:
        other = await _difference(context)
    if other is None and state.facts.model_accepted:
        other = await _other_kind(context)
    state.is_proven = other is None
    if other is not None and other != state.stranger:
        text = (
            f"On {context.order.url} there is now {other} of this run. It is neither read nor"
            " written."
        )
        context.log.note("identity.changed", Severity.CRITICAL, text, raw=model)
    state.stranger = other
    if state.is_proven:
        state.identity_at = dict.fromkeys(IDENTITY_READS, context.now)
    return state.is_proven


async def is_still_there(context: SessionContext) -> bool:
    """Check model and software on the intact link before the safe order; return False for signs of
    another station.

    Only a different answer is a sign. A station that is silent, refuses, or is garbled counts as
    the same: it was proven before, and a hot tool must not wait.
    """
    try:
        for name in IDENTITY_READS:
            known = context.state.said_at_start(name)
            if known is None:
                continue
            found = await read_confirmed(context.station, context.command(name), known=known)
            if found != known:
                return False
    except LinkError:
        return False
    except StationError:
        return True
    return True


async def _other_kind(context: SessionContext) -> str | None:
    """Describe why a station with an accepted name is of another kind than at the start; None if it
    is not.
    """
    state = context.state
    why = await unanswered_read(context.station, state.family, min(state.ports))
    return None if why is None else f"a {state.facts.model} of another kind ({why})"


async def _difference(context: SessionContext) -> str | None:
    """Describe how a station of the same model differs from this run's; None if it does not."""
    state = context.state
    model, software = state.facts.model, state.facts.software
    if software is not None:
        found = await context.reads.confirmed(context.command("software_version"), known=software)
        if found != software:
            state.answers_as = Identity(model, str(found))
            return f"a {model} with software {found}, not the one with {software}"
    for number, (before, then) in state.plugged_hours.items():
        hours = await _hours(context, number, before)
        if hours is not None and not can_be(hours, before, context.now - then):
            state.answers_as = Identity(model, software, {number: hours})
            return (
                f"a {model} with {hours} plugged hours on port {number}, not the one with {before}"
            )
    return None


def expect_same(context: SessionContext, number: int, hours: Value) -> None:
    """Raise `OtherStation` if the plugged hours just read cannot be those of this run's station."""
    before, then = context.state.plugged_hours.get(number, (None, 0.0))
    if before is None or not isinstance(hours, int):
        return
    if not can_be(hours, before, context.now - then):
        raise OtherStation(
            f"the plugged hours of port {number} are {hours}, and were {before}", since=then
        )
    context.state.plugged_hours[number] = hours, context.now


def expect_identity(context: SessionContext, name: str, value: Value) -> None:
    """Raise `OtherStation` if the model or software just read is not that of this run's station."""
    known = context.state.said_at_start(name)
    if value != known:
        since = context.state.identity_at.get(name, context.order.t0)
        raise OtherStation(f"its {name.replace('_', ' ')} is {value}, and was {known}", since=since)
    context.state.identity_at[name] = context.now


async def expect_still_same(context: SessionContext) -> None:
    """Read model and software again over the intact link before recording a change as the
    station's.

    Raises `OtherStation` if another one answers, and whatever reading raises: then the change may
    not be the station's.
    """
    for name in IDENTITY_READS:
        known = context.state.said_at_start(name)
        if known is None:
            continue
        try:
            found = await context.reads.confirmed(context.command(name), known=known)
        except NotSupported as error:
            since = context.state.identity_at.get(name, context.order.t0)
            raise OtherStation(
                f"it no longer knows its {name.replace('_', ' ')}", since=since
            ) from error
        expect_identity(context, name, found)


async def _hours(context: SessionContext, number: int, known: int | None = None) -> int | None:
    """Read the plugged hours of a port; None if the station has none."""
    counter = context.state.family.hours
    if counter is None:
        return None
    try:
        hours = await context.reads.confirmed(
            context.command(counter), number, known=known, grows=True
        )
    except NotSupported:
        return None
    return hours if isinstance(hours, int) else None


# -- stations of one line that may have been mixed up ----------------------------------------------
#
# A session sees one cable only. That another station answers on it says that *something* is wrong;
# two sessions that each see the other's station say what: the cables are swapped.


def swapped(contexts: Sequence[SessionContext]) -> Iterator[tuple[SessionContext, SessionContext]]:
    """Yield pairs of stations of which each answers as the other."""
    strange = [context for context in contexts if context.state.answers_as is not None]
    for first, second in combinations(strange, 2):
        if _stands_for(first, second) and _stands_for(second, first):
            yield first, second


def _stands_for(found: SessionContext, meant: SessionContext) -> bool:
    """Return True if the station on the cable of `found` can be the one of `meant`."""
    answer = found.state.answers_as
    if answer is None:
        return False
    if meant.state.has_identity:
        return answer.may_be(meant.state.identity())
    if meant.order.model is not None:
        return answer.model == meant.order.model
    family = meant.order.family
    if family is None or answer.model is None:
        return False
    proven = family_of(answer.model)
    return proven is not None and proven.name == family.name


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
        facts = context.state.facts
        if context.state.has_identity and facts.model is not None:
            of_kind[facts.model, facts.software].append(context)
    names: dict[str, list[str]] = {}
    for group in of_kind.values():
        for first, second in combinations(group, 2):
            if first.state.identity().may_be(second.state.identity()):
                names.setdefault(first.name, []).append(second.name)
                names.setdefault(second.name, []).append(first.name)
    return names
