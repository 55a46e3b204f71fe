"""Open a station for a command: identify it, find its ports and tools."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from jbclog.core.errors import (
    NotSupported,
    OutOfRange,
    RobotModeOff,
    StartRefused,
    StationError,
    StationSilent,
    UsageError,
)
from jbclog.core.io_requests import Reopen, Steps, Wait
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


class Place(NamedTuple):
    """Target of a command; all None is the whole station. `condition` is the number of an OMEGA
    solder condition.
    """

    port: int | None = None
    tool: int | None = None
    condition: int | None = None

    def __str__(self) -> str:
        """Format: ``port 1, tool 2``; empty for the whole station."""
        return ", ".join(
            f"{name} {number}" for name, number in self._asdict().items() if number is not None
        )


WHOLE_STATION = Place()


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

    def read(self, command: Command, place: Place) -> Steps[Value]:
        """Read once (the client repeats lost reads). Raises `StationError` and `LinkError`."""
        return (yield from self.client.read(_numbered(command, place), place.port, place.tool))

    def read_confirmed(
        self, command: Command, place: Place, *, known: Value | None = None, grows: bool = False
    ) -> Steps[Value]:
        """Read until two answers are equal. Raises as `read` does."""
        return (
            yield from read_confirmed(
                self.client,
                _numbered(command, place),
                place.port,
                place.tool,
                known=known,
                grows=grows,
            )
        )


def _numbered(command: Command, place: Place) -> Command:
    return command if place.condition is None else command.numbered(place.condition)


def open_contact(target: Target) -> Steps[Contact]:
    """Open the port and identify the station. Raises `StartRefused` and `LinkError`."""
    client = client_for(target.family, target.line, target.address)
    client.unasked((yield Wait(0.0)))
    client.unasked((yield Reopen()))
    family = target.family
    if family is None or "model" in family.commands:
        model = str((yield from _first_answer(target, client, MODEL)))
        family = family or _learnt(target, model)
        return Contact(target, client, family, model, target.ports or family.ports, {})
    yield from _first_answer(target, client, family.commands[family.harmless[0]], again=True)
    return Contact(target, client, family, None, target.ports or family.ports, {})


def _first_answer(
    target: Target, client: Client, command: Command, *, again: bool = False
) -> Steps[Value]:
    """Read the first answer. With `again`, ignore one silence: earlier bytes can swallow an OMEGA's
    first request.
    """
    try:
        return (yield from read_confirmed(client, command))
    except StationSilent as error:
        if not again:
            raise StartRefused(no_answer(target, error)) from error
        return (yield from _first_answer(target, client, command))
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


def expect_proven(contact: Contact) -> Steps[None]:
    """Raise `StartRefused` before anything is written if the family is not proven."""
    if not contact.is_proven:
        if contact.target.model is None:
            raise StartRefused(
                f"{contact.name}: {other_model_text(contact.family, str(contact.model))}"
            )
        raise StartRefused(
            f"{contact.stranger()}; nothing was written to it. Correct `model`, or the cable"
        )
    yield from expect_borne_out(contact)


def expect_borne_out(contact: Contact) -> Steps[None]:
    """Raise `StartRefused` if an accepted model name belongs to a station of another kind than its
    family's.
    """
    if contact.target.model is None:
        return
    why = yield from kind_problem(contact.client, contact.family, min(contact.ports or (1,)))
    if why is not None:
        model, family = contact.model, contact.family.name
        raise StartRefused(
            f"{contact.name}: model {model} is driven as {family} by the line file, but {why}."
            f" {NOT_DRIVEN}"
        )


def find_ports(contact: Contact) -> Steps[tuple[int, ...]]:
    """Return the ports named by the line file or the family, else those that answer."""
    if contact.ports is None:
        found = []
        for number in PORTS:
            if (yield from find_tool(contact, number)) is not None:
                found.append(number)
        contact.ports = tuple(found)
    return contact.ports


def find_tool(contact: Contact, port: int) -> Steps[int | None]:
    """Return the code of the tool in `port`, 0 for none; None for a missing port. One answer is
    enough.
    """
    if port not in contact.tools:
        command = contact.family.command_of("tool")
        try:
            found = (
                NO_TOOL
                if command is None
                else (yield from contact.read_confirmed(command, Place(port)))
            )
        except (NotSupported, OutOfRange):
            return None
        contact.tools[port] = found if isinstance(found, int) else NO_TOOL
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
    if command.scope is Scope.CONDITION and not is_number_of_one(place.condition):
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


def is_number_of_one(condition: int | None) -> bool:
    """Return True if OMEGA can have a solder condition, or its cleaning, under this number."""
    return condition is not None and (condition == CLEANING or is_condition(condition))


def tools_of(family: Family) -> tuple[int, ...]:
    return tuple(code for code in family.tools if code != NO_TOOL)


def places(contact: Contact, command: Command, asked: Place) -> Steps[list[Place]]:
    """Return every place addressed: the given one, or all ports, with the tools in them.

    Raises `StartRefused` if a tool is needed and the port is empty.
    """
    if command.scope not in (Scope.PORT, Scope.TOOL):
        return [Place(condition=asked.condition)]
    ports = (asked.port,) if asked.port is not None else (yield from find_ports(contact))
    found = []
    for port in ports:
        found.append((yield from _place(contact, command, port, asked.tool)))
    return found


def _place(contact: Contact, command: Command, port: int, tool: int | None) -> Steps[Place]:
    if command.scope is not Scope.TOOL or tool is not None:
        return Place(port, tool)
    connected = yield from find_tool(contact, port)
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


def everywhere(contact: Contact, commands: Iterable[Command]) -> Steps[list[tuple[Command, Place]]]:
    """List every place of each command: the station, its ports, the tools in them."""
    ports = yield from find_ports(contact)
    found: list[tuple[Command, Place]] = []
    for command in commands:
        if command.scope is Scope.STATION:
            found.append((command, WHOLE_STATION))
            continue
        for port in ports:
            tool = yield from find_tool(contact, port)
            if command.scope is Scope.PORT or tool in TOOLS_WITH_A_PLACE:
                found.append((command, Place(port, tool if command.scope is Scope.TOOL else None)))
    return found
