"""Decide whether it is still the same station: adapters swap names, and people swap cables.

Checked after every disconnection. The model proves little on a production line of equal units, so
the software version and the plugged hours are compared too (docs/reference/faults.md, F-16 and
F-17). Hours are compared at every reading, because two cables can be swapped between two requests;
model and software are read as often as the counters. Nothing in the manuals distinguishes two units
of one model and software with equal hours. OMEGA reports none of these.
"""

from __future__ import annotations

from jbclog.core.errors import LinkError, NotSupported, OtherStation, StationError
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value
from jbclog.core.rows import Severity
from jbclog.protocol.client.confirmed_reads import read_confirmed, unanswered_read
from jbclog.protocol.commands.plugged_hours import can_be
from jbclog.session.rates import IDENTITY_READS
from jbclog.session.run.context import Identity, SessionContext


def learn_identity(context: SessionContext) -> Steps[None]:
    """Store the plugged hours of each port, with model and software, to recognize the station
    later.
    """
    context.identity_at = dict.fromkeys(IDENTITY_READS, context.now)
    context.has_identity = True
    for number in context.ports:
        hours = yield from _hours(context, number)
        if hours is not None:
            context.plugged_hours[number] = (hours, context.now)
            context.ports[number].counted[context.family.counters[0].name] = hours


def recognise(context: SessionContext, model: str | None) -> Steps[bool]:
    """Return True if the station with the name `model` is this run's. Another one is reported once,
    and neither read nor written.

    Raises `StationError` or `LinkError` if it cannot be read.
    """
    context.answers_as = None
    if model != context.facts.model:
        context.answers_as = Identity(model)
        other: str | None = f"a {model}, not the {context.facts.model}"
    else:
        other = yield from _difference(context)
    if other is None and context.facts.model_accepted:
        other = yield from _other_kind(context)
    context.is_proven = other is None
    if other is not None and other != context.stranger:
        text = (
            f"On {context.order.url} there is now {other} of this run. It is neither read nor"
            " written."
        )
        context.note("identity.changed", Severity.CRITICAL, text, raw=model)
    context.stranger = other
    if context.is_proven:
        context.identity_at = dict.fromkeys(IDENTITY_READS, context.now)
    return context.is_proven


def is_still_there(context: SessionContext) -> Steps[bool]:
    """Check model and software on the intact link before the safe order; return False for signs of
    another station.

    Only a different answer is a sign. A station that is silent, refuses, or is garbled counts as
    the same: it was proven before, and a hot tool must not wait.
    """
    try:
        for name in IDENTITY_READS:
            known = _identity(context, name)
            if known is not None and known != (
                yield from read_confirmed(context.station, context.command(name), known=known)
            ):
                return False
    except LinkError:
        return False
    except StationError:
        return True
    return True


def _other_kind(context: SessionContext) -> Steps[str | None]:
    """Describe why a station with an accepted name is of another kind than at the start; None if it
    is not.
    """
    why = yield from unanswered_read(context.station, context.family, min(context.ports))
    return None if why is None else f"a {context.facts.model} of another kind ({why})"


def _difference(context: SessionContext) -> Steps[str | None]:
    """Describe how a station of the same model differs from this run's; None if it does not."""
    model, software = context.facts.model, context.facts.software
    if software is not None:
        found = yield from context.read_confirmed(
            context.command("software_version"), known=software
        )
        if found != software:
            context.answers_as = Identity(model, str(found))
            return f"a {model} with software {found}, not the one with {software}"
    for number, (before, then) in context.plugged_hours.items():
        hours = yield from _hours(context, number, before)
        if hours is not None and not can_be(hours, before, context.now - then):
            context.answers_as = Identity(model, software, {number: hours})
            return (
                f"a {model} with {hours} plugged hours on port {number}, not the one with {before}"
            )
    return None


def expect_same(context: SessionContext, number: int, hours: Value) -> None:
    """Raise `OtherStation` if the plugged hours just read cannot be those of this run's station."""
    before, then = context.plugged_hours.get(number, (None, 0.0))
    if before is None or not isinstance(hours, int):
        return
    if not can_be(hours, before, context.now - then):
        raise OtherStation(
            f"the plugged hours of port {number} are {hours}, and were {before}", since=then
        )
    context.plugged_hours[number] = hours, context.now


def is_this_identity(context: SessionContext, name: str, value: Value) -> bool:
    """Return True if `value` is the station's model or software at the start."""
    return value == _identity(context, name)


def _identity(context: SessionContext, name: str) -> str | None:
    """Return the station's model or software at the start; None if it reported none."""
    return context.facts.model if name == IDENTITY_READS[0] else context.facts.software


def expect_identity(context: SessionContext, name: str, value: Value) -> None:
    """Raise `OtherStation` if the model or software just read is not that of this run's station."""
    if not is_this_identity(context, name, value):
        since = context.identity_at.get(name, context.order.t0)
        raise OtherStation(
            f"its {name.replace('_', ' ')} is {value}, and was {_identity(context, name)}",
            since=since,
        )
    context.identity_at[name] = context.now


def expect_still_same(context: SessionContext) -> Steps[None]:
    """Read model and software again over the intact link before recording a change as the
    station's.

    Raises `OtherStation` if another one answers, and whatever reading raises: then the change may
    not be the station's.
    """
    for name in IDENTITY_READS:
        known = _identity(context, name)
        if known is None:
            continue
        try:
            found = yield from context.read_confirmed(context.command(name), known=known)
        except NotSupported as error:
            since = context.identity_at.get(name, context.order.t0)
            raise OtherStation(
                f"it no longer knows its {name.replace('_', ' ')}", since=since
            ) from error
        expect_identity(context, name, found)


def _hours(context: SessionContext, number: int, known: int | None = None) -> Steps[int | None]:
    """Read the plugged hours of a port; None if the station has none."""
    counter = context.family.hours
    if counter is None:
        return None
    try:
        hours = yield from context.read_confirmed(
            context.command(counter), number, known=known, grows=True
        )
    except NotSupported:
        return None
    return hours if isinstance(hours, int) else None
