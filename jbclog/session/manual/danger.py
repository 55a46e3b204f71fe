"""What a dangerous command does, in words, and what must hold before it is sent (docs/reference/faults.md, S-5)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from jbclog.core.errors import StartRefused, StationError
from jbclog.core.io_requests import Steps
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import FAMILIES, Family
from jbclog.session.manual.contact import NO_TOOL, Contact, Place, find_ports, find_tool, sentence

COOL_C: Final = 60  # above it nothing is restarted or reset: who knows what the tool does next
ONLY_COLD: Final = frozenset({"restart", "factory_reset"})

WHAT: Final[Mapping[str, str]] = MappingProxyType(
    {
        "restart": "restarts the station: it is silent for some seconds, and what it keeps only while it is on is lost, "
        "the selected temperatures among it",
        "factory_reset": "sets all of the station's parameters to the factory's, those of every tool and the limits included",
        "store": "writes the selected temperatures into the station's EEPROM, which wears with every write",
        "address": "gives the station another address on its line; 0 switches addresses off, and no manual prints the way back",
        "ignore_fuse_error": "lets the station go on working although its fuse is reported to be missing",
        "start_feeding": "starts the solder feeder: wire moves until the length is fed, or until it is told to stop",
        "store_condition": "writes over one of the controller's solder conditions, for whoever runs it next",
        "run_condition": "runs a solder condition now: the machine moves and feeds solder",
    }
)
RESETS_SETTINGS: Final = (
    'is listed as "reset station settings" and described nowhere: the station may be silent for some seconds, '
    "and every setting that it holds may be the factory's afterwards"
)
HOT_AIR_MANUAL: Final = "001"
LIMITS: Final = (("maximum_", "highest"), ("minimum_", "lowest"))


def what_it_does(command: Command) -> str:
    """What is dangerous in it, for the person who is about to do it; where nobody has written that down, its effect."""
    for beginning, which in LIMITS:
        if command.name.startswith(beginning):
            what = command.name.removeprefix(beginning).replace("_", " ")
            return f"moves the {which} {what} that can be selected on the whole station"
    if command.name == "restart" and command.manual.startswith(HOT_AIR_MANUAL):
        return RESETS_SETTINGS  # docs/reference/contradictions.md, B-40
    return WHAT.get(command.name, command.effect.value)


def is_dangerous(name: str, family: Family | None) -> bool:
    """Whether the command of that name is dangerous; where the family is still to be learnt, in any family."""
    families = FAMILIES.values() if family is None else (family,)
    return any(one.commands[name].dangerous for one in families if name in one.commands)


def expect_cold(contact: Contact) -> Steps[None]:
    """Raise `StartRefused` where a tool is hotter than `COOL_C`, or may be: what cannot be read counts as hot."""
    for port in (yield from find_ports(contact)):
        if (yield from find_tool(contact, port)) != NO_TOOL:
            yield from _expect_cold(contact, port)


def _expect_cold(contact: Contact, port: int) -> Steps[None]:
    command = contact.family.command_of("temperature_c")
    if command is None:
        return
    try:
        celsius = yield from _highest(contact, command, Place(port))
    except StationError as error:
        raise StartRefused(
            f"{contact.name}: port {port} counts as hot, its temperature cannot be read ({sentence(error)})"
        ) from error
    if celsius is None or celsius > COOL_C:
        found = "tells no temperature that can be, and counts as hot" if celsius is None else f"is at {celsius:g} °C"
        rest = contact.family.safe_states[0] if contact.family.safe_states else "rest"
        raise StartRefused(
            f"{contact.name}: port {port} {found}; this is sent only when all tools are at {COOL_C} °C or below. "
            f"Put it to {rest}, or take the tool out, and wait"
        )


def _highest(contact: Contact, command: Command, place: Place) -> Steps[float | None]:
    """The higher of two readings; None where one of them is beyond what a tool can have."""
    found = []
    for _ in range(2):
        value = yield from contact.read(command, place)
        if not isinstance(value, int | float) or not contact.family.plausible_c.start <= value < contact.family.plausible_c.stop:
            return None
        found.append(value)
    return max(found)
