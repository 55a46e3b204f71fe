"""Reading a tip while a thermometer is at it: its temperature several times, with its setting before and after. Only questions."""

from __future__ import annotations

from dataclasses import dataclass, field

from jbclog.core.errors import StartRefused, StationError
from jbclog.core.io_requests import Steps, Wait
from jbclog.core.quantities import Value
from jbclog.session.manual.contact import Contact, Place, Target, find_ports, find_tool, meet, sentence
from jbclog.session.manual.plausible import believed

READINGS, EVERY_S = 12, 0.5


@dataclass(slots=True)
class TipReadings:
    """What the station said: `temperatures` in °C in their order, `states` and `settings` (°C) before and after them."""

    model: str | None
    tool: str | None
    adjust_c: float | None
    temperatures: list[float] = field(default_factory=list)
    states: list[str] = field(default_factory=list)
    settings: list[float] = field(default_factory=list)


def read_tip(target: Target, port: int) -> Steps[TipReadings]:
    """Read the tip of `port` for `READINGS` × `EVERY_S` s.

    Raises `StartRefused` where nobody usable answers, there is no such port, no tool in it, or no tip that tells its temperature.
    """
    contact = yield from meet(target)
    ports = yield from find_ports(contact)
    if port not in ports:
        raise StartRefused(f"{contact.name}: there is no port {port}; it has {', '.join(map(str, ports)) or 'none'}")
    temperature = contact.family.command_of("temperature_c")
    if temperature is None:
        raise StartRefused(f"{contact.name}: a {contact.family.name} tells no temperature; read it off its display: --station-c")
    tool = (yield from find_tool(contact, port)) if contact.family.tools else None
    if contact.family.tools and not tool:
        raise StartRefused(f"{contact.name}: there is no tool in port {port}")
    adjust = yield from _number(contact, "adjust", Place(port, tool))
    found = TipReadings(contact.model, contact.family.tool_name(tool) if tool else None, adjust)
    yield from _state(contact, port, found)
    try:
        for _ in range(READINGS):
            value = yield from believed(contact, temperature, Place(port))
            if isinstance(value, int | float):
                found.temperatures.append(float(value))
            contact.client.unasked((yield Wait(contact.client.now + EVERY_S)))
    except StationError as error:
        raise StartRefused(f"{contact.name}: its tip could not be read: {sentence(error)}") from error
    yield from _state(contact, port, found)
    return found


def _state(contact: Contact, port: int, found: TipReadings) -> Steps[None]:
    status = contact.family.command_of("status")
    if status is not None:
        value = yield from _value(contact, status.name, Place(port))
        if isinstance(value, tuple):
            found.states.append(contact.family.status.state(value))
    selected = contact.family.command_of("set_c")
    setting = None if selected is None else (yield from _number(contact, selected.name, Place(port)))
    found.settings += [] if setting is None else [setting]


def _number(contact: Contact, name: str, place: Place) -> Steps[float | None]:
    value = yield from _value(contact, name, place)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _value(contact: Contact, name: str, place: Place) -> Steps[Value | None]:
    """A steady value by its name; None where the family has none of that name, or the station does not tell it."""
    command = contact.family.commands.get(name)
    if command is None:
        return None
    try:
        return (yield from contact.agreed(command, place))
    except StationError:
        return None
