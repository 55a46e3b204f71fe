"""Is it still the same station? Asked whenever a cable was out: adapters swap names, and people swap cables.

The model alone proves little on a line of equal units, so the software version and the plugged hours are compared too:
hours never fall, and grow no faster than time (faults.md, rows 16 and 17). They are so whenever they are read, because
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


def learn_identity(desk: SessionContext) -> Steps[None]:
    """Note the plugged hours of each port beside model and software, to know the station by later."""
    desk.said_at = dict.fromkeys(SAID, desk.now)
    for number in desk.ports:
        hours = yield from _hours(desk, number)
        if hours is not None:
            desk.plugged_hours[number] = (hours, desk.now)


def recognise(desk: SessionContext, model: str | None) -> Steps[bool]:
    """Whether `model` answers for this run's station. A stranger is told once, and neither read further nor written.

    Raises `StationError` or `LinkError` where it cannot be asked.
    """
    other = f"a {model}, not the {desk.facts.model}" if model != desk.facts.model else (yield from _difference(desk))
    if other is None and desk.facts.model_accepted:
        other = yield from _other_kind(desk)
    desk.is_proven = other is None
    if other is not None and other != desk.stranger:
        text = f"On {desk.order.url} there is now {other} of this run. It is neither read nor written."
        desk.note("identity.changed", Severity.CRITICAL, text, raw=model)
    desk.stranger = other
    if desk.is_proven:
        desk.said_at = dict.fromkeys(SAID, desk.now)
    return desk.is_proven


def _other_kind(desk: SessionContext) -> Steps[str | None]:
    """Why a station with an accepted name is not of the kind that was borne out at the start; None where it is."""
    why = yield from why_not_answering(desk.station, desk.family, min(desk.ports))
    return None if why is None else f"a {desk.facts.model} of another kind ({why})"


def _difference(desk: SessionContext) -> Steps[str | None]:
    """How the station differs from this run's, of the same model; None where it does not."""
    model, software = desk.facts.model, desk.facts.software
    if software is not None:
        found = yield from desk.agreed(desk.command("software_version"), known=software)
        if found != software:
            return f"a {model} with software {found}, not the one with {software}"
    for number, (before, then) in desk.plugged_hours.items():
        hours = yield from _hours(desk, number, before)
        if hours is not None and not _can_be(hours, before, desk.now - then):
            return f"a {model} with {hours} plugged hours on port {number}, not the one with {before}"
    return None


def expect_same(desk: SessionContext, number: int, hours: Value) -> None:
    """Raise `OtherStation` where plugged hours that were just read cannot be those of this run's station."""
    before, then = desk.plugged_hours.get(number, (None, 0.0))
    if before is None or not isinstance(hours, int):
        return
    if not _can_be(hours, before, desk.now - then):
        raise OtherStation(f"the plugged hours of port {number} are {hours}, and were {before}", since=then)
    desk.plugged_hours[number] = hours, desk.now


def is_said(desk: SessionContext, name: str, value: Value) -> bool:
    """Whether `value` is what the station said at the start, when it was asked for its model or its software."""
    return value == (desk.facts.model if name == SAID[0] else desk.facts.software)


def expect_said(desk: SessionContext, name: str, value: Value) -> None:
    """Raise `OtherStation` where a model or a software that was just read is not that of this run's station."""
    if not is_said(desk, name, value):
        known = desk.facts.model if name == SAID[0] else desk.facts.software
        what = name.replace("_", " ")
        raise OtherStation(f"its {what} is {value}, and was {known}", since=desk.said_at.get(name, desk.order.t0))
    desk.said_at[name] = desk.now


def _can_be(hours: int, before: int, seconds: float) -> bool:
    """Whether a counter that stood at `before` can stand at `hours` so many seconds later."""
    return (hours - before) % ROLLS_OVER_AT <= seconds / 3600 * (1 + DRIFT) + RESOLUTION_H


def _hours(desk: SessionContext, number: int, known: int | None = None) -> Steps[int | None]:
    """The plugged hours of a port; None where the station does not count them."""
    counter = desk.family.hours
    if counter is None:
        return None
    try:
        hours = yield from desk.agreed(desk.command(counter), number, known=known, grows=True)
    except NotSupported:
        return None
    return hours if isinstance(hours, int) else None
