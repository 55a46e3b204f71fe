"""All settings of a station, read before something dangerous is done to it, so that they can be set again by hand.

Whole means: everything that can be written and read back, of the station, its ports, and the tools connected. Tools that are not
connected are asked for too, because a reset takes their adjustments with it; a station that does not tell them is no obstacle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from jbclog.core.errors import NotSupported, StartRefused, StationError
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import text_of
from jbclog.protocol.commands.command import Command, Scope
from jbclog.session.manual.contact import Contact, Place, everywhere, find_ports, find_tool, sentence, title, tools_of
from jbclog.session.manual.values import shown


@dataclass(frozen=True, slots=True)
class KeptSetting:
    """One setting as it was: `value` in its unit and as `jbclog write` takes it, `raw` the data field."""

    port: int | None
    tool: int | None
    condition: int | None
    setting: str
    value: str
    unit: str
    raw: str
    manual: str


@dataclass(slots=True)
class Snapshot:
    """What a station's settings are. `absent` names what it does not have."""

    station: str
    url: str
    family: str
    model: str | None
    settings: list[KeptSetting] = field(default_factory=list)
    absent: list[str] = field(default_factory=list)


Keep = Callable[[Snapshot], None]
"""Puts a snapshot where it lasts before it returns, or raises `RecordError`."""


def take_snapshot(contact: Contact, number: int | None = None) -> Steps[Snapshot]:
    """Read all settings; of those that are kept under numbers, that of `number`.

    Raises `StartRefused` where one of them cannot be had; then nothing has been changed.
    """
    target = contact.target
    taken = Snapshot(target.name, target.url, contact.family.name, contact.model)
    numbered = [command for command in contact.family.commands.values() if command.scope is Scope.CONDITION and command.readable]
    wanted = [(command, Place(condition=number)) for command in numbered if number is not None]
    for command, place in [*(yield from everywhere(contact, _settings(contact))), *wanted]:
        try:
            yield from _take(contact, command, place, taken)
        except StationError as error:
            raise StartRefused(
                f"{contact.name}: {title(command, place)} cannot be read ({sentence(error)}), so there is no whole snapshot "
                "of the settings; nothing was written"
            ) from error
    yield from _take_unconnected(contact, taken)
    return taken


def _settings(contact: Contact) -> list[Command]:
    return [command for command in contact.family.commands.values() if command.access == "rw"]


def _take(contact: Contact, command: Command, place: Place, taken: Snapshot) -> Steps[None]:
    try:
        value = yield from contact.agreed(command, place)
    except NotSupported:
        taken.absent.append(title(command, place))
        return
    text = shown(value, command, contact.family) if isinstance(value, tuple) else text_of(value)
    kept = KeptSetting(*place, command.name, text, command.unit, contact.client.data, command.manual)
    taken.settings.append(kept)


def _take_unconnected(contact: Contact, taken: Snapshot) -> Steps[None]:
    """As far as the station tells: a tool of which one setting is not told is not asked further."""
    for place in (yield from _unconnected(contact)):
        for command in _of_tools(contact):
            try:
                yield from _take(contact, command, place, taken)
            except StationError:
                taken.absent.append(title(command, place))
                break


def _of_tools(contact: Contact) -> Iterator[Command]:
    return (command for command in _settings(contact) if command.scope is Scope.TOOL)


def _unconnected(contact: Contact) -> Steps[list[Place]]:
    found = []
    for port in (yield from find_ports(contact)):
        connected = yield from find_tool(contact, port)
        found += [Place(port, tool) for tool in tools_of(contact.family) if tool != connected]
    return found
