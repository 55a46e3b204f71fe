"""Reading by hand: one value at each place that is meant, or everything that a station can tell.

No value is told that one answer alone says, or that cannot be (`plausible.py`). What reading would clear is read only by its
name, and once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

from jbclog.core.errors import (
    ImplausibleAnswer,
    NotSupported,
    Refusal,
    RobotModeOff,
    StartRefused,
    StationError,
    StationSilent,
    UsageError,
)
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.omega_values import UNTOLD
from jbclog.session.manual.contact import Contact, Place, Target, everywhere, find_tool, meet, places, sentence
from jbclog.session.manual.names import find, readable, why_only_by_name
from jbclog.session.manual.plausible import believed

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Reading:
    """What a station told, or why it did not: then `value` is None, `reason` the record's word and `problem` the sentence.

    `data` is the data field as it came, the last one of what is not believed; `heard` is when it was there, monotonic seconds.
    `is_void`: it was told, or refused, and means nothing as the port is now. `is_absent`: the station does not have it.
    """

    command: Command
    place: Place
    value: Value | None
    data: str
    heard: float
    reason: str = ""
    problem: str = ""
    is_void: bool = False
    is_absent: bool = False


Tell = Callable[[Contact, Reading], None]
"""Takes each reading as it comes, with the station that it comes from."""


def read_value(target: Target, name: str, asked: Place, tell: Tell) -> Steps[None]:
    """Read the value of that name at each place that is meant.

    Raises `StartRefused` where nobody usable answers or the family has no such value, and `LinkError`.
    """
    contact = yield from meet(target)
    command = found_after_all(contact, lambda: find(name, contact.family, readable))
    for place in (yield from places(contact, command, asked)):
        tell(contact, (yield from _reading(contact, command, place)))


def read_all(target: Target, tell: Tell) -> Steps[None]:
    """Read everything that can be read without changing anything, at every place. Raises as `read_value` does."""
    contact = yield from meet(target)
    for command, place in (yield from everywhere(contact, harmless(contact.family))):
        tell(contact, (yield from _reading(contact, command, place)))


def harmless(family: Family) -> list[Command]:
    """What can be read as often as one likes, and without a number."""
    return [command for command in family.commands.values() if command.readable and not why_only_by_name(command)]


def only_by_name(family: Family) -> list[Command]:
    """What `read_all` leaves out."""
    return [command for command in family.commands.values() if command.readable and why_only_by_name(command)]


def found_after_all(contact: Contact, look: Callable[[], T]) -> T:
    """What `look` finds once the family is known. What it does not find was wrong usage no more: the station was asked."""
    try:
        return look()
    except UsageError as error:
        raise StartRefused(f"{contact.name} is a {contact.model}: {error}") from error


def _reading(contact: Contact, command: Command, place: Place) -> Steps[Reading]:
    """Raises only where nothing more can be read at all."""
    client = contact.client
    try:
        value = yield from believed(contact, command, place)
    except (StationSilent, RobotModeOff) as error:
        raise StartRefused(f"{contact.name}: {error}") from error
    except StationError as error:
        said = client.data if isinstance(error, ImplausibleAnswer) else ""
        is_absent = isinstance(error, NotSupported)
        failed = Reading(command, place, None, said, client.now, error.reason, sentence(error), is_absent=is_absent)
        return (yield from _unless_void(contact, failed)) if isinstance(error, Refusal | ImplausibleAnswer) else failed
    if value == UNTOLD:
        return Reading(command, place, None, client.data, client.heard, "no_digit", UNTOLD, is_void=True)
    return (yield from _unless_void(contact, Reading(command, place, value, command.as_it_came(client.data, value), client.heard)))


def _unless_void(contact: Contact, reading: Reading) -> Steps[Reading]:
    """The same, without its value where that means nothing without a tool, or because of the port's error.

    docs/reference/contradictions.md, B-44.
    """
    family, port = contact.family, reading.place.port
    signal = family.signal_of(reading.command.name)
    if port is None or signal is None or not family.may_be_void(signal):
        return reading
    tool = (yield from find_tool(contact, port)) if family.tools else None
    error = yield from _error_of(contact, port)
    why = family.void(signal, tool, error)
    if why is None:
        return reading
    number = f" (port error {error})" if error else ""
    return replace(reading, value=None, reason=why, problem=why.replace("_", " ") + number, is_void=True)


def _error_of(contact: Contact, port: int) -> Steps[int | None]:
    """The error of `port`; None where it is not told."""
    try:
        error = yield from contact.agreed(contact.family.commands["port_error"], Place(port))
    except (StationError, KeyError):
        return None
    return error if isinstance(error, int) else None
