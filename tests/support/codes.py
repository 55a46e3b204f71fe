"""Every frame that the tables of a family can mean, on every port with every tool."""

from __future__ import annotations

from collections.abc import Iterator

from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import Family

PORTS = (1, 2, 3, 4)
TOOLS = range(1, 10)
CONDITIONS = (0, *range(101, 200), *range(201, 300), *range(301, 400))


def codes_of(command: Command, ports: tuple[int, ...] = PORTS) -> Iterator[str]:
    """The control commands on the wire: ``SMN``, ``TT1``…``TT4``, ``A11``…``A49``."""
    if command.scope is Scope.STATION:
        yield command.code()
    elif command.scope is Scope.CONDITION:
        yield from (command.numbered(number).code() for number in CONDITIONS)
    elif command.scope is Scope.PORT:
        yield from (command.code(port) for port in ports)
    else:
        yield from (command.code(port, tool) for port in ports for tool in TOOLS)


def codes(family: Family) -> dict[str, Command]:
    """Every code of a family with its command."""
    ports = family.ports or PORTS
    return {code: command for command in family.commands.values() for code in codes_of(command, ports)}
