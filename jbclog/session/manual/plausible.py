"""Which answer is believed when a person asks: none of one alone, and none that cannot be.

What stands still, a name, a tool, an error, a setting, a counter, is asked until two answers agree. What moves is asked until
two are about the same, or of three the middle one lies between the others. What reading clears is asked once: a second answer
would be another.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from jbclog.core.errors import ImplausibleAnswer, StationError
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value
from jbclog.protocol.client.agreement import ANSWERS
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.possible import STILL_C, TEMPERATURES, Possible, is_share, possible_as
from jbclog.session.manual.contact import NOWHERE, Contact, Place, title

COMPARE = "ask again, and compare with the station's display"
APART: Mapping[str, int] = MappingProxyType(
    {**dict.fromkeys(TEMPERATURES, STILL_C), "power_permille": 100, "delay_s": 2}  # s: the seconds count while they are asked for
)
"""How far two answers to the same question may be from each other, in the signal's unit."""


def believed(contact: Contact, command: Command, place: Place) -> Steps[Value]:
    """Ask until an answer can be believed. Raises `ImplausibleAnswer` where none can, and what asking raises."""
    if command.asked_once:
        return (yield from contact.read(command, place))
    signal = contact.family.signal_of(command.name)
    possible = possible_as(signal, contact.family)
    if signal is not None and possible is not None:
        return (yield from _moving(contact, command, place, possible, APART[signal]))
    whole = yield from _whole(contact, command)
    is_counter = any(counter.command == command.name for counter in contact.family.counters)
    value = yield from contact.agreed(command, place, grows=is_counter)
    if whole is not None and not is_share(value, whole):
        raise _cannot_be(command, place, [value])
    return value


def _whole(contact: Contact, command: Command) -> Steps[int | None]:
    """What the station tells as the greatest value of `command`; None where it tells none."""
    greatest = contact.family.commands.get(str(command.share_of))
    try:
        whole = None if greatest is None else (yield from contact.agreed(greatest, NOWHERE))
    except StationError:
        return None
    return whole if isinstance(whole, int) and whole > 0 else None


def _moving(contact: Contact, command: Command, place: Place, possible: Possible, apart: int) -> Steps[Value]:
    given: list[Value] = []
    while len(given) < ANSWERS:
        answer = yield from contact.read(command, place)
        is_said_again = answer in given
        given.append(answer)
        if possible(answer):
            value = settled(list(filter(possible, given)), apart)
            if value is not None:
                return value
        elif is_said_again:
            raise _cannot_be(command, place, [answer])
    if not any(map(possible, given)):
        raise _cannot_be(command, place, given)
    said = ", ".join(map(command.shown, given))
    raise ImplausibleAnswer(f"{title(command, place)}: the station says {said} when asked {len(given)} times; {COMPARE}")


def _cannot_be(command: Command, place: Place, given: Sequence[Value]) -> ImplausibleAnswer:
    said = ", ".join(dict.fromkeys(map(command.shown, given)))
    return ImplausibleAnswer(f"{title(command, place)}: the station says {said}, which cannot be; {COMPARE}")


def settled(given: Sequence[Value], apart: int) -> Value | None:
    """What `given`, the answers so far, oldest first, agree on with the last of them, which may be `apart` from another."""
    numbers = [one for one in given if isinstance(one, int | float)]
    *before, last = numbers
    if any(abs(one - last) <= apart for one in before):
        return last
    if len(before) < 2:
        return None
    first, middle = before[-2:]
    return middle if first <= middle <= last or first >= middle >= last else None
