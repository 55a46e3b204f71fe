"""Dangerous commands: their effects, and the snapshot of settings taken before sending one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from jbclog.core.errors import NotSupported, StartRefused, StationError
from jbclog.core.quantities import text_of
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import FAMILIES, Family
from jbclog.session.manual.contact import (
    NO_TOOL,
    Contact,
    everywhere,
    find_ports,
    find_tool,
    sentence,
    title,
    tools_of,
)
from jbclog.session.manual.value_text import shown
from jbclog.session.setting_write import Place

# above it nothing is restarted or reset, because the tool's reaction is unknown
COOL_C: Final = 60
ONLY_COLD: Final = frozenset({"restart", "factory_reset"})

WHAT: Final[Mapping[str, str]] = MappingProxyType(
    {
        "restart": (
            "restarts the station: it is silent for some seconds and loses its volatile settings,"
            " such as the selected temperatures"
        ),
        "factory_reset": (
            "resets all parameters of the station to factory values, including limits and those of"
            " every tool"
        ),
        "store": (
            "writes the selected temperatures into the station's EEPROM, which wears with every"
            " write"
        ),
        "address": (
            "gives the station another address on its link; 0 switches addresses off, and no manual"
            " prints how to switch them on again"
        ),
        "ignore_fuse_error": (
            "lets the station continue to work although it reports its fuse missing"
        ),
        "start_feeding": (
            "starts the solder feeder: it feeds solder wire until the length is fed, or until it is"
            " stopped"
        ),
        "store_condition": (
            "overwrites one of the controller's solder conditions for everyone who uses it"
        ),
        "run_condition": "runs a solder condition now: the machine moves and feeds solder",
    }
)
RESETS_SETTINGS: Final = (
    'is listed as "reset station settings" and described nowhere: the station may be silent for'
    " some seconds, and all its settings may be reset to factory values"
)
HOT_AIR_MANUAL: Final = "001"
LIMITS: Final = (("maximum_", "highest"), ("minimum_", "lowest"))


def what_it_does(command: Command) -> str:
    """Describe the danger of a command to the person sending it; without a text, its effect."""
    for beginning, which in LIMITS:
        if command.name.startswith(beginning):
            what = command.name.removeprefix(beginning).replace("_", " ")
            return f"moves the {which} {what} that can be selected on the whole station"
    if command.name == "restart" and command.manual.startswith(HOT_AIR_MANUAL):
        return RESETS_SETTINGS  # docs/reference/contradictions.md, B-40
    return WHAT.get(command.name, command.effect.value)


def is_dangerous(name: str, family: Family | None) -> bool:
    """Return True if the command of that name is dangerous in `family`; if that is None, in any
    family.
    """
    families = FAMILIES.values() if family is None else (family,)
    return any(one.commands[name].dangerous for one in families if name in one.commands)


async def expect_cold(contact: Contact) -> None:
    """Raise `StartRefused` if a tool is hotter than `COOL_C`; an unread one counts as hot."""
    for port in await find_ports(contact):
        if await find_tool(contact, port) != NO_TOOL:
            await _expect_cold(contact, port)


async def _expect_cold(contact: Contact, port: int) -> None:
    command = contact.family.command_of("temperature_c")
    if command is None:
        return
    try:
        celsius = await _highest(contact, command, Place(port))
    except StationError as error:
        raise StartRefused(
            f"{contact.name}: port {port} counts as hot, because its temperature cannot be read"
            f" ({sentence(error)})"
        ) from error
    if celsius is None or celsius > COOL_C:
        found = (
            "reports no plausible temperature and counts as hot"
            if celsius is None
            else f"is at {celsius:g} °C"
        )
        rest = contact.family.safe_states[0] if contact.family.safe_states else "rest"
        raise StartRefused(
            f"{contact.name}: port {port} {found}; this is sent only when all tools are at {COOL_C}"
            f" °C or below. Put it to {rest}, or take the tool out, and wait"
        )


async def _highest(contact: Contact, command: Command, place: Place) -> float | None:
    """Return the higher of two readings; None if one of them is implausible."""
    found = []
    for _ in range(2):
        value = await contact.read(command, place)
        if (
            not isinstance(value, int | float)
            or not contact.family.plausible_c.start <= value < contact.family.plausible_c.stop
        ):
            return None
        found.append(value)
    return max(found)


# A snapshot has all settings that can be written and read back, of the station, its ports and the
# connected tools, so that a person can restore them. It includes other tools, because a reset
# affects their adjustments, but those may be missing.


@dataclass(frozen=True, slots=True)
class KeptSetting:
    """One setting: `value` in its unit, in the syntax of `jbclog write`; `raw` is the data
    field.
    """

    port: int | None
    tool: int | None
    condition: int | None
    setting: str
    value: str
    uom: str
    raw: str
    manual: str


@dataclass(slots=True)
class Snapshot:
    """A station's settings. `absent` names those it lacks."""

    station: str
    url: str
    family: str
    model: str | None
    settings: list[KeptSetting] = field(default_factory=list)
    absent: list[str] = field(default_factory=list)


Keep = Callable[[Snapshot], None]
"""Stores a snapshot durably before it returns, or raises `RecordError`."""


async def take_snapshot(contact: Contact, number: int | None = None) -> Snapshot:
    """Read all settings; of numbered ones, only that of `number`.

    Raises `StartRefused` if one of them cannot be read; nothing has been changed then.
    """
    target = contact.target
    taken = Snapshot(target.name, target.url, contact.family.name, contact.model)
    numbered = [
        command
        for command in contact.family.commands.values()
        if command.scope is Scope.CONDITION and command.readable
    ]
    wanted = [(command, Place(condition=number)) for command in numbered if number is not None]
    for command, place in [*await everywhere(contact, _settings(contact)), *wanted]:
        try:
            await _take(contact, command, place, taken)
        except StationError as error:
            raise StartRefused(
                f"{contact.name}: {title(command, place)} cannot be read ({sentence(error)}), so"
                " there is no whole snapshot of the settings; nothing was written"
            ) from error
    await _take_unconnected(contact, taken)
    return taken


def _settings(contact: Contact) -> list[Command]:
    return [command for command in contact.family.commands.values() if command.access == "rw"]


async def _take(contact: Contact, command: Command, place: Place, taken: Snapshot) -> None:
    try:
        value = await contact.read_confirmed(command, place)
    except NotSupported:
        taken.absent.append(title(command, place))
        return
    text = shown(value, command, contact.family) if isinstance(value, tuple) else text_of(value)
    kept = KeptSetting(
        *place, command.name, text, command.unit, contact.client.data, command.manual
    )
    taken.settings.append(kept)


async def _take_unconnected(contact: Contact, taken: Snapshot) -> None:
    """Read other tools' settings, as far as the station answers; skip a tool on failure."""
    of_tools = [command for command in _settings(contact) if command.scope is Scope.TOOL]
    for place in await _unconnected(contact):
        for command in of_tools:
            try:
                await _take(contact, command, place, taken)
            except StationError:
                taken.absent.append(title(command, place))
                break


async def _unconnected(contact: Contact) -> list[Place]:
    found = []
    for port in await find_ports(contact):
        connected = await find_tool(contact, port)
        found += [Place(port, tool) for tool in tools_of(contact.family) if tool != connected]
    return found
