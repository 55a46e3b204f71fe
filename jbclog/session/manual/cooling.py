"""What is known of how a tool cools that was told to rest: what it does next by itself, and when it was last seen below a limit.

A tool that stands keeps its setpoint until its sleep delay is over, and its sleep temperature until the hibernation delay is.
What cannot be read is not known, and counts neither as cooling nor as cold.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from jbclog.core.errors import LinkError, StartRefused, StationError
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import OFF
from jbclog.protocol.commands.command import TOOLS_WITH_A_PLACE
from jbclog.protocol.commands.possible import NO_COUNTDOWN
from jbclog.session.manual.contact import NO_TOOL, Contact, Place, Target, find_tool, meet
from jbclog.session.manual.plausible import believed

SLEEPS, HIBERNATES = "sleep", "hibernate"
DELAYS: Final[Mapping[str, str]] = MappingProxyType({SLEEPS: "sleep_delay", HIBERNATES: "hibernation_delay"})
NEXT_FROM: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType({"stand": (SLEEPS, HIBERNATES), "sleep": (HIBERNATES,)})
"""What a tool does next by itself, by the state that it is in; from no other does it go anywhere."""


@dataclass(frozen=True, slots=True)
class Cooling:
    """What follows on the state that a tool rests in.

    `follows`: what it does by itself, in turn; empty where its heater is off. `in_s` are the seconds to the first of these, None
    where they are not known. `never` are those that its delays are off for, None where those could not be read.
    """

    follows: tuple[str, ...] = ()
    in_s: int | None = None
    never: tuple[str, ...] | None = ()

    def text(self) -> str:
        """``sleeps in 2 min 56 s``; ``will not sleep by itself, its delay is off``; ``its heater is off``."""
        if not self.follows:
            return "its heater is off"
        first, never = self.follows[0], self.never or ()
        if first in never:
            found = [f"will not {first} by itself, its delay is off"]
        elif self.in_s is None:
            found = [f"when it {first}s is not known"]
        else:
            found = [f"{first}s in {duration(self.in_s)}"]
        found += [
            f"will not {what} by itself, its delay is off" for what in self.follows[1:] if what in never and first not in never
        ]
        return ", ".join(found)


def duration(seconds: float) -> str:
    """``2 min 56 s``, ``45 s``, ``30 min``."""
    minutes, rest = divmod(round(seconds), 60)
    parts = [f"{minutes} min"] if minutes else []
    return " ".join([*parts, *([f"{rest} s"] if rest or not minutes else [])])


def cooling_of(contact: Contact, port: int, code: int | None, state: str) -> Steps[Cooling]:
    """What the tool with this code in `port` does next; `state` is what it rests in. Raises nothing that a station does."""
    follows = NEXT_FROM.get(state, ()) if DELAYS[SLEEPS] in contact.family.commands else ()
    if not follows:
        return Cooling()
    never = yield from _never(contact, Place(port, code), follows)
    return Cooling(follows, (yield from _countdown(contact, port)), never)


def _never(contact: Contact, place: Place, follows: tuple[str, ...]) -> Steps[tuple[str, ...] | None]:
    if place.tool is not None and place.tool not in TOOLS_WITH_A_PLACE:
        return None
    found = []
    try:
        for what in follows if place.tool is not None else ():
            if (yield from contact.agreed(contact.family.commands[DELAYS[what]], place)) is OFF:
                found.append(what)
    except (StationError, LinkError):
        return None
    return tuple(found)


def _countdown(contact: Contact, port: int) -> Steps[int | None]:
    """The seconds that the station still counts; None where it counts none, or does not tell."""
    command = contact.family.command_of("delay_s")
    try:
        left = None if command is None else (yield from believed(contact, command, Place(port)))
    except (StationError, LinkError):
        return None
    return left if isinstance(left, int) and left not in NO_COUNTDOWN else None


def temperature_of(contact: Contact, port: int) -> Steps[float | None]:
    """The temperature of the tool in `port` by two answers; None where it is not told, or there is no tool to have one."""
    command = contact.family.command_of("temperature_c")
    try:
        if command is None or (yield from find_tool(contact, port)) == NO_TOOL:
            return None
        value = yield from believed(contact, command, Place(port))
    except (StationError, LinkError):
        return None
    return float(value) if isinstance(value, int | float) else None


def temperatures(target: Target, model: str | None, ports: tuple[int, ...]) -> Steps[dict[int, float]]:
    """The temperatures of these tools now, of those that can be had; nothing of a station that is another by now."""
    try:
        contact = yield from meet(target)
    except (StationError, StartRefused):
        return {}
    if contact.model != model:
        return {}
    found = {}
    for port in ports:
        celsius = yield from temperature_of(contact, port)
        if celsius is not None:
            found[port] = celsius
    return found
