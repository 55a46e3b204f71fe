"""Open a station for a command: identify it, find its ports and tools."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from jbclog.core.errors import (
    NotSupported,
    OutOfRange,
    RobotModeOff,
    StartRefused,
    StationError,
    StationSilent,
    UsageError,
)
from jbclog.core.io_requests import reopen, wait
from jbclog.core.quantities import Value
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.client.confirmed_reads import NOT_DRIVEN, kind_problem, read_confirmed
from jbclog.protocol.client.interface import Client
from jbclog.protocol.client.make import client_for
from jbclog.protocol.client.timing import MODEL
from jbclog.protocol.commands.command import TOOLS_WITH_A_PLACE, Command, Scope
from jbclog.protocol.commands.family import (
    Family,
    family_of,
    model_not_accepted_text,
    other_model_text,
    unknown_model_text,
)
from jbclog.protocol.commands.omega import CLEANING, is_condition
from jbclog.session.setting_write import WHOLE_STATION, Place

PORTS = range(1, 5)
NO_TOOL = 0
CONDITIONS = "101 to 199, 201 to 299, 301 to 399, or 0 for the cleaning"


@dataclass(frozen=True, slots=True)
class Target:
    """A station as the line file describes it. `family` None: "auto". `ports` None: the family's.
    `model`: the accepted model name, if any.
    """

    name: str
    url: str
    family: Family | None
    line: LineFormat
    address: int | None
    ports: tuple[int, ...] | None
    model: str | None = None


def title(command: Command, place: Place) -> str:
    """Name a value: ``sleep_delay of port 1, tool 2``."""
    return (
        f"{command.name} of {place}"
        if any(number is not None for number in place)
        else command.name
    )


def sentence(error: StationError) -> str:
    """Return a station error's text without the name of the request."""
    return str(error).partition(": ")[2] or str(error)


@dataclass(slots=True)
class Contact:
    """A station that has answered. `model` None: not reported. `tools`: codes by port."""

    target: Target
    client: Client
    family: Family
    model: str | None
    ports: tuple[int, ...] | None
    tools: dict[int, int]

    @property
    def name(self) -> str:
        return self.target.name

    @property
    def is_proven(self) -> bool:
        """True if the model name proves the family whose tables are used."""
        if self.model is None or self.target.model is None:
            return self.model is None or self.family.proves(self.model)
        return self.model == self.target.model

    def stranger(self) -> str:
        """Describe how the station differs from the line file."""
        if self.target.model is not None:
            return f"{self.name}: {model_not_accepted_text(self.target.model, str(self.model))}"
        return (
            f"{self.name}: the line file says family {self.family.name}, the station says model"
            f" {self.model}"
        )

    async def read(self, command: Command, place: Place) -> Value:
        """Read once (the client repeats lost reads). Raises `StationError` and `LinkError`."""
        return await self.client.read(_numbered(command, place), place.port, place.tool)

    async def read_confirmed(
        self, command: Command, place: Place, *, known: Value | None = None, grows: bool = False
    ) -> Value:
        """Read until two answers are equal. Raises as `read` does."""
        return await read_confirmed(
            self.client,
            _numbered(command, place),
            place.port,
            place.tool,
            known=known,
            grows=grows,
        )

    async def value(self, name: str, place: Place) -> Value | None:
        """Return a confirmed value by its command's name; None if the family lacks it, or the
        station gives none. Raises `LinkError`.
        """
        if name not in self.family.commands:
            return None
        try:
            return await self.read_confirmed(self.family.commands[name], place)
        except StationError:
            return None


def _numbered(command: Command, place: Place) -> Command:
    return command if place.condition is None else command.numbered(place.condition)


async def open_contact(target: Target) -> Contact:
    """Open the port and identify the station. Raises `StartRefused` and `LinkError`."""
    client = client_for(target.family, target.line, target.address)
    client.unasked(await wait(0.0))
    client.unasked(await reopen())
    family = target.family
    if family is None or "model" in family.commands:
        model = str(await _first_answer(target, client, MODEL))
        family = family or _learnt(target, model)
        return Contact(target, client, family, model, target.ports or family.ports, {})
    await _first_answer(target, client, family.commands[family.harmless[0]], again=True)
    return Contact(target, client, family, None, target.ports or family.ports, {})


async def _first_answer(
    target: Target, client: Client, command: Command, *, again: bool = False
) -> Value:
    """Read the first answer. With `again`, ignore one silence: earlier bytes can swallow an OMEGA's
    first request.
    """
    try:
        return await read_confirmed(client, command)
    except StationSilent as error:
        if again:
            return await _first_answer(target, client, command)
        raise StartRefused(no_answer(target, error)) from error
    except RobotModeOff as error:
        raise StartRefused(
            f"{target.name}: Robot mode is off; switch it on in the station's menu"
        ) from error
    except StationError as error:
        raise StartRefused(no_answer(target, error)) from error


def no_answer(target: Target, error: StationError) -> str:
    """Say what to check if no usable answer arrives."""
    addressing = "without addresses" if target.address is None else f"address {target.address:02d}"
    robot_mode = (
        ""
        if target.family is not None and not target.family.models
        else "Robot mode is switched on in its menu, "
    )
    return (
        f"{target.name}: no usable answer on {target.url} at {target.line.baudrate}"
        f" {target.line.format}, {addressing} ({error}); check that the station is on,"
        f" {robot_mode}the cable, and the line format"
    )


def _learnt(target: Target, model: str) -> Family:
    family = family_of(model)
    if family is None:
        raise StartRefused(f"{target.name}: {unknown_model_text(model)}")
    return family


async def expect_proven(contact: Contact) -> None:
    """Raise `StartRefused` before anything is written if the family is not proven."""
    if not contact.is_proven:
        if contact.target.model is None:
            raise StartRefused(
                f"{contact.name}: {other_model_text(contact.family, str(contact.model))}"
            )
        raise StartRefused(
            f"{contact.stranger()}; nothing was written to it. Correct `model`, or the cable"
        )
    await expect_borne_out(contact)


async def expect_borne_out(contact: Contact) -> None:
    """Raise `StartRefused` if an accepted model name belongs to a station of another kind than its
    family's.
    """
    if contact.target.model is None:
        return
    why = await kind_problem(contact.client, contact.family, min(contact.ports or (1,)))
    if why is not None:
        model, family = contact.model, contact.family.name
        raise StartRefused(
            f"{contact.name}: model {model} is driven as {family} by the line file, but {why}."
            f" {NOT_DRIVEN}"
        )


async def find_ports(contact: Contact) -> tuple[int, ...]:
    """Return the ports named by the line file or the family, else those that answer."""
    if contact.ports is None:
        answering = [port for port in PORTS if await find_tool(contact, port) is not None]
        contact.ports = tuple(answering)
    return contact.ports


async def find_tool(contact: Contact, port: int) -> int | None:
    """Return the code of the tool in `port`, 0 for none; None for a missing port. One answer is
    enough.
    """
    if port not in contact.tools:
        command = contact.family.command_of("tool")
        code: Value = NO_TOOL
        if command is not None:
            try:
                code = await contact.read_confirmed(command, Place(port))
            except (NotSupported, OutOfRange):
                return None
        contact.tools[port] = code if isinstance(code, int) else NO_TOOL
    return contact.tools[port]


def check_place(
    command: Command, family: Family, ports: tuple[int, ...] | None, place: Place
) -> None:
    """Raise `UsageError` for an impossible port or tool, without a request."""
    if command.scope in (Scope.STATION, Scope.CONDITION) and place.port is not None:
        raise UsageError(f"{command.name} belongs to the whole station: omit --port")
    if command.scope is not Scope.TOOL and place.tool is not None:
        raise UsageError(f"{command.name} belongs to no tool: omit --tool")
    if command.scope is not Scope.CONDITION and place.condition is not None:
        raise UsageError(f"{command.name} belongs to no solder condition: omit --condition")
    number = place.condition
    is_number = number is not None and (number == CLEANING or is_condition(number))
    if command.scope is Scope.CONDITION and not is_number:
        raise UsageError(f"{command.name} needs --condition with a number: {CONDITIONS}")
    if place.port is not None and ports is not None and place.port not in ports:
        raise UsageError(
            f"there is no port {place.port}; this station has {', '.join(map(str, ports))}"
        )
    if place.tool is not None and place.tool not in TOOLS_WITH_A_PLACE:
        known = "; ".join(f"{code} {family.tools[code]}" for code in tools_of(family))
        raise UsageError(
            f"no command can address tool {place.tool}, only 1 to 9. Manual {family.manual} prints"
            f" {known}"
        )


def tools_of(family: Family) -> tuple[int, ...]:
    return tuple(code for code in family.tools if code != NO_TOOL)


async def places(contact: Contact, command: Command, asked: Place) -> list[Place]:
    """Return every place addressed: the given one, or all ports, with the tools in them.

    Raises `StartRefused` if a tool is needed and the port is empty.
    """
    if command.scope not in (Scope.PORT, Scope.TOOL):
        return [Place(condition=asked.condition)]
    ports = (asked.port,) if asked.port is not None else await find_ports(contact)
    return [await _place(contact, command, port, asked.tool) for port in ports]


async def _place(contact: Contact, command: Command, port: int, tool: int | None) -> Place:
    if command.scope is not Scope.TOOL or tool is not None:
        return Place(port, tool)
    connected = await find_tool(contact, port)
    if not connected:
        example = next(iter(tools_of(contact.family)))
        raise StartRefused(
            f"{contact.name}: {command.name} belongs to a tool, and there is none in port {port}; "
            f"name one with --tool, such as --tool {example} ({contact.family.tools[example]})"
        )
    if connected not in TOOLS_WITH_A_PLACE:
        raise StartRefused(
            f"{contact.name}: {command.name} belongs to a tool, and no command can address tool"
            f" {connected}"
        )
    return Place(port, connected)


async def everywhere(contact: Contact, commands: Iterable[Command]) -> list[tuple[Command, Place]]:
    """List every place of each command: the station, its ports, the tools in them."""
    ports = await find_ports(contact)
    targets: list[tuple[Command, Place]] = []
    for command in commands:
        if command.scope is Scope.STATION:
            targets.append((command, WHOLE_STATION))
            continue
        for port in ports:
            tool = await find_tool(contact, port)
            if command.scope is Scope.PORT or tool in TOOLS_WITH_A_PLACE:
                targets.append(
                    (command, Place(port, tool if command.scope is Scope.TOOL else None))
                )
    return targets
