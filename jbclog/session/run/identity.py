"""Is it still the same station? Asked whenever a cable was out: adapters swap names, and people swap cables.

The model alone proves little on a line of equal units, so the software version and the plugged hours are compared too:
hours never fall, and grow no faster than time (docs/reference/faults.md, F-16 and F-17). They are so whenever
they are read, because
who is quick swaps two cables between two questions; model and software are read again as often as the counters. Two units of
one model and software whose hours agree cannot be told apart by anything that the manuals print. OMEGA tells none of these:
that one answers is all that is known of it.
"""

from __future__ import annotations

from jbclog.core.errors import NotSupported, OtherStation
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value
from jbclog.core.rows import Severity
from jbclog.protocol.client.family_proof import why_not_answering
from jbclog.session.run.context import SessionContext

SAID = ("model", "software_version")  # reads by which a station says who it is, the same all through a run
RESOLUTION_H = 1  # the counters count whole hours
DRIFT = 0.01  # by which a station's clock may differ from ours
ROLLS_OVER_AT = 100_000  # five digits


def learn_identity(context: SessionContext) -> Steps[None]:
    """Note the plugged hours of each port beside model and software, to know the station by later."""
    context.said_at = dict.fromkeys(SAID, context.now)
    for number in context.ports:
        hours = yield from _hours(context, number)
        if hours is not None:
            context.plugged_hours[number] = (hours, context.now)


def recognise(context: SessionContext, model: str | None) -> Steps[bool]:
    """Whether `model` answers for this run's station. A stranger is told once, and neither read further nor written.

    Raises `StationError` or `LinkError` where it cannot be asked.
    """
    other = f"a {model}, not the {context.facts.model}" if model != context.facts.model else (yield from _difference(context))
    if other is None and context.facts.model_accepted:
        other = yield from _other_kind(context)
    context.is_proven = other is None
    if other is not None and other != context.stranger:
        text = f"On {context.order.url} there is now {other} of this run. It is neither read nor written."
        context.note("identity.changed", Severity.CRITICAL, text, raw=model)
    context.stranger = other
    if context.is_proven:
        context.said_at = dict.fromkeys(SAID, context.now)
    return context.is_proven


def _other_kind(context: SessionContext) -> Steps[str | None]:
    """Why a station with an accepted name is not of the kind that was borne out at the start; None where it is."""
    why = yield from why_not_answering(context.station, context.family, min(context.ports))
    return None if why is None else f"a {context.facts.model} of another kind ({why})"


def _difference(context: SessionContext) -> Steps[str | None]:
    """How the station differs from this run's, of the same model; None where it does not."""
    model, software = context.facts.model, context.facts.software
    if software is not None:
        found = yield from context.agreed(context.command("software_version"), known=software)
        if found != software:
            return f"a {model} with software {found}, not the one with {software}"
    for number, (before, then) in context.plugged_hours.items():
        hours = yield from _hours(context, number, before)
        if hours is not None and not _can_be(hours, before, context.now - then):
            return f"a {model} with {hours} plugged hours on port {number}, not the one with {before}"
    return None


def expect_same(context: SessionContext, number: int, hours: Value) -> None:
    """Raise `OtherStation` where plugged hours that were just read cannot be those of this run's station."""
    before, then = context.plugged_hours.get(number, (None, 0.0))
    if before is None or not isinstance(hours, int):
        return
    if not _can_be(hours, before, context.now - then):
        raise OtherStation(f"the plugged hours of port {number} are {hours}, and were {before}", since=then)
    context.plugged_hours[number] = hours, context.now


def is_said(context: SessionContext, name: str, value: Value) -> bool:
    """Whether `value` is what the station said at the start, when it was asked for its model or its software."""
    return value == (context.facts.model if name == SAID[0] else context.facts.software)


def expect_said(context: SessionContext, name: str, value: Value) -> None:
    """Raise `OtherStation` where a model or a software that was just read is not that of this run's station."""
    if not is_said(context, name, value):
        known = context.facts.model if name == SAID[0] else context.facts.software
        what = name.replace("_", " ")
        raise OtherStation(f"its {what} is {value}, and was {known}", since=context.said_at.get(name, context.order.t0))
    context.said_at[name] = context.now


def _can_be(hours: int, before: int, seconds: float) -> bool:
    """Whether a counter that stood at `before` can stand at `hours` so many seconds later."""
    return (hours - before) % ROLLS_OVER_AT <= seconds / 3600 * (1 + DRIFT) + RESOLUTION_H


def _hours(context: SessionContext, number: int, known: int | None = None) -> Steps[int | None]:
    """The plugged hours of a port; None where the station does not count them."""
    counter = context.family.hours
    if counter is None:
        return None
    try:
        hours = yield from context.agreed(context.command(counter), number, known=known, grows=True)
    except NotSupported:
        return None
    return hours if isinstance(hours, int) else None
